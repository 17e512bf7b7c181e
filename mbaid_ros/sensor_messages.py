"""Sensor readings, simulated or of a log, and their messages, duck-typed as in `estimate_messages`; stamps in ns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.estimate_messages import MessageTypes, stamped, vector
from mbaid_ros.simulation.sensors import BaseReadings, ImuReadings, JointReadings, PoseReadings

SENSOR_TYPES = {
    'joint_states': 'sensor_msgs/msg/JointState',
    'odom': 'nav_msgs/msg/Odometry',
    'pose': 'geometry_msgs/msg/PoseStamped',
    'imu': 'sensor_msgs/msg/Imu',
    'thrust': 'geometry_msgs/msg/WrenchStamped',
    'stored_momentum': 'geometry_msgs/msg/Vector3Stamped',
    'target_pose': 'geometry_msgs/msg/PoseStamped',
}
_ABSENT = np.array([-1.0, *np.zeros(8)])  # covariance of a quantity that is not measured (REP 145)

_NOT_KNOWN = np.zeros(36)  # covariance


@dataclass(frozen=True)
class Joints:
    """N readings (N,) s of n joints, or commands to them: position (N, n) rad or m, velocity and effort where known."""

    topic: ClassVar[str] = 'joint_states'

    names: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array | None = None
    effort: Array | None = None

    def message(self, types: MessageTypes, index: int, stamp: int) -> Any:
        """Return one of them as a sensor_msgs/JointState."""
        position, velocity, effort = (
            np.zeros(0) if each is None else np.ascontiguousarray(each[index])  # a serialiser takes no other memory
            for each in (self.position, self.velocity, self.effort)
        )
        return types.find(SENSOR_TYPES['joint_states'])(
            header=stamped(stamp, '', types),
            name=list(self.names),
            position=position,
            velocity=velocity,
            effort=effort,
        )


@dataclass(frozen=True)
class Poses:
    """N poses of the base, or of a frame on it, at times (N,) s."""

    topic: ClassVar[str] = 'odom'

    time: Array
    position: Array  # (N, 3) m, in the odometry frame
    orientation: Array  # (N, 4) quaternion x, y, z, w from the frame on the base to the odometry frame
    twist: Array  # (N, 6) linear and angular velocity in that frame's axes, m/s and rad/s; NaN where it is not logged
    frame: str = 'base_link'
    odometry_frame: str = 'odom'
    covariances: tuple[Array, Array] = (_NOT_KNOWN, _NOT_KNOWN)  # of pose and twist, 36 numbers each

    def message(self, types: MessageTypes, index: int, stamp: int) -> Any:
        """Return one of them as a nav_msgs/Odometry."""
        find, twist = types.find, self.twist[index]
        of_pose, of_twist = (each.ravel() for each in self.covariances)
        motion = find('geometry_msgs/msg/Twist')(linear=vector(twist[:3], types), angular=vector(twist[3:], types))
        return find(SENSOR_TYPES['odom'])(
            header=stamped(stamp, self.odometry_frame, types),
            child_frame_id=self.frame,
            pose=find('geometry_msgs/msg/PoseWithCovariance')(pose=pose_of(self, types, index), covariance=of_pose),
            twist=find('geometry_msgs/msg/TwistWithCovariance')(twist=motion, covariance=of_twist),
        )


@dataclass(frozen=True)
class BarePoses(Poses):
    """Poses without twist and covariance, as motion capture publishes them."""

    topic: ClassVar[str] = 'pose'

    def message(self, types: MessageTypes, index: int, stamp: int) -> Any:
        """Return one of them as a geometry_msgs/PoseStamped."""
        return pose_stamped(self, types, index, stamped(stamp, self.odometry_frame, types))


@dataclass(frozen=True)
class Imu:
    """N readings (N,) s of an IMU on a link: rad/s, and m/s^2 without gravity's pull, (N, 3) in axes of the link.

    `orientation` (N, 4) x, y, z, w is of the link in the frame of an orientation sensor beside it; None without one.
    """

    time: Array
    angular_velocity: Array
    linear_acceleration: Array  # (N, 0) where it is not measured
    frame: str = 'base_link'
    orientation: Array | None = None
    orientation_std: float = 0.0  # rad; 0 where not known
    topic: str = 'imu'

    def message(self, types: MessageTypes, index: int, stamp: int) -> Any:
        """Return one of them as a sensor_msgs/Imu."""
        quaternion, covariance = np.array([0.0, 0.0, 0.0, 1.0]), _ABSENT
        if self.orientation is not None:
            quaternion, covariance = self.orientation[index], (self.orientation_std**2 * np.eye(3)).ravel()
        acceleration = self.linear_acceleration[index]
        return types.find(SENSOR_TYPES['imu'])(
            header=stamped(stamp, self.frame, types),
            orientation=vector(quaternion, types, 'Quaternion'),
            orientation_covariance=covariance,
            angular_velocity=vector(self.angular_velocity[index], types),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(acceleration if acceleration.size else np.zeros(3), types),
            linear_acceleration_covariance=np.zeros(9) if acceleration.size else _ABSENT,
        )


@dataclass(frozen=True)
class Thrust:
    """N commanded wrenches."""

    topic: ClassVar[str] = 'thrust'

    time: Array  # (N,) s, from when on each counts
    wrench: Array  # (N, 6) force and torque about the frame's origin in its axes, N and N m
    frame: str = 'base_link'  # a link, or the odometry frame

    def message(self, types: MessageTypes, index: int, stamp: int) -> Any:
        """Return one of them as a geometry_msgs/WrenchStamped."""
        force, torque = self.wrench[index, :3], self.wrench[index, 3:]
        value = types.find('geometry_msgs/msg/Wrench')(force=vector(force, types), torque=vector(torque, types))
        return types.find(SENSOR_TYPES['thrust'])(header=stamped(stamp, self.frame, types), wrench=value)


@dataclass(frozen=True)
class StoredMomentum:
    """N angular momenta (N, 3) N m s of wheels or gyros in axes of a link, at times (N,) s."""

    topic: ClassVar[str] = 'stored_momentum'

    time: Array
    momentum: Array
    frame: str = 'base_link'

    def message(self, types: MessageTypes, index: int, stamp: int) -> Any:
        """Return one of them as a geometry_msgs/Vector3Stamped."""
        header = stamped(stamp, self.frame, types)
        return types.find(SENSOR_TYPES['stored_momentum'])(header=header, vector=vector(self.momentum[index], types))


@dataclass(frozen=True)
class TargetPoses:
    """N poses of a frame fixed to the target: (N,) s, (N, 3) m and quaternions (N, 4) x, y, z, w, of `frame`."""

    topic: ClassVar[str] = 'target_pose'

    time: Array
    position: Array
    orientation: Array
    frame: str = 'odom'

    def message(self, types: MessageTypes, index: int, stamp: int) -> Any:
        """Return one of them as a geometry_msgs/PoseStamped."""
        return pose_stamped(self, types, index, stamped(stamp, self.frame, types))


@dataclass(frozen=True)
class NamedPoses:
    """N poses of a link, or a part of them, by a further sensor: (N,) s, (N, 3) m and quaternions (N, 4) x, y, z, w."""

    topic: str
    time: Array
    position: Array
    orientation: Array
    measures: str = 'both'  # 'position', 'orientation' or 'both'
    frame: str = 'world'

    def message(self, types: MessageTypes, index: int, stamp: int) -> Any:
        """Return one of them as a geometry_msgs/PoseStamped, or QuaternionStamped of an orientation alone."""
        header = stamped(stamp, self.frame, types)
        if self.measures == 'orientation':
            quaternion = vector(self.orientation[index], types, 'Quaternion')
            return types.find(pose_type(self.measures))(header=header, quaternion=quaternion)
        return pose_stamped(self, types, index, header)


def pose_type(measures: str) -> str:
    """Return the type of the messages of a sensor of poses by what it measures."""
    return f'geometry_msgs/msg/{"QuaternionStamped" if measures == "orientation" else "PoseStamped"}'


def pose_of(readings: Poses | TargetPoses | NamedPoses, types: MessageTypes, index: int) -> Any:
    """Return one of N poses as a geometry_msgs/Pose."""
    return types.find('geometry_msgs/msg/Pose')(
        position=vector(readings.position[index], types, 'Point'),
        orientation=vector(readings.orientation[index], types, 'Quaternion'),
    )


def pose_stamped(readings: Poses | TargetPoses | NamedPoses, types: MessageTypes, index: int, header: Any) -> Any:
    """Return one of N poses as a geometry_msgs/PoseStamped."""
    return types.find('geometry_msgs/msg/PoseStamped')(header=header, pose=pose_of(readings, types, index))


Readings = Joints | Poses | Imu | Thrust | StoredMomentum | TargetPoses | NamedPoses


def in_order(
    parts: Sequence[Readings], types: MessageTypes, stamp: Callable[[Readings, float], int]
) -> list[tuple[float, str, Any]]:
    """Return time (s), topic and message of all readings in the order of time; of one time in that of the parts.

    `stamp` makes the stamp (ns) of a reading at a time (s).
    """
    messages = [
        (time, part.topic, part.message(types, index, stamp(part, time)))
        for part in parts
        for index, time in enumerate(part.time.tolist())
    ]
    return sorted(messages, key=lambda entry: entry[0])


# -- Of a simulated robot


def joints_of(readings: JointReadings, names: Sequence[str]) -> Joints:
    """Return the readings of all joints, by their names."""
    return Joints(tuple(names), readings.time, readings.position, readings.velocity, readings.effort)


def poses_of(readings: BaseReadings, base_link: str, odometry_frame: str = 'odom', *, pose_only: bool = False) -> Poses:
    """Return the readings of the base, as Odometry or as PoseStamped."""
    kind = BarePoses if pose_only else Poses
    twist = np.concatenate((readings.linear_velocity, readings.angular_velocity), axis=1)
    covariances = readings.pose_covariance, readings.twist_covariance
    return kind(readings.time, readings.position, readings.orientation, twist, base_link, odometry_frame, covariances)


def further_of(readings: ImuReadings | PoseReadings, topic: str, base_link: str) -> Imu | NamedPoses:
    """Return the readings of a gyro or of a sensor of poses, on a topic."""
    if isinstance(readings, PoseReadings):
        return NamedPoses(topic, readings.time, readings.position, readings.orientation, readings.measures)
    orientation = readings.orientation if readings.orientation.shape[1] else None
    frame = readings.link or base_link
    nothing = np.zeros((len(readings.time), 0))
    turning = readings.angular_velocity
    return Imu(readings.time, turning, nothing, frame, orientation, readings.orientation_std, topic)
