"""Windows some of which a joint's reading has spoilt: what is left of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Flags
from mbaid_ros.core.trajectory.windows.window import Window


@dataclass(frozen=True)
class SpoiltReading:
    """A joint's reading that may be wrong in some of the windows.

    Attributes
    ----------
    text : in words
    windows : the others, as they would be without it
    """

    text: str
    windows: list[Window]


def but_for(windows: Sequence[Window], spoilt: Flags) -> list[Window]:
    """Return windows without spoilt ones and their neighbours, each told where nothing links it to the one before.

    Parameters
    ----------
    windows : in order
    spoilt : (W,) which of them
    """
    left = ~(spoilt | np.append(spoilt[1:], False) | np.append(False, spoilt[:-1]))
    return [
        replace(window, fresh=window.fresh or (place > 0 and not left[place - 1]))
        for place, window in enumerate(windows)
        if left[place]
    ]
