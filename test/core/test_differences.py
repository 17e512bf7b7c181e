"""The statistics that noise levels are made of: medians, weights and variances of differences, on white noise."""

from __future__ import annotations

import numpy as np
import pytest

from checked import generic
from mbaid_ros.core.geometry import exp
from mbaid_ros.core.noise import (
    BINOMIAL,
    CHANNELS,
    Differences,
    NoiseLevels,
    _correlation_factor,
    _turns,
    _weights,
    median,
    variances,
    white_noise,
)


@pytest.mark.parametrize('count', [1, 2, 3, 8, 9])
def test_the_median_is_that_of_numpy(count: int) -> None:
    values = np.random.default_rng(count).normal(size=(count, 3))
    assert median(values) == pytest.approx(np.median(values, axis=0))


@pytest.mark.parametrize('order', [1, 2, 4])
def test_the_deviation_of_white_noise_is_found_beside_a_motion(order: int) -> None:
    rng, time = np.random.default_rng(order), np.arange(20_000.0)
    motion = 1e-4 * time[:, None] ** (order - 1)  # differences of this order do not see it
    values = motion + np.array([0.1, 3.0]) * rng.normal(size=(len(time), 2))
    assert white_noise(values, order) == pytest.approx([0.1, 3.0], rel=0.04)


def test_differences_of_uneven_readings_cancel_polynomials_and_vary_as_one_error() -> None:
    stamp = np.cumsum(np.random.default_rng(0).integers(5_000_000, 15_000_000, (4, 7)), axis=1)
    weights = _weights(stamp)
    assert np.sum(weights**2, axis=1) == pytest.approx(np.ones(4))
    time = (stamp - stamp[:, :1]) * 1e-7
    for power in range(6):
        assert np.sum(weights * time**power, axis=1) == pytest.approx(np.zeros(4), abs=1e-9 * 10.0**power)
    assert np.all(np.abs(np.sum(weights * time**6, axis=1)) > 1.0)
    even = _weights(np.arange(0, 70_000_000, 10_000_000)[None])[0]
    assert even == pytest.approx(BINOMIAL)
    nearly = _weights(np.array([[0, 10_000_000, 20_000_000, 30_000_000, 40_000_000, 50_000_000, 60_000_001]]))[0]
    assert nearly == pytest.approx(BINOMIAL, abs=1e-5)
    assert _weights(np.array([[0, 5]]))[0] == pytest.approx([-np.sqrt(0.5), np.sqrt(0.5)])


@pytest.mark.parametrize(('order', 'jitter'), [(6, 0), (6, 3_000_000), (1, 0)])
def test_counted_differences_have_the_variance_of_the_noise(order: int, jitter: int) -> None:
    """Of two kinds of readings, one with a third of the declared noise and one with four times as much."""
    rng, count = np.random.default_rng(order + jitter), 2000
    stamp = 10_000_000 * np.arange(count) + rng.integers(-jitter, jitter + 1, count)
    values = np.column_stack((rng.normal(size=(count, 3)) * 0.1, rng.normal(size=(count, 3)) * 4.0))
    differences = Differences((slice(0, 3), slice(3, 6)), (1, 4), order)
    for piece in np.array_split(np.arange(count), 5):
        differences.add(stamp[piece], values[piece], np.tile([0.3, 1.0], (len(piece), 1)))
    differences.count(int(stamp[-1]))
    found = variances(differences.counts)
    # Rows of a kind lie together, by stride; every fourth of the wide ones is counted, so that these are fewer.
    assert found == pytest.approx([1.0 / 9.0, 1.0 / 9.0, 16.0, 16.0], rel=0.2)
    assert found[::2] == pytest.approx([1.0 / 9.0, 16.0], rel=0.1)
    assert variances(np.zeros_like(differences.counts)).tolist() == [0.0] * 4


def test_small_turns_are_read_off_a_difference_of_matrices() -> None:
    rotation, turn = exp(generic(0, 2, 3)), 1e-6 * generic(1, 2, 3)
    difference = exp(turn) @ rotation - rotation
    assert _turns(difference.reshape(2, 9), rotation.reshape(2, 9)) == pytest.approx(turn, rel=1e-5)


def test_slow_means_of_correlated_readings_vary_as_those_of_an_autoregression() -> None:
    """By (1 + c) / (1 - c), c the correlation of neighbours; as independent ones where the spacing is unknown."""
    kept = np.exp(-0.1 / 0.4)
    assert _correlation_factor(np.array([0.1, 0.0]), 0.4) == pytest.approx([(1.0 + kept) / (1.0 - kept), 1.0])
    assert _correlation_factor(np.array([0.1, 0.2]), 0.0).tolist() == [1.0, 1.0]


def levels(declared: float, estimated: float, *, used: bool = False, contradicted: bool = False) -> NoiseLevels:
    """Return levels as declared but for those of the base's position."""
    here = np.isin(CHANNELS, 'base_position')
    usual = np.full(len(CHANNELS), 1e-3)
    return NoiseLevels(
        declared=np.where(here, declared, usual),
        estimated=np.where(here, estimated, usual),
        assumed=np.full(len(CHANNELS), np.nan),
        correlation_time=0.0,
        used=here & used,
        contradicted=here & contradicted,
    )


@pytest.mark.parametrize(
    ('found', 'text'),
    [
        (levels(1e-3, 1.2e-3), ''),
        (levels(1e-3, 0.8e-3), ''),
        (levels(1e-3, 2e-3), 'base position: your noise value, 0.001 m, is 2 times too small: 0.002 m in the data'),
        (
            levels(1e-3, 2.5e-4, used=True),
            'base position: your noise value, 0.001 m, is 4 times too large: 0.00025 m in the data; the data are used',
        ),
        (levels(1e-3, np.nan), ''),
        (levels(np.nan, 2e-3), 'no noise is set for base position (0.002 m): estimated from the data'),
    ],
)
def test_what_differs_from_the_declared_noise_is_listed(found: NoiseLevels, text: str) -> None:
    assert '; '.join(found.differences()) == text


def test_a_declared_level_that_is_replaced_is_warned_of() -> None:
    assert levels(1e-3, 2e-3).warnings == []
    assert levels(1e-3, 2e-3).as_declared
    wrong = levels(1e-3, 2e-3, used=True, contradicted=True)
    text = 'the noise set for the odometry is wrong: base position 2 times too small: 0.002 m is used, not 0.001'
    assert wrong.warnings == [text]
    assert not wrong.as_declared
    assert wrong.rows()[2] == ('base position', 'm', '0.002 estimated, 0.001 set')
    assert levels(1e-3, 2e-3).rows()[2] == ('base position', 'm', '0.001 set, 0.002 estimated')
