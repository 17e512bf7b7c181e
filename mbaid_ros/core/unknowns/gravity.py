"""The gravity gradient of an orbit that nobody has declared: its size and directions.

In a frame that falls along an orbit a mass at x falls by G x faster, with a symmetric G without trace (Hill 1878). Of a
robot with the integrals H of x and S of x x^T over its mass, the momentum about the frame's origin changes by

    P' = G H,    L' = the axial vector of S G

a second. G turns with the orbit, by 2 n: over minutes it changes at a constant rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, unvec
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.unknowns.declaration import Linear

GRAVITY = 'gravity gradient'

# Orthonormal symmetric matrices without trace, (5, 3, 3).
_TRACELESS = np.array(
    [
        np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / np.sqrt(2.0),
        np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) / np.sqrt(2.0),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]) / np.sqrt(2.0),
        np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0),
        np.diag([1.0, 1.0, -2.0]) / np.sqrt(6.0),
    ]
)
# Further than this from its origin, m, a frame is not taken for one that falls with the robot.
_NEAR = 200.0


@dataclass(frozen=True, eq=False)
class Gravity(Linear):
    """The five numbers of a gradient G at the begin, 1/s^2, and of its change a second."""

    in_equations = True
    pushes = True

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the change of (P, L) a second by each of them."""
        del rotation
        rates = rates_by(_TRACELESS, whole, origin if np.linalg.norm(origin) < _NEAR else np.zeros(3))
        return np.concatenate((rates, time[:, None, None] * rates), axis=2)

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return nothing: tables do not orbit."""
        del detector
        return np.zeros((len(self.factor), 0))


def rates_by(gradients: Array, whole: Array, origin: Array) -> Array:
    """Return the changes of (P, L) a second, (B, 6, k), by (k, 3, 3) or (B, k, 3, 3) gradients; as `momentum_rates`."""
    mass, first, inertia = whole[:, 0], whole[:, 1:4], unvec(whole[:, 4:])
    second = 0.5 * np.trace(inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) - inertia
    weighed = (second + first[:, :, None] * origin)[:, None] @ gradients  # (B, k, 3, 3)
    rates = np.zeros((len(whole), 6, gradients.shape[-3]))
    rates[:, :3] = np.swapaxes((gradients @ (first + mass[:, None] * origin)[:, None, :, None])[..., 0], 1, 2)
    for axis, (one, other) in enumerate(((1, 2), (2, 0), (0, 1))):
        rates[:, 3 + axis] = weighed[..., one, other] - weighed[..., other, one]
    return rates


def gravity(rate: float) -> Gravity:
    """Return the gradient as an unknown, that of a circular orbit at a rate (rad/s) in a plane of any direction."""
    size = np.sqrt(6.0 / 5.0) * rate**2
    deviations = np.repeat((size, np.sqrt(3.0) * rate * size), len(_TRACELESS))
    return Gravity(np.diag(deviations)[:, deviations > 0.0], (GRAVITY,) * len(deviations))


def rate_of(value: Array) -> float:
    """Return the mean motion, rad/s, of an orbit with a gradient of (10,) numbers at the begin."""
    return float((value[:5] @ value[:5] / 6.0) ** 0.25)
