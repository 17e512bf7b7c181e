"""The base's twist that conservation predicts from joint motion and momentum, and its derivatives.

About the base's origin, in odometry axes,  M(q, R; phi) V + b(q, q', R; phi) = (P, L - p x P),  with the locked inertia
M and the momentum b of the joint motion at a resting base, both linear in the target's parameters phi.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
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
    return predicted(kernel, middle, parameters, uncertain)[0]


def predicted(
    kernel: MomentumKernel, middle: Midpoints, parameters: Array, uncertain: Sequence[int] = ()
) -> tuple[Prediction, BodyStates]:
    """Return the same with the states of a robot that moves so, all bodies of which are known."""
    linear, angular = parameters[:3] + middle.impulse[:, :3], parameters[3:6] + middle.impulse[:, 3:]
    body = parameters[6:16]
    kernel = with_errors(kernel, parameters[16:], uncertain)
    still = np.zeros((len(middle), 6))
    states = kernel.states_of(middle.base_rotation, middle.joint_position, middle.joint_velocity, still)
    target = express(body, states.rotation, states.position)
    # Inverted once: most of what it is applied to are derivatives.
    inverse = np.linalg.inv(inertia_matrix(np.sum(states.known, axis=1) + target))
    about_base = angular - cross(middle.base_position, linear)
    total = np.concatenate((linear, about_base), axis=1)
    moving = states.known_momentum + momentum(target, states.twist)
    twist = (inverse @ (total - moving)[..., None])[..., 0]
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
    solved = inverse @ right
    known = states.known.copy()
    known[:, kernel.target.body] += target
    return Prediction(twist, solved[..., :count], solved[..., count:]), replace(
        states, body_twist=states.body_twist + twist[:, None], known=known, twist=states.twist + twist
    )


def with_errors(kernel: MomentumKernel, errors: Array, uncertain: Sequence[int]) -> MomentumKernel:
    """Return the kernel with the errors of uncertain known bodies, 10 standard parameters each, taken into account."""
    if not uncertain:
        return kernel
    change = np.zeros_like(kernel.known)
    change[list(uncertain)] = errors.reshape(-1, 10)
    return kernel.corrected(change)


def mobility(states: BodyStates) -> Array:
    """Return M^-1 of N instants, (N, 6, 6)."""
    return np.linalg.inv(inertia_matrix(np.sum(states.known, axis=1)))


def joint_gains(kernel: MomentumKernel, states: BodyStates) -> tuple[Array, Array]:
    """Return how joint errors move the prediction.

    Parameters
    ----------
    kernel : MomentumKernel
    states : of N instants, as predicted

    Returns
    -------
    (N, 6, n) derivative of the twist by the joint rates, and by the joint positions
    """
    joints = kernel.model.joints
    by_joints = sensitivity_of_known(kernel, states)[..., : 2 * joints]
    gains = -mobility(states) @ by_joints
    return gains[..., joints:], gains[..., :joints]


def gains_by_bodies(kernel: MomentumKernel, states: BodyStates, by_rate: Array, uncertain: Sequence[int] = ()) -> Array:
    """Return how the derivative A of the twist by the joint rates depends on the bodies.

    A joint at unit rate, where there is no momentum, makes the base move by its column of A and the bodies by that and
    its own twist; M dA = -Y dphi at those motions.

    Parameters
    ----------
    kernel : MomentumKernel
    states : of N instants, as predicted
    by_rate : (N, 6, n) A there
    uncertain : indices of the uncertain known bodies

    Returns
    -------
    (N, 6, u - 6, n) by phi, then by the errors of those bodies
    """
    bodies, base = states.configuration, np.swapaxes(by_rate, 1, 2)
    links = [(kernel.target.body, states.rotation, states.position)]
    links += [(index, bodies.rotation[:, index], bodies.position[:, index]) for index in uncertain]
    columns = []
    for index, rotation, position in links:
        motion = base + kernel.kinematics.ancestors[index][:, None] * bodies.joint_twist
        columns.append(regressor(rotation[:, None], position[:, None], motion))
    right = -np.moveaxis(np.concatenate(columns, axis=-1), 1, -1)  # (N, 6, u - 6, n)
    return (mobility(states) @ right.reshape(*right.shape[:2], -1)).reshape(right.shape)
