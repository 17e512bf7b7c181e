"""The momentum at midpoints: in total, and that of the joints' motion at a resting base."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.filter.knots import Midpoints
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.robot.kinematics import Configuration
from mbaid_ros.core.robot.orbit import OF_A_THRUSTER, of_bodies
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum


def mobility_and_joint_momentum(
    layout: Layout, point: Point, middle: Midpoints, known: Array, placed: Configuration, body_twist: Array
) -> tuple[Array, Array]:
    """Return M^-1 and the momentum of the joint motion at a resting base, that stored inside bodies included."""
    storage = point.side.kernel.storage
    mobility, moving = mobility_and_momentum(known, placed, body_twist)
    if storage.count:
        moving[:, 3:] += np.sum(storage.momenta(placed.rotation, middle.stored), axis=1)
    if layout.plane is not None:
        mobility = in_plane(mobility, layout.plane)
    return mobility, moving


def total_momentum(middle: Midpoints, point: Point, known: Array, brought: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the total (P, L_b) at N instants, (N, 3) each: that of the point, thrust and orbit included.

    Parameters
    ----------
    middle, point : Midpoints, Point
    known : (n + 1, 10) standard parameters of all bodies
    brought : columns of tide and of thrusters that deviate from their commands
    """
    parameters, (tide, thrust) = point.parameters, brought
    linear, angular = parameters[:3] + middle.impulse[:, :3], parameters[3:6] + middle.impulse[:, 3:]
    about_base = angular - cross(middle.base_position, linear)
    parts = [(tide, known)] if tide.shape[1] else []
    if thrust.shape[1] and point.side.thrust.any():
        parts.append((thrust, point.side.thrust.reshape(-1, OF_A_THRUSTER)))
    for columns, numbers in parts:
        more = of_bodies(columns, numbers)
        linear, about_base = linear + more[:, :3], about_base + more[:, 3:]
    return linear, about_base


def in_plane(mobility: Array, plane: Array) -> Array:
    """Return the (N, 6, 6) matrices from momentum to twist of a robot kept in a plane with (3, 6) rows.

    The constraint takes up all momentum out of the plane.
    """
    return np.asarray(plane.T @ np.linalg.inv(plane @ np.linalg.inv(mobility) @ plane.T) @ plane)
