"""The goal of a planned motion: the wanted precision of each parameter, and the cost of the search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mbaid_ros.core.geometry import Array, Flags

Criterion = Literal['worst', 'mean', 'volume']

_SHARP = 8  # exponent of the mean that stands for the worst, smooth enough to be climbed


@dataclass(frozen=True, eq=False)
class Wanted:
    """The goal of a motion.

    Attributes
    ----------
    relative : (10,) relative standard deviations wanted
    asked : (10,) which of them count
    criterion : the cost: the worst of the ratios to the wanted precision, their mean square, or their volume
    """

    relative: Array
    asked: Flags
    criterion: Criterion = 'worst'

    def ratio(self, relative: Array) -> Array:
        """Return the largest ratio (...) of (..., 10) to the wanted precision: 1 is reached."""
        return np.asarray((relative / self.relative)[..., self.asked].max(axis=-1))

    def cost(self, relative: Array) -> Array:
        """Return the cost of the search, (...)."""
        ratios = (relative / self.relative)[..., self.asked]
        if self.criterion == 'volume':
            return np.asarray(np.exp(np.log(ratios).mean(axis=-1)))
        power = _SHARP if self.criterion == 'worst' else 2
        return np.asarray((ratios**power).mean(axis=-1) ** (1.0 / power))
