"""How far off the robot looks beside what is declared of it, kind by kind, and what that adds to the variances.

Numbers of a kind, the zeros of all joints, say, are declared by one standard deviation. The windows see combinations of
them. Where those are as far off as k times that would make them, what the windows do not see is likely to be as well.
The estimate stays what it is: of its errors, the part that comes from the kind is k times as large
(docs/trajectory.md, eq. 8). In geodesy these are variance components (Koch 1999, section 3.6).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.belief import Moments
from mbaid_ros.core.trajectory.knots import Integers
from mbaid_ros.core.trajectory.state import Layout
from mbaid_ros.core.unknowns.words import of_size
from mbaid_ros.core.verdict.widening import likely_size

_SURE = 0.9  # chance, from which it is told


@dataclass(frozen=True, eq=False)
class PriorSizes:
    """How many times as far off as declared things are.

    Attributes
    ----------
    kinds : by kind of cause ('zero', 'link', ...) that factor, and the chance that it is more than one
    each : (e,) that factor of each of the unknowns' independent numbers
    """

    kinds: Mapping[str, tuple[float, float]]
    each: Array

    @staticmethod
    def of(moments: Moments, layout: Layout) -> PriorSizes:
        """Return what a run says of them."""
        values, factor = moments.unknowns(layout)
        kinds = np.array([cause.partition(':')[0] for cause in layout.causes])
        found, each = {}, np.ones(len(values))
        for kind in dict.fromkeys(kinds.tolist()):
            own = np.flatnonzero(layout.belongs[:, kinds == kind].any(axis=1))
            found[kind] = likely_size(values[own], factor[own] @ factor[own].T)
            each[own] = found[kind][0]
        return PriorSizes(found, each)

    def added(self, moments: Moments, layout: Layout, rows: Integers) -> Array:
        """Return by how much the covariance of m numbers of the state grows, (m, m)."""
        if not np.any(self.each > 1.0):
            return np.zeros((len(rows), len(rows)))
        parts = moments.contributions(moments.factor_of(moments.variables.spread[rows]), layout)
        return np.asarray(parts.T @ ((self.each**2 - 1.0)[:, None] * parts))

    @property
    def told(self) -> tuple[str, ...]:
        """What is surely further off than declared, a line each."""
        return tuple(of_size(kind, size) for kind, (size, chance) in self.kinds.items() if chance > _SURE)
