"""The base's twist that conservation predicts from joint motion and momentum, and its derivatives.

About the base's origin, in odometry axes,  M(q, R; phi) V + b(q, q', R; phi) = (P, L - p x P),  with the locked inertia
M and the momentum b of the joint motion at a resting base, both linear in the target's parameters phi.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum, regressor
from mbaid_ros.core.robot.sensitivity import sensitivity_of_known
from mbaid_ros.core.stacked import Stacked
from mbaid_ros.core.trajectory.midpoints import Midpoints

# Rows of a twist (v, w) in the order (angular, linear) of a pose error.
ANGULAR_FIRST = np.array([3, 4, 5, 0, 1, 2])


@dataclass(frozen=True)
class Prediction(Stacked):
    """The predicted twist (v, w) of the base at N instants, odometry axes.

    Attributes
    ----------
    twist : (N, 6)
    by_parameters : (N, 6, u) derivative by the parameters
    by_pose_error : (N, 6, 6) derivative by an error (theta, rho) of the base's pose, the turn of V itself left out
    """

    twist: Array
    by_parameters: Array
    by_pose_error: Array

    @property
    def error_slope(self) -> Array:
        """Return F, the (..., 6, 6) rate of change of a pose error (theta, rho) by itself."""
        slope = self.by_pose_error[..., ANGULAR_FIRST, :]
        slope[..., 3:, :3] -= skew(self.twist[..., :3])  # the predicted velocity turns with the true base
        return slope

    def divided(self, shapes: Sequence[tuple[int, ...]]) -> list[Prediction]:
        """Return parts of the instants, each laid out along several axes instead of one."""
        ends = np.cumsum([np.prod(shape) for shape in shapes])
        parts = [self[int(end - np.prod(shape)) : int(end)] for shape, end in zip(shapes, ends, strict=True)]
        return [
            Prediction(*(values.reshape(*shape, *values.shape[1:]) for values in vars(part).values()))
            for part, shape in zip(parts, shapes, strict=True)
        ]


def predict(kernel: MomentumKernel, middle: Midpoints, parameters: Array, uncertain: Sequence[int] = ()) -> Prediction:
    """Return the twist that conservation predicts at midpoints.

    Parameters
    ----------
    kernel : MomentumKernel
    middle : Midpoints of N intervals
    parameters : (u,) (P, L, phi) with L about the run's origin, both before any known thrust, then the errors of the
        uncertain known bodies, 10 each
    uncertain : indices of those bodies
    """
    linear, angular = parameters[:3] + middle.impulse[:, :3], parameters[3:6] + middle.impulse[:, 3:]
    body = parameters[6:16]
    kernel = with_errors(kernel, parameters[16:], uncertain)
    still = np.zeros((len(middle), 6))
    states = kernel.states_of(middle.base_rotation, middle.joint_position, middle.joint_velocity, still)
    target = express(body, states.rotation, states.position)
    locked = inertia_matrix(np.sum(states.known, axis=1) + target)
    about_base = angular - cross(middle.base_position, linear)
    total = np.concatenate((linear, about_base), axis=1)
    moving = states.known_momentum + momentum(target, states.twist)
    twist = np.linalg.solve(locked, (total - moving)[..., None])[..., 0]
    # M dV = dh - (dM V + db): the second is the target's regressor at the predicted motion.
    count = len(parameters)
    right = np.zeros((len(twist), 6, count + 6))
    right[..., :6] = np.eye(6)
    right[:, 3:, :3] = -skew(middle.base_position)
    right[..., 6:16] = -regressor(states.rotation, states.position, states.twist + twist)
    bodies = states.configuration
    for place, index in enumerate(uncertain):
        motion = states.body_twist[:, index] + twist
        columns = regressor(bodies.rotation[:, index], bodies.position[:, index], motion)
        right[..., 16 + 10 * place : 26 + 10 * place] = -columns
    # A turn theta of the true base turns M and b along; the momentum stays: M^-1 of (P x theta, L_b x theta + P x rho).
    turned = skew(linear)
    right[:, :3, count : count + 3] = turned
    right[:, 3:, count : count + 3] = skew(about_base)
    right[:, 3:, count + 3 :] = turned
    solved = np.linalg.solve(locked, right)
    return Prediction(twist, solved[..., :count], solved[..., count:])


def with_errors(kernel: MomentumKernel, errors: Array, uncertain: Sequence[int]) -> MomentumKernel:
    """Return the kernel with the errors of uncertain known bodies, 10 standard parameters each, taken into account."""
    if not uncertain:
        return kernel
    change = np.zeros_like(kernel.known)
    change[list(uncertain)] = errors.reshape(-1, 10)
    return kernel.corrected(change)


def joint_gains(kernel: MomentumKernel, middle: Midpoints, twist: Array, body: Array) -> tuple[Array, Array]:
    """Return how joint errors move the prediction.

    Parameters
    ----------
    kernel : MomentumKernel
    middle : Midpoints of N intervals
    twist : (N, 6) predicted there
    body : (10,) phi

    Returns
    -------
    (N, 6, n) derivative of the twist by the joint rates, and by the joint positions
    """
    # A target of which all is known is a known body.
    change = np.zeros_like(kernel.known)
    change[kernel.target.body] = express(body, kernel.target.rotation, kernel.target.position)
    kernel = kernel.corrected(change)
    states = kernel.states_of(middle.base_rotation, middle.joint_position, middle.joint_velocity, twist)
    joints = kernel.model.joints
    by_joints = sensitivity_of_known(kernel, states)[..., : 2 * joints]
    gains = -np.linalg.solve(inertia_matrix(np.sum(states.known, axis=1)), by_joints)
    return gains[..., joints:], gains[..., :joints]


def unit_rates(kernel: MomentumKernel, middle: Midpoints, parameters: Array, uncertain: Sequence[int] = ()) -> Array:
    """Return how the derivative of the twist by the joint rates depends on the bodies.

    That derivative is the twist that each joint makes alone, at unit rate, where there is no momentum.

    Parameters
    ----------
    kernel, middle, parameters, uncertain : as of `predict`

    Returns
    -------
    (N, 6, u - 6, n) by the parameters but the momentum
    """
    joints, count = kernel.model.joints, len(middle)
    each = middle[np.repeat(np.arange(count), joints)]
    alone = replace(each, joint_velocity=np.tile(np.eye(joints), (count, 1)), impulse=np.zeros_like(each.impulse))
    bodies = np.concatenate((np.zeros(6), parameters[6:]))
    slope = predict(kernel, alone, bodies, uncertain).by_parameters[..., 6:]
    return np.moveaxis(slope.reshape(count, joints, 6, len(bodies) - 6), 1, -1)
