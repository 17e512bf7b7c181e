"""Motions of the joints from the end of a run, the base's reaction and the information gained, many at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mbaid_ros.core.filter.posterior import Posterior
from mbaid_ros.core.geometry import Array, rotate_back
from mbaid_ros.core.state import Point
from mbaid_ros.errors import ParameterError
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.planning.efforts import JointEfforts
from mbaid_ros.planning.floating import BaseMotion, FloatingRobot, base_motions
from mbaid_ros.planning.information import Grid, Information
from mbaid_ros.planning.requirements import BaseLimits, JointLimits
from mbaid_ros.planning.splines import Splines

_PARTS = (slice(0, 3), slice(3, 6))  # of a twist
WINDOWS, KNOTS = 14, 5  # of a motion in the search: finer ones give the same information within some 2 %
_STEPS = 2  # a piece, of the base's motion, where nothing but that is asked for
# The parts of a limit that motions beyond it are reduced to, and whether by longer ramps, in turn.
_MARGINS = ((0.98, True), (0.95, True), (0.95, False))
_SPARSE = 2  # of these from one at which torques are asked for to the next: ends of pieces, where they are largest


@dataclass(frozen=True, eq=False)
class Motions:
    """All motions of one length."""

    posterior: Posterior  # where they begin, with the posterior there
    information: Information  # that they add to it
    splines: Splines  # their form
    limits: JointLimits  # of the joints
    efforts: JointEfforts  # of the joints of the robot as it is known best

    def with_duration(self, duration: float) -> Motions:
        """Return motions of another length, s."""
        return replace(self, splines=replace(self.splines, duration=duration))

    @cached_property
    def start(self) -> Array:
        """Where the joints that follow no other begin, (k,)."""
        moved = self.posterior.layout.kernel.model.transmission
        return self.posterior.end.joint_position[moved.independent]

    @cached_property
    def floating(self) -> FloatingRobot:
        """The robot as it is known best."""
        return self.at_point(self.posterior.point)

    def at_point(self, point: Point) -> FloatingRobot:
        """Return the robot as it may be."""
        end = self.posterior.end
        return FloatingRobot(point, end.stored, end.base_rotation, end.base_position, self.posterior.layout.plane)

    @property
    def coarse(self) -> Grid:
        """Windows that suffice for a search."""
        return Grid(WINDOWS, KNOTS, self.splines.duration / (WINDOWS * KNOTS))

    def limited(self, speeds: Array) -> Array:
        """Return speeds (B, K, k) within the joints' limits."""
        return self.splines.limited(speeds, self.start, self.limits)

    def joints(self, speeds: Array, times: Array) -> tuple[Array, Array]:
        """Return positions and rates (T, B, n) of all joints at instants."""
        moved = self.posterior.layout.kernel.model.transmission
        position = np.tensordot(self.splines.basis(times), speeds, axes=(1, 1)) + self._held(times)[:, None]
        rate = np.tensordot(self.splines.basis(times, 1), speeds, axes=(1, 1)) + self._speed
        return moved.positions(position), moved.rates(rate)

    @cached_property
    def _speed(self) -> Array:
        """Rates of the joints that keep theirs, (k,); zero of the others."""
        moved, end = self.posterior.layout.kernel.model.transmission, self.posterior.end
        return np.where(self.limits.held, end.joint_velocity[moved.independent], 0.0)

    def _held(self, times: Array) -> Array:
        """Return positions (T, k) at instants where no joint is moved."""
        return np.asarray(self.start + times[:, None] * self._speed)

    @cached_property
    def holding(self) -> Array:
        """Which part of their effort limits the joints use to stay where they are while the base tumbles, (k,)."""
        return self.effort(np.zeros((1, self.splines.count, len(self.start))))[0]

    def require_hold(self) -> None:
        """Refuse a robot whose joints are too weak to stay where they are.

        Raises ParameterError: One of them is.
        """
        joint = int(np.argmax(self.holding))
        if self.holding[joint] >= 1.0:
            name = self.posterior.layout.kernel.model.independent_joints[joint]
            raise ParameterError(
                f"joint '{name}' at rest while the base tumbles needs {self.holding[joint]:.3g} times its effort limit "
                "in the robot description; accepted: a larger one there, or 'plan.stuck' with the joint"
            )

    def effort(self, speeds: Array, course: tuple[Array, BaseMotion] | None = None) -> Array:
        """Return which part of their effort limits the joints that are moved use at most, (B, k), in motions.

        Parameters
        ----------
        speeds : (B, K, k)
        course : their first results of `base_course`
        """
        times, base = course or self.base_course(speeds)[:2]
        position, rate = self.joints(speeds, times)
        bend = np.tensordot(self.splines.basis(times, 2), speeds, axes=(1, 1))
        moved = self.posterior.layout.kernel.model.transmission
        twist = np.concatenate([rotate_back(base.rotation, base.twist[..., part]) for part in _PARTS], axis=-1)
        return np.where(self.limits.moved, self.efforts.limit_use(position, rate, moved.rates(bend), twist), 0.0)

    def relative(self, speeds: Array, grid: Grid, every: int = 0) -> Array:
        """Return relative standard deviations of the body after motions (B, K, k), as `Information.std_after`."""
        position, rate = self.joints(speeds, grid.half_steps)
        base = self.floating.base_motion(position, rate, grid.spacing)
        return self.information.std_after(grid, (position[::2], rate[::2]), base, every)

    def excursions(self, speeds: Array) -> Array:
        """Return how far motions move the robot from coasting at most, (B, 4) as of `BaseMotion.deviation_from`."""
        return np.asarray(self.base_course(speeds)[2].max(axis=0))

    def beside_holding(self, effort: Array) -> Array:
        """Return the used part (B, k) of the limits beside holding: it grows with the motion, nearly."""
        return (effort - self.holding) / (1.0 - self.holding)

    def trajectory(self, speeds: Array) -> JointTrajectory:
        """Return one motion (K, k), of the joints that may be moved."""
        moved = np.flatnonzero(self.limits.moved)
        names = self.posterior.layout.kernel.model.independent_joints
        return self.splines.trajectory(speeds[:, moved], self.start[moved], tuple(names[each] for each in moved))

    def joints_along(self, trajectory: JointTrajectory, times: Array) -> tuple[Array, Array]:
        """Return positions and rates (T, 1, n) of all joints at instants of a trajectory from the start on."""
        model = self.posterior.layout.kernel.model
        position, rate = self._held(times), np.tile(self._speed, (len(times), 1))
        places = [model.independent_joints.index(name) for name in trajectory.joints]
        position[:, places], rate[:, places], _ = trajectory.state_at(times)
        return model.transmission.positions(position)[:, None], model.transmission.rates(rate)[:, None]

    def relative_along(self, trajectory: JointTrajectory, grid: Grid, point: Point) -> Array:
        """Return relative standard deviations (10,) after a trajectory, if the robot is as it may be."""
        position, rate = self.joints_along(trajectory, grid.half_steps)
        base = self.at_point(point).base_motion(position, rate, grid.spacing)
        return self.information.at_point(point).std_after(grid, (position[::2], rate[::2]), base)[0]

    def excursions_of(self, robots: Sequence[FloatingRobot], speeds: Array) -> Array:
        """Return how far one motion (K, k) moves R robots from coasting at most, (R, 4) as `excursions`."""
        step, times = self._instants
        moved, still = (
            base_motions(robots, position[:, 0], rate[:, 0], step)
            for position, rate in (self.joints(speeds[None], times), self.joints_at_rest(times))
        )
        return np.asarray(moved.deviation_from(still).max(axis=0))

    @property
    def _instants(self) -> tuple[float, Array]:
        """A step, s, and every half step of the motion, (2 T - 1,) s."""
        steps = _STEPS * (self.splines.count + 2)
        step = self.splines.duration / steps
        return step, np.arange(2 * steps + 1) * 0.5 * step

    def base_course(self, speeds: Array) -> tuple[Array, BaseMotion, Array]:
        """Return instants (T,) s, the base's motions at them, and (T, B, 4) how far these are from coasting."""
        step, times = self._instants
        base = self._base_motion(*self.joints(speeds, times), step)
        return times[::2], base, base.deviation_from(self._coasting)

    @cached_property
    def _coasting(self) -> BaseMotion:
        """How base and passive joints move while no joint is moved."""
        step, times = self._instants
        return self._base_motion(*self.joints_at_rest(times), step)

    def _base_motion(self, position: Array, rate: Array, step: float) -> BaseMotion:
        """Return how base and passive joints move, as of `FloatingRobot.base_motion`."""
        base = self.floating.base_motion(position, rate, step)
        return self.floating.deflected(base, position[::2], rate[::2], step)

    def joints_at_rest(self, times: Array) -> tuple[Array, Array]:
        """Return positions and rates (T, 1, n) of all joints at instants, none of them moved."""
        return self.joints(np.zeros((1, self.splines.count, len(self.start))), times)

    def scaled_to_limits(self, speeds: Array, most: BaseLimits) -> Array:
        """Return motions (B, K, k) within the limits of efforts and base.

        Where efforts ask for it their ramps are made longer; then they are made as much smaller as is left to do. A
        base that is moved by the sum of the joints' motions is moved in proportion to that, nearly; so are torques.
        """
        if not (np.isfinite(most.array).any() or self.efforts.limited):
            return speeds
        speeds = speeds.copy()
        beyond = np.flatnonzero(np.ones(len(speeds)))
        for margin, ramps in _MARGINS:
            own = speeds[beyond]
            of_base, of_effort = self._use(own, most)
            over = np.maximum(of_base, of_effort) > 1.0
            beyond, own, of_base, of_effort = beyond[over], own[over], of_base[over], of_effort[over]
            if not len(beyond):
                break
            if ramps:
                own = self._ramped(own, margin / np.maximum(of_effort / np.maximum(of_base, 1.0), margin))
            else:
                of_base = np.maximum(of_base, of_effort)
            speeds[beyond] = own * (margin / np.maximum(of_base, margin))[:, None, None]
        return speeds

    def _ramped(self, speeds: Array, part: Array) -> Array:
        """Return motions (B, K, k) with a part (B,) of their accelerations."""
        bend = self.splines.limit_use(speeds, self.start, self.limits)[:, 2]
        return self.splines.limited(speeds, self.start, self.limits, bend * part[:, None])

    def _use(self, speeds: Array, most: BaseLimits) -> tuple[Array, Array]:
        """Return which part of the limits of the base, and of efforts, motions use at most, (B,) each."""
        times, base, away = self.base_course(speeds)
        of_base: Array = (away.max(axis=0) / most.array).max(axis=1)
        if not self.efforts.limited:
            return of_base, np.zeros(len(speeds))
        sparse = slice(None, None, _SPARSE)
        effort = self.effort(speeds, (times[sparse], base[sparse]))
        return of_base, np.asarray(self.beside_holding(effort).max(axis=1))
