"""How far off the robot looks beside what is declared of it, kind by kind, and what that adds to the variances.

Numbers of a kind, the zeros of all joints, say, are declared by one standard deviation. The windows see combinations of
them. Where those are as far off as k times that would make them, what the windows do not see is likely to be as well.
The estimate stays what it is: of its errors, the part that comes from the kind is k times as large
(docs/trajectory.md, eq. 8). In geodesy these are variance components (Koch 1999, section 3.6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
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
    def of(values: Array, factor: Array, causes: Sequence[str]) -> PriorSizes:
        """Return what data say of them.

        Parameters
        ----------
        values, factor : (e,), (e, w) the numbers, of unit variance about zero beforehand, and a factor of their
            covariance
        causes : what each of them belongs to, 'zero:joint1'
        """
        kind_of = np.array([cause.partition(':')[0] for cause in causes])
        found, each = {}, np.ones(len(values))
        for kind in dict.fromkeys(kind_of.tolist()):
            own = np.flatnonzero(kind_of == kind)
            found[kind] = likely_size(values[own], factor[own] @ factor[own].T)
            each[own] = found[kind][0]
        return PriorSizes(found, each)

    @property
    def as_declared(self) -> bool:
        """Whether nothing is further off."""
        return not np.any(self.each > 1.0)

    def beside(self, contributions: Array) -> Array:
        """Return what a covariance's factor grows by, (m, n): columns, of what each number contributes, (e, m).

        An estimate errs by that for each number of unit variance; where they are s times as far off, its variance has
        s^2 - 1 times the square beside what it had (docs/trajectory.md, eq. 8).
        """
        larger = self.each > 1.0
        return np.asarray(contributions[larger].T * np.sqrt(self.each[larger] ** 2 - 1.0))

    @property
    def sure(self) -> tuple[tuple[str, float], ...]:
        """The kinds that are surely further off than declared, and how many times as far."""
        return tuple((kind, size) for kind, (size, chance) in self.kinds.items() if chance > _SURE)
