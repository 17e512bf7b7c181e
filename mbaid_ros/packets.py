"""Makers of packets of serialised messages, by the type of the message."""

from __future__ import annotations

from mbaid_ros.core.joints.stream import JointStateLayout
from mbaid_ros.core.odometry.stream import OdometryLayout
from mbaid_ros.core.samples import JOINT_STATE_TYPE, ODOMETRY_TYPE, Packer


def packer(type_name: str) -> Packer[JointStateLayout] | Packer[OdometryLayout] | None:
    """Return the maker of packets for messages of a type, None if its layout is not known."""
    if type_name == JOINT_STATE_TYPE:
        return Packer(JointStateLayout)
    return Packer(OdometryLayout) if type_name == ODOMETRY_TYPE else None
