"""Poses in other conventions than those of ROS: what a driver may have mistaken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from mbaid_ros.core.trajectory.windows.knots import Knots

PoseReading = Callable[[Knots], Knots]

_MILLIMETRE = 1e-3  # m: a unit


def as_read(knots: Knots) -> Knots:
    """Return knots as they are."""
    return knots


def _inverse(knots: Knots) -> Knots:
    return replace(knots, base_rotation=np.swapaxes(knots.base_rotation, -1, -2))


def _scalar_first(knots: Knots) -> Knots:
    """Return the knots of quaternions whose w stands where x should, and so on."""
    quaternion = quaternion_from_rotation(knots.base_rotation)
    return replace(knots, base_rotation=rotation_from_quaternion(np.roll(quaternion, -1, axis=-1)))


def _in_millimetres(knots: Knots) -> Knots:
    return replace(knots, base_position=_MILLIMETRE * knots.base_position)


# In words, what knots are if it is so, and how far (m) the base would seem to go at least: less of it is explained by
# anything that makes it less.
MISREAD_POSES: tuple[tuple[str, PoseReading, float], ...] = (
    (
        'the orientation of the odometry is the inverse: in ROS it turns from the base to the odometry frame',
        _inverse,
        0.0,
    ),
    ('the quaternion of the odometry has its w first: in ROS it is x, y, z, w', _scalar_first, 0.0),
    ('the position of the odometry is in millimetres: in ROS it is in metres', _in_millimetres, 20.0),
)
