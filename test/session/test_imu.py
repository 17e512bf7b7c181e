"""A gyro beside slow poses, on a moving link, alone or with an orientation: estimates hold, and errors are named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gyros import KNOWN, Spoil, angular_momentum, messages, normalised, rated, taken
from mbaid_ros.bags import BagWriter
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.filter.posterior import FIRST
from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation, rotation_from_quaternion
from mbaid_ros.core.gyro import IMU_FRAME, DeadReckoning, Gyro, ImuReader
from mbaid_ros.core.odometry.stream import measured_orientation
from mbaid_ros.core.pipeline import GYRO_ALONE, ORIENTATION_AND_GYRO
from mbaid_ros.core.samples import ImuStream
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.replay.arguments import replay
from mbaid_ros.session.explanation import obstacles
from mbaid_ros.session.session import Session
from simulated import CONFIG
from streams import urdf
from unchanged import Unchanged


def test_a_bias_that_walks_is_uncertain_until_the_end_of_the_newest_window() -> None:
    walk = 1e-3  # rad/s/sqrt(s): in a window, far more than the gyro's noise leaves open
    session, found = taken(messages('table1', 16.0, 0), 'table1', {**KNOWN, 'imu.bias_walk': walk})
    posterior = session.posterior()
    assert posterior is not None
    (place,) = (
        place
        for unknown, place in zip(posterior.layout.unknowns, posterior.layout.places, strict=True)
        if isinstance(unknown, Gyro)
    )
    bias = posterior.triangle[:, place.start - FIRST] * float(str(KNOWN['imu.bias_std']))
    assert np.linalg.norm(bias) > 0.99 * walk * np.sqrt(session.config.window)
    assert found[-1].identifiable.any()


@pytest.mark.parametrize(('name', 'seconds'), [('table1', 16.0), ('ets7', 12.0)])
def test_intervals_hold_however_the_calls_are_spread(name: str, seconds: float) -> None:
    said = messages(name, seconds, 0)
    session, found = taken(said, name)
    pieces = tuple(each for each in said if each.time < 8.0)
    _, again = taken(pieces, name, at_once=61)
    assert len(again) == 15
    assert [each.parameters.tobytes() for each in found[:15]] == [each.parameters.tobytes() for each in again]
    assert [each.covariance.tobytes() for each in found[:15]] == [each.covariance.tobytes() for each in again]
    assert found[-1].stage == 'trajectory'
    assert found[-1].status == 'estimating'
    assert session.received['imu'] == 200 * seconds
    assert not session.dropped
    errors = normalised(found[-1], name)
    assert len(errors) == (4 if name == 'table1' else 10)
    assert np.abs(errors).max() < 4.0
    assert 0.8 < found[-1].residual < 1.2


@pytest.mark.parametrize(
    ('spoil', 'parameters', 'dropped'),
    [
        (lambda time, message: None if time % 4.0 < 1.0 else message, {}, ''),
        (lambda time, message: None if time < 5.0 else message, {}, ''),
        (rated(lambda rate: np.where(rate[0] > 0.01, np.nan, rate)), {}, 'IMU: NaN or infinite value'),
        (rated(lambda rate: np.clip(rate, -0.02, 0.02)), {'imu.range': 0.02}, 'IMU: angular velocity at the end'),
    ],
)
def test_what_is_missing_costs_only_what_it_would_have_reported(
    spoil: Spoil, parameters: dict[str, object], dropped: str
) -> None:
    session, found = taken(messages('ets7', 14.0, 1), 'ets7', {**KNOWN, **parameters}, spoil)
    assert found[-1].status == 'estimating'
    assert np.abs(normalised(found[-1], 'ets7')).max() < 4.0
    assert any(cause.startswith(dropped) for cause in session.dropped) == bool(dropped)


def test_gyro_messages_that_come_twice_or_late_are_dropped() -> None:
    given = messages('ets7', 6.0, 1)
    again = tuple(each for each in given if each.topic == 'imu')[-3:]
    session, found = taken((*given, *again), 'ets7')
    assert session.dropped.total() == 3
    _, plain = taken(given, 'ets7')
    assert found[-1].parameters.tobytes() == plain[-1].parameters.tobytes()
    assert found[-1].covariance.tobytes() == plain[-1].covariance.tobytes()


@pytest.mark.parametrize(
    ('spoil', 'seconds', 'reported'),
    [
        (rated(lambda rate: rate * np.array([1.0, -1.0, -1.0])), 9.0, 'the IMU is turned by'),
        (rated(lambda rate: 1.1 * rate), 14.5, 'gyro scale'),
    ],
)
def test_errors_are_reported(spoil: Spoil, seconds: float, reported: str) -> None:
    _, found = taken(messages('ets7', seconds, 2), 'ets7', spoil=spoil)
    assert found[-1].status in {'inconsistent', 'not_identifiable'}
    assert reported in ' '.join((*found[-1].warnings, *(cause for cause, _ in found[-1].causes)))


# -- An IMU on a link that joints move: it measures as much as one on the base; an impossible place is reported.


@pytest.mark.parametrize(
    ('name', 'link', 'seconds', 'seed'),
    [
        ('ets7', 'link3', 14.0, 0),
        pytest.param('ets7', 'link5', 14.0, 1, marks=pytest.mark.long),
        pytest.param('table1', 'link2', 20.0, 2, marks=pytest.mark.long),
    ],
)
def test_intervals_hold_and_are_as_narrow_as_on_the_base(
    name: str, link: str, seconds: float, seed: int, unchanged: Unchanged
) -> None:
    session, found = taken(messages(name, seconds, seed, 0.0, link), name, {**KNOWN, 'imu.frame': link})
    _, on_base = taken(messages(name, seconds, seed), name)
    last = found[-1]
    unchanged(last)
    assert last.status == 'estimating'
    assert session.received['imu'] == 200 * seconds
    assert not session.dropped
    assert np.abs(normalised(last, name)).max() < 4.0
    assert 0.8 < last.residual < 1.2
    known = last.identifiable & on_base[-1].identifiable
    assert known.sum() >= 4
    assert np.nanmax((last.std / on_base[-1].std)[known]) < 1.25


def test_taken_for_one_on_the_base_it_is_reported() -> None:
    said = messages('ets7', 14.0, 0, 0.0, 'link3')
    _, found = taken(said, 'ets7', {**KNOWN, 'imu.frame': 'base_link'})
    assert found[-1].status in {'inconsistent', 'not_identifiable'}
    session, _ = taken(said[:600], 'ets7', KNOWN)
    assert session.dropped[IMU_FRAME] > 100  # that it is on a moving link has to be said


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        ({'imu.frame': 'nowhere'}, "'imu.frame' is 'nowhere'; accepted: base_link, link1, link2"),
        ({'imu.frame': 'link6', 'flexible.joints': ['joint6'], 'flexible.joint6.frequency': 0.5},
         "'imu.frame' is 'link6', which a joint of flexible.joints moves; accepted: base_link, link1"),
        ({'imu.frame': 'link3', 'imu.alone': True}, "'imu.frame' is 'link3', and 'imu.alone' is true; accepted: base"),
        ({'imu.orientation': True}, "'imu.orientation' is true without 'imu.alone'; accepted: both"),
        ({'imu.alone': True, 'imu.noise_density': 0.0}, "'imu.alone' is true, and .*imu.noise_density is 0"),
        ({'imu.alone': True, 'method': 'difference'}, "'imu.alone' is true, and .*difference, which needs poses"),
        ({'imu.alone': True, 'capture.phase': 'pre_capture'}, "'imu.alone' is true, and .*the run has a capture"),
    ],
)  # fmt: skip
def test_parameters_that_do_not_fit_are_refused(given: dict[str, object], reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        Session(build(EstimatorConfig, {**KNOWN, **given}), urdf('ets7'))


# -- An IMU with an orientation, where nothing locates the base: used where it is measured, and only if asked for.

NOISE = 1e-3  # rad
ALONE = {**KNOWN, 'imu.alone': True, 'imu.bias_std': 3e-3, 'imu.orientation_std': 2e-3}
ORIENTED, BY_GYRO = {**ALONE, 'imu.orientation': True}, {**ALONE, 'imu.orientation_std': 1e-3}


def mounted(turn: Array) -> Spoil:
    """Return what makes messages those of an IMU that is turned on the base."""

    def spoil(_time: float, message: Any) -> Any:
        reported, rate = message.orientation, message.angular_velocity
        rotation = rotation_from_quaternion(np.array([reported.x, reported.y, reported.z, reported.w])) @ exp(turn)
        reported.x, reported.y, reported.z, reported.w = quaternion_from_rotation(rotation).tolist()
        rate.x, rate.y, rate.z = (exp(-turn) @ np.array([rate.x, rate.y, rate.z])).tolist()
        return message

    return spoil


def now_and_then(time: float, message: Any) -> Any:
    """Tell the orientation ten times a second alone; in between the quaternion is that of a message not filled in."""
    if round(200.0 * time) % 20:
        message.orientation.x = message.orientation.y = message.orientation.z = message.orientation.w = 0.0
        message.orientation_covariance = np.array([-1.0, *np.zeros(8)])
    return message


def without_covariance(_time: float, message: Any) -> Any:
    message.orientation_covariance = np.zeros(9)
    return message


@pytest.mark.parametrize(
    ('spoil', 'seed'),
    [
        (None, 0),
        (mounted(np.array([2e-3, -1e-3, 2e-3])), 2),
        (now_and_then, 3),
        *(pytest.param(*each, marks=pytest.mark.long) for each in ((None, 1), (without_covariance, 4))),
    ],
)
def test_body_and_momentum_are_within_their_intervals(spoil: Spoil | None, seed: int) -> None:
    parameters = {**ORIENTED, 'noise.base_orientation': NOISE}
    session, found = taken(messages('ets7', 12.0, seed, NOISE), 'ets7', parameters, spoil)
    last = found[-1]
    assert last.status == 'estimating'
    assert not session.dropped.keys() - {'the pose of the base comes from another source'}
    assert ORIENTATION_AND_GYRO in last.warnings
    assert 0.7 < last.residual < 1.3
    errors = normalised(last, 'ets7')
    assert len(errors) >= 9
    assert np.abs(errors).max() < 4.0
    assert np.isnan(last.momentum[:3]).all()
    away = last.momentum[3:] - angular_momentum('ets7')
    assert np.sqrt(away @ np.linalg.solve(last.momentum_covariance[3:, 3:], away)) < 4.0


def test_it_determines_more_than_the_gyro_alone() -> None:
    said = messages('ets7', 12.0, 0, NOISE)
    _, alone = taken(said, 'ets7', ALONE)
    _, both = taken(said, 'ets7', ORIENTED)
    assert GYRO_ALONE in alone[-1].warnings  # what is not asked for is not used
    known = alone[-1].identifiable
    assert np.all(both[-1].std[known] < alone[-1].std[known])
    assert np.median(both[-1].std[known] / alone[-1].std[known]) < 0.7
    ends = [np.sqrt(np.trace(each[-1].momentum_covariance[3:, 3:])) for each in (alone, both)]
    assert ends[1] < 0.2 * ends[0]


def test_a_reader_gives_the_base_s_orientation_and_leaves_out_what_is_none() -> None:
    first, *others = (each.message for each in messages('ets7', 0.1, 0, NOISE) if each.topic == 'imu')
    axes = exp(np.array([0.3, -0.5, 0.2]))
    reported = first.orientation
    measured = rotation_from_quaternion(np.array([reported.x, reported.y, reported.z, reported.w]))
    others[0].orientation.w = 7.0
    others[1].orientation_covariance = np.array([-1.0, *np.zeros(8)])
    others[2].orientation_covariance = np.full(9, np.nan)
    stream, dropped = ImuReader({'sensor': axes}, 'sensor', 0.01).read([first, *others[:3]])
    assert isinstance(stream, ImuStream)
    assert stream.rotation[0] == pytest.approx(measured @ axes.T)
    assert stream.rotation_covariance[0] == pytest.approx(NOISE**2 * np.eye(3))
    assert stream.rotation_covariance[3] == pytest.approx(1e-4 * np.eye(3))
    assert np.isfinite(stream.angular_velocity).all()
    assert dropped == {'IMU: orientation is no unit quaternion': 1}
    base = measured_orientation(stream)
    assert base is not None
    assert base.stamp.tolist() == stream.stamp[[0, 3]].tolist()
    assert np.isnan(base.pose_covariance[:, :3]).all()
    assert measured_orientation(stream[1:3]) is None


@pytest.mark.parametrize('covariance', [-1.0, 0.0])
def test_its_absence_from_all_messages_is_reported(covariance: float) -> None:
    def silent(_time: float, message: Any) -> Any:
        message.orientation.w = 9.0
        message.orientation_covariance = np.array([covariance, *np.zeros(8)])
        return message

    said = messages('ets7', 2.0, 0, NOISE)
    session, found = taken(said, 'ets7', ORIENTED, silent)
    assert not found
    assert any('no message on imu has one; accepted: a unit quaternion' in each for each in obstacles(session))
    assert obstacles(taken(said, 'ets7', ORIENTED)[0]) == []


# -- A gyro where nothing locates the base: inertia is found, position, heading and linear momentum are not.


def test_a_robot_is_identified_by_how_it_turns() -> None:
    session, found = taken(messages('ets7', 14.0, 3), 'ets7', BY_GYRO)
    last = found[-1]
    assert (last.stage, last.status) == ('trajectory', 'estimating')
    assert session.received['odom'] == 0
    errors = normalised(last, 'ets7')
    assert len(errors) >= 4
    assert np.abs(errors).max() < 4.0
    assert np.isnan(last.momentum[:3]).all()
    assert np.isfinite(last.momentum[3:]).all()
    known = np.arange(6) >= 3
    assert np.array_equal(np.isfinite(last.momentum_covariance), known & known[:, None])
    assert last.warnings[-1].startswith('nothing locates the base')


def test_a_bag_without_poses_gives_json_and_exit_code(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        bag.add_topic('/imu', 'sensor_msgs/msg/Imu')
        for timed in messages('ets7', 14.0, 3):
            if timed.topic != 'odom':
                bag.write(f'/{timed.topic}', timed.message, 1_700_000_000_000_000_000 + round(1e9 * timed.time))
    arguments = [str(tmp_path / 'bag'), '--model', str(CONFIG / 'ets7.urdf'), '--json', str(tmp_path / 'found.json')]
    for name, value in BY_GYRO.items():
        arguments += ['-p', f'{name}:={json.dumps(value)}']
    assert replay(arguments) == 0
    found = json.loads((tmp_path / 'found.json').read_text(encoding='utf-8'))
    assert found['momentum']['linear'] == [None] * 3
    assert None not in found['momentum']['angular']
    assert found['estimate']['mass'] is not None


def test_a_course_is_followed_to_fourth_order() -> None:
    # A cone: the axis of the rate turns in the body's own axes, and the orientation is known in closed form.
    rate, half = 3.0, 0.4
    errors = []
    for count in (200, 400):
        time = np.arange(count + 1) / count
        spin = np.array([np.sin(half) * np.cos(rate * time), np.sin(half) * np.sin(rate * time), 0.0 * time]).T
        stream = ImuStream(np.round(1e9 * time).astype(np.int64), 5.0 * spin)
        whole = DeadReckoning().push(stream)
        fine = np.arange(4001) / 4000
        spin = np.array([np.sin(half) * np.cos(rate * fine), np.sin(half) * np.sin(rate * fine), 0.0 * fine]).T
        exact = DeadReckoning().push(ImuStream(np.round(1e9 * fine).astype(np.int64), 5.0 * spin))
        assert whole is not None
        assert exact is not None
        errors.append(np.abs(whole.rotation[-1] - exact.rotation[-1]).max())
        pieces = DeadReckoning()
        cut = [pieces.push(stream[begin : begin + 7]) for begin in range(0, count + 1, 7)]
        again = np.concatenate([each.rotation for each in cut if each is not None])
        assert np.array_equal(again, whole.rotation)
    assert errors[1] < errors[0] / 3.5
    assert errors[1] < 1e-5
