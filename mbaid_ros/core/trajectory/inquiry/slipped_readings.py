"""Joints whose reading jumps once and stays off: an encoder that slipped, missed counts, or was given another zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.inquiry.spoilt_reading import SpoiltReading, but_for
from mbaid_ros.core.trajectory.windows.window import Window

# A step among the middle ones of eight knots, less what those beside them go by: of a quadratic motion there is none.
_STEP = np.array([0.75, 0.0, -1.75, 0.0, 0.0, 1.75, 0.0, -0.75])
_MIDDLE = 3.5  # knots, from the first of them: where a step between knots lies
_LARGE = 8.0  # times what such steps are in the rest of the joint's motion: acceleration and noise seldom make as much


@dataclass(frozen=True)
class SlippedReading(SpoiltReading):
    """A joint's reading that may have jumped.

    Attributes
    ----------
    as_read : the same windows, the jump left in
    """

    as_read: list[Window]


def slipped_readings(windows: Sequence[Window], joints: Sequence[str]) -> list[SlippedReading]:
    """Return the joints whose readings may have jumped, the clearest first; whether they have, a pass has to tell.

    Parameters
    ----------
    windows : in order
    joints : their names
    """
    parts = [_steps(window) for window in windows]
    times, steps = (np.concatenate(each) for each in zip(*parts, strict=True))
    size = np.abs(steps)
    usual = np.median(size, axis=0)
    found = []
    for joint, place in enumerate(np.argmax(size, axis=0).tolist()):
        if size[place, joint] > _LARGE * usual[joint]:
            clear = size[place, joint] / max(usual[joint], np.finfo(float).tiny)
            found.append((clear, joint, float(times[place]), float(steps[place, joint])))
    found.sort(reverse=True)
    return [_slipped(windows, joints[joint], joint, time, step) for _, joint, time, step in found]


def _steps(window: Window) -> tuple[Array, Array]:
    """Return the times, s, and the steps between knots there, (J - 7, n); zero where a knot is empty."""
    steps = sliding_window_view(window.knots.joint_position, len(_STEP), axis=0) @ _STEP
    places = np.arange(len(steps)) + _MIDDLE - window.inside.start
    return window.start + window.spacing * places, np.nan_to_num(steps)


def _slipped(windows: Sequence[Window], name: str, joint: int, time: float, step: float) -> SlippedReading:
    has = np.array([window.start <= time < window.start + window.length for window in windows])
    back = [_moved(window, joint, -step) if window.start > time else window for window in windows]
    text = f'the reading of {name} jumps by {1e3 * step:+.3g} mrad (mm) at {time:.1f} s: look at its encoder'
    return SlippedReading(text, but_for(back, has), but_for(windows, has))


def _moved(window: Window, joint: int, step: float) -> Window:
    positions = window.knots.joint_position.copy()
    positions[:, joint] += step
    return replace(window, knots=replace(window.knots, joint_position=positions))
