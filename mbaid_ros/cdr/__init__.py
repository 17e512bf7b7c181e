"""Messages as their bytes: plain little-endian CDR (DDSI-RTPS 2.5, 10.2), many messages of one layout at a time."""

from mbaid_ros.cdr.layouts import JOINT_STATE_TYPE, ODOMETRY_TYPE, JointStateLayout, OdometryLayout
from mbaid_ros.cdr.packets import Packer, Packet, Packets, packer

__all__ = [
    'JOINT_STATE_TYPE',
    'ODOMETRY_TYPE',
    'JointStateLayout',
    'OdometryLayout',
    'Packer',
    'Packet',
    'Packets',
    'packer',
]
