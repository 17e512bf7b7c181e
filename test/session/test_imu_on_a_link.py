"""An IMU on a link that joints move: it tells as much as one on the base, and where it cannot be is told."""

from __future__ import annotations

import numpy as np
import pytest

from gyros import KNOWN, messages, normalised, taken
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.messages import IMU_FRAME
from mbaid_ros.session import Session
from streams import urdf


@pytest.mark.parametrize(
    ('name', 'link', 'seconds', 'seed'),
    [('ets7', 'link3', 14.0, 0), ('ets7', 'link5', 14.0, 1), ('table1', 'link2', 20.0, 2)],
)
def test_intervals_hold_and_are_as_narrow_as_on_the_base(name: str, link: str, seconds: float, seed: int) -> None:
    session, found = taken(messages(name, seconds, seed, 0.0, link), name, {**KNOWN, 'imu.frame': link})
    _, on_base = taken(messages(name, seconds, seed), name)
    last = found[-1]
    assert last.status == 'estimating'
    assert session.received['imu'] == 200 * seconds
    assert not session.dropped
    assert np.abs(normalised(last, name)).max() < 4.0
    assert 0.8 < last.residual < 1.2
    known = last.identifiable & on_base[-1].identifiable
    assert known.sum() >= 4
    assert np.nanmax((last.std / on_base[-1].std)[known]) < 1.25


def test_taken_for_one_on_the_base_it_is_told() -> None:
    said = messages('ets7', 14.0, 0, 0.0, 'link3')
    _, found = taken(said, 'ets7', {**KNOWN, 'imu.frame': 'base_link'})
    assert found[-1].status in {'inconsistent', 'not_identifiable'}
    session, _ = taken(said[:600], 'ets7', KNOWN)
    assert session.dropped[IMU_FRAME] > 100  # that it is on a moving link has to be said


@pytest.mark.parametrize(
    ('given', 'told'),
    [
        ({'imu.frame': 'link6'}, "is 'link6', which moves with the target; accepted: base_link, link1"),
        ({'imu.frame': 'link3', 'imu.alone': True}, "is 'link3', and 'imu.alone' is true; accepted: base_link"),
        ({'imu.frame': 'hand'}, "is 'hand'; accepted: base_link, link1"),
        ({'imu.frame': 'a/link3', 'target_link': 'link3', 'frame_prefix': 'a/'}, 'which moves with the target'),
    ],
)
def test_where_it_cannot_be_is_told(given: dict[str, object], told: str) -> None:
    with pytest.raises(ParameterError, match=f"parameter 'imu.frame' .*{told}"):
        Session(build(EstimatorConfig, {**KNOWN, **given}), urdf('ets7'))
