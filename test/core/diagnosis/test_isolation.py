"""What distinguishes causes: likelihood gains, the noise of samples, lines in a spectrum, and their ranking."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import chdtri
from scipy.stats import multivariate_normal

from checked import some
from mbaid_ros.core.diagnosis.isolation import CandidateCauses
from mbaid_ros.core.filter.posterior import PriorComparison
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.faults import joint_noise_factor
from mbaid_ros.core.odometry.faults import vibration_frequencies
from mbaid_ros.core.passive import swinging_text
from mbaid_ros.core.pipeline import Synchroniser
from mbaid_ros.core.samples import Samples
from windowed import base_stream, joint_stream

JOINT = 1e-4  # rad


def test_joints_with_readings_neither_follow_others_nor_are_passive() -> None:
    model = SimpleNamespace(transmission=SimpleNamespace(independent=np.array([0, 2, 3, 5])))
    robot = SimpleNamespace(model=model, springs=SimpleNamespace(joints=(2, 5)))
    causes = CandidateCauses.__new__(CandidateCauses)
    object.__setattr__(causes, 'layout', SimpleNamespace(kernel=robot))
    assert causes.read_joints == (0, 3)


compared = PriorComparison.from_posterior


def test_what_is_as_certain_as_declared_gains_nothing_by_less() -> None:
    assert compared(np.array([0.5]), np.array([[1e-4]])).gain(1000.0)[0] < 0.0


@pytest.mark.parametrize(
    ('reading', 'text'),
    [
        (0.0, 'rigid; set flexible.joints: [boom], flexible.boom.frequency: 0.31'),
        (1e-9, 'add to the URDF <joint name="panel"'),
    ],
)
def test_a_swing_is_of_an_unreported_joint_or_of_one_to_add(reading: float, text: str) -> None:
    positions = np.column_stack((np.linspace(0.0, 1.0, 5), np.full(5, reading)))
    windows: Any = [SimpleNamespace(knots=SimpleNamespace(joint_position=positions))]
    assert text in swinging_text(0.312, windows, ['elbow', 'boom'])


def samples(noise: float, seed: int) -> Samples:
    """Return a window in which everything moves, with noise of the joints so many times as large as declared."""
    rng = np.random.default_rng(seed)
    stamps = 1_700_000_000_000_000_000 + np.round(1e7 * np.arange(60)).astype(np.int64)
    found = some(Synchroniser(1.0).push(joint_stream(stamps), base_stream(stamps)))
    shape = found.joint_position.shape
    return replace(found, joint_position=np.sin(found.time[:, None]) + noise * JOINT * rng.normal(size=shape))


@pytest.mark.parametrize('noise', [1.0, 10.0])
def test_samples_tell_how_noisy_joints_are_whatever_moves(noise: float) -> None:
    made = [samples(noise, seed) for seed in range(8)]
    read = range(made[0].joint_position.shape[1])
    found = joint_noise_factor(made, JOINT, read)
    assert found == pytest.approx(noise, rel=0.15)
    led = [replace(each, joint_position=each.joint_position @ np.tile(np.eye(len(read)), 4) * 9.0) for each in made]
    whole = [
        replace(one, joint_position=np.concatenate((one.joint_position, other.joint_position), axis=1))
        for one, other in zip(made, led, strict=True)
    ]  # joints that follow others, with their readings nine times as large
    assert joint_noise_factor(whole, JOINT, read) == found
    assert np.isnan(joint_noise_factor(whole, JOINT, ()))


def test_a_swing_is_found_beside_a_drift_and_white_noise_has_none() -> None:
    rng = np.random.default_rng(1)
    time = 0.5 * np.arange(80)
    values = rng.normal(size=(80, 6))
    assert vibration_frequencies(values, 0.5) == []
    values += 0.02 * (time - 20.0)[:, None] ** 2
    values[:, 2] += 1.5 * np.sin(2.0 * np.pi * 0.31 * time)
    assert vibration_frequencies(values, 0.5)[0] == pytest.approx(0.31, abs=0.01)


@pytest.mark.parametrize('power', [1, 2, 3, 4])
def test_a_drift_alone_is_no_swing(power: int) -> None:
    course = np.linspace(-1.0, 1.0, 80)[:, None] ** power
    assert vibration_frequencies(np.random.default_rng(0).normal(size=(80, 6)) + 40.0 * course, 0.5) == []


NUMBERS, MEASURED = 4, 6
BEFORE = 0.05  # chance that they are declared too certain


def posterior(rows: Array, data: Array) -> tuple[Array, Array]:
    """Return mean and covariance of numbers of unit variance after data = rows numbers + noise of unit variance."""
    covariance = np.linalg.inv(np.eye(rows.shape[1]) + rows.T @ rows)
    return covariance @ rows.T @ data, covariance


def drawn(seed: int, size: float, seen: float) -> tuple[Array, Array]:
    """Return the posterior of numbers that are so many times as large as declared."""
    random = np.random.default_rng(seed)
    rows = seen * random.normal(size=(MEASURED, NUMBERS))
    return posterior(rows, rows @ (size * random.normal(size=NUMBERS)) + random.normal(size=MEASURED))


@pytest.mark.parametrize('seed', range(5))
def test_the_gain_is_that_of_the_likelihood_of_the_data(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, data = random.normal(size=(MEASURED, NUMBERS)), 5.0 * random.normal(size=MEASURED)

    def likelihood(factor: float) -> float:
        covariance = np.eye(MEASURED) + factor**2 * rows @ rows.T
        return float(multivariate_normal(np.zeros(MEASURED), covariance).logpdf(data))

    expected = {factor: likelihood(factor) - likelihood(1.0) for factor in (3.0, 10.0)}
    most, factor = compared(*posterior(rows, data)).gain(10.0)
    assert factor == max(expected, key=lambda each: expected[each])
    assert most == pytest.approx(expected[float(factor)], rel=1e-9)


def test_what_is_as_large_as_declared_stays() -> None:
    sizes = [compared(*drawn(seed, 1.0, 10.0)).likely_scales(BEFORE, BEFORE)[0] for seed in range(500)]
    assert np.median(sizes) < 1.05
    assert np.mean(np.array(sizes) > 1.5) < 0.03


@pytest.mark.parametrize('size', [3.0, 6.0])
def test_what_is_larger_is_found_to_be(size: float) -> None:
    found = np.array([compared(*drawn(seed, size, 10.0)).likely_scales(BEFORE, BEFORE)[:2] for seed in range(200)])
    assert 0.7 * size < np.median(found[:, 0]) < 1.3 * size
    assert np.median(found[:, 1]) > 0.9


def test_numbers_that_data_say_nothing_of_stay_as_declared() -> None:
    mean, covariance = drawn(0, 3.0, 1e-6)
    assert compared(mean, covariance).likely_scales(BEFORE, BEFORE)[:2] == pytest.approx((1.0, 0.0), abs=1e-3)
    assert [*compared(np.zeros(NUMBERS), np.eye(NUMBERS)).likely_scales(BEFORE, BEFORE)] == [1.0, 0.0, 0.0]


@pytest.mark.parametrize('seen', [0.5, 10.0])
def test_what_is_as_declared_is_as_far_from_its_prior_as_chance_has_it(seen: float) -> None:
    """Also where data see little of the numbers: what is left at the prior is no evidence for it."""
    square, _, degrees = np.transpose([compared(*drawn(seed, 1.0, seen)).distances for seed in range(500)])
    assert np.mean(square > chdtri(degrees, 0.05)) == pytest.approx(0.05, abs=0.03)
    assert np.mean(square) == pytest.approx(np.mean(degrees), rel=0.1)
    _, twice, degrees = np.transpose([compared(*drawn(seed, 2.0, seen)).distances for seed in range(500)])
    assert np.mean(twice) == pytest.approx(np.mean(degrees), rel=0.1)


def test_what_no_data_see_is_at_no_distance() -> None:
    assert [*compared(np.zeros(NUMBERS), np.eye(NUMBERS)).distances] == [0.0, 0.0, 0]


def test_what_data_see_at_second_order_only_is_no_distance() -> None:
    """Data see the product of two numbers, which both are as declared; linear extrapolation calls them far off."""
    noise, data = 0.4, 0.45

    def solved(at: Array, *, steps: int = 1) -> tuple[Array, Array]:
        for _ in range(steps):
            rows = at[::-1][None] / noise
            at, covariance = posterior(rows, np.array([(data + at[0] * at[1]) / noise]))
        return at, covariance

    mean, covariance = solved(np.array([0.3, 0.2]), steps=200)
    draws = mean + np.random.default_rng(0).multivariate_normal(np.zeros(2), covariance, 3)
    moved = np.array([solved(draw)[0] - mean for draw in draws])
    assert compared(mean, covariance).distances[2] == 1
    assert [*compared(mean, covariance, moved).distances] == [0.0, 0.0, 0]
    straight = 0.01 * moved
    assert [*compared(mean, covariance, straight).distances] == [*compared(mean, covariance).distances]


def test_groups_side_by_side_are_as_each_by_itself() -> None:
    drawings = [drawn(seed, 3.0, 2.0) for seed in range(5)]
    together = compared(*map(np.array, zip(*drawings, strict=True)))
    for place, each in enumerate(compared(*drawing) for drawing in drawings):
        assert [part[place] for part in together.likely_scales(BEFORE, BEFORE)] == [*each.likely_scales(BEFORE, BEFORE)]
        assert [part[place] for part in together.distances] == [*each.distances]
        assert [part[place] for part in together.gain(30.0)] == [*each.gain(30.0)]
