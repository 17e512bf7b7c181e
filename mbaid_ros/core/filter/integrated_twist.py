"""The integrated twist beside poses with correlated errors (trajectory.md, eqs. 9 and 10).

Integrated over windows, the joints' noise in the predicted twist telescopes: neighbours share only its effect c on the
pose at the border, which is carried from window to window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.filter.measured_window import IntegratedTwist
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class TwistLink:
    """How a window's measurements depend on c (k,), and c on the next window's; q (k,) are of unit variance."""

    # by_noise, by_carried: (w, k) derivatives of a window's w whitened measurements by q and c
    by_noise: Array
    by_carried: Array
    # way_value, way_rows, back: (k,), (k, v), (k, k): q = back (c' - c - process noise + value - rows variables)
    way_value: Array
    way_rows: Array
    back: Array
    process: Array  # (k, n) of that noise, as in `WhitenedWindow`


def linked(
    twist: IntegratedTwist,
    pose: tuple[Array, Array, Array],
    joints: tuple[Array, Array],
    variables: Variables,
) -> tuple[list[tuple[Array, Array, Array, TwistLink]], Array]:
    """Return value, rows, log_noise and link of B windows by pose and integrated twist, as in `WhitenedWindow`.

    Second, (B, 6, 6) S^-1 of these measurements as the joints' noise is in them. The measured way, free of that noise,
    takes the place of the change of xi that whitens the mean pose.

    Parameters
    ----------
    twist, variables : of the B windows; of the filter
    pose : value (B, 6), rows (B, 6, s) and covariance (B, 6, 6)
    joints : (B, 6, n), (B, 6, n') factors of their noise in the mean pose, and on the way
    """
    select, (value, rows, covariance), (of_joints, process) = variables.measured, pose, joints
    size, change = len(select), twist.change[:, None]
    values = np.concatenate(
        ((value - change * twist.way_value) @ select.T, twist.mean_value @ select.T),
        axis=1,
    )
    by_state = np.concatenate(
        (select @ (rows - change[..., None] * twist.way_rows), select @ twist.mean_rows),
        axis=1,
    )
    common = of_joints @ np.swapaxes(of_joints, -1, -2)
    factor = np.linalg.cholesky(select @ twist.white @ select.T)
    noise = np.zeros((len(value), 2 * size, 2 * size))
    noise[:, :size, :size] = select @ covariance @ select.T
    noise[:, :size, size:] = noise[:, size:, :size] = select @ common @ select.T
    noise[:, size:, size:] = select @ (common + twist.left[:, None, None] * twist.white) @ select.T
    by_noise = np.concatenate((-change[..., None] * factor, twist.share[:, None, None] * factor), axis=1)
    by_carried = np.concatenate((np.zeros((size, size)), np.eye(size)))
    triangle = np.linalg.cholesky(noise)
    whiten = np.linalg.inv(triangle)
    links = map(
        TwistLink,
        whiten @ by_noise,
        whiten @ by_carried,
        twist.way_value @ select.T,
        select @ variables.rows(twist.way_rows),
        np.linalg.inv(factor),
        select @ process,
    )
    both = block_diag(select, select).reshape(2, size, 2, 6).sum(axis=2).reshape(2 * size, 6)
    certain = _certain(noise + by_noise @ np.swapaxes(by_noise, -1, -2), by_carried, factor)
    log_noise = 2.0 * np.add.reduce(np.log(np.diagonal(triangle, axis1=1, axis2=2).T.copy()), axis=0)
    white = (whiten @ values[..., None])[..., 0], whiten @ variables.rows(by_state), log_noise
    return list(zip(*white, links, strict=True)), both.T @ certain @ both


def _certain(noise: Array, by_carried: Array, walk: Array) -> Array:
    """Return the (B, w, w) inverse of the covariance of the measurements, with c as certain as all windows make it.

    c is a random walk. Measured with a variance r times that of its step, it keeps 1 / sqrt(1 + 4 r) of r: the smoothed
    variance far from the ends of a run.

    Parameters
    ----------
    noise, by_carried : (B, w, w) covariance of the measurements given c, and (w, k) their derivative by c
    walk : (B, k, k) factor of the covariance of a step of c
    """
    inverse = np.linalg.inv(noise)
    seen = inverse @ by_carried @ walk
    size, along = np.linalg.eigh(np.swapaxes(by_carried @ walk, -1, -2) @ seen)
    size = np.maximum(size, 1e-12)
    left = (seen @ along) / np.sqrt(np.sqrt(size * (size + 4.0)))[:, None]
    return np.asarray(inverse - left @ np.swapaxes(left, -1, -2))
