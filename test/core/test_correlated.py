"""Noise with a time constant: how poses are weighted, and how it is recognised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.innovations import seen_in
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.levels import FoundNoise
from mbaid_ros.core.sensors.synchroniser import Synchroniser
from measured import base_stream, joint_stream
from observed import MID

STEP, SIZE = 0.01, 1e-3  # s, m


def coloured(constant: float, count: int, seed: int) -> Array:
    """Return (count, 3) numbers of unit variance with a time constant (s)."""
    keep = np.exp(-STEP / constant)
    values = np.random.default_rng(seed).normal(size=(count, 3))
    for index in range(1, count):
        values[index] = keep * values[index - 1] + np.sqrt(1.0 - keep**2) * values[index]
    return values


def samples(error: Array, every: int = 1, constant: float = 0.0) -> Samples:
    """Return samples of a moving base whose positions have an error; one in so many comes."""
    stamps = 1_700_000_000_000_000_000 + np.round(1e9 * STEP * np.arange(len(error))).astype(np.int64)
    base = base_stream(stamps)
    base.position[:] += SIZE * error
    base.pose_covariance[:, :3, :3] = SIZE**2 * np.eye(3)
    found = Synchroniser(1.0).push(joint_stream(stamps), base[::every])
    assert found is not None
    noise = replace(MID, base_correlation_time=constant)
    return FoundNoise(noise, found.joint_position.shape[1]).applied(found, 0)[0]


@pytest.mark.parametrize('constant', [0.05, 0.3, 2.0])
def test_the_time_is_seen_in_a_window(constant: float) -> None:
    found = [seen_in(samples(coloured(constant, 100, seed)))[0] for seed in range(20)]
    assert np.median(found) == pytest.approx(constant, rel=0.15)


def test_neither_white_noise_nor_interpolated_poses_are_taken_for_correlated() -> None:
    for seed in range(20):
        white = np.random.default_rng(seed).normal(size=(100, 3))
        assert seen_in(samples(white)) == (0.0, 0.0)
        assert seen_in(samples(white, every=10)) == (0.0, 0.0)


def test_poses_weigh_as_much_less_as_their_slow_means_vary() -> None:
    nothing = np.zeros((100, 3))
    keep = np.exp(-STEP / 0.3)
    ratio = samples(nothing, constant=0.3).pose_covariance[1:, 0, 0] / samples(nothing).pose_covariance[1:, 0, 0]
    np.testing.assert_allclose(ratio, (1.0 + keep) / (1.0 - keep), rtol=1e-9)
    np.testing.assert_array_equal(samples(nothing, constant=0.3).twist_covariance, samples(nothing).twist_covariance)
