"""What unknowns do that add to the joints' motion, by how these move and what they bear."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.linearised.prediction import Bodies, joint_gains
from mbaid_ros.core.trajectory.windows.interpolation import Midpoints, gradient
from mbaid_ros.core.unknowns.declaration import JointMotion, Unknown


def by_deflections(
    unknown: Unknown, kernel: MomentumKernel, motions: Sequence[Midpoints], spacings: Sequence[float], bodies: Bodies
) -> Array:
    """Return how the predicted twist (v, w) depends on an unknown of the joints, at N instants, (N, 6, e).

    Parameters
    ----------
    unknown : that is of the joints
    kernel : of the robot where it is linearised
    motions, spacings : of each stack of windows, and s between its instants
    bodies : of all instants, one after the other
    """
    # About the base's origin: momentum of all that a joint moves, (N, n, 6).
    states = bodies.states
    carried = kernel.kinematics.ancestors.T @ states.momenta
    origin, axes = states.body_twist[:, 0, :3], states.configuration.joint_twist
    ends = np.cumsum([0, *(motion.turn[..., 0].size for motion in motions)])
    parts = [
        _joint_motion(motion, spacing, *(part[begin:end] for part in (carried, origin, axes)))
        for (begin, end), motion, spacing in zip(pairwise(ends), motions, spacings, strict=True)
    ]
    position, rate = unknown.deflections(JointMotion.concatenate(parts))
    by_rate, by_position = joint_gains(kernel, bodies)
    return np.asarray((by_position @ position + by_rate @ rate) @ unknown.factor)


def _joint_motion(motion: Midpoints, spacing: float, carried: Array, origin: Array, axes: Array) -> JointMotion:
    """Return what the joints do in a stack, one instant after the other; others are per instant, as above."""
    shape = motion.turn.shape[:2]
    momenta, velocity, axis = (part.reshape(*shape, *part.shape[1:]) for part in (carried, origin, axes))
    # The force and moment about the base's origin, which moves, that change momenta about it.
    force = gradient(momenta) / spacing
    force[..., 3:] += cross(np.broadcast_to(velocity[..., None, :], momenta[..., :3].shape), momenta[..., :3])
    torque = np.sum(axis * force, axis=-1)
    rate = motion.joint_velocity
    values = (motion.joint_position, rate, gradient(rate) / spacing, torque, gradient(torque) / spacing)
    return JointMotion(*(value.reshape(-1, value.shape[-1]) for value in values))
