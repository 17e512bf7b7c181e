"""Messages that cannot be used: their counts, reports and derived rates; and clocks that jump or differ."""

from __future__ import annotations

from copy import copy
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import defects
from checked import some
from defects import JOINTS, ODOMETRY, Arrival, Defect, arrivals, changed, estimates, shifted
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.clocks import LATE, OTHER_CLOCK, STRAY_STAMP, ZERO_STAMP
from mbaid_ros.core.filter.posterior import Continuation
from mbaid_ros.core.forces import FAR_THRUST
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.outliers import REPEATED
from mbaid_ros.core.pipeline import JOINT_RATES_DERIVED, POSES_ALONE, TWIST_DERIVED
from mbaid_ros.core.samples import (
    BAD_QUATERNION,
    JOINT_MISSING,
    LENGTH_MISMATCH,
    LOST_TRACKING,
    NOT_FINITE,
    POSE_COVARIANCE,
    TWIST_COVARIANCE,
    WRONG_CHILD_FRAME,
)
from mbaid_ros.parameters import build
from mbaid_ros.session.explanation import explain, intake_warnings, missing_joints, obstacles, remarks, sensor_rows
from mbaid_ros.session.session import Session
from recorded import header, of
from sessions import fed, first_columns
from simulated import CONFIG

ROBOT, SECONDS = 'servicer7', 12.0


@cache
def clean() -> list[Arrival]:
    return arrivals(ROBOT, SECONDS, 2)


def given(topic: str, name: str, value: object) -> Defect:
    return changed(topic, lambda m: setattr(m, name, value))


def turned(quaternion: Array) -> Defect:
    return changed(ODOMETRY, lambda m: setattr(m.pose.pose, 'orientation', of('Quaternion', quaternion)))


NAMELESS = given(JOINTS, 'name', list('abcdefg'))
JOINT_NAMES = [f'joint{number}' for number in range(1, 8)]
NEVER_FINITE = 'is NaN or infinite in 200 of 200 messages: look'


@pytest.mark.parametrize(
    ('spoil', 'cause', 'sentence'),
    [
        (given(ODOMETRY, 'child_frame_id', 'link3'), WRONG_CHILD_FRAME, "'link3'; accepted: "),
        (given(ODOMETRY, 'child_frame_id', ''), WRONG_CHILD_FRAME, "''; accepted: 'base_link'"),
        (turned(np.zeros(4)), LOST_TRACKING, 'has lost the base'),
        (turned(np.ones(4)), BAD_QUATERNION, 'length is not 1'),
        (given(JOINTS, 'position', np.full(7, np.nan)), NOT_FINITE, f'position of joint1 {NEVER_FINITE}'),
        (
            changed(ODOMETRY, lambda m: setattr(m.pose.pose.position, 'y', np.nan)),
            NOT_FINITE,
            f'position of the base {NEVER_FINITE}',
        ),
        (NAMELESS, JOINT_MISSING, 'they contain a, b, c, d, e, f'),
        (given(JOINTS, 'name', ['base', *JOINT_NAMES]), LENGTH_MISMATCH, ': 8 names, 7 positions, 7 velocities;'),
    ],
)
def test_unusable_messages_are_reported(spoil: Defect, cause: str, sentence: str) -> None:
    messages = arrivals(ROBOT, 2.0, 2)  # a copy of its own: nested parts are changed in place
    result, session = estimates(ROBOT, spoil(messages))
    assert result == []
    assert session.dropped[cause] == 200
    assert any(sentence in warning for warning in intake_warnings(session))


@pytest.mark.parametrize('at_once', [1, 100_000])
def test_poses_of_zeros_are_lost_tracking_once_the_base_was_seen(at_once: int) -> None:
    def lost(message: Any) -> None:
        message.pose.pose.position = of('Point', np.zeros(3))
        message.pose.pose.orientation = of('Quaternion', np.array([0.0, 0.0, 0.0, 1.0]))

    def spoiled(first: int, last: int) -> list[Arrival]:
        messages = arrivals(ROBOT, 4.0, 2)
        for place, arrival in enumerate(each for each in messages if each.topic == ODOMETRY):
            if first <= place < last:
                lost(arrival.message)
        return messages

    result, session = estimates(ROBOT, spoiled(100, 250), at_once=at_once)
    assert session.dropped[LOST_TRACKING] == 150
    assert result[-1].status != 'inconsistent'
    _, session = estimates(ROBOT, spoiled(0, 400), at_once=at_once)
    assert session.dropped[LOST_TRACKING] == 0  # a base that is held, to the bit


@pytest.mark.parametrize('at_once', [1, 100_000])
def test_covariances_that_are_none_are_counted_and_the_parameters_stand_in_for_them(at_once: int) -> None:
    def spoil(message: Any) -> None:
        message.pose.covariance, message.twist.covariance = np.full(36, -1.0), np.zeros(36)

    messages = arrivals(ROBOT, 4.0, 2)  # a copy of its own: nested parts are changed in place
    plain, _ = estimates(ROBOT, changed(ODOMETRY, defects.no_covariance)(messages))
    result, session = estimates(ROBOT, changed(ODOMETRY, spoil)(messages), at_once=at_once)
    assert np.array_equal(first_columns(result), first_columns(plain))
    assert (session.replaced, session.dropped.total()) == ({POSE_COVARIANCE: 400}, 0)
    reported = '400 messages partly used: covariance of the pose is none: not finite, not symmetric, not positive'
    assert [warning.startswith(reported) for warning in intake_warnings(session)] == [True]
    session.reset()
    assert not session.replaced


def test_what_was_wrong_before_a_restart_is_counted_and_not_named_as_missing() -> None:
    spoil = changed(ODOMETRY, lambda m: setattr(m.twist, 'covariance', np.full(36, np.nan)))
    _, session = estimates(ROBOT, [*spoil(arrivals(ROBOT, 7.0, 2)[1000:1400]), *clean()[:400]], at_once=1)
    assert session.restarted == 1
    assert session.replaced == {TWIST_COVARIANCE: 200}
    _, session = estimates(ROBOT, [*NAMELESS(clean()[1000:1400]), *clean()[:400]], at_once=1)
    assert session.restarted == 1
    assert explain(session, [JOINT_MISSING]) == [JOINT_MISSING]
    assert missing_joints(session) == ()


def test_no_unused_message_of_the_odometry_counts_as_used() -> None:
    spoil = changed(ODOMETRY, lambda m: setattr(m.pose.pose.position, 'y', np.nan))
    again = defects.out_of_order(3, 0.03)(clean()[:1400])
    _, session = estimates(ROBOT, [*spoil(arrivals(ROBOT, 7.0, 2)[1000:1400]), *again])
    (row,) = sensor_rows(session, None)
    assert (session.restarted, row.dropped[NOT_FINITE], row.dropped[LATE] > 0) == (1, 200, True)
    assert row.used == session.received[ODOMETRY] - sum(row.dropped.values())


def test_a_run_to_continue_with_other_unknowns_is_left_out() -> None:
    before = Continuation(planar=False, root=np.eye(3, 4), bias=np.zeros((0, 1)))
    session = Session(EstimatorConfig(), (CONFIG / f'{ROBOT}.urdf').read_text(), before=before)
    result = fed(session, ((each.topic, each.message) for each in clean()[:1400]), 300)
    assert session.restarted == 1
    assert any('continue_from is left out: the run to continue has 3 unkn' in text for text in result[-1].warnings)


def test_memory_does_not_grow_while_no_measurements_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('mbaid_ros.core.forces.LARGEST_BACKLOG', 50)
    monkeypatch.setattr('mbaid_ros.session.session.LARGEST_BACKLOG', 50)
    session = Session(build(EstimatorConfig, {'repair': True}), (CONFIG / f'{ROBOT}.urdf').read_text())
    wrench = SimpleNamespace(force=of('Vector3', np.ones(3)), torque=of('Vector3', np.zeros(3)))
    for number in range(200):
        session.add_thrust(SimpleNamespace(header=header(number * 10**8, 'base_link'), wrench=wrench))
        session.process(at_once=False)
    assert session.intake.faults._waiting == []
    assert session.dropped[FAR_THRUST] == 150
    assert len(some(session._recording._kept)) == 50


def test_half_of_the_joints_alone_are_waited_with() -> None:
    messages = list(defects.in_halves(clean()[:400]))
    half = [a for a in messages if a.topic == ODOMETRY or len(a.message.name) == 4]
    result, session = estimates(ROBOT, half)
    assert result == []
    assert obstacles(session) == [
        'joint missing: the joint states lack joint5, joint6, joint7; they contain joint1, joint2, joint3, joint4'
    ]
    assert missing_joints(session) == ('joint5', 'joint6', 'joint7')


def test_only_what_keeps_most_joint_states_from_use_counts_as_missing() -> None:
    tail = clean()[600:800]
    for whole, missing in ((clean()[:100], ('joint1',)), (clean()[:600], ())):
        _, session = estimates(ROBOT, [*whole, *NAMELESS(tail)])
        assert session.dropped[JOINT_MISSING] == 100
        assert missing_joints(session)[:1] == missing


def test_notes_say_what_was_derived() -> None:
    spoil = changed(JOINTS, defects.no_rates)
    alone: dict[str, object] = {'method': 'difference'}
    assert estimates(ROBOT, spoil(clean()), alone)[0][-1].warnings[-1:] == (JOINT_RATES_DERIVED,)
    spoil = changed(ODOMETRY, defects.no_twist)
    assert estimates(ROBOT, spoil(clean()), alone)[0][-1].warnings[-1:] == (TWIST_DERIVED,)
    assert estimates(ROBOT, spoil(clean()))[0][-1].warnings[-1:] == (POSES_ALONE,)


def test_late_and_repeated_messages_are_counted() -> None:
    assert estimates(ROBOT, defects.repeated(clean()))[1].dropped[REPEATED] == len(clean()) // 3
    dropped = estimates(ROBOT, defects.out_of_order(3, 0.03)(clean()))[1].dropped
    assert 0 < dropped[LATE] < 10


# Time


@cache
def looped() -> list[Arrival]:
    """Return the run twice, as from a bag played in a loop; the odometry's jump comes a little after the joints'."""
    later = {JOINTS: 0, ODOMETRY: 30_000_000}
    return defects.in_order(
        [
            Arrival(a.topic, a.time + later[a.topic] + round(turn * SECONDS * 1e9), a.message)
            for turn in (0, 1)
            for a in clean()
        ]
    )


@pytest.mark.parametrize('at_once', [pytest.param(1, marks=pytest.mark.long), 77, 100_000])
def test_a_loop_starts_again_and_says_why(at_once: int) -> None:
    result, session = estimates(ROBOT, looped(), at_once=at_once)
    assert session.restarted == 1
    assert session.restarts[0].startswith('the stamps of the joint states jumped back by 11.99 s')
    half = len(result) // 2
    # The second time round, the clean run's numbers come again, with the reason as a warning.
    expected = estimates(ROBOT, clean())[0]
    assert np.array_equal(first_columns(result[-len(expected) :]), first_columns(expected))
    assert all(session.restarts[0] in estimate.warnings for estimate in result[-len(expected) :])
    assert not any(session.restarts[0] in estimate.warnings for estimate in result[:half])
    assert session.dropped[OTHER_CLOCK] > 0
    assert session.used > 2 * 12 * 95
    once, twice = (sensor_rows(each, None)[0].rate for each in (estimates(ROBOT, clean())[1], session))
    assert twice == pytest.approx(once, rel=0.01)


def test_stray_and_zero_stamps_are_dropped_alone() -> None:
    messages = list(clean())
    for index, change in ((500, shifted(1e6)), (900, shifted(-1e3)), (1300, shifted(-1.7e9))):
        messages[index : index + 1] = changed(messages[index].topic, change)([messages[index]])
    zero = copy(messages[1700].message)
    zero.header = header(0)
    messages[1700] = Arrival(messages[1700].topic, messages[1700].time, zero)
    result, session = estimates(ROBOT, messages)
    assert session.dropped[STRAY_STAMP] == 3
    assert session.dropped[ZERO_STAMP] == 1
    assert session.restarted == 0
    assert np.all(np.abs(result[-1].parameters - estimates(ROBOT, clean())[0][-1].parameters) < 0.5 * result[-1].std)


def test_clocks_that_differ_are_reported() -> None:
    result, session = estimates(ROBOT, changed(JOINTS, shifted(100.0))(clean()[:400]))
    assert result == []
    text = 'the stamps of the joint states are 100 s ahead of those of the poses of the base'
    assert obstacles(session) == [f'{text}: these have stopped, or the clocks differ']
    assert obstacles(session) == remarks(session, stuck=True)
    assert remarks(session, stuck=False) == []  # a busy node reads one topic before the other
