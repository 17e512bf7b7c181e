"""What is told of estimates that follow each other: numbers while they can be used, and once that they no longer can.

Who reads a topic of numbers alone, without a status, has to learn that the last ones are not to be computed with.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.results.debris import Debris
from mbaid_ros.core.results.estimate import Estimate


def is_usable(estimate: Estimate) -> bool:
    """Tell whether an estimate says enough to compute with, at least in a plane.

    That is a positive mass, two coordinates of the centre of mass and a moment of inertia.
    """
    mass, com, moments = estimate.parameters[0], estimate.parameters[1:4], estimate.parameters[[4, 7, 9]]
    known = mass > 0.0 and np.sum(np.isfinite(com)) >= 2 and np.any(moments > 0.0)
    return bool(known) and estimate.status != 'inconsistent'


def is_complete(estimate: Estimate) -> bool:
    """Tell whether all ten parameters of a link are known."""
    return is_usable(estimate) and bool(np.all(estimate.identifiable & np.isfinite(estimate.parameters)))


class InertiaCourse:
    """The mass properties of estimates that follow each other."""

    def __init__(self) -> None:
        self._told = False  # whether the last ones can be used

    def follow(self, estimate: Estimate) -> Estimate | None:
        """Return the next estimate, without its numbers where these cannot be used; None where that is known."""
        before, self._told = self._told, is_usable(estimate)
        if self._told:
            return estimate
        return replace(estimate, parameters=np.full(10, np.nan)) if before else None


class DebrisCourse:
    """The captured body alone, as estimates that follow each other have it."""

    def __init__(self) -> None:
        self._told: Debris | None = None

    def follow(self, found: Debris | None) -> Debris | None:
        """Return the next one, without numbers where it is not determined any more; None where that is known."""
        before, self._told = self._told, found
        if found is None and before is not None:
            return replace(before, parameters=np.full(10, np.nan), covariance=np.full((10, 10), np.nan))
        return found
