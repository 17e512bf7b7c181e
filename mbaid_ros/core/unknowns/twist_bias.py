"""What the odometry's twist reads too much, whatever moves: a gyro's bias, where a gyro is what it comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.momentum import inertia_matrix
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.unknowns.declaration import Linear, Reading

TURNS, SPEEDS = ('twist bias', 'twist velocity bias')


@dataclass(frozen=True, eq=False)
class TwistBias(Linear):
    """Constant in base axes, angular (rad/s) and linear (m/s)."""

    in_equations = True

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum follows from the twist that is read."""
        del kernel
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        rotation = states.configuration.rotation[:, 0]
        return -np.concatenate((inertia[..., 3:] @ rotation, inertia[..., :3] @ rotation), axis=-1)

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the base's axes."""
        pose, twist = np.zeros((2, len(motion.time), 6, 6))
        twist[:, :3, :3] = twist[:, 3:, 3:] = motion.axes
        return pose, twist

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the turn about the normal and the speeds in the plane."""
        plane = detector.plane_of(0)
        basis = np.zeros((6, 3))
        basis[:3, 0], basis[3:, 1:] = plane.normal, plane.across.T
        return basis


def twist_bias(angular: float, linear: float) -> TwistBias:
    """Return the bias as an unknown, of standard deviations in rad/s and m/s; 0 is exact."""
    deviations = np.repeat((angular, linear), 3)
    return TwistBias(np.diag(deviations)[:, deviations > 0.0], (TURNS,) * 3 + (SPEEDS,) * 3)
