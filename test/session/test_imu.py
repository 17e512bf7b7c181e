"""A fast gyro beside slow poses: estimates hold, and what is wrong with an IMU is told, never silently taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import cache
from typing import Any

import numpy as np
import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.known_side import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.messages import IMU_FRAME
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.session import Session, explain
from mbaid_ros.session.session import IMU_NOT_ASKED_FOR
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from observed import MID
from simulated import CONFIG, robot
from streams import urdf

DENSITY = 1e-4  # rad/s/sqrt(Hz)
IMU: dict[str, object] = {
    'imu.rate': 200.0,
    'imu.noise_density': DENSITY,
    'imu.bias': [3e-3, -2e-3, 1e-3],
    'imu.bias_walk': 2e-5,
    'imu.scale': [2e-3, -1e-3, 3e-3],
}
KNOWN: dict[str, object] = {
    **EXACT,
    'maximum_gap': 0.25,
    'imu.noise_density': DENSITY,
    'imu.bias_std': 5e-3,
    'imu.scale_std': 3e-3,
}
Spoil = Callable[[float, Any], Any]


@cache
def messages(name: str, seconds: float, seed: int) -> tuple[TimedMessage, ...]:
    """Return what the sensors of a robot say: an IMU at 200 Hz, poses without a twist at 10 Hz."""
    values = load_parameter_file(CONFIG / f'{name}_simulator.yaml', 'simulator')
    noise = {f'noise.{channel}': value for channel, value in vars(MID).items() if channel != 'base_correlation_time'}
    config = build(SimulatorConfig, {**values, **noise, **IMU, 'seed': seed, 'odometry_rate': 10.0})
    made = SimulatedRun(config, urdf(name), BAG_TYPES)
    made.start = 1_700_000_000_000_000_000
    said = made.read(seconds - 0.001)
    for each in said:
        if each.topic == 'odom':
            motion = each.message.twist.twist
            for part in (motion.linear, motion.angular):
                part.x = part.y = part.z = np.nan
    return tuple(said)


def taken(
    said: tuple[TimedMessage, ...],
    name: str,
    parameters: Mapping[str, object] = KNOWN,
    spoil: Spoil | None = None,
    at_once: int = 100_000,
) -> tuple[Session, list[Estimate]]:
    session = Session(build(EstimatorConfig, parameters), urdf(name))
    take = {'joint_states': session.add_joint_state, 'odom': session.add_odometry, 'imu': session.add_imu}
    found: list[Estimate] = []
    for place, each in enumerate(said):
        message = each.message
        if each.topic == 'imu' and spoil is not None:
            message = spoil(each.time, deepcopy(message))
        if message is not None:
            take[each.topic](message)
        if place % at_once == at_once - 1:
            found += session.process()
    return session, [*found, *session.process()]


def normalised(estimate: Estimate, name: str) -> Array:
    """Return the errors of what is determined in standard deviations."""
    model = robot(name)
    truth = physical(model.link(model.last_link).parameters)
    return ((estimate.parameters - truth) / estimate.std)[estimate.identifiable]


def rated(change: Callable[[Array], Array]) -> Spoil:
    """Return what changes the angular velocity of a message."""

    def spoil(_time: float, message: Any) -> Any:
        rate = message.angular_velocity
        rate.x, rate.y, rate.z = change(np.array([rate.x, rate.y, rate.z]))
        return message

    return spoil


@pytest.mark.parametrize(('name', 'seconds'), [('table1', 16.0), ('ets7', 16.0)])
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
def test_what_is_missing_costs_only_what_it_would_have_told(
    spoil: Spoil, parameters: dict[str, object], dropped: str
) -> None:
    session, found = taken(messages('ets7', 14.0, 1), 'ets7', {**KNOWN, **parameters}, spoil)
    assert found[-1].status == 'estimating'
    assert np.abs(normalised(found[-1], 'ets7')).max() < 4.0
    assert any(cause.startswith(dropped) for cause in session.dropped) == bool(dropped)


@pytest.mark.parametrize(
    ('spoil', 'told'),
    [
        (rated(lambda rate: rate * np.array([1.0, -1.0, -1.0])), 'the IMU is turned by'),
        (rated(lambda rate: 1.1 * rate), 'gyro scale'),
    ],
)
def test_what_is_wrong_is_told(spoil: Spoil, told: str) -> None:
    _, found = taken(messages('ets7', 14.5, 2), 'ets7', spoil=spoil)
    assert found[-1].status in {'inconsistent', 'not_identifiable'}
    assert told in ' '.join((*found[-1].warnings, *(cause for cause, _ in found[-1].causes)))


def test_a_gyro_at_the_end_of_a_range_that_nobody_has_told_makes_nothing_wrong() -> None:
    _, found = taken(messages('ets7', 14.0, 2), 'ets7', spoil=rated(lambda rate: np.clip(rate, -0.02, 0.02)))
    if found[-1].status not in {'inconsistent', 'not_identifiable'}:
        assert np.abs(normalised(found[-1], 'ets7')).max() < 4.0


def test_an_imu_that_is_not_asked_for_or_elsewhere_is_told() -> None:
    said = messages('table1', 16.0, 0)[:600]
    session, _ = taken(said, 'table1', EXACT)
    assert session.dropped[IMU_NOT_ASKED_FOR] > 100

    def on_the_arm(_time: float, message: Any) -> Any:
        message.header.frame_id = 'link2'
        return message

    session, _ = taken(said, 'table1', KNOWN, on_the_arm)
    assert session.dropped[IMU_FRAME] > 100
    assert explain(session, [IMU_FRAME])[0].endswith(
        "it is 'link2'; accepted: base_link; or imu.frame says which it is"
    )
    with pytest.raises(ParameterError, match=r"'imu.frame' is 'nowhere'; accepted: base_link"):
        Session(build(EstimatorConfig, {**KNOWN, 'imu.frame': 'nowhere'}), urdf('table1'))
