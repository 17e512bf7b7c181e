"""Noise levels and time constants from readings alone, and covariances of messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from checked import some
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.noise import Differences, FoundLevels, LevelEstimator, NoiseEstimator, NoiseLevels
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


@pytest.mark.parametrize(('spacing', 'times'), [(0.05, 100.0), (0.5, 1.0)])
def test_an_undeclared_base_hardly_counts_before_its_poses_can_tell(spacing: float, times: float) -> None:
    joints, base = streams(20 * spacing, 1.0 / spacing)
    undeclared = np.array([True, False, True, True, False, True])
    noise = NoiseEstimator(MID, joints.position.shape[1], undeclared)
    noise.add_readings(joints, replace(base, declared=np.zeros((len(base.stamp), 4), dtype=bool)))
    own = replace(window(joints, base), apart=np.full(20, spacing), base_angular_velocity=np.full((20, 3), np.nan))
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
