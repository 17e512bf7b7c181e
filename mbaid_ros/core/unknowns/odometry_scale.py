"""By what part the odometry reads lengths too long: a camera's baseline or a marker's size is not as it believes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.momentum import inertia_matrix
from mbaid_ros.core.unknowns.declaration import Linear, Reading

SCALE = 'odometry scale'


@dataclass(frozen=True, eq=False)
class OdometryScale(Linear):
    """What of every length is too much, relative: positions are read (1 + s) times as far as they are."""

    in_equations = True

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum follows from the velocity that is read; the arm of the linear one is left out."""
        del kernel
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        return -inertia[..., :3] @ states.body_twist[:, 0, :3, None]

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the position as far as the base has come, and its velocity."""
        pose, twist = np.zeros((2, len(motion.time), 6, 1))
        pose[:, 3:, 0], twist[:, 3:, 0] = motion.position, motion.twist[:, 3:]
        return pose, twist


def odometry_scale(deviation: float) -> OdometryScale:
    """Return the scale as an unknown, of a relative standard deviation."""
    return OdometryScale(np.array([[deviation]]), (SCALE,))
