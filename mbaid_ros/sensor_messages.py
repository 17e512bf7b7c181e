"""Sensor readings to messages, each with its stamp in ns, duck-typed as in `outgoing`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.outgoing import MessageTypes, stamped, vector
from mbaid_ros.simulation.sensors import BaseReadings, ImuReadings, JointReadings

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
        header=stamped(stamp, '', types), name=list(names), position=position, velocity=velocity, effort=effort
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
        position=vector(pose[0], types, 'Point'), orientation=vector(pose[1], types, 'Quaternion')
    )
    motion = find('geometry_msgs/msg/Twist')(linear=vector(twist[0], types), angular=vector(twist[1], types))
    return find(SENSOR_TYPES['odom'])(
        header=stamped(stamp, frames[0], types),
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
        header=stamped(stamp, frame, types),
        orientation=vector(quaternion, types, 'Quaternion'),
        orientation_covariance=covariance,
        angular_velocity=vector(rate, types),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(np.zeros(3) if acceleration is None else acceleration, types),
        linear_acceleration_covariance=_ABSENT if acceleration is None else np.zeros(9),
    )


def wrench_message(types: MessageTypes, stamp: int, frame: str, wrench: Array) -> Any:
    """Return force and torque (6,) on a frame as a geometry_msgs/WrenchStamped."""
    value = types.find('geometry_msgs/msg/Wrench')(force=vector(wrench[:3], types), torque=vector(wrench[3:], types))
    return types.find(SENSOR_TYPES['thrust'])(header=stamped(stamp, frame, types), wrench=value)


def vector_message(types: MessageTypes, stamp: int, frame: str, values: Array) -> Any:
    """Return a vector (3,) in the axes of a frame as a geometry_msgs/Vector3Stamped."""
    header = stamped(stamp, frame, types)
    return types.find(SENSOR_TYPES['stored_momentum'])(header=header, vector=vector(values, types))


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
