"""What is seen of a motion from a frame that turns with its orbit."""

from __future__ import annotations

from dataclasses import replace

from mbaid_ros.core.geometry import cross, quaternion_from_rotation, rotate_back
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.simulation import quaternions
from mbaid_ros.core.simulation.run import Truth


def seen_from_orbit(orbit: Orbit, truth: Truth, *, relative_twist: bool) -> Truth:
    """Return a motion in the falling frame as the frame sees it that turns with the orbit.

    Parameters
    ----------
    orbit : Orbit, the epoch at time 0
    truth : in the falling frame
    relative_twist : whether the twist is that relative to the turning frame, or stays that to the falling one
    """
    turn = orbit.turned(truth.time)
    place = rotate_back(turn, truth.base_position)
    back = quaternions.conjugate(quaternion_from_rotation(turn))
    orientation = quaternions.product(back, truth.base_orientation)
    seen = replace(truth, base_position=place, base_orientation=orientation)
    if not relative_twist:
        return seen
    to_base = quaternions.conjugate(orientation)
    rate = orbit.rate(truth.time)
    carried = cross(rate, place)
    return replace(
        seen,
        base_linear_velocity=truth.base_linear_velocity - quaternions.rotate(to_base, carried),
        base_angular_velocity=truth.base_angular_velocity - quaternions.rotate(to_base, rate),
    )
