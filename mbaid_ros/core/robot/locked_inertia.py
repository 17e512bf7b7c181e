"""Inertia and momentum of the whole robot, by the pseudo-inertias of its bodies: no inertia is turned on its own."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.robot.inertia import pseudo_inertia
from mbaid_ros.core.robot.kinematics import Configuration

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # the cyclic neighbours of each axis


def mobility_and_momentum(parameters: Array, configuration: Configuration, body_twist: Array) -> tuple[Array, Array]:
    """Return the inverse of the locked inertia and the momentum of all bodies, about the base's origin, odometry axes.

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
    (N, 6, 6) M^-1 with twist = M^-1 momentum for a robot that moves as one body, and the (N, 6) momentum (P, L) at the
    twists

    Raises
    ------
    LinAlgError
        All mass lies on a line, and M has no inverse.
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
    momentum = np.empty((count, 6))
    momentum[:, :3] = pseudo[..., 3].ravel() @ both[..., 4:]
    momentum[:, 3:] = moving[:, _NEXT, _LAST] - moving[:, _LAST, _NEXT]
    return _mobility(float(np.sum(parameters[:, 0])), first, second), momentum


def _mobility(mass: float, first: Array, second: Array) -> Array:
    """Return M^-1 (N, 6, 6) of a mass, the integrals (N, 3) of x and (N, 3, 3) of x x^T over it.

    With c the centre of mass and K the inverse of the inertia about it, w = K (L - c x P) and u = P / m + c x w.

    Raises
    ------
    LinAlgError
        There is no K: all mass lies on a line.
    """
    centre = first / mass
    about = second - mass * centre[:, :, None] * centre[:, None]
    turned = skew(centre)
    inertia = np.trace(about, axis1=1, axis2=2)[:, None, None] * np.eye(3) - about
    # By its cofactors: LAPACK's calls take longer, for so small a matrix.
    cofactors = cross(inertia[:, _NEXT], inertia[:, _LAST])
    determinant = np.add.reduce(inertia[:, 0] * cofactors[:, 0], axis=-1)
    if not determinant.all():
        raise np.linalg.LinAlgError('no inertia about the centre of mass')
    inverse = cofactors / determinant[:, None, None]
    across = turned @ inverse
    mobility = np.empty((len(first), 6, 6))
    mobility[:, :3, :3] = np.eye(3) / mass - across @ turned
    mobility[:, :3, 3:], mobility[:, 3:, :3], mobility[:, 3:, 3:] = across, across.swapaxes(1, 2), inverse
    return mobility
