"""What an orbit does to the momentum of bodies: tide and gravity gradient, linear in their standard parameters.

In the frame that falls along, gravity leaves G x at x from its origin, with a symmetric G. A body at x, of axes R, has

    P' = G (m x + R h),    L' = x x P' + R h x G x + 3 k R [s]x I_o s,    s = R^T up, k = mu / r^3

(Hughes 1986, chapter 8, in standard parameters): a column for each of them, whatever a body may turn out to be.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, bracket, cross, rotate_back, skew
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.kinematics import Configuration
from mbaid_ros.core.robot.model import Link, express
from mbaid_ros.core.samples import Samples

OF_A_THRUSTER = 5  # numbers that say how it is off its command: scale, turn about three axes, delay


def momentum_rates(orbit: Orbit, time: Array, configuration: Configuration, base_position: Array) -> Array:
    """Return how fast (P, L) about the frame's origin change by each body's standard parameters, (N, n + 1, 6, 10).

    Parameters
    ----------
    orbit : Orbit
    time : (N,) s after the epoch
    configuration : of all bodies at N instants
    base_position : (N, 3) m
    """
    rotation, place = configuration.rotation, base_position[:, None] + configuration.position
    gradient, up = orbit.gradient(time)[:, None], orbit.upward(time)[:, None]
    pull = (gradient @ place[..., None])[..., 0]
    first = gradient @ rotation
    seen = rotate_back(rotation, np.broadcast_to(up, place.shape))
    rates = np.zeros((*place.shape[:2], 6, 10))
    rates[..., :3, 0], rates[..., :3, 1:4] = pull, first
    rates[..., 3:, 0] = cross(place, pull)
    rates[..., 3:, 1:4] = skew(place) @ first - skew(pull) @ rotation
    strength = orbit.strength(time)[:, None, None, None]
    rates[..., 3:, 4:] = 3.0 * strength * (rotation @ (skew(seen) @ bracket(seen)))
    return rates


def about(brought: Array, position: Array, numbers: int = 10) -> Array:
    """Return (N, 60 b) columns of (P, L) about the origin as (N, b, 6, 10) ones about (N, 3) points.

    Of what each has another number of instead of ten standard parameters, likewise.
    """
    columns = brought.reshape(len(brought), brought.shape[1] // (6 * numbers), 6, numbers).copy()
    if not columns.size:
        return columns
    columns[..., 3:, :] -= skew(position)[:, None] @ columns[..., :3, :]
    return columns


def of_link(columns: Array, link: Link) -> Array:
    """Return the (N, 6, 10) columns of a link's standard parameters in its own frame, from those of all bodies."""
    to_body = express(np.eye(10), link.rotation, link.position).T
    return np.asarray(columns[:, link.body] @ to_body)


def of_bodies(columns: Array, parameters: Array) -> Array:
    """Return the (N, 6) sum over (n + 1, 10) standard parameters of all bodies, each in its own frame."""
    return np.asarray(np.einsum('nbij,bj->ni', columns, parameters))


def brought(samples: Samples, parameters: Array) -> Array:
    """Return what thrust and orbit have changed (P, L) by until the last sample, (6,), about the odometry's origin.

    Parameters
    ----------
    samples : Samples
    parameters : (n + 1, 10) standard parameters of all bodies, each in its own frame
    """
    impulse = samples.impulse[-1]
    if not samples.tide.shape[1]:
        return impulse
    return np.asarray(impulse + of_bodies(about(samples.tide[-1:], np.zeros((1, 3))), parameters)[0])
