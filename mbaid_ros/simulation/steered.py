"""Joints that follow trajectories, given beforehand or on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.errors import DataError, listing
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.simulation.motion import Driven

Places = npt.NDArray[np.intp]

_NEAR = 0.05  # rad or m, by which a trajectory may begin elsewhere than the joints are


@dataclass(frozen=True, eq=False)
class TrajectoryMotion(Driven):
    """Joints that follow a trajectory from a time on, and rest before it and after it."""

    trajectory: JointTrajectory  # of the k joints that it moves, the others of the n rest
    start: Array  # (n,) where all joints are before it, rad or m; at its first point those that it moves
    places: Places  # (k,) of the joints that it moves among the n
    begin: float = 0.0  # s

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration of the joints at a time, (n,) each."""
        position, velocity, acceleration = self.start.copy(), np.zeros(len(self.start)), np.zeros(len(self.start))
        parts = self.trajectory.state_at(np.asarray(time - self.begin))
        position[self.places], velocity[self.places], acceleration[self.places] = parts
        return position, velocity, acceleration

    def from_time(self, time: float) -> TrajectoryMotion:
        """Return the motion with time 0 at a time (s) of this one."""
        return TrajectoryMotion(self.trajectory, self.start, self.places, self.begin - time)


class SteeredMotion(Driven):
    """A motion, and trajectories added during the run, each of which replaces it from its time on.

    Parameters
    ----------
    first : until then
    """

    def __init__(self, first: Driven) -> None:
        self._first = first
        self._orders: list[TrajectoryMotion] = []  # with times of `first`
        self._offset = 0.0

    def add_trajectory(self, trajectory: JointTrajectory, model: RobotModel, begin: float) -> None:
        """Follow a trajectory from a future time (s) on; joints that it does not name rest from there.

        Raises DataError: It names joints that the robot does not have, or begins where the joints are not.
        """
        place, rate, bend = self.reference(begin)
        every = with_mimic_joints(trajectory, model)
        places = _places(every, model)
        joined = _joined(every, place[places], rate[places], bend[places])
        self._orders.append(TrajectoryMotion(joined, place, places, begin + self._offset))

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration of the joints at a time, (n,) each."""
        now = time + self._offset
        for order in reversed(self._orders):
            if now >= order.begin:
                return order.reference(now)
        return self._first.reference(now)

    def from_time(self, time: float) -> SteeredMotion:
        """Return the motion with time 0 at a time (s) of this one; trajectories added to either apply to both."""
        other = SteeredMotion(self._first)
        other._orders, other._offset = self._orders, self._offset + time
        return other


def with_mimic_joints(trajectory: JointTrajectory, model: RobotModel) -> JointTrajectory:
    """Return a trajectory extended to the joints that mimic its own.

    Raises DataError: It names a joint that the robot does not have, or that follows another.
    """
    independent = list(model.independent_joints)
    foreign = [name for name in trajectory.joints if name not in independent]
    if foreign:
        raise DataError(f"the trajectory moves '{foreign[0][:60]}'; accepted: joints among {listing(independent)}")
    moved = model.transmission
    if moved.direct:
        return trajectory
    columns = [
        (name, trajectory.joints.index(independent[moved.driver[joint]]), moved.multiplier[joint], moved.offset[joint])
        for joint, name in enumerate(model.joint_names)
        if independent[moved.driver[joint]] in trajectory.joints
    ]
    place = [column for _, column, _, _ in columns]
    gain, offset = (np.array(each) for each in zip(*(column[2:] for column in columns), strict=True))
    return JointTrajectory(
        tuple(name for name, _, _, _ in columns),
        trajectory.time,
        trajectory.position[:, place] * gain + offset,
        trajectory.velocity[:, place] * gain if trajectory.velocity.size else trajectory.velocity,
        trajectory.acceleration[:, place] * gain if trajectory.acceleration.size else trajectory.acceleration,
    )


def motion_along(trajectory: JointTrajectory, model: RobotModel, start: Array | None, begin: float) -> TrajectoryMotion:
    """Return the motion of a robot that follows a trajectory from a time (s) on.

    Raises DataError: The trajectory is of other joints, or begins elsewhere.

    Parameters
    ----------
    trajectory : of some of its joints
    start : (n,) where its joints are before; None for zero, and where the trajectory begins
    begin : s
    """
    every = with_mimic_joints(trajectory, model)
    places = _places(every, model)
    if start is None:
        start = model.transmission.positions(np.zeros(len(model.independent_joints)))
        start[places] = every.position[0]
    rest = np.zeros(len(places))
    return TrajectoryMotion(_joined(every, start[places], rest, rest), start, places, begin)


def _places(trajectory: JointTrajectory, model: RobotModel) -> Places:
    return np.array([model.joint_names.index(name) for name in trajectory.joints], dtype=np.intp)


def _joined(trajectory: JointTrajectory, place: Array, rate: Array, bend: Array) -> JointTrajectory:
    """Return a trajectory that begins at time 0 where the joints are, as they move.

    Its own first point, where that is at time 0 and near, makes room for where they truly are.
    """
    at_once = trajectory.time[0] == 0.0
    away = np.abs(trajectory.position[0] - place)
    if at_once and np.any(away > _NEAR):
        joint = int(np.argmax(away))
        raise DataError(
            f"the trajectory begins with '{trajectory.joints[joint]}' at {trajectory.position[0, joint]:.4g}, which is "
            f'at {place[joint]:.4g}; accepted: within {_NEAR:g} of it, or a first point later than 0 s'
        )
    points = ((trajectory.position, place), (trajectory.velocity, rate), (trajectory.acceleration, bend))
    parts = (np.concatenate((own[None], part[int(at_once) :])) if part.size else part for part, own in points)
    return JointTrajectory(
        trajectory.joints, trajectory.time if at_once else np.insert(trajectory.time, 0, 0.0), *parts
    )
