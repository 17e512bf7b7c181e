"""Errors in variables: the joints' noise in a window's rows feigns information, and intervals are wider without it.

Least squares counts noise in its rows as if motion had made it. The score that this adds to the estimate is taken off
(`joint_noise`), at the estimate itself; what the score changes by on the way there is information that is none. Where
motion hardly moves the joints more than noise does, most of what seems known is of that kind (Fuller 1987, chapter 1,
there of one variable: the reliability ratio).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.state import BODY
from mbaid_ros.core.trajectory.variables import Variables

_MOST = 0.99  # part of what is known that may be feigned: beyond, intervals are a hundred times as wide


def feigned_information(precision: Array, slope: Array, body: Array, variables: Variables) -> Array:
    """Return the information of the target body that the joints' noise in the rows makes, in the filter's variables.

    Parameters
    ----------
    precision : (B, 6, 6) S^-1 of what B windows measure, the joints' noise in pose and twist together
    slope : (B, 6, 10 + e, n) that noise in the rows, of the target body and the unknowns
    body : (B, 10) standard parameters of the target that they are linearised at
    variables : of the filter

    Returns
    -------
    (B, b, b + 1) array, of the b variables of the body: the information M, and M times where they are linearised
    """
    of_body = slope[:, :, :10].transpose(0, 3, 1, 2) @ variables.spread[BODY, variables.body]
    weighed = precision[:, None] @ of_body  # (B, n, 6, b)
    windows, joints, numbers, count = of_body.shape
    flat = of_body.reshape(windows, joints * numbers, count)
    information = np.swapaxes(flat, 1, 2) @ weighed.reshape(flat.shape)  # M of docs/trajectory.md, eq. 13
    at = variables.gather[variables.body, BODY] @ body[..., None]
    return np.concatenate((information, information @ at), axis=-1)


def nothing_feigned(variables: Variables) -> Array:
    """Return the same, (b, b + 1), of no window."""
    count = variables.own - variables.head
    return np.zeros((count, count + 1))


@dataclass(frozen=True)
class Attenuation:
    """What noise in the rows makes of the errors of the body's b variables, P their covariance as it seems.

    M is that of docs/trajectory.md, eq. 13; what is published by these that of docs/trajectory.md, eq. 14.

    Attributes
    ----------
    gain : (b, b) N of (1 - P M)^-1 = 1 + P N, which errors are larger by
    score : (b, b) K: their covariance has (1 - P M)^-1 P M P (1 - M P)^-1 = P K K^T P beside, of the score itself
    shift : (b,) s: the estimate would be P s elsewhere if windows had been linearised there
    """

    gain: Array
    score: Array
    shift: Array

    @staticmethod
    def of(covariance: Array, feigned: Array, mean: Array) -> Attenuation:
        """Return it for mean (b,) and covariance (b, b) as they seem, and what is feigned (b, b + 1)."""
        root, (information, at) = np.linalg.cholesky(covariance), np.split(feigned, [-1], axis=1)
        # With P = F F^T and F^T M F = V diag(mu) V^T:  N = F^-T V diag(mu / (1 - mu)) V^T F^-1.
        part, along = np.linalg.eigh(root.T @ information @ root)
        part = np.clip(part, 0.0, _MOST)
        back = solve_triangular(root, along, trans='T', lower=True)
        gain = (back * (part / (1.0 - part))) @ back.T
        score = information @ mean - at[:, 0]
        return Attenuation(gain, back * (np.sqrt(part) / (1.0 - part)), score + gain @ covariance @ score)
