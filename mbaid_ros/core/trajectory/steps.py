"""Windows in the filter's variables, measurements in units of their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.belief import Coordinates
from mbaid_ros.core.trajectory.chain import BODY, WindowModel

_POSE = slice(0, 6)


@dataclass(frozen=True)
class Step:
    """A window in the filter's variables, measurements in units of their noise.

    Attributes
    ----------
    value, rows : (k,), (k, v): value = rows variables + white noise of variance 1
    log_noise : logarithm of the determinant of the noise's covariance
    transition, drift, process : (v, v), (v,), (v, n): to the next window's first node, without force; a factor of the
        covariance of what joint noise adds on the way
    shared : (v,) the score that noise makes on average because rows and value share it
    window : what it was made of
    """

    value: Array
    rows: Array
    log_noise: float
    transition: Array
    drift: Array
    process: Array
    shared: Array
    window: WindowModel


def prepare(window: WindowModel, coordinates: Coordinates) -> Step:
    """Return one window's step of the filter (see `prepared`)."""
    several = WindowModel(*(np.asarray(part)[None] for part in vars(window).values()))
    return prepared(several, coordinates)[0]


def prepared(windows: WindowModel, coordinates: Coordinates) -> list[Step]:
    """Return the steps of the filter for B windows."""
    joints = (windows.joints, windows.joints_by_parameters)
    *pose, shared = _whitened(windows.pose_value, windows.pose_rows, windows.pose_covariance, joints, coordinates)
    moving = np.flatnonzero(np.all(np.isfinite(windows.twist_value), axis=-1))
    own = windows[moving]
    joints = (own.joints, own.joints_by_parameters)
    *twist, own_shared = _whitened(own.twist_value, own.twist_rows, own.twist_covariance, joints, coordinates)
    shared[moving] += own.joints_in_twist[:, None] * own_shared
    measured = list(zip(*pose, strict=True))
    both = [np.concatenate((part[moving], more), axis=1) for part, more in zip(pose, twist, strict=True)]
    for index, parts in zip(moving.tolist(), zip(*both, strict=True), strict=True):
        measured[index] = parts
    gather, spread = coordinates.gather, coordinates.spread
    # The whole state's transition is that of the pose error beside 1: 1 + turn (transition - (1, 0)) spread.
    turn = gather[:, _POSE]
    change = windows.transition - np.eye(6, len(spread))
    transition = np.eye(len(gather)) + turn @ (change @ spread)
    drift, process = (turn @ windows.drift[..., None])[..., 0], turn @ windows.process
    steps = []
    for index, (value, rows, deviation) in enumerate(measured):
        step = Step(
            value=value,
            rows=rows,
            log_noise=2.0 * float(np.sum(np.log(deviation))),
            transition=transition[index],
            drift=drift[index],
            process=process[index],
            shared=shared[index],
            window=windows[index],
        )
        steps.append(step)
    return steps


def _whitened(
    value: Array, rows: Array, covariance: Array, joints: tuple[Array, Array], coordinates: Coordinates
) -> tuple[Array, Array, Array, Array]:
    """Return (B, k) values and (B, k, v) rows in units of their noise, and the diagonal of its Cholesky factor.

    And last, for the joints' noise in the values (B, 6, n) and in the rows (B, 6, u - 6, n), the mean of the product of
    both, the (B, v) score that this noise makes by itself.
    """
    select = coordinates.measured
    factor = np.linalg.cholesky(select @ covariance @ select.T)
    noise, slope = joints
    columns = slope.reshape(*slope.shape[:2], slope.shape[2] * slope.shape[3])
    parts = (rows @ coordinates.spread, value[..., None], noise, columns)
    white = np.linalg.solve(factor, select @ np.concatenate(parts, axis=-1))
    ends = np.cumsum([part.shape[-1] for part in parts[:-1]])
    own, known, noise, columns = np.split(white, ends, axis=-1)
    score = np.sum(columns.reshape(*columns.shape[:2], *slope.shape[2:]) * noise[..., None, :], axis=(1, 3))
    bodies = coordinates.spread[BODY.start : BODY.start + score.shape[-1]]
    return known[..., 0], own, np.diagonal(factor, axis1=-2, axis2=-1), score @ bodies
