"""The paper's two forms (eqs. 22 and 25, corrected), as linear equations of (1/m, r_c, I_c): rows and right sides.

P' and L' are the momentum of the target link: the total minus that of the known bodies. The paper sets the total linear
momentum to zero. The moment equations are then the same about every fixed point, and here they are written with
L_k about the base link's origin and r the target's hinge relative to it, so that the base's own position drops out:
L' - p x P' = L_0 - L_k - r x P'.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, bracket, cross, rotate_back, skew
from mbaid_ros.core.robot.kernel import BodyStates

UNKNOWNS = 10  # parameters of the body


def linear_rows(states: BodyStates) -> tuple[Array, Array]:
    """Return P' (1/m) - [w]x R r_c = v (eq. 21 with B' = [w]x R): (N, 3, 10), (N, 3)."""
    linear = -states.known_momentum[:, :3]  # P' = P_0 - P_k with P_0 = 0 (eq. 24)
    rows = np.zeros((len(linear), 3, UNKNOWNS))
    rows[..., 0] = linear
    rows[..., 1:4] = -skew(states.twist[:, 3:]) @ states.rotation
    return rows, states.hinge_velocity


def angular_rows(states: BodyStates) -> tuple[Array, Array]:
    """Return -[P']x R r_c + R bracket(R^T w) vec(I_c) = L_0 + (-L_k - r x P'), without L_0: (N, 3, 10), (N, 3).

    Eq. 20, with the rotation of the inertia.
    """
    known = states.known_momentum
    linear = -known[:, :3]
    rows = np.zeros((len(known), 3, UNKNOWNS))
    rows[..., 1:4] = -skew(linear) @ states.rotation
    rows[..., 4:] = states.rotation @ bracket(rotate_back(states.rotation, states.twist[:, 3:]))
    return rows, -known[:, 3:] - cross(states.position, linear)


def main_form(states: BodyStates, total_angular_momentum: Array) -> tuple[Array, Array]:
    """Return the main form (eq. 22, corrected) with L_0 (3,) kg m^2/s, odometry axes: (N, 6, 10), (N, 6)."""
    linear, velocity = linear_rows(states)
    angular, moment = angular_rows(states)
    right_side = np.concatenate((velocity, moment + total_angular_momentum), axis=1)
    return np.concatenate((linear, angular), axis=1), right_side


def difference_form(
    linear: tuple[Array, Array], angular: tuple[Array, Array], reference: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the difference form (eq. 25, corrected): the angular rows minus those of each reference sample.

    The unknown L_0 cancels; the linear rows are not differenced: (N, 6, 10), (N, 6).
    """
    return (
        np.concatenate((linear[0], angular[0] - reference[0]), axis=1),
        np.concatenate((linear[1], angular[1] - reference[1]), axis=1),
    )
