"""Motions of one length as splines of fifth degree, linear in the waypoints they pass; at rest at both ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.planning.limits import JointLimits

_DENSE = 32  # instants a segment at which limits are checked
_KEPT = 0.995  # of a limit, as a spline may bulge between these


@dataclass(frozen=True)
class Splines:
    """Motions that pass `waypoints` points at equal distances in time after the start.

    Attributes
    ----------
    waypoints : number K
    duration : s
    """

    waypoints: int
    duration: float

    @cached_property
    def _spline(self) -> BSpline:
        """Of (K,) functions on [0, 1], each 1 at a waypoint of its own and 0 at the others and the start."""
        place = np.linspace(0.0, 1.0, self.waypoints + 1)
        nothing = np.zeros((2, self.waypoints))
        ends = [(1, nothing[0]), (2, nothing[1])]
        return make_interp_spline(place, np.eye(self.waypoints + 1)[:, 1:], k=5, bc_type=(ends, ends))

    def basis(self, times: Array, order: int = 0) -> Array:
        """Return what waypoints make of the derivative of an order at (N,) s, (N, K); at rest before and after."""
        place = np.clip(times / self.duration, 0.0, 1.0)
        values: Array = self._spline(place, nu=order) / self.duration**order
        if order:
            values[(times < 0.0) | (times > self.duration)] = 0.0
        return values

    def passed(self, waypoints: Array, other: Splines) -> Array:
        """Return where motions (..., K, k) are when those of another length or number pass their waypoints."""
        share = np.arange(1, other.waypoints + 1) / other.waypoints
        return np.asarray(self.basis(share * self.duration) @ waypoints)

    @cached_property
    def _checked(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at instants that lie dense."""
        times = np.linspace(0.0, self.duration, _DENSE * self.waypoints + 1)
        return self.basis(times), self.basis(times, 1), self.basis(times, 2)

    def use(self, waypoints: Array, start: Array, limits: JointLimits) -> Array:
        """Return how much of the joints' limits motions use, (..., 3, k): position, velocity, acceleration; 1 is all.

        Parameters
        ----------
        waypoints : (..., K, k) less the start
        start : (k,)
        limits : JointLimits
        """
        place, rate, bend = (each @ waypoints for each in self._checked)
        room = np.maximum(np.where(place > 0.0, limits.upper - start, start - limits.lower), 1e-9)
        parts = (np.abs(place) / room, np.abs(rate) / limits.velocity, np.abs(bend) / limits.acceleration)
        return np.stack([each.max(axis=-2) for each in parts], axis=-2)

    def within(self, waypoints: Array, start: Array, limits: JointLimits) -> Array:
        """Return (..., K, k) waypoints with each joint's motion made as much smaller as its limits ask for."""
        moving = waypoints * limits.moved
        most = self.use(moving, start, limits).max(axis=-2)
        return np.asarray(moving * np.where(most > _KEPT, _KEPT / np.maximum(most, _KEPT), 1.0)[..., None, :])

    def trajectory(self, waypoints: Array, start: Array, joints: tuple[str, ...]) -> JointTrajectory:
        """Return one motion (K, k) as its points, which between them is the very same."""
        times = np.linspace(0.0, self.duration, self.waypoints + 1)
        parts = [self.basis(times, order) @ waypoints for order in range(3)]
        return JointTrajectory(joints, times, start + parts[0], parts[1], parts[2])
