"""Estimates and sensor readings to messages, duck-typed: one builder for rclpy's classes and rosbags'."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.results.estimate import Debris, Estimate, Event
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
        span=_duration(max(0.0, estimate.time), types),
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
        stamp=time_message(stamp, types),
        time=float(event.time),
        kind=event.kind,
        linear=_vector(event.linear, types),
        angular=_vector(event.angular, types),
        cause=event.cause,
    )


def time_message(stamp: int, types: MessageTypes) -> Any:
    """Return a stamp in ns as a builtin_interfaces/Time."""
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    return types.find('builtin_interfaces/msg/Time')(sec=seconds, nanosec=nanoseconds)


def _stamped(stamp: int, frame: str, types: MessageTypes) -> Any:
    return types.find('std_msgs/msg/Header')(stamp=time_message(stamp, types), frame_id=frame)


def _header(estimate: Estimate, types: MessageTypes, frames: Frames) -> Any:
    return _stamped(estimate.stamp, f'{frames.prefix}{frames.target_link}', types)


def _inertia(parameters: Array, types: MessageTypes) -> Any:
    mass, _, _, _, ixx, ixy, ixz, iyy, iyz, izz = (float(value) for value in parameters)
    return types.find('geometry_msgs/msg/Inertia')(
        m=mass, com=_vector(parameters[1:4], types), ixx=ixx, ixy=ixy, ixz=ixz, iyy=iyy, iyz=iyz, izz=izz
    )


def _vector(values: Array, types: MessageTypes, name: str = 'Vector3') -> Any:
    """Return values (3,) or (4,) as a type of geometry_msgs with fields x, y, z and w."""
    return types.find(f'geometry_msgs/msg/{name}')(**dict(zip('xyzw', map(float, values), strict=False)))


def trajectory_message(trajectory: JointTrajectory, types: MessageTypes) -> Any:
    """Return a motion as a trajectory_msgs/JointTrajectory; its stamp is 0: it begins when it is received."""
    point = types.find('trajectory_msgs/msg/JointTrajectoryPoint')
    derivatives = trajectory.position, trajectory.velocity, trajectory.acceleration
    parts = [each if each.size else np.zeros((len(trajectory.time), 0)) for each in derivatives]
    return types.find('trajectory_msgs/msg/JointTrajectory')(
        header=_stamped(0, '', types),
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


def _duration(time: float, types: MessageTypes) -> Any:
    seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
    return types.find('builtin_interfaces/msg/Duration')(sec=seconds, nanosec=nanoseconds)


# -- Readings, each with its stamp in ns

SENSOR_TYPES = {
    'joint_states': 'sensor_msgs/msg/JointState',
    'odom': 'nav_msgs/msg/Odometry',
    'imu': 'sensor_msgs/msg/Imu',
    'thrust': 'geometry_msgs/msg/WrenchStamped',
    'stored_momentum': 'geometry_msgs/msg/Vector3Stamped',
}
_UNKNOWN = np.zeros(36)  # covariance that is not known
_ABSENT = np.array([-1.0, *np.zeros(8)])  # covariance of a quantity that is not measured (REP 145)


def joint_state_message(
    types: MessageTypes, stamp: int, names: Sequence[str], position: Array, velocity: Array, effort: Array
) -> Any:
    """Return positions, velocities and efforts of joints, each (n,) or (0,), as a sensor_msgs/JointState."""
    return types.find(SENSOR_TYPES['joint_states'])(
        header=_stamped(stamp, '', types), name=list(names), position=position, velocity=velocity, effort=effort
    )


def odometry_message(
    types: MessageTypes,
    stamp: int,
    frames: tuple[str, str],
    pose: tuple[Array, Array],
    twist: tuple[Array, Array],
    covariances: tuple[Array, Array] = (_UNKNOWN, _UNKNOWN),
) -> Any:
    """Return a pose and a twist as a nav_msgs/Odometry.

    Parameters
    ----------
    frames : of the odometry, and the one on the base
    pose : position (3,) and quaternion x, y, z, w (4,) of this in that
    twist : linear and angular velocity (3,) in its axes
    covariances : of pose and twist, 36 numbers each
    """
    find = types.find
    place = find('geometry_msgs/msg/Pose')(
        position=_vector(pose[0], types, 'Point'), orientation=_vector(pose[1], types, 'Quaternion')
    )
    motion = find('geometry_msgs/msg/Twist')(linear=_vector(twist[0], types), angular=_vector(twist[1], types))
    return find(SENSOR_TYPES['odom'])(
        header=_stamped(stamp, frames[0], types),
        child_frame_id=frames[1],
        pose=find('geometry_msgs/msg/PoseWithCovariance')(pose=place, covariance=covariances[0].ravel()),
        twist=find('geometry_msgs/msg/TwistWithCovariance')(twist=motion, covariance=covariances[1].ravel()),
    )


def imu_message(
    types: MessageTypes,
    stamp: int,
    frame: str,
    rate: Array,
    acceleration: Array | None = None,
    orientation: tuple[Array, Array] | None = None,
) -> Any:
    """Return an angular velocity (3,) as a sensor_msgs/Imu, with an acceleration (3,) where there is one.

    `orientation` is a quaternion x, y, z, w (4,) with its covariance (9,); None where it is not measured.
    """
    quaternion, covariance = orientation or (np.array([0.0, 0.0, 0.0, 1.0]), _ABSENT)
    return types.find(SENSOR_TYPES['imu'])(
        header=_stamped(stamp, frame, types),
        orientation=_vector(quaternion, types, 'Quaternion'),
        orientation_covariance=covariance,
        angular_velocity=_vector(rate, types),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=_vector(np.zeros(3) if acceleration is None else acceleration, types),
        linear_acceleration_covariance=_ABSENT if acceleration is None else np.zeros(9),
    )


def wrench_message(types: MessageTypes, stamp: int, frame: str, wrench: Array) -> Any:
    """Return force and torque (6,) on a frame as a geometry_msgs/WrenchStamped."""
    value = types.find('geometry_msgs/msg/Wrench')(force=_vector(wrench[:3], types), torque=_vector(wrench[3:], types))
    return types.find(SENSOR_TYPES['thrust'])(header=_stamped(stamp, frame, types), wrench=value)


def vector_message(types: MessageTypes, stamp: int, frame: str, vector: Array) -> Any:
    """Return a vector (3,) in the axes of a frame as a geometry_msgs/Vector3Stamped."""
    header = _stamped(stamp, frame, types)
    return types.find(SENSOR_TYPES['stored_momentum'])(header=header, vector=_vector(vector, types))


class SensorMessages:
    """Makes the messages of a simulated robot's sensors.

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
        self._types = types
        self._wheels = np.zeros(len(wheels))
        self._frames = odometry_frame, model.base_link
        self._joints = [place for place, name in enumerate(model.joint_names) if name not in unreported]
        self._names = [*(model.joint_names[joint] for joint in self._joints), *wheels]

    def joint_state(self, readings: JointReadings, index: int, stamp: int) -> Any:
        """Return one of the readings as a JointState."""
        parts = (readings.position, readings.velocity, readings.effort)
        position, velocity, effort = (part[index][self._joints] for part in parts)
        if len(self._wheels):
            position, effort = np.append(position, self._wheels), np.append(effort, self._wheels)
            velocity = np.append(velocity, readings.wheel_speed[index])
        return joint_state_message(self._types, stamp, self._names, position, velocity, effort)

    def odometry(self, readings: BaseReadings, index: int, stamp: int) -> Any:
        """Return one of the readings as an Odometry."""
        pose = readings.position[index], readings.orientation[index]
        twist = readings.linear_velocity[index], readings.angular_velocity[index]
        covariances = readings.pose_covariance, readings.twist_covariance
        return odometry_message(self._types, stamp, self._frames, pose, twist, covariances)

    def imu(self, readings: ImuReadings, index: int, stamp: int) -> Any:
        """Return one of the readings as an Imu."""
        orientation = None
        if readings.orientation.shape[1]:
            orientation = readings.orientation[index], (readings.orientation_std**2 * np.eye(3)).ravel()
        frame, rate = readings.link or self._frames[1], readings.angular_velocity[index]
        return imu_message(self._types, stamp, frame, rate, orientation=orientation)
