"""An IMU that tells its orientation, too, where nothing locates the base: used where told, and only if asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gyros import KNOWN, Spoil, angular_momentum, messages, normalised, taken
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation, rotation_from_quaternion
from mbaid_ros.core.identifier import GYRO_ALONE, ORIENTATION_AND_GYRO
from mbaid_ros.core.samples import ImuStream
from mbaid_ros.core.sensors.base import measured_orientation
from mbaid_ros.messages import ImuReader
from mbaid_ros.session import Session, obstacles
from streams import urdf

NOISE = 1e-3  # rad
ALONE = {**KNOWN, 'imu.alone': True, 'imu.bias_std': 3e-3, 'imu.orientation_std': 2e-3}
ORIENTED = {**ALONE, 'imu.orientation': True}


def mounted(turn: Array) -> Spoil:
    """Return what makes messages those of an IMU that is turned on the base."""

    def spoil(_time: float, message: Any) -> Any:
        told, rate = message.orientation, message.angular_velocity
        rotation = rotation_from_quaternion(np.array([told.x, told.y, told.z, told.w])) @ exp(turn)
        told.x, told.y, told.z, told.w = quaternion_from_rotation(rotation).tolist()
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
    [(None, 0), (None, 1), (mounted(np.array([2e-3, -1e-3, 2e-3])), 2), (now_and_then, 3), (without_covariance, 4)],
)
def test_it_tells_body_and_momentum_within_their_intervals(spoil: Spoil | None, seed: int) -> None:
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


def test_it_tells_more_than_the_gyro_alone() -> None:
    said = messages('ets7', 12.0, 0, NOISE)
    _, alone = taken(said, 'ets7', ALONE)
    _, both = taken(said, 'ets7', ORIENTED)
    assert GYRO_ALONE in alone[-1].warnings  # what is not asked for is not used
    known = alone[-1].identifiable
    assert np.all(both[-1].std[known] < alone[-1].std[known])
    assert np.median(both[-1].std[known] / alone[-1].std[known]) < 0.7
    ends = [np.sqrt(np.trace(each[-1].momentum_covariance[3:, 3:])) for each in (alone, both)]
    assert ends[1] < 0.2 * ends[0]


def test_how_calls_are_spread_makes_no_difference() -> None:
    said = messages('ets7', 8.0, 3, NOISE)
    _, at_once = taken(said, 'ets7', ORIENTED, now_and_then)
    _, pieces = taken(said, 'ets7', ORIENTED, now_and_then, at_once=61)
    assert len(pieces) > 10
    assert [each.parameters.tobytes() for each in at_once] == [each.parameters.tobytes() for each in pieces]


def test_a_reader_gives_the_base_s_orientation_and_leaves_out_what_is_none() -> None:
    first, *others = (each.message for each in messages('ets7', 0.1, 0, NOISE) if each.topic == 'imu')
    axes = exp(np.array([0.3, -0.5, 0.2]))
    told = first.orientation
    measured = rotation_from_quaternion(np.array([told.x, told.y, told.z, told.w]))
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
def test_that_no_message_tells_it_is_told(covariance: float) -> None:
    def untold(_time: float, message: Any) -> Any:
        message.orientation.w = 9.0
        message.orientation_covariance = np.array([covariance, *np.zeros(8)])
        return message

    said = messages('ets7', 2.0, 0, NOISE)
    session, found = taken(said, 'ets7', ORIENTED, untold)
    assert not found
    assert any('no message on imu has told one; accepted: a unit quaternion' in each for each in obstacles(session))
    assert obstacles(taken(said, 'ets7', ORIENTED)[0]) == []


def test_beside_poses_it_cannot_be_asked_for() -> None:
    given = {**ORIENTED, 'imu.alone': False}
    with pytest.raises(ParameterError, match=r"'imu.orientation' is true without 'imu.alone'; accepted: both"):
        Session(build(EstimatorConfig, given), urdf('ets7'))
