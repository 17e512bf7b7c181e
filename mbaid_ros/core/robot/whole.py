"""Inertia and momentum of the whole robot, by the pseudo-inertias of its bodies: no inertia is turned on its own."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.robot.inertia import pseudo_inertia
from mbaid_ros.core.robot.kinematics import Configuration

_AXES = np.arange(3)
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # the cyclic neighbours of each axis


def whole(parameters: Array, configuration: Configuration, body_twist: Array) -> tuple[Array, Array]:
    """Return the locked inertia and the momentum of all bodies, about the base's origin, odometry axes.

    A point y of a body is at x = P (y, 1) and moves with v = V (y, 1), for P = (R, r) and V = [w]x P + (0, u). With the
    body's pseudo-inertia J, the integral of (y, 1) (y, 1)^T over its mass, those of x x^T, x v^T, x and v are
    P J P^T, P J V^T, and the last columns of P J and V J. All bodies are summed up in one product.

    Parameters
    ----------
    parameters : (b, 10) standard parameters of the bodies, each in its own frame
    configuration : of N instants
    body_twist : (N, b, 6) (u, w) at the base's origin

    Returns
    -------
    (N, 6, 6) M with momentum = M twist for a robot that moves as one body, and the (N, 6) momentum (P, L) at the twists
    """
    count, bodies = configuration.position.shape[:2]
    place = np.concatenate((configuration.rotation, configuration.position[..., None]), axis=-1)
    velocity = skew(body_twist[..., 3:]) @ place
    velocity[..., 3] += body_twist[..., :3]
    pseudo = pseudo_inertia(parameters)
    weighed = (place @ pseudo).swapaxes(1, 2).reshape(count, 3, 4 * bodies)
    columns = np.zeros((count, bodies, 4, 7))
    columns[..., :3], columns[:, :, 3, 3], columns[..., 4:] = place.swapaxes(2, 3), 1.0, velocity.swapaxes(2, 3)
    both = columns.reshape(count, 4 * bodies, 7)
    moments = weighed @ both  # (N, 3, 7): of x x^T, x, x v^T
    second, first, moving = moments[..., :3], moments[..., 3], moments[..., 4:]
    locked = np.zeros((count, 6, 6))
    lever = skew(first)
    locked[:, _AXES, _AXES] = np.sum(parameters[:, 0])
    locked[:, :3, 3:], locked[:, 3:, :3] = -lever, lever
    locked[:, 3:, 3:] = -second
    locked[:, 3 + _AXES, 3 + _AXES] += (second[:, 0, 0] + second[:, 1, 1] + second[:, 2, 2])[:, None]
    momentum = np.empty((count, 6))
    momentum[:, :3] = pseudo[..., 3].ravel() @ both[..., 4:]
    momentum[:, 3:] = moving[:, _NEXT, _LAST] - moving[:, _LAST, _NEXT]
    return locked, momentum
