"""The preintegrated gyro, frames attached to the base, and joints that turn by more than their readings show."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from checked import generic, some
from mbaid_ros.core.contracts import Motion
from mbaid_ros.core.geometry import Array, cross, exp, log, rotate
from mbaid_ros.core.gyro import (
    DRIFT,
    IMU_FRAME,
    IMU_NOT_FINITE,
    IMU_NOT_REAL,
    IMU_WITHOUT_RATE,
    SATURATED,
    DeadReckoning,
    GyroErrors,
    ImuConfig,
    ImuReader,
    RateIntegrator,
    _preintegrated,
    declared_gyro,
    drifting_gyro,
    gyro,
    gyro_check,
    gyro_sensor,
    gyro_sensors,
    imu_reader,
)
from mbaid_ros.core.joints.stream import JointMerge
from mbaid_ros.core.odometry.model import parabolic_weights
from mbaid_ros.core.odometry.stream import AttachedFrame
from mbaid_ros.core.robot.model import Kinematics
from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream, Samples, Stamps
from observed import MID, kernel
from simulated import robot

SERVICER = robot('servicer7')
KINEMATICS = Kinematics(SERVICER)
MILLISECOND = 1_000_000
GAP = 100 * MILLISECOND


def stream(times: Array, rate: Array) -> ImuStream:
    return ImuStream(np.round(times * MILLISECOND).astype(np.int64), rate)


def even(times: Array) -> Array:
    """Return a rate (N, 3), rad/s, that changes evenly with the time, ms."""
    return np.array([0.3, -0.2, 0.1]) + 1e-3 * times[:, None] * np.array([0.5, 0.4, -0.6])


def at(times: Array) -> Stamps:
    return np.round(times * MILLISECOND).astype(np.int64)


@pytest.mark.parametrize('pieces', [1, 3, 17])
def test_the_integral_of_an_evenly_changing_rate_is_exact_at_and_between_readings(pieces: int) -> None:
    times = np.cumsum(np.random.default_rng(0).uniform(2.0, 9.0, 40))
    gyro, whole = RateIntegrator(GAP), stream(times, even(times))
    for piece in np.array_split(np.arange(len(times)), pieces):
        gyro.push(whole[piece])
    stamps = at(np.concatenate((times[[0, 5, -1]], 0.5 * (times[10:20] + times[11:21]) + 0.7)))
    milliseconds, first = stamps / MILLISECOND, whole.stamp[0] / MILLISECOND
    # The mean rate over the time since the first reading.
    expected = 1e-3 * (milliseconds - first)[:, None] * 0.5 * (even(milliseconds) + even(np.array([first])))
    found, segment = gyro.integral_at(stamps)
    assert found == pytest.approx(expected, abs=1e-9)
    assert np.all(segment == segment[0])
    outside, nowhere = gyro.integral_at(whole.stamp[[0, -1]] + np.array([-1, 1]))
    assert np.isnan(outside).all()
    assert nowhere.tolist() == [-1, -1]
    gyro.forget_before(int(stamps[3]))
    assert gyro.integral_at(stamps[3:])[0] == pytest.approx(expected[3:], abs=1e-9)
    assert np.isnan(gyro.integral_at(stamps[:1])[0]).all()


def test_nothing_is_known_in_a_gap_nor_across_one() -> None:
    times = np.concatenate((np.arange(0.0, 200.0, 5.0), np.arange(600.0, 800.0, 5.0)))
    gyro = RateIntegrator(GAP)
    gyro.push(stream(times, even(times)))
    asked = np.array([100.0, 190.0, 300.0, 650.0, 700.0])
    known = np.isfinite(gyro.integral_at_samples(at(asked))).all(axis=1)
    assert known.tolist() == [True, True, False, True, True]
    # A gap between two samples: the second one is as if it were in it.
    gyro = RateIntegrator(GAP)
    gyro.push(stream(times, even(times)))
    known = np.isfinite(gyro.integral_at_samples(at(np.array([100.0, 150.0, 650.0])))).all(axis=1)
    assert known.tolist() == [True, True, False]
    assert np.isfinite(gyro.integral_at_samples(at(np.array([700.0])))).all()  # after the last of those before


def test_readings_at_the_end_of_the_range_are_not_used() -> None:
    times = np.arange(0.0, 500.0, 5.0)
    rate = even(times)
    rate[50] = 2.0 * (1.0 - 1e-7)  # as a number of four bytes may have it
    gyro = RateIntegrator(GAP, largest=2.0)
    gyro.push(stream(times, rate))
    assert gyro.dropped == {SATURATED: 1}
    known = np.isfinite(gyro.integral_at_samples(at(np.array([240.0, 248.0, 260.0, 270.0])))).all(axis=1)
    assert known.tolist() == [True, False, True, True]


def test_the_range_is_that_of_the_gyros_own_axes() -> None:
    times = np.arange(0.0, 500.0, 5.0)
    rate = even(times)
    rate[50] = 2.0, 0.0, 0.0
    turn = exp(np.array([[0.0, 0.0, 0.8]]))[0]
    gyro = RateIntegrator(GAP, largest=2.0)
    gyro.push(replace(stream(times, rate @ turn.T), read=rate))
    assert gyro.dropped == {SATURATED: 1}


@pytest.mark.parametrize('pieces', [1, 7, 90])
def test_an_axis_that_stays_the_same_while_it_turns_fast_is_stuck_from_its_eighth_reading_on(pieces: int) -> None:
    times = 5.0 * np.arange(90)
    rate = even(times)
    rate[:, 1] += 1.0
    rate[10:30, 1] = rate[40:47, 1] = rate[60:68, 0] = 0.8  # 20, 7 and 8 readings in a row
    rate[50:80, 2] = 0.1  # slow
    gyro, whole = RateIntegrator(GAP), stream(times, rate)
    for piece in np.array_split(np.arange(len(times)), pieces):
        gyro.push(whole[piece])
    assert gyro.dropped == {SATURATED: 13 + 0 + 1}


def window(rng: np.random.Generator, start: float, matrix: Array, link: str) -> Samples:
    """Return a window of a base that turns evenly, whose gyro, on the base or a link, reads the rate times a matrix."""
    time = start + np.arange(0.0, 0.5, 0.1)
    rate = 0.1 * rng.normal(size=3)
    turned = exp((time - start)[:, None] * rate) @ exp(1e-4 * rng.normal(size=(5, 3)))
    none, joints = np.zeros((5, 3)), np.zeros((5, 7))
    if link:  # that turns, joints and all, as the base would; at its first pose it is aligned with its frame
        joints = np.outer(time, rng.normal(size=7))
        relative, _ = KINEMATICS.configure(np.tile(np.eye(3), (5, 1, 1)), joints).link_pose(SERVICER.link(link))
        turned = turned @ np.swapaxes(relative, -1, -2)
    covariance = np.tile(1e-8 * np.eye(6), (5, 1, 1))
    gyro = time[:, None] * (matrix @ rate + np.array([0.01, -0.02, 0.03]))
    return Samples(time, joints, joints, none, turned, none, none, covariance, covariance, further=gyro)


@pytest.mark.parametrize(
    ('matrix', 'reported'),
    [
        (1.02 * exp(np.array([0.0, 0.03, 0.0])), ''),
        (np.eye(3) * 180.0 / np.pi, 'it is in degrees'),
        (np.diag([1.0, -1.0, -1.0]), 'turned by 180 degrees'),
        (np.diag([1.0, -1.0, 1.0]), 'left-handed axes: its x, y, z are (x, -y, z) as read'),
        (np.eye(3)[[1, 0, 2]], 'left-handed axes: its x, y, z are (y, x, z) as read'),
        (np.diag([1.0, 1.5, 1.0]), 'axes of other scales: y reads 1.5 times its motion'),
        (exp(np.array([0.0, 0.0, -1.0])), 'turned by 57 degrees about (0.00, 0.00, 1.00)'),
    ],
)
@pytest.mark.parametrize('link', ['', 'link6'])
def test_other_axes_and_units_are_reported(matrix: Array, reported: str, link: str) -> None:
    rng = np.random.default_rng(2)
    check = gyro_check(gyro_sensor('gyros.hand', 1e-4, SERVICER, SERVICER.link(link) if link else None), KINEMATICS)
    found = [check.update(window(rng, 0.5 * number, matrix, link)) for number in range(20)][-1]
    assert reported in (found.text if found else '')
    assert bool(found) == bool(reported)


def test_a_drift_is_repaired_by_a_walk_that_goes_as_far_in_half_a_minute() -> None:
    unknown = drifting_gyro('gyros.hand', 1e-7)
    cause, value = f'{DRIFT}:hand', np.array([0.0, 1e-4, 0.0])
    assert unknown.causes == (cause,) * 3
    found = unknown.repair(cause, value, 0.1 * value, kernel('servicer7'))
    assert found.parameters == {'gyros.hand.bias_walk': 1e-3}
    assert found.cause == 'the bias of the gyro hand drifts by 6 mrad/s a minute'
    axes, time = exp(generic(5, 2, 3)), np.array([3.0, 7.0])
    motion = cast('Motion', SimpleNamespace(time=time, axes=axes))
    assert np.array_equal(some(unknown.measured('gyros.hand', motion)), time[:, None, None] * axes)
    assert unknown.measured('imu', motion) is None


GENERATOR = np.random.default_rng(1)
FRAME = AttachedFrame(exp(np.array([0.4, -1.1, 0.7])), np.array([0.3, -0.2, 0.5]))
COUNT = 5


def base() -> BaseStream:
    rotation = exp(GENERATOR.normal(size=(COUNT, 3)))
    return BaseStream(
        np.arange(COUNT),
        *(GENERATOR.normal(size=(COUNT, 3)), rotation),
        *(GENERATOR.normal(size=(COUNT, 3)), GENERATOR.normal(size=(COUNT, 3))),
        *(np.tile(MID.pose_covariance(), (COUNT, 1, 1)), np.tile(MID.twist_covariance(), (COUNT, 1, 1))),
    )


def measured(stream: BaseStream) -> BaseStream:
    """Return what is measured of the frame."""
    lever = rotate(stream.rotation, FRAME.position)
    return replace(
        stream,
        position=stream.position + lever,
        rotation=stream.rotation @ FRAME.rotation,
        linear_velocity=stream.linear_velocity + cross(stream.angular_velocity, lever),
    )


def test_pose_and_twist_are_those_of_the_base() -> None:
    stream = base()
    back = FRAME.to_base(measured(stream))
    for name in ('position', 'rotation', 'linear_velocity', 'angular_velocity'):
        assert getattr(back, name) == pytest.approx(getattr(stream, name), abs=1e-12), name
    assert not FRAME.is_base
    assert AttachedFrame(np.eye(3), np.zeros(3)).is_base
    assert not AttachedFrame(FRAME.rotation, np.zeros(3)).is_base
    assert not AttachedFrame(np.eye(3), FRAME.position).is_base


def test_covariances_are_those_of_the_errors() -> None:
    stream = measured(base())
    converted = FRAME.to_base(stream)
    step = 1e-6

    def spread(change: list[BaseStream], pick: str) -> Array:
        """Return the covariance that small errors of the frame lead to, by differences."""
        columns = []
        for moved in change:
            back = FRAME.to_base(moved)
            if pick == 'pose':
                turn = log(back.rotation @ np.swapaxes(converted.rotation, 1, 2))
                columns.append(np.concatenate((back.position - converted.position, turn), axis=1) / step)
            else:
                change_of = (
                    back.linear_velocity - converted.linear_velocity,
                    back.angular_velocity - converted.angular_velocity,
                )
                axes = np.swapaxes(converted.rotation, 1, 2)
                columns.append(np.concatenate([rotate(axes, value) for value in change_of], axis=1) / step)
        jacobian = np.stack(columns, axis=-1)
        covariance = stream.pose_covariance if pick == 'pose' else stream.twist_covariance
        return jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)

    errors = step * np.eye(3)
    poses = [replace(stream, position=stream.position + error) for error in errors]
    poses += [replace(stream, rotation=exp(error) @ stream.rotation) for error in errors]
    twists = [replace(stream, linear_velocity=stream.linear_velocity + rotate(stream.rotation, e)) for e in errors]
    twists += [replace(stream, angular_velocity=stream.angular_velocity + rotate(stream.rotation, e)) for e in errors]
    assert converted.pose_covariance == pytest.approx(spread(poses, 'pose'), rel=1e-4, abs=1e-12)
    assert converted.twist_covariance == pytest.approx(spread(twists, 'twist'), rel=1e-4, abs=1e-12)


READINGS, SPACING = 200, 20_000_000  # ns
TIME = 1e-9 * SPACING * np.arange(READINGS)
RANDOM = np.random.default_rng(2)


def merged(position: Array, velocity: Array, pieces: int, time: Array = TIME) -> Array:
    """Return the positions (N, 1) that one turning joint has after the merge."""
    merge = JointMerge(np.array([True]), 100_000_000, 0)
    stamp, parts = np.round(1e9 * time).astype(np.int64), []
    for piece in np.array_split(np.arange(len(time)), pieces):
        found = merge.push({(0,): JointStream(stamp[piece], position[piece, None], velocity[piece, None])})
        parts += [] if found is None else [found.position[:, 0]]
    return np.concatenate(parts)


def wrapped_to_a_turn(angle: Array) -> Array:
    return np.asarray(np.angle(np.exp(1j * angle)))


@pytest.mark.parametrize('pieces', [1, 9, READINGS])
@pytest.mark.parametrize('speed', [-400.0, -170.0, -157.08, 0.3, 157.08, 1000.0])
@pytest.mark.parametrize('wrapped', [True, False])
def test_positions_follow_the_velocity(speed: float, pieces: int, *, wrapped: bool) -> None:
    angle = 0.3 + speed * 1e-9 * SPACING * np.arange(READINGS)
    read = wrapped_to_a_turn(angle) if wrapped else angle
    read += 1e-3 * RANDOM.standard_normal(READINGS)
    velocity = speed + 0.1 * RANDOM.standard_normal(READINGS)
    found = merged(read, velocity, pieces)
    assert np.ptp(found - angle) < 0.01


@pytest.mark.parametrize('velocity', [np.nan, 0.0, 1e4])
def test_a_velocity_that_is_missing_or_wrong_turns_nothing(velocity: float) -> None:
    angle = np.pi - 0.05 * np.cos(0.1 * np.arange(READINGS))
    found = merged(wrapped_to_a_turn(angle), np.full(READINGS, velocity), 1)
    assert np.ptp(found - angle) < 1e-9


@pytest.mark.parametrize('pieces', [1, 200])
@pytest.mark.parametrize('rate', [10.0, 50.0, 400.0])
@pytest.mark.parametrize('way', [1.0, -1.0])
def test_a_wheel_is_followed_as_it_spins_up_over_lost_messages(way: float, rate: float, pieces: int) -> None:
    time: Array = np.arange(0.0, 30.0, 1.0 / rate)
    kept = (RANDOM.random(len(time)) > 0.2) & ((time < 12.0) | (time > 12.5))
    time = time[kept]
    speed = way * (330.0 * np.sin(0.1 * time) + 2.0)
    angle = way * (2.0 * time - 3300.0 * np.cos(0.1 * time))
    read = wrapped_to_a_turn(angle) + 1e-3 * RANDOM.standard_normal(len(time))
    found = merged(read, speed + 0.05 * RANDOM.standard_normal(len(time)), pieces, time)
    assert np.ptp(found - angle) < 0.02


@pytest.mark.parametrize('pieces', [1, READINGS])
@pytest.mark.parametrize('velocity', [0.0, np.nan, 330.0])
def test_single_wrong_readings_of_a_wheel_leave_no_turns_behind(velocity: float, pieces: int) -> None:
    angle, speed = 0.3 + 330.0 * TIME, np.full(READINGS, 330.0)
    wrong = np.arange(READINGS) % 13 == 5
    read, speed[wrong] = np.where(wrong, 0.0, wrapped_to_a_turn(angle)), velocity
    found = merged(read, speed, pieces)
    assert np.ptp((found - angle)[~wrong]) < 1e-6


def test_an_arm_whose_velocities_are_in_degrees_turns_nowhere() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    angle = 2.0 * np.sin(0.5 * time)
    assert np.ptp(merged(angle, np.rad2deg(np.cos(0.5 * time)), 1, time) - angle) < 1e-9


def test_samples_wait_for_a_gyro_that_is_silent_for_less_than_a_second() -> None:
    gyro = RateIntegrator(GAP)
    assert gyro.complete_until(5_000_000_000) == 4_000_000_000
    gyro.push(stream(np.array([3000.0, 3500.0]), np.zeros((2, 3))))
    assert gyro.complete_until(4_200_000_000) == 3_500_000_000
    assert gyro.complete_until(4_600_000_000) == 3_600_000_000


def test_readings_are_forgotten_up_to_the_last_that_is_needed() -> None:
    times = 5.0 * np.arange(20)
    for until, left in ((-1, 20), (0, 20), (50, 10), (52, 10), (54, 10), (55, 9), (1000, 1)):
        gyro = RateIntegrator(GAP)
        gyro.push(stream(times, even(times)))
        whole = gyro.integral_at(at(times))[0]
        gyro.forget_before(until * MILLISECOND)
        found = gyro.integral_at(at(times))[0]
        known = np.isfinite(found).all(axis=1)
        assert known.sum() == left
        assert found[known] == pytest.approx(whole[known])


def test_a_gap_is_longer_than_declared_and_lost_readings_make_one() -> None:
    for apart, known in ((100.0, True), (101.0, False)):
        gyro = RateIntegrator(GAP, largest=2.0)
        gyro.push(stream(np.array([0.0, 10.0, 10.0 + apart, 20.0 + apart]), np.ones((4, 3))))
        assert bool(np.isfinite(gyro.integral_at(at(np.array([12.0])))[0]).all()) is known
    for places, parts, all_parts in (([0], [-1, 0, 0, 0], 1), ([1], [0, -1, 1, 1], 2), ([3], [0, 0, 0, -1], 2)):
        gyro, rate = RateIntegrator(GAP, largest=2.0), np.ones((4, 3))
        rate[places, 1] = -2.0
        gyro.push(stream(10.0 * np.arange(4), rate))
        gyro.push(stream(np.array([40.0, 50.0]), np.ones((2, 3))))
        found, segments = gyro.integral_at(at(10.0 * np.arange(4)))
        lost = np.array(parts) < 0
        assert np.isnan(found).all(axis=1).tolist() == lost.tolist()
        assert len(set(segments[~lost].tolist())) == len({*parts} - {-1})
        after = gyro.integral_at(at(np.array([50.0])))[1]
        assert len({*segments[~lost].tolist(), *after.tolist()}) == all_parts


def test_an_orientation_by_integration_stays_one_and_turns_as_far_as_its_rate() -> None:
    """A rate that changes evenly and turns: to fourth order, however many steps there are."""

    def ends(count: int) -> Array:
        time = np.linspace(0.0, 20.0, count)
        rate = np.array([0.3, -0.2, 0.1]) + time[:, None] * np.array([-0.02, 0.05, 0.03])
        stamps = np.round(1e9 * time).astype(np.int64)
        return some(DeadReckoning().push(ImuStream(stamps, rate))).rotation[-1]

    coarse, fine, finest = (ends(count) for count in (201, 401, 1601))
    assert finest @ finest.T == pytest.approx(np.eye(3), abs=1e-14)
    first, second = (np.linalg.norm(log(each.T @ finest)) for each in (coarse, fine))
    assert first < 1e-5
    assert second == pytest.approx(first / 16.0, rel=0.3)


@pytest.mark.parametrize('count', [5, 10, 25])
def test_white_noise_of_a_gyro_is_as_large_in_a_window_as_its_weights_make_it(count: int) -> None:
    """Rates of knots are differences of means over a knot, sharpened by those beside; drawn at a hundred a knot."""
    spacing, fine = 0.05, 100
    rng = np.random.default_rng(count)
    steps = rng.normal(size=(600, (count + 6) * fine)) * np.sqrt(spacing / fine)  # of unit density
    means = np.cumsum(steps, axis=1).reshape(600, count + 6, fine).mean(axis=2)
    rates = np.diff(means, axis=1) / spacing  # between knots
    sharp = rates[:, 1:-1] - np.diff(rates, 2, axis=1) / 24.0
    offset = (sharp.shape[1] - count) // 2
    window = sharp[:, offset : offset + count] @ parabolic_weights(count)
    assert np.var(window) == pytest.approx(_preintegrated(count, spacing), rel=0.2)


def test_a_gyro_askew_to_the_base_has_scales_about_the_axes_of_its_frame() -> None:
    askew = replace(SERVICER.links[0], name='imu_link', rotation=exp(np.array([0.1, -0.2, 0.7])))
    model = replace(SERVICER, links=(*SERVICER.links, askew))
    config = ImuConfig(noise_density=1e-4, frame='imu_link', scale_std=0.02)
    (sensor,) = gyro_sensors({'imu': config}, model, '')
    assert sensor.link is None
    scales = gyro(GyroErrors(scale=0.02, axes=askew.rotation)).factor
    assert declared_gyro(config, sensor).factor[:, 3:6] == pytest.approx(scales)


def test_scales_of_a_gyro_that_may_be_askew_count_about_any_axes() -> None:
    """Where nothing says on which link it is: no frame leads to wider ones than are declared."""
    links = [
        replace(SERVICER.links[0], name='imu_link', rotation=exp(np.array(turn)))
        for turn in ([0.1, -0.2, 0.7], [0.0, 0.0, 0.25 * np.pi], [0.0, 0.5 * np.pi, 0.0])
    ]
    for shared in (0.0, 0.03):
        config = ImuConfig(noise_density=1e-4, scale_std=0.02, cross_axis_std=shared)
        for askew in links:
            model = replace(SERVICER, links=(*SERVICER.links, askew))
            unset, named = (
                declared_gyro(each, *gyro_sensors({'imu': each}, model, '')).factor
                for each in (config, replace(config, frame='imu_link'))
            )
            left = unset @ unset.T - named @ named.T
            assert np.linalg.eigvalsh(left).min() > -1e-12
            # A quarter turn only exchanges the axes.
            assert (np.abs(left).max() < 1e-12) == (askew is links[-1])


def test_messages_of_an_imu_that_cannot_be_used_are_counted_by_their_cause() -> None:
    axes = {'one': exp(generic(1, 3)), 'other': exp(generic(2, 3))}
    rates = generic(3, 33).reshape(11, 3)
    rates[1, 1], rates[2, 0], rates[3:6, 2] = np.nan, np.inf, 1e9
    frames = ['one'] * 8 + ['other', 'none', 'none']
    messages = [
        SimpleNamespace(
            header=SimpleNamespace(frame_id=frame, stamp=SimpleNamespace(sec=3, nanosec=place)),
            angular_velocity=SimpleNamespace(**dict(zip('xyz', rate, strict=True))),
            angular_velocity_covariance=[-1.0 if place == 7 else 0.0, *[0.0] * 8],
        )
        for place, (frame, rate) in enumerate(zip(frames, rates, strict=True))
    ]
    reader = ImuReader(axes, '')
    found, dropped = reader.read(messages)
    assert dropped == {IMU_NOT_FINITE: 2, IMU_NOT_REAL: 3, IMU_WITHOUT_RATE: 1, IMU_FRAME: 2}
    assert reader.other_frame == 'none'
    kept = some(found)
    assert kept.stamp.tolist() == [3 * 10**9 + place for place in (0, 6, 8)]
    expected = [axes[frames[place]] @ rates[place] for place in (0, 6, 8)]
    assert kept.angular_velocity == pytest.approx(np.array(expected))


def test_messages_may_be_in_the_frame_of_any_link_of_the_base_by_its_prefixed_name() -> None:
    (sensor,) = gyro_sensors({'imu': ImuConfig(noise_density=1e-4)}, SERVICER, '')
    message = SimpleNamespace(
        header=SimpleNamespace(frame_id='first/base_link', stamp=SimpleNamespace(sec=3, nanosec=0)),
        angular_velocity=SimpleNamespace(x=0.1, y=-0.2, z=0.3),
        angular_velocity_covariance=[0.0] * 9,
    )
    read = {
        prefix: imu_reader(ImuConfig(), sensor, SERVICER, prefix, 0.0).read([message])[0] for prefix in ('first/', '')
    }
    assert some(read['first/']).angular_velocity.tolist() == [[0.1, -0.2, 0.3]]
    assert read[''] is None
