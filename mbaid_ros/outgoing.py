"""Estimates and sensor readings to messages, duck-typed: one builder for rclpy's classes and rosbags'."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.published_inertia import Debris
from mbaid_ros.core.robot.model import RobotModel

if TYPE_CHECKING:
    from mbaid_ros.core.capture.known_momentum import Capture
    from mbaid_ros.simulation.sensors import BaseReadings, ImuReadings, JointReadings


@dataclass(frozen=True)
class MessageTypes:
    """Where the message classes come from."""

    find: Callable[[str], Any]  # returns the class of a type: ``package/msg/Type``
    flags: Callable[[Flags], Any]  # converts to a field of type bool[]: rclpy wants a list, rosbags an array


@dataclass(frozen=True)
class Frames:
    """The frames an estimate is given in."""

    target_link: str  # frame of mass properties, without the prefix
    odometry: str  # frame of the momenta
    prefix: str = ''  # of the name of the first one in messages


def estimate_message(
    estimate: Estimate, types: MessageTypes, frames: Frames, warnings: Sequence[str] = (), *, stale: bool = False
) -> Any:
    """Return an estimate as a mbaid_msgs/InertiaEstimate.

    Parameters
    ----------
    warnings : those of the run, which come after the estimate's own
    stale : whether it is published again because no data come
    """
    seconds, nanoseconds = divmod(max(0, round(estimate.time * 1e9)), 1_000_000_000)
    budget = estimate.budget
    return types.find('mbaid_msgs/msg/InertiaEstimate')(
        header=_header(estimate, types, frames),
        method=estimate.method,
        stage=estimate.stage,
        status=estimate.status,
        phase=estimate.phase,
        stale=stale,
        inertia=_inertia(estimate.parameters, types),
        covariance=np.ascontiguousarray(estimate.covariance, dtype=float).ravel(),
        standard_deviation=np.ascontiguousarray(estimate.std, dtype=float),
        budget_causes=[] if budget is None else list(budget.causes),
        budget_shares=np.zeros(0) if budget is None else np.ascontiguousarray(budget.shares, dtype=float).ravel(),
        identifiable=types.flags(np.asarray(estimate.identifiable, dtype=bool)),
        momentum_frame=frames.odometry,
        linear_momentum=_vector(estimate.momentum[:3], types),
        angular_momentum=_vector(estimate.momentum[3:], types),
        momentum_covariance=np.ascontiguousarray(estimate.momentum_covariance, dtype=float).ravel(),
        residual=float(estimate.residual),
        time_offset=float(estimate.time_offset),
        time_offset_std=float(estimate.time_offset_std),
        consistency_correction=float(estimate.consistency_correction),
        events=[_event(event, estimate, types) for event in estimate.events],
        samples=int(estimate.samples),
        span=types.find('builtin_interfaces/msg/Duration')(sec=seconds, nanosec=nanoseconds),
        warnings=[*estimate.warnings, *warnings, *map(str, estimate.flexible)],
    )


def debris_message(
    alone: Debris, estimate: Estimate, types: MessageTypes, frames: Frames, capture: Capture | None = None
) -> Any:
    """Return the captured body alone as a mbaid_msgs/InertiaEstimate.

    Its momenta are those that the body alone had before the capture; NaN where the run began after it. It has no error
    budget: that of the estimate is of the whole link.

    Parameters
    ----------
    alone : the captured body; NaN where nothing is known of it any more
    estimate : that it was taken from
    frames : of the estimate
    capture : Capture, optional
    """
    body = replace(
        estimate,
        parameters=alone.parameters,
        covariance=alone.covariance,
        identifiable=np.isfinite(alone.parameters),
        budget=None,
        momentum=np.full(6, np.nan) if capture is None else capture.momentum,
        momentum_covariance=np.full((6, 6), np.nan) if capture is None else capture.covariance,
    )
    return estimate_message(body, types, frames)


def inertia_message(estimate: Estimate, types: MessageTypes, frames: Frames) -> Any:
    """Return the mass properties alone as a geometry_msgs/InertiaStamped; NaN if the data do not determine one."""
    return types.find('geometry_msgs/msg/InertiaStamped')(
        header=_header(estimate, types, frames), inertia=_inertia(estimate.parameters, types)
    )


def _event(event: Event, estimate: Estimate, types: MessageTypes) -> Any:
    stamp = max(0, estimate.stamp - round((estimate.time - event.time) * 1e9))
    return types.find('mbaid_msgs/msg/MomentumEvent')(
        stamp=_time(stamp, types),
        time=float(event.time),
        kind=event.kind,
        linear=_vector(event.linear, types),
        angular=_vector(event.angular, types),
        cause=event.cause,
    )


def _time(stamp: int, types: MessageTypes) -> Any:
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    return types.find('builtin_interfaces/msg/Time')(sec=seconds, nanosec=nanoseconds)


def _header(estimate: Estimate, types: MessageTypes, frames: Frames) -> Any:
    return types.find('std_msgs/msg/Header')(
        stamp=_time(estimate.stamp, types), frame_id=f'{frames.prefix}{frames.target_link}'
    )


def _inertia(parameters: Array, types: MessageTypes) -> Any:
    mass, _, _, _, ixx, ixy, ixz, iyy, iyz, izz = (float(value) for value in parameters)
    return types.find('geometry_msgs/msg/Inertia')(
        m=mass, com=_vector(parameters[1:4], types), ixx=ixx, ixy=ixy, ixz=ixz, iyy=iyy, iyz=iyz, izz=izz
    )


def _vector(values: Array, types: MessageTypes) -> Any:
    return types.find('geometry_msgs/msg/Vector3')(x=float(values[0]), y=float(values[1]), z=float(values[2]))


def trajectory_message(trajectory: JointTrajectory, types: MessageTypes) -> Any:
    """Return a motion as a trajectory_msgs/JointTrajectory; its stamp is 0: it begins when it is received."""
    point = types.find('trajectory_msgs/msg/JointTrajectoryPoint')
    parts = [each if each.size else np.zeros((len(trajectory.time), 0)) for each in _derivatives(trajectory)]
    return types.find('trajectory_msgs/msg/JointTrajectory')(
        header=types.find('std_msgs/msg/Header')(stamp=_time(0, types), frame_id=''),
        joint_names=list(trajectory.joints),
        points=[
            point(
                positions=parts[0][k],
                velocities=parts[1][k],
                accelerations=parts[2][k],
                effort=np.zeros(0),
                time_from_start=_duration(time, types),
            )
            for k, time in enumerate(trajectory.time.tolist())
        ],
    )


def _derivatives(trajectory: JointTrajectory) -> tuple[Array, Array, Array]:
    return trajectory.position, trajectory.velocity, trajectory.acceleration


def _duration(time: float, types: MessageTypes) -> Any:
    seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
    return types.find('builtin_interfaces/msg/Duration')(sec=seconds, nanosec=nanoseconds)


class SensorMessages:
    """Makes the messages of a robot's sensors.

    Parameters
    ----------
    odometry_frame : name
    wheels : names of wheels whose speeds JointState has
    unreported : names of joints that it leaves out
    """

    def __init__(
        self,
        types: MessageTypes,
        model: RobotModel,
        odometry_frame: str,
        wheels: Sequence[str] = (),
        unreported: Sequence[str] = (),
    ) -> None:
        self._wheels = tuple(wheels)
        self._types = types
        self._model = model
        self._frame = odometry_frame
        self._joints = [place for place, name in enumerate(model.joint_names) if name not in unreported]

    def joint_state(self, readings: JointReadings, index: int, stamp: int) -> Any:
        """Return one of the readings as a sensor_msgs/JointState stamped in ns."""
        parts = (readings.position, readings.velocity, readings.effort)
        position, velocity, effort = (part[index][self._joints] for part in parts)
        if self._wheels:
            none = np.zeros(len(self._wheels))
            position, effort = np.append(position, none), np.append(effort, none)
            velocity = np.append(velocity, readings.wheel_speed[index])
        return self._types.find('sensor_msgs/msg/JointState')(
            header=self._header(stamp, ''),
            name=[*(self._model.joint_names[joint] for joint in self._joints), *self._wheels],
            position=position,
            velocity=velocity,
            effort=effort,
        )

    def stored_momentum(self, momentum: Array, stamp: int) -> Any:
        """Return a momentum (3,) in the base link's axes as a geometry_msgs/Vector3Stamped stamped in ns."""
        vector, header = self._of('Vector3', momentum, 'xyz'), self._header(stamp, self._model.base_link)
        return self._types.find('geometry_msgs/msg/Vector3Stamped')(header=header, vector=vector)

    def imu(self, readings: ImuReadings, index: int, stamp: int) -> Any:
        """Return one of the readings as a sensor_msgs/Imu stamped in ns."""
        find, absent = self._types.find, np.zeros(9)
        absent[0] = -1.0  # REP 145: not measured
        none = self._of('Vector3', np.zeros(3), 'xyz')
        measured = readings.orientation.shape[1] > 0
        orientation = readings.orientation[index] if measured else np.array([0.0, 0.0, 0.0, 1.0])
        return find('sensor_msgs/msg/Imu')(
            header=self._header(stamp, readings.link or self._model.base_link),
            orientation=self._of('Quaternion', orientation, 'xyzw'),
            orientation_covariance=(readings.orientation_std**2 * np.eye(3)).ravel() if measured else absent,
            angular_velocity=self._of('Vector3', readings.angular_velocity[index], 'xyz'),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=none,
            linear_acceleration_covariance=absent,
        )

    def wrench(self, wrench: Array, link: str, stamp: int) -> Any:
        """Return force and torque (6,) on a link as a geometry_msgs/WrenchStamped stamped in ns."""
        find = self._types.find
        force, torque = self._of('Vector3', wrench[:3], 'xyz'), self._of('Vector3', wrench[3:], 'xyz')
        value = find('geometry_msgs/msg/Wrench')(force=force, torque=torque)
        return find('geometry_msgs/msg/WrenchStamped')(header=self._header(stamp, link), wrench=value)

    def odometry(self, readings: BaseReadings, index: int, stamp: int) -> Any:
        """Return one of the readings as a nav_msgs/Odometry stamped in ns."""
        find = self._types.find
        pose = find('geometry_msgs/msg/Pose')(
            position=self._of('Point', readings.position[index], 'xyz'),
            orientation=self._of('Quaternion', readings.orientation[index], 'xyzw'),
        )
        twist = find('geometry_msgs/msg/Twist')(
            linear=self._of('Vector3', readings.linear_velocity[index], 'xyz'),
            angular=self._of('Vector3', readings.angular_velocity[index], 'xyz'),
        )
        return find('nav_msgs/msg/Odometry')(
            header=self._header(stamp, self._frame),
            child_frame_id=self._model.base_link,
            pose=find('geometry_msgs/msg/PoseWithCovariance')(pose=pose, covariance=readings.pose_covariance.ravel()),
            twist=find('geometry_msgs/msg/TwistWithCovariance')(
                twist=twist, covariance=readings.twist_covariance.ravel()
            ),
        )

    def time(self, stamp: int) -> Any:
        """Return a stamp in ns as a builtin_interfaces/Time."""
        return _time(stamp, self._types)

    def _of(self, name: str, values: Array, fields: str) -> Any:
        return self._types.find(f'geometry_msgs/msg/{name}')(**dict(zip(fields, values.tolist(), strict=True)))

    def _header(self, stamp: int, frame: str) -> Any:
        return self._types.find('std_msgs/msg/Header')(stamp=self.time(stamp), frame_id=frame)
