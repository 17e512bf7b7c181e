"""Motions of one length whose velocities are splines of second degree, linear in the speeds these go by.

A velocity lies between the three speeds that it is blended of, an acceleration between two differences of neighbours.
So limits of both are limits of the speeds and their differences, and a joint goes at full speed wherever three speeds
in a row are that; at both ends it rests, without acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.planning.requirements import JointLimits

_DENSE = 4  # instants a piece at which limits are checked
_KEPT = 0.999  # of a limit, as numbers are rounded and a position may bulge between these


@dataclass(frozen=True)
class Splines:
    """Motions by speeds at equal distances in time, before and after which the joints rest."""

    count: int  # number K of speeds
    duration: float  # s

    @property
    def step(self) -> float:
        """Length of a piece, s: K + 2 of them make the motion."""
        return self.duration / (self.count + 2)

    def basis(self, times: Array, order: int = 0) -> Array:
        """Return the weights of speeds in the derivative of an order at (N,) s, (N, K); at rest before and after."""
        # A speed is blended in over the three pieces from its own on: by powers cut off at their ends.
        passed = np.clip(times[:, None] / self.step - np.arange(self.count), 0.0, 3.0)
        power, whole = 3 - order, (6.0, 2.0, 1.0)[order]
        parts = (each * np.maximum(passed - end, 0.0) ** power for end, each in enumerate((1.0, -3.0, 3.0)))
        return np.asarray(sum(parts) / whole * self.step ** (1 - order))

    @cached_property
    def _checked(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at instants that lie dense."""
        times = np.linspace(0.0, self.duration, _DENSE * (self.count + 2) + 1)
        return self.basis(times), self.basis(times, 1), self.basis(times, 2)

    def limit_use(self, speeds: Array, start: Array, limits: JointLimits) -> Array:
        """Return how much of the joints' limits motions use, (..., 3, k): position, velocity, acceleration; 1 is all.

        Parameters
        ----------
        speeds : (..., K, k)
        start : (k,)
        """
        place, rate, bend = (each @ speeds for each in self._checked)
        parts = (
            np.abs(place) / _room(place, start, limits),
            np.abs(rate) / limits.velocity,
            np.abs(bend) / limits.acceleration,
        )
        return np.stack([each.max(axis=-2) for each in parts], axis=-2)

    def scaled_to_limits(self, speeds: Array, start: Array, limits: JointLimits) -> Array:
        """Return (..., K, k) speeds with each joint's motion, unchanged in form, as large as its limits allow."""
        moving = speeds * limits.moved
        most = self.limit_use(moving, start, limits).max(axis=-2)
        return np.asarray(moving * (_KEPT / np.where(most > 0.0, most, 1.0))[..., None, :])

    def limited(self, speeds: Array, start: Array, limits: JointLimits, part: Array | float = 1.0) -> Array:
        """Return (..., K, k) speeds cut off where velocity or acceleration are at their limit.

        Of a joint that goes too far the whole motion is made smaller. A `part` (..., k) of the acceleration is allowed.
        """
        kept = np.clip(speeds, -_KEPT * limits.velocity, _KEPT * limits.velocity) * limits.moved
        change = _KEPT * limits.acceleration * part * self.step
        for course in (kept, np.flip(kept, axis=-2)):  # the second: backwards in time, in the same memory
            before: Array = np.zeros(kept.shape[-1])
            for index in range(self.count):
                before = np.clip(course[..., index, :], before - change, before + change)
                course[..., index, :] = before
        place = self._checked[0] @ kept
        most = (np.abs(place) / _room(place, start, limits)).max(axis=-2)
        return np.asarray(kept * np.where(most > _KEPT, _KEPT / np.maximum(most, _KEPT), 1.0)[..., None, :])

    def trajectory(self, speeds: Array, start: Array, joints: tuple[str, ...]) -> JointTrajectory:
        """Return one motion (K, k) as its points, which between them is the very same."""
        times = np.linspace(0.0, self.duration, self.count + 3)
        parts = [self.basis(times, order) @ speeds for order in range(3)]
        return JointTrajectory(joints, times, start + parts[0], parts[1], parts[2])


def _room(place: Array, start: Array, limits: JointLimits) -> Array:
    """Return how far joints may go to the side where they are, (..., k), rad or m."""
    return np.maximum(np.where(place > 0.0, limits.upper - start, start - limits.lower), 1e-9)
