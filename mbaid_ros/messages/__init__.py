"""Messages to arrays, many at a time: the objects of rclpy and rosbags alike, and bytes that were made into none."""

from mbaid_ros.messages.fields import (
    joint_state_shape,
    number_of,
    numbers_of,
    odometry_shape,
    positions_of,
    stamp_of,
    stamps_of,
    vector_of,
    wrench_of,
)
from mbaid_ros.messages.imu import IMU_FRAME, ImuReader
from mbaid_ros.messages.joints import JointReader, trajectory_of
from mbaid_ros.messages.odometry import OdometryReader
from mbaid_ros.messages.poses import (
    BAD_QUATERNION,
    JOINT_MISSING,
    LENGTH_MISMATCH,
    LOST_TRACKING,
    NAMED_TWICE,
    NOT_FINITE,
    NOT_REAL,
    POSE_COVARIANCE,
    TOO_MANY_NAMES,
    TWIST_COVARIANCE,
    WRONG_CHILD_FRAME,
    PoseReader,
    Source,
    source_of,
)

__all__ = [
    'BAD_QUATERNION',
    'IMU_FRAME',
    'JOINT_MISSING',
    'LENGTH_MISMATCH',
    'LOST_TRACKING',
    'NAMED_TWICE',
    'NOT_FINITE',
    'NOT_REAL',
    'POSE_COVARIANCE',
    'TOO_MANY_NAMES',
    'TWIST_COVARIANCE',
    'WRONG_CHILD_FRAME',
    'ImuReader',
    'JointReader',
    'OdometryReader',
    'PoseReader',
    'Source',
    'joint_state_shape',
    'number_of',
    'numbers_of',
    'odometry_shape',
    'positions_of',
    'source_of',
    'stamp_of',
    'stamps_of',
    'trajectory_of',
    'vector_of',
    'wrench_of',
]
