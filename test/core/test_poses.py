"""Further poses by name: interpolation between knots, rows in the filter, worlds of their own, refusals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, Literal, cast

import numpy as np
import pytest

from benchmarks.data import simulator_config
from checked import assert_derivative, generic, some
from gyros import normalised
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.clocks import LATE
from mbaid_ros.core.contracts import Motion
from mbaid_ros.core.geometry import Array, exp, log, quaternion_from_rotation, rotate, rotation_from_quaternion
from mbaid_ros.core.noise import FoundNoise
from mbaid_ros.core.outliers import OUTLIER, ResidualGate
from mbaid_ros.core.poses import (
    DRIFT,
    EARLY,
    TURNING,
    NamedPoseConfig,
    PoseCollector,
    PoseSensor,
    Reference,
    pose_check,
    pose_drift,
    pose_errors,
    pose_sensors,
    pose_wander,
)
from mbaid_ros.core.poses import _between as between
from mbaid_ros.core.poses import _interpolation as interpolation
from mbaid_ros.core.repair import Repair
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import Kinematics
from mbaid_ros.core.samples import BaseStream, Samples, Stamps
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.session.explanation import intake_warnings, sensor_rows
from mbaid_ros.session.repairing import RepairPolicy
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulated_run import SimulatedRun
from observed import kernel
from sessions import NOISE, fed
from simulated import robot
from streams import urdf
from unchanged import Unchanged

ROBOT = 'servicer7'
START = 1_700_000_000_000_000_000  # ns
GYRO = {'imu.rate': 100.0, 'imu.noise_density': 1e-5, 'imu.bias': [1e-3, -2e-3, 1e-3]}
WITH_GYRO = {**EXACT, 'imu.noise_density': 1e-5, 'imu.bias_std': 1e-2}
TRACKER = {'poses.names': ['tracker'], 'poses.tracker.measures': 'orientation', 'poses.tracker.orientation_std': 2e-5}
T_PLACES = np.sort(np.append(np.random.default_rng(6).uniform(0.1, 16.0, 38), [0.5, 14.5]))  # s
Said = list[tuple[float, str, Any]]


@cache
def spoken(seed: int, seconds: float) -> tuple[tuple[float, str, Any], ...]:
    """Return what joints, odometry and a gyro on the base say."""
    made = SimulatedRun(simulator_config(ROBOT, {**NOISE, **GYRO, 'seed': seed}), urdf(ROBOT), BAG_TYPES)
    made.start = START
    return tuple((each.time, each.topic, each.message) for each in made.read(seconds - 0.001))


def said(seed: int, seconds: float, *without: str) -> Said:
    return [each for each in spoken(seed, seconds) if each[1] not in without]


def poses(
    name: str,
    seed: int,
    seconds: float,
    rate: float,
    noise: tuple[float, float],
    world: tuple[float, ...] = (),
    *,
    link: str = 'base_link',
) -> Said:
    """Return what a sensor of a link's pose says in the same run.

    Parameters
    ----------
    rate, noise : Hz; m and rad, of a reading
    world : turn (rad) and displacement (m) of its world; none: that of the odometry
    """
    simulation = make_simulation(simulator_config(ROBOT, {**NOISE, 'seed': seed}), robot(ROBOT))
    times = np.arange(0.0137, seconds, 1.0 / rate)
    truth = simulation.advance(times)
    random = np.random.default_rng([seed, 77])
    moved, kinematics = robot(ROBOT), Kinematics(robot(ROBOT))
    placed = kinematics.configure(rotation_from_quaternion(truth.base_orientation), truth.joint_position)
    turned, away = placed.link_pose(moved.link(link))
    rotation = exp(noise[1] * random.normal(size=(len(times), 3))) @ turned
    position = truth.base_position + away + noise[0] * random.normal(size=(len(times), 3))
    if world:
        turn = exp(np.array(world[:3]))
        rotation, position = turn @ rotation, position @ turn.T + np.array(world[3:])
    found = []
    for time, place, turned in zip(times.tolist(), position, quaternion_from_rotation(rotation), strict=True):
        stamp = START + round(time * 1e9)
        header = SimpleNamespace(stamp=SimpleNamespace(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id='world')
        point = SimpleNamespace(**dict(zip('xyz', place.tolist(), strict=True)))
        pose = SimpleNamespace(
            position=point, orientation=SimpleNamespace(**dict(zip('xyzw', turned.tolist(), strict=True)))
        )
        found.append((time, f'poses.{name}', SimpleNamespace(header=header, pose=pose)))
    return found


def heard(messages: Said, parameters: Mapping[str, object], at_once: int = 100_000) -> tuple[Session, list[Estimate]]:
    session = Session(build(EstimatorConfig, parameters), urdf(ROBOT))
    in_order = sorted(messages, key=lambda each: each[0])
    return session, fed(session, ((topic, message) for _, topic, message in in_order), at_once)


def last(messages: Said, parameters: Mapping[str, object]) -> Estimate:
    return heard(messages, parameters)[1][-1]


@cache
def by_odometry(seed: int) -> tuple[Estimate, ...]:
    """Return the estimates of 11 s by joints and odometry alone."""
    return tuple(heard(said(seed, 11.0, 'imu'), EXACT)[1])


def test_cubics_are_interpolated_exactly_between_knots() -> None:
    place = np.array([[-0.3, 0.0], [0.4, 2.5], [4.7, 6.0]])
    weights = interpolation(place, 7)
    knots = np.arange(7.0)
    for power in range(4):
        assert weights @ knots**power == pytest.approx(place**power, abs=1e-11)


@pytest.mark.parametrize('fast', [1.0, 18.0])  # by more than half a turn in all, by less within four knots
def test_a_pose_between_knots_is_that_of_a_steady_turn(fast: float) -> None:
    times = np.arange(6.0)[:, None]
    rate = fast * np.array([[0.02, -0.03, 0.01], [0.0, 0.05, 0.02]])
    velocity = np.array([[0.1, 0.0, -0.2], [0.3, 0.1, 0.0]])
    rotation, position = exp(times[..., None] * rate), times[..., None] * velocity
    place = np.array([[0.3, 4.6], [2.2, 3.9]])
    turned, there = between(rotation, position, place, interpolation(place, 6))
    assert turned == pytest.approx(exp(place[..., None] * rate), abs=1e-12)
    assert there == pytest.approx(place[..., None] * velocity, abs=1e-12)


def test_one_pose_is_a_position_and_an_orientation() -> None:
    """Equal numbers of one sensor of both, and of two with the same readings, of which each measures one part."""
    noise = 1e-3, 1e-4
    read = poses('whole', 0, 11.0, 50.0, noise)
    exact = {'time_offset_std': 0.0, 'turning_std': 0.0}  # one of both parts, and two of a part each
    levels = {'position_std': noise[0], 'orientation_std': noise[1], **exact}
    without = said(0, 11.0, 'odom', 'imu')

    def declared(**measures: str) -> dict[str, object]:
        own: dict[str, object] = {f'poses.{name}.{key}': each for name in measures for key, each in levels.items()}
        own |= {f'poses.{name}.measures': value for name, value in measures.items()}
        return {**EXACT, 'poses.alone': True, 'poses.names': list(measures), **own}

    one = last([*without, *read], declared(whole='both'))
    parts = [(time, f'poses.{name}', message) for name in ('place', 'turn') for time, _, message in read]
    two = last([*without, *parts], declared(place='position', turn='orientation'))
    assert one.identifiable.all()
    assert two.parameters == pytest.approx(one.parameters, abs=1e-6 * float(np.min(one.std)))
    assert two.std == pytest.approx(one.std, rel=1e-6)


@pytest.mark.parametrize(
    'world', [pytest.param((), marks=pytest.mark.long), pytest.param((0.3, -0.5, 1.0, 3.0, 2.0, 1.0), id='world1')]
)
def test_motion_capture_beside_odometry_makes_estimates_sharper(world: tuple[float, ...], unchanged: Unchanged) -> None:
    alone = by_odometry(0)[-1]
    read = poses('mocap', 0, 11.0, 100.0, (1e-4, 2e-5), world)
    names = {'poses.names': ['mocap'], 'poses.mocap.position_std': 1e-4, 'poses.mocap.orientation_std': 2e-5}
    both = last([*said(0, 11.0, 'imu'), *read], {**EXACT, **names, 'poses.mocap.same_world': not world})
    unchanged(both)
    assert both.status in {'estimating', 'converged'}
    assert np.all(both.std < 0.6 * alone.std)
    assert np.all(np.abs(normalised(both, ROBOT)) < 3.5)


@pytest.mark.parametrize('link', [pytest.param('link3', marks=pytest.mark.long), 'link7'])
def test_a_camera_on_the_arm_or_on_the_target_makes_estimates_sharper(link: str, unchanged: Unchanged) -> None:
    alone = by_odometry(4)[-1]
    read = poses('mocap', 4, 11.0, 100.0, (1e-4, 2e-5), (0.3, -0.5, 1.0, 3.0, 2.0, 1.0), link=link)
    names = {'poses.names': ['mocap'], 'poses.mocap.position_std': 1e-4, 'poses.mocap.orientation_std': 2e-5}
    both = last([*said(4, 11.0, 'imu'), *read], {**EXACT, **names, 'poses.mocap.frame': link})
    unchanged(both)
    assert both.status in {'estimating', 'converged'}
    assert np.all(both.std < 0.9 * alone.std)
    assert np.all(np.abs(normalised(both, ROBOT)) < 3.5)


def test_a_star_tracker_and_a_gyro_alone() -> None:
    read = poses('tracker', 1, 20.0, 2.0, (1.0, 2e-5))
    session, estimates = heard([*said(1, 20.0, 'odom'), *read], {**WITH_GYRO, **TRACKER, 'poses.alone': True})
    estimate = estimates[-1]
    assert estimate.status in {'estimating', 'converged'}
    assert estimate.identifiable.all()
    assert np.all(np.abs(normalised(estimate, ROBOT)) < 3.5)
    assert session.config.located is False


def test_a_camera_that_measures_positions_beside_a_star_tracker(unchanged: Unchanged) -> None:
    read = [*poses('tracker', 2, 15.0, 2.0, (1.0, 2e-5)), *poses('camera', 2, 15.0, 5.0, (1e-3, 1.0))]
    camera = {'poses.camera.measures': 'position', 'poses.camera.position_std': 1e-3, 'poses.alone': True}
    names = {**TRACKER, **camera, 'poses.names': ['camera', 'tracker']}
    estimate = last([*said(2, 15.0, 'odom'), *read], {**WITH_GYRO, **names})
    unchanged(estimate)
    assert estimate.identifiable.all()
    assert np.all(np.abs(normalised(estimate, ROBOT)) < 3.5)


def test_calls_make_no_difference() -> None:
    messages = [*said(3, 8.0), *poses('tracker', 3, 8.0, 2.0, (1.0, 2e-5))]
    at_once, few = (heard(messages, {**WITH_GYRO, **TRACKER}, count)[1] for count in (100_000, 7))
    assert [each.stamp for each in at_once] == [each.stamp for each in few]
    assert np.array_equal(at_once[-1].parameters, few[-1].parameters)
    assert np.array_equal(at_once[-1].std, few[-1].std)


def test_a_sensor_that_never_speaks_is_named_and_the_run_goes_on() -> None:
    session, estimates = heard(said(0, 11.0, 'imu'), {**EXACT, **TRACKER})
    assert 'poses.tracker is used, and nothing comes on tracker' in intake_warnings(session)
    alone = by_odometry(0)
    # It is waited for, a second.
    before = next(each for each in alone if each.stamp == estimates[-1].stamp)
    assert estimates[-1].std == pytest.approx(before.std, rel=1e-9)
    assert alone[-1].stamp - estimates[-1].stamp <= 1_000_000_000


def test_one_that_is_not_used_changes_nothing() -> None:
    left_out = last(said(0, 8.0, 'imu'), {**EXACT, **TRACKER, 'poses.tracker.use': False})
    assert np.array_equal(left_out.std, last(said(0, 8.0, 'imu'), EXACT).std)


def shifted(messages: Said, change: Callable[[Any, float], None]) -> Said:
    """Return messages that a function of each and its time, s, has changed."""
    copies = deepcopy(messages)
    for time, _, message in copies:
        change(message, time)
    return copies


def late(message: Any, _time: float) -> None:
    """Stamp a message 50 ms late."""
    stamp = message.header.stamp
    seconds, stamp.nanosec = divmod(stamp.nanosec + 50_000_000, 1_000_000_000)
    stamp.sec += seconds


def drifting(message: Any, time: float) -> None:
    """Move a pose by 2 mm/s."""
    message.pose.position.x += 2e-3 * time


def stretched(message: Any, _time: float) -> None:
    """Make lengths 1 % too large."""
    for axis in 'xyz':
        setattr(message.pose.position, axis, 1.01 * getattr(message.pose.position, axis))


def noisy(message: Any, time: float) -> None:
    """Add noise of 5 mm."""
    message.pose.position.x += 5e-3 * float(np.random.default_rng(round(1e4 * time)).normal())


@pytest.mark.parametrize(
    ('change', 'named', 'among'),
    [
        pytest.param(late, 'mocap is stamped +', 1, marks=pytest.mark.long),
        pytest.param(stretched, 'lengths of mocap are +0.99', 1, marks=pytest.mark.long),
        # A steady drift may as well be one of the odometry the other way: momentum is conserved in either frame.
        pytest.param(drifting, 'poses.mocap contradicts the other sensors', 2, marks=pytest.mark.long),
        (noisy, 'poses.mocap.position_std and poses.mocap.orientation_std are', 1),
    ],
)
def test_a_broken_sensor_is_the_first_cause(
    change: Callable[[Any, float], None], named: str, among: int, unchanged: Unchanged
) -> None:
    noise = 1e-3, 1e-4
    read = shifted(poses('mocap', 0, 16.0, 50.0, noise), change)
    names = {'poses.names': ['mocap'], 'poses.mocap.position_std': noise[0], 'poses.mocap.orientation_std': noise[1]}
    estimate = last([*said(0, 16.0), *read], {**WITH_GYRO, **names, 'known_links.relative_std': 0.01})
    unchanged(estimate)
    assert estimate.contradicted
    assert any(cause.startswith(named) for cause, _ in estimate.causes[:among])


def test_each_sensor_has_a_row() -> None:
    read = poses('tracker', 3, 11.0, 2.0, (1.0, 2e-5))
    session, estimates = heard([*said(3, 11.0), *read, *read[-1:]], {**WITH_GYRO, **TRACKER})
    odometry, imu, tracker = sensor_rows(session, estimates[-1])
    assert (odometry.name, imu.name, tracker.name) == ('odom', 'imu', 'poses.tracker')
    assert (tracker.topic, tracker.used, tracker.dropped) == ('/tracker', len(read), {'stamp repeated': 1})
    assert (odometry.rate, imu.rate, tracker.rate) == pytest.approx((100.0, 100.0, 2.0), rel=0.1)
    assert odometry.share + imu.share + tracker.share == pytest.approx(1.0)
    assert 0.5 < tracker.residual < 1.5


def test_a_sensor_that_a_repair_leaves_out_has_a_row_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    noise = 1e-3, 1e-4
    read = poses('mocap', 0, 5.0, 50.0, noise)
    names = {'poses.names': ['mocap'], 'poses.mocap.position_std': noise[0], 'poses.mocap.orientation_std': noise[1]}
    left = iter([Repair('poses.mocap contradicts the other sensors', {'poses.mocap.use': False})])
    monkeypatch.setattr(RepairPolicy, 'repair', lambda *_: next(left, None))
    session, estimates = heard([*said(0, 5.0, 'imu'), *read], {**EXACT, **names, 'repair': True})
    assert np.array_equal(estimates[-1].std, last(said(0, 5.0, 'imu'), EXACT).std)
    _, mocap = sensor_rows(session, estimates[-1])
    assert (mocap.name, mocap.used, mocap.dropped) == ('poses.mocap', 0, {'left out by a repair': len(read)})
    session.reset()  # it is read again
    assert fed(session, [('poses.mocap', message) for _, _, message in read]) == []
    assert session.dropped_of('poses.mocap') == {}


def test_orientations_are_not_made_up_while_their_sensor_is_silent() -> None:
    located, turned = (readings((1e9 * np.arange(0.0, 40.0, step)).astype(np.int64)) for step in (0.1, 0.5))
    silent = (turned.stamp > 10 * 10**9) & (turned.stamp < 30 * 10**9)
    made = some(Reference('camera', 'tracker', np.zeros(3)).push({'camera': located, 'tracker': turned[~silent]}))
    assert not np.any((made.stamp > 10 * 10**9) & (made.stamp < 30 * 10**9))
    assert (
        len(made.stamp) == np.sum((located.stamp <= 10 * 10**9) | (located.stamp >= 30 * 10**9)) - 5
    )  # that at 30 s among them


def readings(stamps: Stamps) -> BaseStream:
    count = len(stamps)
    unknown, nothing = np.full((count, 3), np.nan), np.zeros((count, 6, 6))
    return BaseStream(
        stamps, np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), unknown, unknown, nothing, nothing
    )


def samples(stamps: Stamps) -> Samples:
    count = len(stamps)
    still, upright, nothing = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 6, 6))
    joints = np.zeros((count, 1))
    return Samples(1e-9 * stamps, joints, joints, still, upright, still, still, nothing, nothing)


@pytest.mark.parametrize('pieces', [1, 4, 40])
def test_samples_have_the_readings_since_the_one_before(pieces: int) -> None:
    """Times in ms: samples each 10, readings each 25 but one, which comes sooner than samples waited for it."""
    stamps = np.sort(np.append(np.arange(3, 1000, 25), 504)) * 1_000_000
    every = np.arange(0, 1000, 10) * 1_000_000
    collector = PoseCollector(100_000_000, 'both', same_world=True)
    counts: list[Array] = []
    done = 0
    for part in np.array_split(stamps, pieces):
        collector.push(readings(part))
        ready = int(np.searchsorted(every, collector.complete_until(int(every[-1])), side='right'))
        if ready > done:
            counts.append(collector.columns(samples(every[done:ready]), every[done:ready])[:, 0])
            done = ready
    expected = np.bincount(np.searchsorted(every, np.arange(3, 1000, 25) * 1_000_000), minlength=101)
    found = np.concatenate(counts)
    assert np.array_equal(found, expected[: len(found)])
    assert collector.dropped[EARLY] == 1


@pytest.mark.parametrize('measures', ['both', 'position', 'orientation'])
def test_readings_are_summed_in_the_world_of_the_odometry_which_the_first_of_them_places(measures: str) -> None:
    """Each at the next sample, if that is near; parts without a measurement are no outliers."""
    rng, every = np.random.default_rng(3), np.append(np.arange(0, 1000, 50), 2000) * 1_000_000
    stamps = np.array([3, 20, 61, 500, 899, 1880, 1900, 1990]) * 1_000_000
    at = np.searchsorted(every, stamps)
    there = replace(samples(every), base_rotation=exp(rng.normal(size=(21, 3))), base_position=rng.normal(size=(21, 3)))
    there = replace(there, time=there.time + 7.0)
    turn, shift = (np.eye(3) if measures == 'position' else exp(generic(1, 1, 3))[0]), generic(2, 3)
    rotation, place = turn @ there.base_rotation[at], there.base_position[at] @ turn.T + shift
    rotation = exp(rng.normal(size=(8, 3))) if measures == 'position' else rotation
    place[1:] += 0.0 if measures != 'orientation' else rng.normal(size=(7, 3))
    root = rng.normal(size=(8, 6, 6))
    read = replace(readings(stamps), rotation=rotation, position=place, pose_covariance=root @ np.swapaxes(root, 1, 2))
    collector, whole = PoseCollector(100_000_000, measures, same_world=False), np.kron(np.eye(2), turn)
    collector.push(read)
    found = collector.columns(there, every)
    assert collector.dropped == {'no sample around the stamp of a pose': 1, LATE: 0, EARLY: 0, OUTLIER: 0}
    expected = np.zeros((21, 50))
    for place_of, one in zip(at, range(8), strict=True):
        pose = (turn.T @ rotation[one]).ravel(), turn.T @ (read.position[one] - shift)
        covariance = (whole.T @ read.pose_covariance[one] @ whole).ravel()
        if one != 5:  # 120 ms before the next sample
            expected[place_of] += np.concatenate(([1.0, 1e-9 * stamps[one] + 7.0], *pose, covariance))
    assert found == pytest.approx(expected, abs=1e-9)
    collector.push(read)
    assert collector.dropped[LATE] + collector.dropped[EARLY] == 8


@pytest.mark.parametrize('pieces', [1, 9])
def test_positions_of_one_sensor_between_orientations_of_another_are_poses_of_the_base(pieces: int) -> None:
    rate, lever, rng = np.array([0.3, -0.5, 0.2]), generic(4, 3), np.random.default_rng(5)
    turns, places = (readings(np.round(1e9 * each).astype(np.int64)) for each in (np.arange(1, 30) / 2, T_PLACES))
    covariances = [
        each @ np.swapaxes(each, 1, 2) for each in (rng.normal(size=(29, 6, 6)), rng.normal(size=(40, 6, 6)))
    ]
    turns = replace(turns, rotation=exp(1e-9 * turns.stamp[:, None] * rate), pose_covariance=covariances[0])
    base, turned = rng.normal(size=(40, 3)), exp(T_PLACES[:, None] * rate)
    places = replace(places, position=base + rotate(turned, lever), pose_covariance=covariances[1])
    both, parts = Reference('camera', 'tracker', lever), []
    for time in np.array_split(np.arange(0, 200), pieces):
        own = [each[(each.stamp >= 1e8 * time[0]) & (each.stamp < 1e8 * (time[-1] + 1))] for each in (places, turns)]
        given = {name: each for name, each in zip(('camera', 'tracker'), own, strict=True) if len(each.stamp)}
        parts += [each for each in [both.push(given)] if each is not None]
    made = BaseStream.concatenate(parts)
    known = (T_PLACES >= 0.5) & (T_PLACES <= 14.5)
    assert both.name == 'camera'
    assert made.stamp.tolist() == places.stamp[known].tolist()
    assert made.position == pytest.approx(base[known], abs=1e-8)
    assert made.rotation == pytest.approx(turned[known], abs=1e-8)
    assert np.isnan(made.linear_velocity).all()
    assert np.isnan(made.angular_velocity).all()
    after = np.searchsorted(turns.stamp, made.stamp).clip(min=1)
    assert np.array_equal(made.pose_covariance[:, :3, :3], covariances[1][known][:, :3, :3])
    assert np.array_equal(made.pose_covariance[:, 3:, 3:], covariances[0][after][:, 3:, 3:])
    assert not made.pose_covariance[:, :3, 3:].any()
    assert not made.pose_covariance[:, 3:, :3].any()


def test_one_sensor_alone_locates_the_base_or_turns_it() -> None:
    read = replace(readings(np.arange(4)), position=generic(1, 4, 3), declared=np.eye(4, dtype=bool))
    one, turning = Reference('tracker', 'tracker', np.ones(3)), Reference(None, 'tracker', np.ones(3))
    assert [one.name, turning.name] == ['tracker', 'tracker']
    assert [one.push({}), turning.push({})] == [None, None]
    made, turned = some(one.push({'tracker': read})), some(turning.push({'tracker': read}))
    assert np.array_equal(made.position, read.position)
    assert np.isnan([made.linear_velocity, made.angular_velocity]).all()
    assert np.array_equal(turned.declared, read.declared)
    assert np.isnan(turned.pose_covariance[:, :3, :3]).all()


@pytest.mark.parametrize('pieces', [1, 5, 300])
def test_a_reading_that_leaves_the_motion_is_dropped_and_a_lasting_change_is_not(pieces: int) -> None:
    """At any rate: the residual drifts, one reading is off, and later all are."""
    rng = np.random.default_rng(0)
    residual = 1e-4 * rng.normal(size=(300, 2, 3)) + np.linspace(0.0, 0.05, 300)[:, None, None]
    residual[[100, 101, 200], 0] += 0.02
    residual[230:, 1] += 0.1
    gate, parts = ResidualGate(2), np.array_split(np.arange(300), pieces)
    found = np.concatenate([gate.outliers(residual[part], np.full((len(part), 2), 1e-4)) for part in parts])
    assert np.flatnonzero(found).tolist() == [100, 101, 200, 230, 231, 232]


@pytest.mark.parametrize('pieces', [1, 7, 200])
def test_noise_that_nobody_declares_is_found_in_the_readings(pieces: int) -> None:
    rng, time = np.random.default_rng(1), np.arange(200) / 10.0
    moving = np.sin(0.3 * time)[:, None] * np.ones(6)
    values = moving + rng.normal(size=(200, 6)) * np.repeat((4e-3, 5e-4), 3)
    noise, stamp = FoundNoise(np.array([1e-3, 1e-4])), np.round(1e9 * time).astype(np.int64)
    parts = np.array_split(np.arange(200), pieces)
    levels = np.concatenate([noise.levels(stamp[part], values[part]) for part in parts])
    assert levels[0] == pytest.approx([0.1, 0.01])  # not to be trusted before
    assert levels[-1] == pytest.approx([4e-3, 5e-4], rel=0.2)
    slow = FoundNoise(np.array([1e-3, 1e-4])).levels(10 * stamp, values)
    assert slow[-1] == pytest.approx([1e-3, 1e-4])  # motion shows in differences


@pytest.mark.parametrize('count', [1, 50])
def test_what_is_left_of_correlated_errors_in_a_window(count: int) -> None:
    """The mean of readings about the process in the window's middle, as simulated."""
    rng, length, time = np.random.default_rng(2), 0.5, 5.0
    sensor = PoseSensor('poses.a', 'both', slice(0, 50), correlation_time=time)
    steps = np.exp(-0.5 * length / (50 * time)) ** 2
    process: Array = rng.normal(size=(4000, 51))
    for place in range(1, 51):
        process[:, place] = steps * process[:, place - 1] + np.sqrt(1.0 - steps**2) * process[:, place]
    middle = process[:, 25]
    read = process.mean(axis=1) if count > 1 else process[np.arange(4000), rng.integers(0, 51, 4000)]
    left = float(sensor._share_left(np.array([float(count)]), length)[0])
    assert 0.9 < left / np.var(read - middle) < 1.5


def test_correlated_errors_need_a_size() -> None:
    with pytest.raises(ParameterError, match=r"'poses.a.correlation_time' is 2 s, and 'poses.a.position_std' is 0"):
        Session(build(EstimatorConfig, {'poses.names': ['a'], 'poses.a.correlation_time': 2.0}), urdf(ROBOT))


@pytest.mark.parametrize(
    ('parameters', 'named'),
    [
        ({'poses.names': ['a', 'a']}, "'poses.names' has 'a'"),
        ({'poses.names': ['imu']}, "'poses.names' has 'imu'"),
        ({'poses.names': ['a'], 'poses.a.frame': 'link9'}, "'poses.a.frame' is 'link9'; accepted: base_link, link1"),
        ({'poses.names': ['a'], 'poses.a.frame': 'link3', 'poses.alone': True}, "'poses.a.frame' is 'link3', and it"),
        ({'poses.names': ['a'], 'poses.b.use': True}, "'poses.b' is of no pose"),
        ({'poses.names': ['a'], 'poses.a.measures': 'position'}, "'poses.a.same_world' is false"),
        ({'poses.alone': True}, "'poses.alone' is true, and none of 'poses.names' measures the orientation"),
        ({'poses.names': ['a'], 'poses.a.marker.position': [0.0, 0.0, 1.0], 'poses.a.marker.orientation': [1.0] * 4},
         "'poses.a.marker.orientation' has length 2"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named_in_one_line(parameters: Mapping[str, object], named: str) -> None:
    with pytest.raises(ParameterError) as error:
        Session(build(EstimatorConfig, parameters), urdf(ROBOT))
    assert named in str(error.value)
    assert '\n' not in str(error.value)


def test_a_pose_is_read_off_by_its_errors_as_the_columns_say() -> None:
    """Mount, world, delay and scale at a generic pose that turns and moves."""
    (turned,), position, (angular, linear) = exp(generic(1, 1, 3)), generic(2, 3), generic(3, 2, 3)
    origin = generic(4, 3)  # of the run, in the sensor's world
    unknown = pose_errors('mocap', NamedPoseConfig(), same_world=False)

    def read(errors: Array) -> Array:
        mount, placed, world, moved = np.split(errors[:12], 4)
        rotation = exp(world) @ exp(-errors[12] * angular) @ turned @ exp(mount)
        longer = errors[13] * (position + origin)
        where = exp(world) @ (position - errors[12] * linear + turned @ placed + longer) + moved
        return np.concatenate((log(rotation @ turned.T), where - position))

    motion = SimpleNamespace(
        time=np.zeros(1),
        origin=origin,
        rotation=turned[None],
        position=position[None],
        twist=np.concatenate((angular, linear))[None],
    )
    columns = some(unknown.measured('poses.mocap', cast('Motion', motion)))[0]
    assert_derivative(columns, read, np.zeros(14))
    parts: tuple[tuple[Literal['orientation', 'position'], slice], ...]
    parts = ('orientation', slice(3)), ('position', slice(3, 6))
    for kind, rows in parts:
        part = pose_errors('mocap', NamedPoseConfig(measures=kind), same_world=True)
        assert np.array_equal(some(part.measured('poses.mocap', cast('Motion', motion)))[0], columns[rows])
        assert part.measured('poses.camera', cast('Motion', motion)) is None


def test_a_drift_moves_a_pose_as_a_world_that_turns_and_moves_does() -> None:
    (turned,), position, origin, time = exp(generic(1, 1, 3)), generic(2, 3), generic(4, 3), 7.0
    unknown = pose_drift('mocap', 'both', 1e-5, 1e-6)

    def read(rates: Array) -> Array:
        rotation = exp(time * rates[:3])
        from_world = position + origin
        return np.concatenate((time * rates[:3], rotation @ from_world + time * rates[3:] - from_world))

    motion = SimpleNamespace(time=np.array([time]), origin=origin, rotation=turned[None], position=position[None])
    columns = some(unknown.measured('poses.mocap', cast('Motion', motion)))[0]
    assert_derivative(columns, read, np.zeros(6))
    part = pose_drift('mocap', 'orientation', 1e-5)
    assert part.causes == (f'{TURNING}:mocap',) * 3
    moving = pose_drift('mocap', 'position', 1e-5, 1e-6)
    assert moving.factor @ moving.factor.T == pytest.approx(np.diag([0.0] * 3 + [1e-12] * 3), rel=1e-9)
    assert np.array_equal(some(part.measured('poses.mocap', cast('Motion', motion)))[0], columns[:3])
    assert part.measured('poses.camera', cast('Motion', motion)) is None


@pytest.mark.parametrize(
    ('kind', 'measures', 'parameters', 'text'),
    [
        (TURNING, 'both', {'poses.mocap.turning_std': 5e-4}, 'the orientation of mocap drifts by 15 mrad a minute'),
        (DRIFT, 'orientation', {'poses.mocap.turning_std': 5e-4}, 'mocap drifts by 15 mrad a minute'),
        (DRIFT, 'both', {'poses.mocap.use': False}, 'mocap drifts by 15 mrad and 60 mm a minute'),
        (DRIFT, 'position', {'poses.mocap.use': False}, 'mocap drifts by 60 mm a minute'),
    ],
)
def test_a_drift_is_declared_as_large_as_it_is_and_positions_that_drift_are_left_out(
    kind: str, measures: str, parameters: dict[str, object], text: str
) -> None:
    value = np.array([0.0, 2.5e-4, 0.0, 1e-3, 0.0, 0.0])
    value[:3] *= measures != 'position'
    value[3:] *= measures != 'orientation' and kind == DRIFT
    unknown = pose_drift('mocap', measures, 1e-6, 1e-6 * (kind == DRIFT))
    found = unknown.repair(f'{kind}:mocap', value, 0.1 * value, kernel(ROBOT))
    assert (found.parameters, found.cause) == (parameters, text)


TURN = exp(np.array([0.0, 0.0, 0.5 * np.pi]))


@pytest.mark.parametrize(
    ('measures', 'axes', 'places', 'named'),
    [
        ('both', exp(np.array([0.0, 0.02, 0.0])), np.eye(3), ''),
        ('orientation', TURN, np.eye(3), 'the axes of mocap are turned by 90 degrees about (0.00, 0.00, 1.00)'),
        ('both', TURN, np.eye(3), 'the axes of mocap are turned by 90 degrees about (0.00, 0.00, 1.00)'),
        ('both', np.eye(3), TURN.T, 'the positions of mocap are turned by 90 degrees about (0.00, 0.00, 1.00)'),
        ('both', TURN, TURN.T, 'the axes of mocap are turned by 90 degrees about (0.00, 0.00, 1.00) and the positions'),
        ('position', np.eye(3), 1e3 * np.eye(3), 'the positions of mocap are in millimetres'),
    ],
)
@pytest.mark.parametrize('link', ['base_link', 'link6'])
def test_a_sensor_of_other_axes_or_units_is_reported(
    measures: str, axes: Array, places: Array, named: str, link: str
) -> None:
    random, model, width = np.random.default_rng(4), robot(ROBOT), 50
    moved = Kinematics(model)
    sensor = PoseSensor('poses.mocap', measures, slice(0, width), link=model.link(link))
    check, found = pose_check(sensor, moved), None
    for number in range(20):
        turned, position = exp(0.3 * random.normal(size=(5, 3))), 0.2 * random.normal(size=(5, 3))
        joints, nothing = random.normal(size=(5, 7)), np.zeros((5, 3))
        placed, away = moved.configure(turned, joints).link_pose(model.link(link))
        covariance = np.tile(1e-8 * np.eye(6), (5, 1, 1))
        readings = np.zeros((5, width))
        readings[::2, 0] = 1.0  # of three readings, one of them a mean of two
        readings[::2, 2:11] = (placed @ axes).reshape(5, 9)[::2]
        readings[::2, 11:14] = ((position + away) @ places.T)[::2]
        readings[::2, 14:50] = covariance.reshape(5, 36)[::2]
        readings[2] *= 2.0
        time = 0.5 * number + 0.1 * np.arange(5)
        window = Samples(time, joints, joints, position, turned, nothing, nothing, covariance, covariance)
        found = check.update(replace(window, readings=readings))
    assert bool(found) == bool(named)
    if found:
        assert found.text.startswith(named)
        assert found.severity == 'conflict'
        assert some(found.repair).parameters == {'poses.mocap.use': False}


@pytest.mark.parametrize(
    ('measures', 'rows'), [('both', slice(0, 6)), ('orientation', slice(0, 3)), ('position', slice(3, 6))]
)
def test_correlated_errors_are_those_of_their_sensor_alone(measures: str, rows: slice) -> None:
    config = NamedPoseConfig(measures=measures, position_std=0.3, orientation_std=0.2, correlation_time=5.0)
    unknown = pose_wander('mocap', config)
    motion = cast('Motion', SimpleNamespace(time=np.zeros(2)))
    assert unknown.measured('poses.camera', motion) is None
    columns = some(unknown.measured('poses.mocap', motion))
    assert np.array_equal(columns, np.tile(np.eye(6)[rows], (2, 1, 1)))
    sizes = np.array([0.2] * 3 + [0.3] * 3)[rows]
    assert np.diag(unknown.factor @ unknown.factor.T)[rows] == pytest.approx(sizes**2)
    assert np.count_nonzero(unknown.factor) == unknown.count == len(sizes)
    assert unknown.time_constants.tolist() == [5.0] * len(sizes)
    assert pose_wander('mocap', replace(config, correlation_time=0.0)).count == 0


def test_each_sensor_has_columns_and_a_frame_of_its_own_and_one_alone_defines_the_world() -> None:
    """Positions alone leave open how a world is turned: only that of the first sensor is as it is."""
    parameters: dict[str, object] = {
        'poses.names': ['a', 'b', 'c'],
        'poses.alone': True,
        'poses.a.measures': 'position',
    }
    for name in 'abc':
        parameters[f'poses.{name}.marker.position'] = [0.1, 0.2, 0.3]
    config = build(EstimatorConfig, parameters | {'poses.c.frame': 'link5'}).poses
    sensors = pose_sensors(config, robot(ROBOT), '')
    columns = [np.arange(200)[each.columns].tolist() for each in sensors]
    assert [len(each) for each in columns] == [50] * 3
    assert [column for each in columns for column in each] == [*range(150)]
    assert [each.name for each in sensors] == ['poses.a', 'poses.b', 'poses.c']
    assert [np.flatnonzero(each.moved_by).tolist() for each in sensors] == [[], [], [0, 1, 2, 3, 4]]
    # Poses are turned into those of the link as they are read; a position alone cannot be.
    assert [each.lever.tolist() for each in sensors] == [[0.1, 0.2, 0.3], [0.0] * 3, [0.0] * 3]
