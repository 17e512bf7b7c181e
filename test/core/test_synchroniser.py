"""Two streams brought to common stamps and cut into windows, however they come in pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checked import same, some
from mbaid_ros.core import pipeline
from mbaid_ros.core.geometry import Array, log
from mbaid_ros.core.pipeline import NO_ODOMETRY, ODOMETRY_GAP, OUT_OF_ORDER, Synchroniser
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, SensorNoise, Stamps
from mbaid_ros.core.windows import Windows
from windowed import base_stream, joint_stream, piece, smooth_motion

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def every(milliseconds: float, count: int, first: float = 0.0) -> Stamps:
    return START + np.round((first + milliseconds * np.arange(count)) * 1e6).astype(np.int64)


def synchronise(joints: JointStream, base: BaseStream, gap: float = 1.0) -> Samples:
    return some(Synchroniser(gap).push(joints, base))


def messy_stamps(seed: int, period: float, count: int) -> Stamps:
    """Return stamps with jitter, equal ones, ones out of order, and a gap."""
    rng = np.random.default_rng(seed)
    stamps = every(period, count) + rng.integers(-200_000, 200_000, count) * rng.integers(0, 2, count)
    stamps[rng.integers(1, count, 3)] -= 2 * round(period * 1e6)
    stamps[rng.integers(1, count, 2)] = stamps[rng.integers(1, count, 2)]
    stamps[count // 2 :] += round(rng.choice([0.0, 0.4]) * SECOND)
    return stamps


@given(seed=st.integers(0, 50), cuts=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_pieces_do_not_matter(seed: int, cuts: int) -> None:
    joints = joint_stream(messy_stamps(seed, 10.0, 90))
    base = base_stream(messy_stamps(seed + 1000, 25.0, 40))
    whole = Synchroniser(0.2)
    together = whole.push(joints, base)
    rng = np.random.default_rng(cuts)
    pieces = Synchroniser(0.2)
    parts: list[Samples | None] = []
    taken = [0, 0]
    while taken[0] < len(joints.stamp) or taken[1] < len(base.stamp):
        # Some of one stream, of the other, of both, of none.
        size = rng.integers(0, [25, 12]) * rng.integers(0, 2, 2)
        begin, taken = taken, [taken[0] + int(size[0]), taken[1] + int(size[1])]
        parts.append(pieces.push(piece(joints, begin[0], taken[0]), piece(base, begin[1], taken[1])))
    joined = [part for part in parts if part is not None]
    assert together is not None
    assert same(Samples.concatenate(joined), together)
    assert pieces.dropped == whole.dropped
    assert pieces.origin == whole.origin


def interpolation_errors(spacing: float) -> Array:
    """Return the largest errors of position, orientation, linear and angular velocity between readings (ms) apart."""
    times = every(spacing, round(2000.0 / spacing) + 1)
    between = every(3.7, 530, first=1.3)
    samples = synchronise(joint_stream(between), base_stream(times))
    truth = smooth_motion(between)
    errors = (
        samples.base_position - truth.position,
        log(np.swapaxes(truth.rotation, 1, 2) @ samples.base_rotation),
        samples.base_linear_velocity - truth.linear_velocity,
        samples.base_angular_velocity - truth.angular_velocity,
    )
    return np.array([np.abs(error).max() for error in errors])


def test_half_the_spacing_leaves_a_sixteenth_of_the_poses_error_and_a_quarter_of_the_rates() -> None:
    coarse, fine = interpolation_errors(100.0), interpolation_errors(50.0)
    # At 20 Hz, of a motion of 1 m and 1 rad within seconds.
    assert (fine[:2] < 1e-5).all()
    # Higher orders are left at finite spacing: within 15 %.
    assert coarse / fine == pytest.approx([16.0, 16.0, 4.0, 4.0], rel=0.15)


def pose_errors_without_a_twist(spacing: float) -> Array:
    """Return the largest errors of position and orientation between poses (ms) apart, without velocities."""
    base = base_stream(every(spacing, round(2000.0 / spacing) + 1))
    nothing = np.full_like(base.linear_velocity, np.nan)
    between = every(3.7, 480, first=2.0 * spacing)
    samples = synchronise(
        joint_stream(between), replace(base, linear_velocity=nothing, angular_velocity=nothing), gap=0.15
    )
    truth = smooth_motion(between)
    turn = log(np.swapaxes(truth.rotation, 1, 2) @ samples.base_rotation)
    return np.array([np.abs(error).max() for error in (samples.base_position - truth.position, turn)])


def test_poses_alone_are_interpolated_to_third_order() -> None:
    assert pose_errors_without_a_twist(100.0) / pose_errors_without_a_twist(50.0) == pytest.approx([8.0, 8.0], rel=0.2)


def test_a_gap_is_not_bridged() -> None:
    base = base_stream(np.concatenate((every(20.0, 10), every(20.0, 10, first=500.0))))
    samples = Synchroniser(0.1)
    found = some(samples.push(joint_stream(every(10.0, 70)), base))
    inside = (found.time > 0.185) & (found.time < 0.495)
    # Stamps that agree with an odometry's own need no neighbour.
    assert not inside.any()
    assert np.isclose(found.time, 0.18).any()
    assert np.isclose(found.time, 0.5).any()
    assert samples.dropped[ODOMETRY_GAP] == 31


@pytest.mark.parametrize('repeated', [True, False])
def test_a_stamp_that_is_not_later_is_dropped_and_counted(repeated: bool) -> None:
    stamps = every(10.0, 20)
    stamps[7] = stamps[6] if repeated else stamps[3]
    whole, part = Synchroniser(1.0), Synchroniser(1.0)
    found = some(whole.push(joint_stream(stamps), base_stream(every(10.0, 21))))
    expected = some(part.push(joint_stream(np.delete(stamps, 7)), base_stream(every(10.0, 21))))
    assert same(found, expected)
    assert whole.dropped[OUT_OF_ORDER] == 1
    # The same of the base.
    late = every(10.0, 21)
    late[9] = late[8] if repeated else late[2]
    both = Synchroniser(1.0)
    both.push(joint_stream(every(10.0, 20)), base_stream(late))
    assert both.dropped[OUT_OF_ORDER] == 1


def test_joints_that_arrive_long_after_their_odometry_are_used() -> None:
    samples = Synchroniser(1.0)
    joints, base = joint_stream(every(10.0, 100)), base_stream(every(10.0, 130))
    samples.push(piece(joints, 0, 10), piece(base, 0, 40))
    samples.push(None, piece(base, 40, 130))
    found = some(samples.push(piece(joints, 10, 100), None))
    assert len(found) == 90
    assert not +samples.dropped


def test_what_waits_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, 'LARGEST_BACKLOG', 100)
    samples = Synchroniser(1.0)
    for begin in range(10):
        assert samples.push(joint_stream(every(10.0, 50, first=500.0 * begin)), None) is None
    assert samples.dropped[NO_ODOMETRY] == 400
    found = some(samples.push(None, base_stream(every(10.0, 51, first=4500.0))))
    assert len(found) == 50


def test_readings_shared_by_several_samples_count_once() -> None:
    # Five samples in one odometry interval: their mean is no better than a reading.
    samples = synchronise(joint_stream(every(10.0, 101)), base_stream(every(50.0, 21)))
    base = base_stream(every(50.0, 21))
    assert samples.pose_covariance[10] == pytest.approx(5.0 * base.pose_covariance[2], rel=1e-9)
    # More odometry than joints: each sample has its own.
    samples = synchronise(joint_stream(every(50.0, 20)), base_stream(every(10.0, 101)))
    assert samples.twist_covariance[3] == pytest.approx(base_stream(every(10.0, 16)).twist_covariance[15], rel=1e-9)


@pytest.mark.parametrize(('joints', 'base'), [(10.0, 50.0), (50.0, 10.0)])
def test_samples_are_by_readings_of_the_base_as_far_apart_as_the_slower_stream_has_them(
    joints: float, base: float
) -> None:
    samples = synchronise(joint_stream(every(joints, 20)), base_stream(every(base, 101)))
    assert samples.apart[1:] == pytest.approx(0.05)


def test_without_a_twist_the_pose_changes_evenly() -> None:
    base = base_stream(every(40.0, 26))
    nothing = np.full_like(base.linear_velocity, np.nan)
    samples = synchronise(
        joint_stream(every(10.0, 101)), replace(base, linear_velocity=nothing, angular_velocity=nothing)
    )
    assert np.isnan(samples.base_linear_velocity).all()
    assert np.isnan(samples.base_angular_velocity).all()
    assert samples.base_position[1] == pytest.approx(0.75 * base.position[0] + 0.25 * base.position[1], abs=1e-12)
    turn = log(base.rotation[0].T @ base.rotation[1])
    assert log(base.rotation[0].T @ samples.base_rotation[2]) == pytest.approx(0.5 * turn, abs=1e-12)


def samples_at(time: Array) -> Samples:
    count = len(time)
    three = np.arange(3.0 * count).reshape(count, 3)
    noise = SensorNoise(*(1e-3,) * 6)
    return Samples(
        time=time,
        joint_position=three[:, :2],
        joint_velocity=three[:, 1:],
        base_position=three,
        base_rotation=np.tile(np.eye(3), (count, 1, 1)),
        base_linear_velocity=three,
        base_angular_velocity=three,
        pose_covariance=np.tile(noise.pose_covariance(), (count, 1, 1)),
        twist_covariance=np.tile(noise.twist_covariance(), (count, 1, 1)),
    )


@pytest.mark.parametrize('length', [0.5, 0.1, 0.7])
def test_a_sample_at_a_limit_opens_the_next_window(length: float) -> None:
    # Multiples of the period in ns, as stamps give them: they round either way.
    time = np.arange(140) * 100_000_000 * 1e-9
    cutter = Windows(length)
    cut = [*cutter.push(samples_at(time)), *cutter.flush()]
    per_window = round(length / 0.1)
    assert [len(window) for window in cut] == [per_window] * (140 // per_window)
    assert [round(window.time[0] / length, 6) for window in cut] == list(range(len(cut)))


def test_poses_that_jump_begin_a_new_frame_unless_their_frame_turns() -> None:
    stamps = every(10.0, 200)
    base, joints = base_stream(stamps), joint_stream(stamps)
    after = np.arange(200)[:, None] >= 90
    jumping = replace(base, position=base.position + 0.3 * after)
    whole = Synchroniser(0.2)
    samples = some(whole.push(joints, jumping))
    np.testing.assert_allclose(samples.base_position, base.position, atol=1e-3)
    assert np.all(np.any(samples.frame > 0.0, axis=1) == after[:, 0])
    np.testing.assert_array_equal(some(Synchroniser(0.2, lambda each: each).push(joints, jumping)).frame, 0.0)
    pieces = Synchroniser(0.2)
    parts = [pieces.push(joints[place : place + 30], jumping[place : place + 30]) for place in range(0, 200, 30)]
    assert same(Samples.concatenate([part for part in parts if part is not None]), samples)
