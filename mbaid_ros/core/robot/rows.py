"""The rows of the momentum equations alone, of thousands of samples at once: no more than they need, and fast.

What `BodyStates` says of the momentum and its regressor, by a recursion from the base outwards. The samples stand last
in every array here, so that each product is one of long vectors; as nothing mixes samples, a batch is its samples to
the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, unvec
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.samples import Samples


@dataclass(frozen=True)
class MomentumRows:
    """Momentum equations of N samples, about the base link's origin, odometry axes.

    Attributes
    ----------
    known : (6, N) momentum (P_k, L_k) of the known bodies
    regressors : (6, 10, N) Y of each unknown link
    """

    known: Array
    regressors: tuple[Array, ...]


@dataclass(frozen=True)
class _Motion:
    """The motion of b bodies at N samples; the components of vectors stand first, so that products are of long vectors.

    Attributes
    ----------
    rotation : (3, 3, b, N) body to odometry axes
    position : (3, b, N) m, of the origins relative to the base's
    velocity, rate : (3, b, N) m/s, rad/s of the origins, odometry axes
    """

    rotation: Array
    position: Array
    velocity: Array
    rate: Array

    def of(self, link: Link) -> _Motion:
        """Return the motion of a link's frame, without the axis of the bodies."""
        rotation, position, velocity, rate = (
            values[..., link.body, :] for values in (self.rotation, self.position, self.velocity, self.rate)
        )
        lever = _turned(rotation, link.position[:, None])
        turned = np.stack([_turned(rotation, column[:, None]) for column in link.rotation.T], axis=1)
        return _Motion(turned, position + lever, velocity + _cross(rate, lever), rate)


def momentum_rows(kernel: MomentumKernel, samples: Samples) -> MomentumRows:
    """Return the momentum equations of N samples."""
    motion = _motion(kernel, samples)
    return MomentumRows(_momentum(motion, kernel.known), tuple(_regressor(motion.of(link)) for link in kernel.unknown))


def _motion(kernel: MomentumKernel, samples: Samples) -> _Motion:
    """Return the motion of all bodies, from the base outwards."""
    model, kinematics = kernel.model, kernel.kinematics
    angle, speed = (np.ascontiguousarray(values.T) for values in (samples.joint_position, samples.joint_velocity))
    parents, count = list(model.parents), len(model.parents) + 1
    rotation = np.empty((3, 3, count, len(samples)))
    position, velocity, rate = np.zeros((3, 3, count, len(samples)))
    rotation[:, :, 0] = np.moveaxis(samples.base_rotation, 0, -1)
    velocity[:, 0], rate[:, 0] = samples.base_linear_velocity.T, samples.base_angular_velocity.T
    local = kinematics.local(np.sin(angle), np.cos(angle))
    for joint, parent in enumerate(parents):
        rotation[:, :, joint + 1] = _product(rotation[:, :, parent], local[:, :, joint])
    carrier = rotation[:, :, parents]
    axis, lever = (_turned(carrier, vectors.T[..., None]) for vectors in (kinematics.axes, model.positions))
    slides = np.array(model.prismatic, dtype=bool).reshape(-1, 1)
    lever += axis * np.where(slides, angle, 0.0)
    turn, slide = axis * np.where(slides, 0.0, speed), axis * np.where(slides, speed, 0.0)
    for joint, parent in enumerate(parents):
        rate[:, joint + 1] = rate[:, parent] + turn[:, joint]
    swing = _cross(rate[:, parents], lever) + slide
    for joint, parent in enumerate(parents):
        velocity[:, joint + 1] = velocity[:, parent] + swing[:, joint]
        position[:, joint + 1] = position[:, parent] + lever[:, joint]
    return _Motion(rotation, position, velocity, rate)


def _momentum(motion: _Motion, parameters: Array) -> Array:
    """Return the (6, N) momentum of all bodies with (b, 10) parameters, each in its own frame."""
    mass, first_moment, inertia = parameters[:, 0, None], parameters[:, 1:4].T[..., None], unvec(parameters[:, 4:])
    first = _turned(motion.rotation, first_moment)
    spin = _turned(np.moveaxis(inertia, 0, -1)[..., None], _turned_back(motion.rotation, motion.rate))
    # P = m v + w x h;  L = h x v + I_o w about the body's origin
    linear = mass * motion.velocity + _cross(motion.rate, first)
    angular = _cross(first, motion.velocity) + _turned(motion.rotation, spin) + _cross(motion.position, linear)
    bodies = np.concatenate((linear, angular))
    total = bodies[:, 0]
    for body in range(1, len(parameters)):  # one by one: how numpy sums depends on the number of samples
        total = total + bodies[:, body]
    return total


def _regressor(link: _Motion) -> Array:
    """Return the (6, 10, N) Y of a link; see `momentum.regressor`."""
    rotation, position, velocity, rate = link.rotation, link.position, link.velocity, link.rate
    matrix = np.zeros((6, 10, rate.shape[-1]))
    # P = m v + [w]x R h
    first = _cross(rate[:, None], rotation)
    matrix[:3, 0], matrix[:3, 1:4] = velocity, first
    # L_b = m r x v + ([r]x [w]x R - [v]x R) h + R bracket(R^T w) vec(I_o)
    matrix[3:, 0] = _cross(position, velocity)
    matrix[3:, 1:4] = _cross(position[:, None], first) - _cross(velocity[:, None], rotation)
    x, y, z = _turned_back(rotation, rate)
    along = rotation.swapaxes(0, 1)
    matrix[3:, 4] = along[0] * x
    matrix[3:, 5] = along[0] * y + along[1] * x
    matrix[3:, 6] = along[0] * z + along[2] * x
    matrix[3:, 7] = along[1] * y
    matrix[3:, 8] = along[1] * z + along[2] * y
    matrix[3:, 9] = along[2] * z
    return matrix


def _turned(rotation: Array, vector: Array) -> Array:
    """Return R a."""
    return _contracted(rotation.swapaxes(0, 1), vector)


def _turned_back(rotation: Array, vector: Array) -> Array:
    """Return R^T a."""
    return _contracted(rotation, vector)


def _product(left: Array, right: Array) -> Array:
    """Return the product of two matrices."""
    return _contracted(left.swapaxes(0, 1)[:, :, None], right[:, None])


def _contracted(left: Array, right: Array) -> Array:
    """Return the sum of the products along the first axis."""
    return np.asarray(left[0] * right[0] + left[1] * right[1] + left[2] * right[2])


def _cross(left: Array, right: Array) -> Array:
    """Return a x b."""
    (a, b, c), (x, y, z) = left, right
    product = np.empty(np.broadcast_shapes(left.shape, right.shape))
    product[0] = b * z - c * y
    product[1] = c * x - a * z
    product[2] = a * y - b * x
    return product
