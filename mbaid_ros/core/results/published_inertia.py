"""Publication of estimates: the captured body alone, and when numbers are withdrawn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import (
    physical,
    physical_jacobian,
    standard,
)

# Relative standard deviation from which a mass may be zero, at two standard deviations.
_MASS_MAY_VANISH = 0.5


@dataclass(frozen=True)
class Debris:
    """The captured body: mass, CoM and inertia about it (10,), with covariance, in the target link's frame."""

    parameters: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """One standard deviation of each parameter, (10,)."""
        return np.sqrt(np.diag(self.covariance))


def debris(estimate: Estimate, link: Array, link_covariance: Array | None = None) -> Debris | None:
    """Return the captured body, None where not all ten parameters are determined or its mass may be zero.

    Standard parameters add up, so those of the link are subtracted, and the covariances of both added.

    Parameters
    ----------
    estimate : of link and captured body together
    link : (10,) standard parameters (m, h, I_o) of the link itself
    link_covariance : (10, 10) of the link's parameters; known exactly where not given
    """
    if not np.all(estimate.identifiable) or not np.all(np.isfinite(estimate.covariance)):
        return None
    together = standard(estimate.parameters)
    alone = together - link
    if alone[0] <= 0.0:
        return None
    # Covariance of (m, h, I_o) from that of (m, r_c, I_c), then on to the captured body's own (m, r_c, I_c).
    onward = physical_jacobian(alone)
    change = np.linalg.solve(physical_jacobian(together).T, onward.T).T
    covariance = change @ estimate.covariance @ change.T
    if link_covariance is not None:
        covariance = covariance + onward @ link_covariance @ onward.T
    if covariance[0, 0] > (_MASS_MAY_VANISH * alone[0]) ** 2:
        return None
    return Debris(physical(alone), covariance)


def is_usable(estimate: Estimate) -> bool:
    """Return whether an estimate has a positive mass, two coordinates of the CoM and a moment: enough in a plane."""
    mass, com, moments = estimate.parameters[0], estimate.parameters[1:4], estimate.parameters[[4, 7, 9]]
    known = mass > 0.0 and np.sum(np.isfinite(com)) >= 2 and np.any(moments > 0.0)
    return bool(known) and estimate.status != 'inconsistent'


def is_complete(estimate: Estimate) -> bool:
    """Return whether all ten parameters of a link are known."""
    return is_usable(estimate) and bool(np.all(estimate.identifiable & np.isfinite(estimate.parameters)))


class InertiaPublication:
    """The mass properties of estimates that follow each other."""

    def __init__(self) -> None:
        self._published = False  # whether the last ones can be used

    def follow(self, estimate: Estimate) -> Estimate | None:
        """Return the next estimate, without its numbers where these cannot be used; None where that is known."""
        before, self._published = self._published, is_usable(estimate)
        if self._published:
            return estimate
        return replace(estimate, parameters=np.full(10, np.nan)) if before else None


class DebrisPublication:
    """The captured body alone, as estimates that follow each other have it."""

    def __init__(self) -> None:
        self._published: Debris | None = None

    def follow(self, found: Debris | None) -> Debris | None:
        """Return the next one, without numbers where it is not determined any more; None where that is known."""
        before, self._published = self._published, found
        if found is None and before is not None:
            return replace(before, parameters=np.full(10, np.nan), covariance=np.full((10, 10), np.nan))
        return found
