"""Noise levels and time constants from readings alone, and covariances of messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from checked import some
from mbaid_ros.core.geometry import Array, Integers, exp
from mbaid_ros.core.noise import (
    _SQUARES,
    BINOMIAL,
    Differences,
    DifferenceVariances,
    ErrorModels,
    FoundLevels,
    LeastSteps,
    LevelEstimator,
    NoiseEstimator,
    NoiseLevels,
    candidates,
    likeliest,
)
from mbaid_ros.core.odometry.stream import usable_covariance
from mbaid_ros.core.pipeline import Synchroniser
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, SensorNoise
from observed import MID
from windowed import base_stream, joint_stream

TRUE = np.array([2e-4, 5e-3, 3e-3, 2.5e-4, 5e-4, 3e-4])  # of CHANNELS; MID is declared
BEGIN = 1_700_000_000_000_000_000
DECLARED = np.array([getattr(MID, name) for name in list(vars(MID))[:6]])
ALL = 10**19


def streams(
    seconds: float, rate: float, seed: int = 0, keep: float = 0.0, jitter: float = 0.0
) -> tuple[JointStream, BaseStream]:
    """Return readings of what swings by half a radian, or metre, at 0.3 Hz; poses' errors have a correlation."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    time = time + jitter / rate * rng.uniform(-0.5, 0.5, len(time))
    stamps = BEGIN + np.round(1e9 * time).astype(np.int64)
    joints, base = joint_stream(stamps), base_stream(stamps)
    swing = 0.5 * np.sin(2.0 * np.pi * 0.3 * time)[:, None] * np.array([1.0, 0.7, -0.4])

    def errors(channel: int, columns: int = 3) -> Array:
        white = TRUE[channel] * rng.normal(size=(len(time), columns))
        gain = np.sqrt(1.0 - keep**2) if channel in {2, 3} else 1.0
        return np.asarray(lfilter([gain], [1.0, -keep if channel in {2, 3} else 0.0], white, axis=0))

    count = joints.position.shape[1]
    joints.position[:] = swing[:, :1] + errors(0, count)
    joints.velocity[:] = swing[:, :1] + errors(1, count)
    read = swing + errors(2), exp(errors(3)) @ exp(swing), swing + errors(4), swing + errors(5)
    return joints, as_declared(base, *read)


def as_declared(base: BaseStream, position: Array, rotation: Array, linear: Array, angular: Array) -> BaseStream:
    """Return readings of the base of which MID is declared."""
    pose, twist = (np.tile(each, (len(base.stamp), 1, 1)) for each in (MID.pose_covariance(), MID.twist_covariance()))
    return BaseStream(base.stamp, position, rotation, linear, angular, pose, twist)


def found(joints: JointStream, base: BaseStream, spacing: float, *, free: bool = True) -> FoundLevels:
    levels = LevelEstimator(MID, joints.position.shape[1], trusted=not free)
    levels.add_readings(joints, base)
    return levels.levels_at(ALL, spacing, free=(free, free))


@pytest.mark.parametrize(('rate', 'jitter'), [(100.0, 0.0), (100.0, 0.8), (10.0, 0.3)])
def test_levels_are_found_within_a_tenth_whatever_moves(rate: float, jitter: float) -> None:
    levels = found(*streams(60.0, rate, jitter=jitter), 1.0 / rate)
    assert levels.factor * DECLARED == pytest.approx(TRUE, rel=0.1)
    assert levels.times.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(('joints', 'unread'), [(9, ()), (9, (7, 8)), (12, (0, 1, 2, 3))])
def test_as_many_joints_as_a_rotation_has_numbers_and_followers_have_the_level_of_the_others(
    joints: int, unread: tuple[int, ...]
) -> None:
    rng, stamps = np.random.default_rng(2), 20_000_000 * np.arange(2000)
    moving = 0.2 * np.sin(1e-9 * stamps[:, None] * (0.3 + 0.05 * np.arange(joints)) + np.arange(joints))
    read = moving + MID.joint_position * rng.normal(size=moving.shape)
    read[:, list(unread)] = 0.1 * read[:, -len(unread) - 1 :][:, : len(unread)]  # as of leaders
    levels = LevelEstimator(MID, joints, unread)
    levels.add_readings(JointStream(stamps, read, np.full_like(read, np.nan)), None)
    found = levels.levels_at(int(stamps[-1]), 0.02, free=(False, False))
    assert found.factor[0] == pytest.approx(1.0, rel=0.05)
    assert not found.used[0]


def test_single_readings_far_off_make_little_of_a_difference() -> None:
    joints, base = streams(60.0, 100.0)
    rng = np.random.default_rng(1)
    far = rng.choice(len(joints.stamp), 30, replace=False)
    joints.position[far] += 1.0
    base.position[far] += 1.0
    assert found(joints, base, 0.01).factor * DECLARED == pytest.approx(TRUE, rel=0.15)


def test_what_is_found_does_not_depend_on_the_calls() -> None:
    joints, base = streams(4.0, 100.0, jitter=0.5)
    at_once, bit_by_bit = (LevelEstimator(MID, joints.position.shape[1]) for _ in range(2))
    at_once.add_readings(joints, base)
    begin = 0
    for end in (*range(7, 400, 13), 400):
        bit_by_bit.add_readings(joints[begin:end], base[begin:end])
        begin = end
        if end >= 50:
            seen = int(joints.stamp[end - 1])
            one, other = (each.levels_at(seen, 0.01, free=(True, True)) for each in (at_once, bit_by_bit))
            np.testing.assert_array_equal(one.factor, other.factor)
            np.testing.assert_array_equal(one.times, other.times)


def drifting(constant: float, wrong: float, seed: int) -> tuple[JointStream, BaseStream]:
    """Return 10 s of a base at rest with errors of a time constant (s), so many times as large as MID declares."""
    joints, base = streams(10.0, 100.0)

    def errors(channel: int) -> Array:
        rng = np.random.default_rng([seed, channel])
        white, keep = rng.normal(size=(len(base.stamp), 3)), np.exp(-0.01 / constant)
        white[1:] *= np.sqrt(1.0 - keep**2)
        return np.asarray(wrong * DECLARED[channel] * lfilter([1.0], [1.0, -keep], white, axis=0))

    return joints, as_declared(base, errors(2), exp(errors(3)), errors(4), errors(5))


@pytest.mark.parametrize('wrong', [1.0, 1.5, 0.1, 10.0])
@pytest.mark.parametrize('constant', [0.1, 0.3, 1.0, 5.0])
def test_errors_of_a_navigation_filter_are_found_whatever_is_declared(constant: float, wrong: float) -> None:
    for seed in range(3):
        joints, base = drifting(constant, wrong, seed)
        levels = LevelEstimator(MID, joints.position.shape[1])
        levels.add_readings(joints, base)
        found = levels.levels_at(ALL, 0.01, free=(False, False))
        assert np.all(found.times > 0.7 * constant)
        variance = np.where(found.used, found.factor, 1.0)[2:] ** 2 / wrong**2
        # What errors do in a moment, and slowly: their densities at high and at low frequencies.
        assert variance / np.repeat(found.times, 2) * constant == pytest.approx(1.0, rel=0.5)
        assert np.all(variance * np.repeat(found.times, 2) > 0.6 * constant)
        if wrong in {0.1, 10.0}:
            assert found.contradicted[2:].all()


def test_neither_a_first_covariance_nor_a_missing_twist_decides_for_the_whole_run() -> None:
    joints, base = drifting(1.0, 1.0, 0)

    def found(read: BaseStream) -> FoundLevels:
        levels = LevelEstimator(MID, joints.position.shape[1])
        for piece in np.array_split(np.arange(len(read.stamp)), 7):
            levels.add_readings(None, read[piece])
        return levels.levels_at(ALL, 0.01, free=(False, False))

    first, missing = base.pose_covariance.copy(), base.linear_velocity.copy()
    first[0] *= 1e-3
    missing[5, 0] = np.nan
    whole, other = found(base), found(replace(base, pose_covariance=first))
    assert other.times[0] == pytest.approx(whole.times[0], rel=0.3)
    assert other.factor[2:4] == pytest.approx(whole.factor[2:4], rel=0.1)
    drift = LevelEstimator(MID, joints.position.shape[1])._drift_of(replace(base, linear_velocity=missing))
    assert np.isfinite(drift).all()


def test_white_noise_that_is_small_is_not_taken_for_correlated() -> None:
    joints, base = streams(20.0, 100.0)
    large = replace(base, pose_covariance=100.0 * base.pose_covariance)
    levels = found(joints, large, 0.01, free=False)
    assert levels.times.tolist() == [0.0, 0.0]
    assert levels.factor[2:4] * 10.0 * DECLARED[2:4] == pytest.approx(TRUE[2:4], rel=0.1)


def window(joints: JointStream, base: BaseStream) -> Samples:
    return Samples(
        time=(joints.stamp - BEGIN) * 1e-9,
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        base_position=base.position,
        base_rotation=base.rotation,
        base_linear_velocity=base.linear_velocity,
        base_angular_velocity=base.angular_velocity,
        pose_covariance=base.pose_covariance,
        twist_covariance=base.twist_covariance,
        apart=np.full(len(joints.stamp), 0.01),
    )


@pytest.mark.parametrize('estimate', [True, False])
def test_a_window_has_what_was_found_where_that_is_asked_for(estimate: bool) -> None:
    joints, base = streams(20.0, 100.0)
    noise = NoiseEstimator(MID, joints.position.shape[1], estimate=estimate, trusted=not estimate)
    noise.add_readings(joints, base)
    changed, levels = noise.with_noise(window(joints, base), BEGIN)
    assert levels.estimated == pytest.approx(TRUE, rel=0.1)
    used = levels.estimated if estimate else DECLARED
    own = MID.for_window(changed)
    assert (own.joint_position, own.joint_velocity) == pytest.approx(tuple(used[:2]))
    both = changed.pose_covariance, changed.twist_covariance
    assert np.sqrt(np.concatenate([np.diagonal(each[0]) for each in both])) == pytest.approx(np.repeat(used[2:], 3))
    line = 'base orientation: your noise value, 0.0001 rad, is 2.5 times too small'
    assert any(line in each for each in levels.differences())


def test_sensors_without_noise_are_not_taken_for_exact() -> None:
    joints, base = streams(4.0, 100.0)
    joints.position[:] = 0.5 + (1e-3 * TRUE[0]) * np.random.default_rng(0).normal(size=joints.position.shape)
    noise = NoiseEstimator(MID, joints.position.shape[1], estimate=True)
    noise.add_readings(joints, base)
    changed, _ = noise.with_noise(window(joints, base), BEGIN)
    assert MID.for_window(changed).joint_position == pytest.approx(1e-4 / 30.0)


def test_an_encoder_at_rest_between_two_steps_shows_no_noise() -> None:
    joints, base = streams(20.0, 100.0)
    step = 2.0 * np.pi / 2**12
    moving = np.arange(len(joints.stamp)) >= 1500  # a quarter of the time
    swing = 0.1 * np.sin(np.arange(len(joints.stamp)) * 0.01)[:, None] * moving[:, None]
    joints.position[:] = step * np.round((0.5 + swing) / step)
    noise = NoiseEstimator(MID, joints.position.shape[1], estimate=True)
    noise.add_readings(joints, base)
    at_rest, _ = noise.with_noise(window(joints[:200], base[:200]), BEGIN)
    assert MID.for_window(at_rest).joint_position == MID.joint_position
    later, _ = noise.with_noise(window(joints, base), BEGIN)
    # Of slow motion rather too much: what shows are the differences that hold a step.
    assert 0.7 < MID.for_window(later).joint_position / (step / np.sqrt(12.0)) < 2.0


def test_undeclared_noise_is_estimated_until_a_message_declares_it() -> None:
    joints, base = streams(20.0, 100.0)
    undeclared = np.array([True, False, True, True, True, False])
    says = np.zeros((len(base.stamp), 4), dtype=bool)
    says[1000:, :2] = True
    noise = NoiseEstimator(MID, joints.position.shape[1], undeclared, trusted=True)
    noise.add_readings(joints, replace(base, declared=says))
    first, later = (noise.with_noise(window(joints[:last], base[:last]), BEGIN)[1] for last in (900, len(base.stamp)))
    assert first.used.tolist() == undeclared.tolist()
    assert np.isnan(first.declared).tolist() == undeclared.tolist()
    assert later.used.tolist() == [True, False, False, False, True, False]
    assert later.declared[2:4] == pytest.approx(DECLARED[2:4])
    assert first.differences()[-1].startswith('no noise is set for joint position (0.0002')


@pytest.mark.parametrize(
    ('spacing', 'later', 'times'),
    [(0.05, 0.0, 100.0), (0.05, 1.0, 100.0), (0.05, 1.1, 1.0), (0.5, 0.0, 1.0)],  # for 40 poses, of 5 Hz at least
)
def test_an_undeclared_base_hardly_counts_before_its_poses_can_tell(spacing: float, later: float, times: float) -> None:
    joints, base = streams(20 * spacing, 1.0 / spacing)
    undeclared = np.array([True, False, True, True, False, True])
    noise = NoiseEstimator(MID, joints.position.shape[1], undeclared)
    noise.add_readings(joints, replace(base, declared=np.zeros((len(base.stamp), 4), dtype=bool)))
    own = replace(window(joints, base), apart=np.full(20, spacing), base_angular_velocity=np.full((20, 3), np.nan))
    own = replace(own, time=own.time + later)
    changed, levels = noise.with_noise(own, BEGIN)
    sizes = np.sqrt(np.diagonal(changed.pose_covariance[0])[[0, 3]] / np.diagonal(MID.pose_covariance())[[0, 3]])
    assert sizes == pytest.approx(times)
    assert not levels.used.any()
    assert levels.assumed[2:4] == pytest.approx(times * DECLARED[2:4])
    assert np.isnan(levels.assumed[[1, 4, 5]]).all()
    assert levels.differences()[-1].endswith('and the data do not determine it: assumed')


def test_declared_noise_stands_until_readings_tell() -> None:
    joints, base = streams(0.05, 100.0)
    assert np.all(np.isnan(found(joints, base, 0.01).factor))
    noise = SensorNoise(*(2.0 * DECLARED).tolist())
    changed, levels = NoiseEstimator(noise, joints.position.shape[1], estimate=True).with_noise(
        window(joints, base), BEGIN
    )
    assert noise.for_window(changed) == noise
    assert levels.differences() == []


@pytest.mark.parametrize(('declared', 'warned'), [(5e-4, False), (3e-2, True)])
def test_joints_that_are_far_better_than_declared_are_warned_of(declared: float, *, warned: bool) -> None:
    joints, base = streams(4.0, 100.0)
    noise = NoiseEstimator(replace(MID, joint_position=declared), joints.position.shape[1])
    noise.add_readings(joints, base)
    warnings = noise.with_noise(window(joints, base), BEGIN)[1].warnings
    assert any(text.startswith('noise.joint_position is 0.03 rad') for text in warnings) == warned


@pytest.mark.parametrize(
    ('declared', 'found', 'replaced', 'another'),
    [(1e-3, 0.97, True, True), (1e-3, 0.2, True, False), (1e-3, 5.0, True, False), (1e-3, 0.97, False, False)],
)
def test_positions_a_thousand_times_as_noisy_as_declared_are_in_another_unit(
    declared: float, found: float, *, replaced: bool, another: bool
) -> None:
    nothing, of_position = np.full(6, np.nan), np.arange(6) == 2
    given, read = (np.where(of_position, value, np.nan) for value in (declared, found))
    levels = NoiseLevels(given, read, nothing, 0.0, of_position, contradicted=of_position & replaced)
    assert levels.in_another_unit == another
    assert not NoiseLevels(nothing, nothing, nothing, 0.0, of_position).in_another_unit


STEP, SIZE = 0.01, 1e-3  # s, m


def samples(error: Array, every: int = 1, constant: float = 0.0) -> Samples:
    """Return samples of a moving base whose positions have an error; one in so many comes."""
    stamps = 1_700_000_000_000_000_000 + np.round(1e9 * STEP * np.arange(len(error))).astype(np.int64)
    base = base_stream(stamps)
    base.position[:] += SIZE * error
    base.pose_covariance[:, :3, :3] = SIZE**2 * np.eye(3)
    found = some(Synchroniser(1.0).push(joint_stream(stamps), base[::every]))
    noise = replace(MID, base_correlation_time=constant)
    return NoiseEstimator(noise, found.joint_position.shape[1]).with_noise(found, 0)[0]


def test_poses_weigh_as_much_less_as_their_slow_means_vary() -> None:
    nothing = np.zeros((100, 3))
    keep = np.exp(-STEP / 0.3)
    ratio = samples(nothing, constant=0.3).pose_covariance[1:, 0, 0] / samples(nothing).pose_covariance[1:, 0, 0]
    np.testing.assert_allclose(ratio, (1.0 + keep) / (1.0 - keep), rtol=1e-9)
    np.testing.assert_array_equal(samples(nothing, constant=0.3).twist_covariance, samples(nothing).twist_covariance)


DEFAULT = 1e-4 * np.eye(6)


def given(diagonal: tuple[float, ...], entry: tuple[int, int, float] | None = None) -> Array:
    matrix = np.diag(diagonal)
    if entry is not None:
        matrix[entry[:2]] = entry[2]
    return matrix


@pytest.mark.parametrize(
    ('matrix', 'own', 'wrong'),
    [
        (np.zeros((6, 6)), (False, False), False),
        (given((2.0,) * 6), (True, True), False),
        (given((2.0, 2.0, 2.0, 0.0, 0.0, 0.0)), (True, False), False),
        (given((2.0,) * 6, (0, 4, np.nan)), (True, True), True),  # the correlation of position and orientation
        (given((2.0, 2.0, 0.0, 0.0, 0.0, 2.0)), (False, False), True),  # of a planar robot
        (given((2.0,) * 6, (0, 1, 0.5)), (False, True), True),  # not symmetric
        (given((-1.0, 0.0, 0.0, 0.0, 0.0, 0.0)), (False, False), True),
        (given((2.0, 2.0, 2.0, 2.0, np.inf, 2.0)), (True, False), True),
        (given((2.0, 2.0, 1e13, 2.0, 2.0, 2.0)), (False, True), True),  # of no possible size
        (np.full((6, 6), 2.0), (False, False), True),
    ],
)
def test_what_is_used_of_a_covariance(matrix: Array, own: tuple[bool, bool], *, wrong: bool) -> None:
    found = usable_covariance(matrix, DEFAULT)
    assert (found.is_given, found.wrong) == (own, wrong)
    assert np.all(np.linalg.eigvalsh(found.matrix) > 0.0)
    for block, kept in zip((slice(0, 3), slice(3, 6)), own, strict=True):
        assert np.array_equal(found.matrix[block, block], (matrix if kept else DEFAULT)[block, block])


def test_a_robot_without_joints_has_no_differences_of_theirs() -> None:
    differences = Differences((slice(0, 0),), (1,))
    stamps = np.arange(100, dtype=np.int64) * 50_000_000
    differences.add(stamps, np.zeros((100, 0)), np.ones((100, 1)))
    differences.count(int(stamps[-1]))
    assert not differences.counts.any()


STRIDES = np.array([1, 2, 4, 8, 16, 32]) * 0.01  # s


def of_sixth_differences(time: float, levels: tuple[float, float], count: int = 1000) -> DifferenceVariances:
    """Return the exact variances of sixth differences of errors that are correlated over a time (s)."""
    apart = np.abs(np.subtract.outer(np.arange(7), np.arange(7)))
    variance = []
    for stride in STRIDES:
        correlation = np.exp(-apart * stride / time) if time else np.eye(7)
        variance.append(BINOMIAL @ correlation @ BINOMIAL)
    return DifferenceVariances(np.outer(levels, variance), np.full((2, 6), count), STRIDES)


@pytest.mark.parametrize('declared', ['no', 'yes'])
@pytest.mark.parametrize('time', [0.05, 0.3, 2.0])
def test_errors_that_last_are_explained_by_their_time_and_size(time: float, declared: str) -> None:
    found = candidates(of_sixth_differences(time, (4.0, 9.0)), 0.0, declared)
    assert np.all(found.time > 0.0)
    best = int(np.argmin(found.cost))
    assert found.time[best] == pytest.approx(time, rel=0.07)  # of a grid
    assert np.exp(found.estimated[best]) == pytest.approx([4.0, 9.0], rel=0.1)
    assert np.array_equal(found.level[best], found.estimated[best])
    assert found.contradicted[best].all()
    assert found.cost[best] < (2.0 if declared == 'no' else 14.0)


def test_a_declared_time_is_the_only_one() -> None:
    found = candidates(of_sixth_differences(0.3, (4.0, 1.0)), 0.3, 'yes')
    assert found.time.tolist() == [0.3]
    assert found.cost == pytest.approx([0.0], abs=1e-9)
    assert np.exp(found.level[0]) == pytest.approx([4.0, 1.0])
    assert found.contradicted.tolist() == [[True, False]]


@pytest.mark.parametrize(
    ('declared', 'levels', 'used', 'contradicted'),
    [
        ('no', (4.0, 1.2), (1.0, 1.0), (True, False)),
        ('yes', (4.0, 1.2), (4.0, 1.0), (True, False)),
        ('yes', (0.25, 0.8), (0.25, 1.0), (True, False)),
        ('trusted', (1.02, 0.98), (1.0, 1.0), (False, False)),
    ],
)
def test_white_errors_have_the_declared_size_until_the_data_contradict_it(
    declared: str, levels: tuple[float, float], used: tuple[float, float], contradicted: tuple[bool, bool]
) -> None:
    found = candidates(of_sixth_differences(0.0, levels, 2000), 0.0, declared)
    assert found.time.tolist() == [0.0]
    assert np.exp(found.estimated[0]) == pytest.approx(levels)
    assert found.contradicted[0].tolist() == [*contradicted]
    if declared != 'no':
        assert np.exp(found.level[0]) == pytest.approx(used)


TRACE = np.array([1.0, 1.0, 2.2, 40.0, 40.0, 40.0])


def grown(seen: DifferenceVariances, first: int, times: float = 9.0) -> DifferenceVariances:
    """Return variances that grow by motion from one stride on."""
    motion = times ** np.maximum(np.arange(6) - first + 1, 0)
    return replace(seen, variance=seen.variance * motion)


@pytest.mark.parametrize(
    ('change', 'clear'),
    [
        (lambda seen: seen, True),
        (lambda seen: replace(seen, counts=np.where(np.arange(6) < 1, [[59], [500]], 500)), False),
        (lambda seen: replace(seen, counts=np.where(np.arange(6) < 1, [[60], [500]], 500)), True),
        (lambda seen: replace(seen, variance=seen.variance * [[1.0], [0.0]]), False),
        (lambda seen: replace(seen, strides=0.0 * seen.strides), False),
        (lambda seen: grown(seen, 1), False),  # motion from the first stride on
        (lambda seen: grown(seen, 2), True),
        (lambda seen: grown(seen, 4), True),
        # Motion where one kind has too few differences is none.
        (lambda seen: grown(replace(seen, counts=np.where(np.arange(6) < 1, 2000, [[11], [500]])), 1), True),
        # A trace of it in the stride before the one that it shows in, and too few differences beyond.
        (lambda seen: replace(seen, counts=seen.counts * (np.arange(6) < 5), variance=seen.variance * TRACE), True),
    ],
)  # fmt: skip
def test_errors_show_in_enough_differences_that_no_motion_hides(
    change: Callable[[DifferenceVariances], DifferenceVariances], *, clear: bool
) -> None:
    found = candidates(change(of_sixth_differences(0.0, (4.0, 1.0), 2000)), 0.0, 'yes')
    assert found.time.tolist() == [0.0]
    assert np.isfinite(found.estimated).all() == clear
    if clear:
        assert np.exp(found.estimated[0]) == pytest.approx([4.0, 1.0])
        assert found.contradicted[0].tolist() == [True, False]


def test_few_differences_do_not_show_whether_it_is_motion_that_they_grow_by() -> None:
    many, few = (grown(of_sixth_differences(0.0, (4.0, 4.0), count), 5, 10.0) for count in (2000, 60))
    assert np.exp(candidates(many, 0.0, 'yes').estimated[0]) == pytest.approx([4.0, 4.0])
    assert np.all(np.exp(candidates(few, 0.0, 'yes').estimated[0]) > 4.5)


@pytest.mark.parametrize(
    ('declared', 'count', 'known'), [('yes', 1000, True), ('yes', 3000, False), ('no', 3000, True)]
)
def test_variances_that_no_time_explains_contradict_no_declared_level(
    declared: str, count: int, *, known: bool
) -> None:
    """They vary by a factor of two from stride to stride."""
    seen = of_sixth_differences(0.0, (4.0, 4.0), count)
    found = candidates(replace(seen, variance=seen.variance * 2.0 ** (np.arange(6) % 2)), 0.0, declared)
    assert np.isfinite(found.estimated).all() == known
    if count == 3000:
        assert found.time.tolist() == [0.0]


def test_errors_that_may_last_for_longer_than_some_readings_are_not_called_white() -> None:
    found = candidates(of_sixth_differences(0.02, (1.0, 1.0), 60), 0.0, 'no')
    assert np.all(found.time > 0.0)
    assert found.time[np.argmin(found.cost)] == pytest.approx(0.02, rel=0.3)
    seen = of_sixth_differences(0.02, (1.0, 1.0), 60)
    two = candidates(replace(seen, counts=seen.counts * (np.arange(6) < 2)), 0.0, 'no')  # white ones are as likely
    assert np.all(two.time > 0.0)


def test_motion_in_long_differences_leaves_the_short_ones_to_show_how_long_errors_last() -> None:
    seen = of_sixth_differences(0.1, (1.0, 1.0))
    still, moving = (candidates(each, 0.0, 'no') for each in (seen, grown(seen, 5, 100.0)))
    assert moving.time[np.argmin(moving.cost)] == still.time[np.argmin(still.cost)]
    assert np.exp(moving.estimated[np.argmin(moving.cost)]) == pytest.approx([1.0, 1.0], rel=0.1)


def models(*times: float, level: float = 1.0) -> ErrorModels:
    """Return models of one cost."""
    count, size = len(times), np.log(level)
    return ErrorModels(
        np.array(times),
        np.zeros(count),
        np.full((count, 2), size),
        np.full((count, 2), size),
        np.full((count, 2), level != 1.0),
    )


RATIO = np.array([2.0, 0.5])  # 1/s, of deviations of twists and poses
LONG = 0.16 * 2.0 ** np.arange(6)  # s


def drifts(pose: float, twist: float, level: float = 1.0) -> DifferenceVariances:
    """Return the variances of drifts by errors of poses and twists that last for a time each, by a sum over time."""
    variance = []
    for apart in LONG:
        steps = (np.arange(2000) + 0.5) * apart / 2000
        lasting = np.exp(-np.abs(np.subtract.outer(steps[::10], steps[::10])) / twist) if twist else 0.0
        way = 0.5 * level * RATIO**2 * (np.mean(lasting) * apart**2)
        variance.append(level * (1.0 - np.exp(-apart / pose) if pose else 1.0) + way)
    return DifferenceVariances(np.transpose(variance), np.full((2, 6), 1000), LONG)


@pytest.mark.parametrize('level', [1.0, 4.0])
@pytest.mark.parametrize(('pose', 'twist'), [(0.5, 0.2), (3.0, 0.2), (0.5, 4.0), (3.0, 4.0)])
def test_drifts_show_how_long_errors_of_poses_and_twists_last(pose: float, twist: float, level: float) -> None:
    found = likeliest(models(0.5, 3.0, level=level), models(0.2, 4.0, level=level), drifts(pose, twist, level), RATIO)
    assert found.time.tolist() == [pose, twist]
    assert found.variance == pytest.approx(np.full(4, level))
    assert (found.used == (level != 1.0)).all()
    assert (found.contradicted == (level != 1.0)).all()


def test_drifts_that_only_one_kind_has_are_left_out_and_a_small_misfit_of_all_is_not() -> None:
    seen = drifts(0.5, 0.2)
    lost = seen.variance * np.where((np.arange(6) == 3) & (np.arange(2) == 0)[:, None], 0.0, 1.0)
    few = seen.counts * np.where((np.arange(6) == 3) & (np.arange(2) == 0)[:, None], 0, 1)
    for known in (replace(seen, variance=lost), replace(seen, counts=few), replace(seen, variance=1.3 * seen.variance)):
        assert likeliest(models(0.5, 3.0), models(0.2, 4.0), known, RATIO).time.tolist() == [0.5, 0.2]


@pytest.mark.parametrize('lost', ['counts', 'variance', 'far'])
def test_of_equally_likely_times_the_longest_counts_where_no_drift_tells(lost: str) -> None:
    """Where drifts are few, zero, or of a size that nothing explains."""
    seen = drifts(0.5, 0.2)
    changed = {'counts': seen.counts // 100, 'variance': 0.0 * seen.variance, 'far': 1e4 * seen.variance**2}
    known = replace(seen, **{lost if lost != 'far' else 'variance': changed[lost]})
    assert likeliest(models(0.5, 3.0), models(0.2, 4.0), known, RATIO).time.tolist() == [3.0, 4.0]


@pytest.mark.parametrize(
    ('times', 'count', 'lasting', 'used'),
    [
        (1.0, 400, False, False),
        (1.5, 400, False, True),
        (0.6, 400, False, True),
        (20.0, 400, False, True),
        (40.0, 400, False, False),  # they are no noise
        (0.025, 400, False, False),
        (5.0, 28, False, False),  # too few differences
        (5.0, 400, True, False),  # no white noise
    ],
)
def test_joints_that_are_as_noisy_as_no_declared_level_allows_have_their_own(
    times: float, count: int, *, lasting: bool, used: bool
) -> None:
    errors = times * MID.joint_position * np.random.default_rng(3).normal(size=(count, 2))
    read = np.cumsum(np.cumsum(errors, axis=0), axis=0) if lasting else errors
    levels = LevelEstimator(MID, 2)
    levels.add_readings(JointStream(10_000_000 * np.arange(count), read, np.full_like(read, np.nan)), None)
    assert levels.levels_at(ALL, 0.01, free=(False, False)).used.tolist() == [used, *[False] * 5]


def counted(count: int, variance: float) -> Integers:
    """Return the histogram of so many squares of normal numbers of positions, and of velocities of unit variance."""
    share = (np.arange(count) + 0.5) / count
    bins = [np.searchsorted(_SQUARES, size * chi2.ppf(share, 1)) for size in (variance, 1.0)]
    return np.array([np.bincount(each, minlength=len(_SQUARES)) for each in bins])


@pytest.mark.parametrize(
    ('variance', 'growth', 'further', 'wrong'),
    [
        (4.0, 1.0, 600, True),
        (4.0, 1.7, 600, True),
        (4.0, 2.3, 600, False),  # by errors that last, or by motion
        (4.0, 0.4, 600, False),
        (4.0, 2.3, 70, True),  # that so few do not show
        (4.0, 5.0, 70, False),
        (4.0, 1.0, 50, False),
        (0.25, 1.0, 600, True),
        (1.5, 1.0, 600, False),
        (1000.0, 1.0, 600, False),
    ],
)
def test_joint_noise_is_wrong_where_it_is_white_and_far_from_the_declared_one(
    variance: float, growth: float, further: int, *, wrong: bool
) -> None:
    levels = LevelEstimator(MID, 1)
    levels._joints.counts, levels._apart.counts = counted(600, variance), counted(further, variance * growth)
    assert levels._wrong_joints(np.array([variance, 1.0])).tolist() == [wrong, False]


@pytest.mark.parametrize(
    ('ends', 'spacing', 'clear_from', 'counts'),
    [
        ([1.0, 2.0, 3.9, 4.1, 5.0], 0.01, 9.0, [0, 0, 0, 4, 1]),  # four seconds
        ([1.0, 2.0, 3.9, 4.1, 5.0], 0.01, 2.0, [0, 2, 1, 1, 1]),  # or until the noise is as declared
        ([3.0, 7.0, 7.9, 8.1], 0.1, 99.0, [0, 0, 0, 4]),  # 80 poses
        ([3.0, 9.0, 9.9, 10.1], 1.0, 99.0, [0, 0, 0, 4]),  # ten seconds at most
    ],
)
def test_the_first_windows_wait_for_their_noise(
    ends: list[float], spacing: float, clear_from: float, counts: list[int]
) -> None:
    noise = NoiseEstimator(MID, 2)
    made: Any = [SimpleNamespace(time=np.array([end - 0.5, end]), apart=np.full(3, spacing)) for end in ends]

    def with_noise(window: Any, _: int, end: float) -> tuple[Any, Any]:
        return window, SimpleNamespace(as_declared=end >= clear_from, until=end)

    noise.with_noise = with_noise  # type: ignore[method-assign, assignment]
    released: list[Any] = [noise.windows_with_noise([each], 0) for each in made]
    assert [len(each) for each in released] == counts
    assert [window for some_ in released for window, _ in some_] == made
    for end, some_ in zip(ends, released, strict=True):
        assert all(levels.until == end for _, levels in some_)
    last = NoiseEstimator(MID, 2)
    last.with_noise = with_noise  # type: ignore[method-assign, assignment]
    assert [len(last.windows_with_noise([each], 0, last=each is made[2])) for each in made[:3]] == (
        [0, 0, 3] if clear_from > ends[2] else [0, 2, 1]
    )


def noise_levels(**given: Any) -> NoiseLevels:
    """Return levels of which nothing is known but what is given, by channels."""
    nothing = np.full(6, np.nan)
    whole = {'declared': nothing, 'estimated': nothing, 'assumed': nothing, 'used': np.zeros(6, dtype=bool)}
    return NoiseLevels(**{'correlation_time': 0.0, **whole, **given})


@pytest.mark.parametrize(('ratio', 'said'), [(1.25, ''), (0.8, ''), (1.4, '1.4 times too small'), (0.5, '2 times too')])
def test_a_level_that_is_hardly_wrong_is_no_difference(ratio: float, said: str) -> None:
    second = np.arange(6) == 1
    levels = noise_levels(declared=np.where(second, 2e-3, np.nan), estimated=np.where(second, ratio * 2e-3, np.nan))
    lines = levels.differences()
    assert len(lines) == bool(said)
    assert all(said in line and line.startswith('joint velocity: ') and 'are used' not in line for line in lines)
    assert all(line.endswith('; the data are used') for line in replace(levels, used=second).differences())


def test_levels_are_listed_with_that_in_use_first() -> None:
    known = np.array([1e-3, np.nan, 2e-3, np.nan, np.nan, np.nan])
    levels = noise_levels(
        declared=known, estimated=3.0 * known, assumed=np.where(np.arange(6) == 5, 0.5, np.nan), used=np.arange(6) == 2
    )
    assert [values for *_, values in levels.rows()] == [
        '0.001 set, 0.003 estimated', '', '0.006 estimated, 0.002 set', '', '', '0.5 assumed',
    ]  # fmt: skip
    assert [name for name, *_ in levels.rows()][:2] == ['joint position', 'joint velocity']


@pytest.mark.parametrize(
    ('changes', 'as_declared'),
    [
        ({}, True),
        ({'clear': False}, False),
        ({'correlation_time': 0.1}, False),
        ({'twist_correlation_time': 0.1}, False),
        ({'contradicted': np.arange(6) == 4}, False),
    ],
)
def test_noise_is_as_declared_where_it_is_white_and_of_that_size(changes: dict[str, Any], *, as_declared: bool) -> None:
    assert noise_levels(**changes).as_declared is as_declared


@pytest.mark.parametrize(('seconds', 'clear'), [(0.12, False), (1.0, True)])
def test_few_differences_of_poses_leave_open_how_noisy_they_are(seconds: float, *, clear: bool) -> None:
    joints, base = streams(seconds, 100.0)
    levels = LevelEstimator(MID, joints.position.shape[1])
    levels.add_readings(joints, None)
    assert levels.levels_at(ALL, 0.01, free=(False, False)).clear  # where there are no poses nothing is open
    levels.add_readings(None, base)
    found = levels.levels_at(ALL, 0.01, free=(True, True))
    assert np.isfinite(found.factor[2:]).all() == clear
    assert found.clear is clear


@pytest.mark.parametrize('twists', [False, True])
def test_levels_that_were_clear_stay_where_a_motion_hides_them_later(twists: bool) -> None:
    """Of a base that shakes: what was used stays in use; of one that shakes from the begin nothing is known."""
    joints, base = streams(20.0, 100.0)
    later = np.arange(len(base.stamp)) >= 400
    shaken = np.where(later, np.sin(0.6 * np.arange(len(base.stamp))), 0.0)[:, None] * np.ones(3)
    moved = as_declared(
        base,
        base.position + 20.0 * shaken,
        exp(shaken) @ base.rotation,
        base.linear_velocity + 5.0 * twists * shaken,
        base.angular_velocity + 5.0 * twists * shaken,
    )
    levels = LevelEstimator(MID, joints.position.shape[1])
    levels.add_readings(joints, moved)
    before = levels.levels_at(int(base.stamp[399]), 0.01, free=(False, False))
    after = levels.levels_at(ALL, 0.01, free=(False, False))
    assert np.isfinite(before.factor).all()
    assert before.used[2:].any()
    hidden = slice(2, 6 if twists else 4)
    for kept in ('factor', 'used', 'contradicted'):
        assert getattr(after, kept)[hidden].tolist() == getattr(before, kept)[hidden].tolist()
    assert after.times[: 1 + twists].tolist() == before.times[: 1 + twists].tolist()
    assert np.all((after.factor[4:] == before.factor[4:]) == twists)
    calm = LevelEstimator(MID, joints.position.shape[1])
    calm.add_readings(joints, base)
    first, last = (calm.levels_at(stamp, 0.01, free=(False, False)) for stamp in (int(base.stamp[399]), ALL))
    assert first.factor == pytest.approx(before.factor)
    assert np.all(last.factor != first.factor)  # where nothing hides them they go on
    late = LevelEstimator(MID, joints.position.shape[1])
    late.add_readings(joints[400:], moved[400:])
    unknown = late.levels_at(ALL, 0.01, free=(False, False))
    assert np.isnan(unknown.factor[hidden]).all()
    assert not unknown.clear


def test_errors_that_last_are_clear_although_they_grow_from_stride_to_stride() -> None:
    joints, base = drifting(1.0, 1.0, 0)
    levels = LevelEstimator(MID, joints.position.shape[1])
    levels.add_readings(joints, base)
    found = levels.levels_at(ALL, 0.01, free=(False, False))
    assert np.all(found.times > 0.0)
    assert found.clear


@pytest.mark.parametrize(
    ('position', 'step'),
    [
        (0.3 * np.sin(0.05 * np.arange(60)), 0.0),  # without noise: nearly the same change each time
        (0.02 * np.arange(60), 0.0),
        (0.01 * np.floor(0.13 * np.arange(120)), 0.01),  # one step each eight readings
        (0.01 * np.floor(1.4 * np.arange(60)), 0.01),
    ],
)
def test_steps_are_those_of_readings_that_change_now_by_fewer_and_now_by_more(position: Array, step: float) -> None:
    follower, halves = LeastSteps(1), np.array_split(position[:, None], 2)
    follower.add(halves[0], len(halves[0]))
    assert follower.add(np.concatenate((halves[0][-1:], halves[1])), len(halves[1]))[-1, 0] == pytest.approx(step)
