"""A fast gyro beside slow poses: estimates hold, and what is wrong with an IMU is told, never silently taken."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gyros import KNOWN, Spoil, messages, normalised, rated, taken
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.messages import IMU_FRAME
from mbaid_ros.session import Session, explain
from mbaid_ros.session.session import IMU_NOT_ASKED_FOR
from streams import urdf


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
    ('spoil', 'seconds', 'told'),
    [
        (rated(lambda rate: rate * np.array([1.0, -1.0, -1.0])), 9.0, 'the IMU is turned by'),
        (rated(lambda rate: 1.1 * rate), 14.5, 'gyro scale'),
    ],
)
def test_what_is_wrong_is_told(spoil: Spoil, seconds: float, told: str) -> None:
    _, found = taken(messages('ets7', seconds, 2), 'ets7', spoil=spoil)
    assert found[-1].status in {'inconsistent', 'not_identifiable'}
    assert told in ' '.join((*found[-1].warnings, *(cause for cause, _ in found[-1].causes)))


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
        "it is 'link2'; accepted: base_link; or imu.frame says which it is, also one that joints move"
    )
    with pytest.raises(ParameterError, match=r"'imu.frame' is 'nowhere'; accepted: base_link, link1, link2"):
        Session(build(EstimatorConfig, {**KNOWN, 'imu.frame': 'nowhere'}), urdf('table1'))
