"""Odometry whose errors are not white: alike from pose to pose, or far off now and then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from mbaid_ros.core.geometry import Array, exp, log, rotation_from_quaternion
from mbaid_ros.core.samples import BaseStream
from mbaid_ros.simulation.simulation import Truth

_FAR, _TURNED = 0.2, np.radians(5.0)  # m, rad: how far outliers are off


def coloured(white: Array, time: Array, constant: float) -> Array:
    """Return errors (N, 3) at (N,) s as an autoregression with a time constant (s), as large as the white ones are."""
    keep = float(np.exp(-np.mean(np.diff(time)) / constant))
    scale = np.full((len(white), 1), np.sqrt(1.0 - keep**2))
    scale[0] = 1.0
    return np.asarray(lfilter([1.0], [1.0, -keep], scale * white, axis=0))


def correlated(base: BaseStream, truth: Truth, constant: float) -> BaseStream:
    """Return poses whose errors have a time constant (s) and the size that they had, white, before."""
    true = rotation_from_quaternion(truth.base_orientation)
    rotation = exp(coloured(log(base.rotation @ np.swapaxes(true, 1, 2)), truth.time, constant)) @ true
    return _posed(
        base, truth.base_position + coloured(base.position - truth.base_position, truth.time, constant), rotation
    )


def outliers(base: BaseStream, share: float, seed: int) -> BaseStream:
    """Return poses of which a share is far off."""
    rng = np.random.default_rng([seed, 2])
    hit = (rng.random(len(base.stamp)) < share)[:, None]
    away, turn = (_directions(rng, len(hit)) for _ in range(2))
    return _posed(base, base.position + hit * _FAR * away, exp(hit * _TURNED * turn) @ base.rotation)


def _directions(rng: np.random.Generator, count: int) -> Array:
    drawn = rng.normal(size=(count, 3))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1)[:, None])


def _posed(base: BaseStream, position: Array, rotation: Array) -> BaseStream:
    """Return a stream with other poses; its twist is told in axes that turn along."""
    turn = rotation @ np.swapaxes(base.rotation, 1, 2)
    linear, angular = ((turn @ each[..., None])[..., 0] for each in (base.linear_velocity, base.angular_velocity))
    return replace(base, position=position, rotation=rotation, linear_velocity=linear, angular_velocity=angular)
