"""Inputs as they really arrive: each defect changes the estimate by less than it is uncertain, or is reported."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

import defects
from benchmarks.honesty import readings
from defects import JOINTS, ODOMETRY, Arrival, arrivals, changed, estimates, shifted
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import JOINT_RATES_DERIVED, POSES_ALONE, TWIST_DERIVED
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.sensors.outliers import OUTLIER, REPEATED_POSE
from mbaid_ros.core.sensors.streams import LATE, OTHER_CLOCK, REPEATED, STRAY_STAMP, ZERO_STAMP
from mbaid_ros.core.two_stage import YOUNG
from mbaid_ros.messages.fields import (
    BAD_QUATERNION,
    JOINT_MISSING,
    LOST_TRACKING,
    NOT_FINITE,
    POSE_COVARIANCE,
    TWIST_COVARIANCE,
    WRONG_CHILD_FRAME,
    stamp_of,
)
from mbaid_ros.nodes.reports import remarks
from mbaid_ros.session.explanation import explain, intake_warnings, missing_joints, obstacles
from mbaid_ros.session.session import Session
from recorded import header, of
from simulated import CONFIG, robot

ROBOT, SECONDS = 'servicer7', 12.0
QUATERNION = np.array([0.1, 0.2, -0.3, 0.9]) / np.sqrt(0.95)
PLACE = np.array([0.3, -0.2, 0.5])
MARKER: dict[str, object] = {'marker.position': PLACE.tolist(), 'marker.orientation': QUATERNION.tolist()}

# What changes nothing but a little of what is known: the defect and the parameters that it needs.
HARMLESS: dict[str, tuple[Callable[[list[Arrival]], list[Arrival]], dict[str, object]]] = {
    'permuted and extra joints': (changed(JOINTS, defects.permuted_and_extra), {}),
    'wrapped angles': (changed(JOINTS, defects.wrapped), {}),
    'quaternions of length 1.05 and either sign': (changed(ODOMETRY, defects.odd_quaternion), {}),
    'two publishers of half the joints': (defects.in_halves, {}),
    'out of order by up to 30 ms': (defects.out_of_order(3, 0.03), {}),
    'repeated messages': (defects.repeated, {}),
    '30 % lost': (defects.lost(3, 0.3), {}),
    'gaps in the odometry': (defects.with_gaps, {}),
    '5 % of the poses thrown off': (lambda messages: thrown(0.05)[: len(messages)], {}),
    'bursts of joint states': (defects.in_bursts, {}),
    'another frame on the base': (defects.of_marker(PLACE, QUATERNION, 'tracking_marker'), MARKER),
    'no joint velocities': (changed(JOINTS, defects.no_rates), {}),
    'no twist': (changed(ODOMETRY, defects.no_twist), {}),
}


@cache
def clean() -> list[Arrival]:
    return arrivals(ROBOT, SECONDS, 2)


def thrown(share: float) -> list[Arrival]:
    """Return the clean run with a share of its poses off by 0.2 m and 5 degrees."""
    return arrivals(ROBOT, SECONDS, 2, read=partial(readings.outliers, share))


@cache
def undisturbed() -> Estimate:
    return estimates(ROBOT, clean())[0][-1]


def first_columns(result: list[Estimate]) -> Array:
    """Return what is published, NaN as a number, for comparison to the last bit."""
    rows = [
        np.concatenate((estimate.parameters, np.ravel(estimate.covariance), estimate.momentum)) for estimate in result
    ]
    return np.nan_to_num(np.array(rows), nan=-1.0)


@pytest.mark.parametrize('defect', HARMLESS)
def test_the_estimate_stays_within_two_standard_deviations(defect: str) -> None:
    spoil, parameters = HARMLESS[defect]
    last = estimates(ROBOT, spoil(clean()), parameters)[0][-1]
    assert np.all(last.identifiable)
    larger = np.maximum(last.std, undisturbed().std)
    # What velocities are taken from is noise of its own.
    limit = 3.0 if defect.startswith('no ') else 2.0
    assert np.all(np.abs(last.parameters - undisturbed().parameters) < limit * larger)


@pytest.mark.parametrize('defect', HARMLESS)
def test_how_the_calls_are_spread_makes_no_difference(defect: str) -> None:
    spoil, parameters = HARMLESS[defect]
    messages = spoil(clean()[:500])
    whole, session = estimates(ROBOT, messages, parameters)
    assert len(whole) >= 3
    for at_once in (1, 33):
        pieces, other = estimates(ROBOT, messages, parameters, at_once)
        assert np.array_equal(first_columns(pieces), first_columns(whole))
        assert [estimate.warnings for estimate in pieces] == [estimate.warnings for estimate in whole]
        assert other.dropped == session.dropped


@pytest.mark.parametrize('at_once', [1_000_000, 7])
def test_repeated_poses_make_no_difference(at_once: int) -> None:
    reported, poses = 0, []
    for arrival in clean():
        if arrival.topic == ODOMETRY:
            if reported % 5 == 0:
                poses.append(arrival)
            reported += 1
    without = defects.in_order([*poses, *(arrival for arrival in clean() if arrival.topic == JOINTS)])
    again = defects.in_order(
        [
            *without,
            *(
                Arrival(ODOMETRY, pose.time + later, defects.stamped(pose.message, pose.time + later))
                for pose in poses[:-1]
                for later in range(10_000_000, 50_000_000, 10_000_000)
            ),
        ]
    )
    expected, _ = estimates(ROBOT, without)
    found, session = estimates(ROBOT, again, at_once=at_once)
    assert np.array_equal(first_columns(found), first_columns(expected))
    assert session.dropped[REPEATED_POSE] == 4 * (len(poses) - 1)
    assert any('pose repeated: a repeated pose is no new' in warning for warning in intake_warnings(session))


@pytest.mark.parametrize('share', [0.01, 0.05])
def test_outliers_cost_little_and_are_reported(share: float) -> None:
    found, session = estimates(ROBOT, thrown(share))
    last, count = found[-1], session.dropped[OUTLIER]
    assert last.status == undisturbed().status
    assert np.all(last.std < 1.2 * undisturbed().std)
    assert np.all(np.abs(last.parameters - undisturbed().parameters) < 1.2 * undisturbed().std)
    assert count == pytest.approx(1200 * share, abs=3.0 * np.sqrt(1200 * share))
    many = f'pose far from those before and after: {100.0 * count / 1200:.2g} % of the odometry are outliers'
    assert any(many in warning for warning in intake_warnings(session)) == (count > 12)


@pytest.mark.long
@pytest.mark.parametrize(('constant', 'declared'), [(0.1, 1.5), (0.3, 0.1), (1.0, 10.0), (5.0, 1.0 / 1.5)])
def test_odometry_of_a_navigation_filter_is_as_uncertain_as_reported(constant: float, declared: float) -> None:
    model = robot(ROBOT)
    truth, within = physical(model.link(model.last_link).parameters), []
    for seed in range(3):
        messages = arrivals(ROBOT, 20.0, seed, read=defects.navigation(constant, declared))
        last = estimates(ROBOT, messages)[0][-1]
        assert last.status in {'estimating', 'converged'}
        assert last.noise is not None
        assert last.noise.correlation_time > 0.7 * constant
        assert last.noise.twist_correlation_time > 0.7 * constant
        wrong = any('the declared noise of the odometry is wrong: base position' in text for text in last.warnings)
        assert wrong or 0.5 < declared < 2.0
        within.append(np.abs(last.parameters - truth) / last.std)
    assert np.all(np.concatenate(within) < 5.0)
    assert np.mean(np.square(within)) < 1.64


@pytest.mark.parametrize(
    ('delay', 'seconds', 'how'),
    [
        (0.2, 18.0, '200 ms late'),
        pytest.param(-0.1, 24.0, '100 ms early', marks=pytest.mark.long),
        pytest.param(-0.32, 24.0, '300 ms early', marks=pytest.mark.long),
    ],
)
def test_joints_that_are_stamped_far_off_are_named_first(delay: float, seconds: float, how: str) -> None:
    messages = changed(JOINTS, shifted(delay))(arrivals(ROBOT, seconds, 1))
    last = estimates(ROBOT, sorted(messages, key=lambda each: (stamp_of(each.message), each.topic)))[0][-1]
    assert last.status in {'inconsistent', 'not_identifiable'}
    assert f'the joints are stamped some {how}' in last.causes[0][0]


@pytest.mark.parametrize('factor', [0.2, 5.0])
def test_noise_that_is_declared_wrong_makes_no_difference_where_it_is_found(factor: float) -> None:
    names = ('joint_position', 'joint_velocity', 'base_position', 'base_orientation')
    wrong = {f'noise.{name}': factor * value for name, value in zip(names, (1e-4, 1e-3, 1e-3, 1e-4), strict=True)}
    last = estimates(ROBOT, clean(), {**wrong, 'noise.estimate': True})[0][-1]
    assert last.status == undisturbed().status
    assert last.noise is not None
    assert last.noise.found == pytest.approx([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4], rel=0.12)
    assert np.all(np.abs(last.std / undisturbed().std - 1.0) < 0.15)


def test_a_recording_that_ends_before_its_noise_is_known_uses_all_of_its_windows() -> None:
    filtered = arrivals(ROBOT, SECONDS, 2, read=defects.navigation(0.3, 0.3))
    messages = [each for each in filtered if each.time - defects.EPOCH < 3.4e9]
    result, session = estimates(ROBOT, messages)
    last = session.finish()[-1]
    assert (result, last.samples, session.finish()) == ([], 300, [])
    assert last.status != 'inconsistent'
    again, other = estimates(ROBOT, filtered)
    assert (len(again) > 20, other.finish()) == (True, [])


def test_the_first_numbers_say_that_they_are_first() -> None:
    reported = [each for each in estimates(ROBOT, clean())[0] if each.identifiable.any()]
    young = [YOUNG in each.warnings for each in reported]
    assert young == [each.time < reported[0].time + 6.0 for each in reported]
    assert young[0]
    assert not young[-1]


def test_undeclared_noise_is_estimated() -> None:
    silent = changed(ODOMETRY, defects.no_covariance)(clean())
    last = estimates(ROBOT, silent)[0][-1]
    assert last.status == undisturbed().status
    assert last.noise is not None
    assert last.noise.used.all()
    assert np.isnan(last.noise.declared).all()
    assert last.noise.found == pytest.approx([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4], rel=0.12)
    assert last.noise.differences()[-1].startswith('no noise is declared for joint position (')
    assert np.all(np.abs(last.std / undisturbed().std - 1.0) < 0.15)
    # Of one sensor it is declared, five times too large: that one counts as declared.
    declared = estimates(ROBOT, silent, {'noise.base_position': 5e-3, 'noise.trust_declared': True})[0][-1]
    assert declared.noise is not None
    assert declared.noise.used.tolist() == [True, True, False, True, True, True]
    assert declared.std[1:4].mean() > 1.1 * last.std[1:4].mean()


def test_slow_poses_of_undeclared_noise_contradict_nothing() -> None:
    noise = np.random.default_rng(1)

    def silent(message: Any) -> None:
        defects.no_twist(message)
        defects.no_covariance(message)
        place = vars(message.pose.pose.position)
        moved = of('Point', [place[axis] + 0.02 * noise.normal() for axis in 'xyz'])
        message.pose = replace(message.pose, pose=replace(message.pose.pose, position=moved))

    messages = changed(ODOMETRY, silent)(arrivals(ROBOT, SECONDS, 2, odometry_times=np.arange(0.0, SECONDS, 0.05)))
    last = estimates(ROBOT, messages)[0][-1]
    assert last.status != 'inconsistent'
    assert last.residual < 1.3
    assert last.noise is not None
    assert last.noise.found[2] == pytest.approx(0.02, rel=0.2)


def test_slow_odometry_that_is_declared_ten_times_too_precise_contradicts_nothing() -> None:
    precise = defects.scaled_covariances(1e-2)
    messages = changed(ODOMETRY, precise)(arrivals(ROBOT, SECONDS, 2, odometry_times=np.arange(0.0, SECONDS, 0.1)))
    last = estimates(ROBOT, messages)[0][-1]
    assert last.status in {'estimating', 'converged'}
    assert any('the declared noise of the odometry is wrong: base position' in text for text in last.warnings)
    truth = physical(robot(ROBOT).link(robot(ROBOT).last_link).parameters)
    assert np.all(np.abs(last.parameters - truth) < 5.0 * last.std)


def test_a_link_of_the_robot_that_is_fixed_to_the_base_is_found_by_itself() -> None:
    text = (CONFIG / f'{ROBOT}.urdf').read_text(encoding='utf-8')
    # Roll 0, pitch 0, yaw 90 degrees.
    marker = (
        '<link name="marker"/><joint name="mount" type="fixed"><parent link="base_link"/><child link="marker"/>'
        '<origin xyz="0.3 -0.2 0.5" rpy="0 0 1.5707963267948966"/></joint></robot>'
    )

    session = Session(build(EstimatorConfig, dict(EXACT)), text.replace('</robot>', marker))
    spoil = defects.of_marker(PLACE, np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]), 'marker')
    for arrival in spoil(clean()):
        (session.add_joint_state if arrival.topic == JOINTS else session.add_odometry)(arrival.message)
    last = session.process()[-1]
    assert np.all(np.abs(last.parameters - undisturbed().parameters) < 0.5 * last.std)


@pytest.mark.parametrize(
    ('spoil', 'cause', 'sentence'),
    [
        (changed(ODOMETRY, lambda m: setattr(m, 'child_frame_id', 'link3')), WRONG_CHILD_FRAME, "'link3'; accepted: "),
        (changed(ODOMETRY, lambda m: setattr(m, 'child_frame_id', '')), WRONG_CHILD_FRAME, "''; accepted: 'base_link'"),
        (
            changed(ODOMETRY, lambda m: setattr(m.pose.pose, 'orientation', of('Quaternion', np.zeros(4)))),
            LOST_TRACKING,
            'has lost the base',
        ),
        (
            changed(ODOMETRY, lambda m: setattr(m.pose.pose, 'orientation', of('Quaternion', np.ones(4)))),
            BAD_QUATERNION,
            'length is not 1',
        ),
        (
            changed(JOINTS, lambda m: setattr(m, 'position', m.position * np.nan)),
            NOT_FINITE,
            'position of joint1 is NaN or infinite in 200 of 200 messages: look',
        ),
        (
            changed(ODOMETRY, lambda m: setattr(m.pose.pose.position, 'y', np.nan)),
            NOT_FINITE,
            'position of the base is NaN or infinite in 200 of 200 messages: look',
        ),
        (changed(JOINTS, lambda m: setattr(m, 'name', list('abcdefg'))), JOINT_MISSING, 'they hold a, b, c, d, e, f'),
    ],
)
def test_unusable_messages_are_reported(
    spoil: Callable[[list[Arrival]], list[Arrival]], cause: str, sentence: str
) -> None:
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
    spoil = changed(JOINTS, lambda m: setattr(m, 'name', list('abcdefg')))
    _, session = estimates(ROBOT, [*spoil(clean()[1000:1400]), *clean()[:400]], at_once=1)
    assert session.restarted == 1
    assert explain(session, [JOINT_MISSING]) == [JOINT_MISSING]
    assert missing_joints(session) == ()


def test_half_of_the_joints_alone_are_waited_with() -> None:
    messages = list(defects.in_halves(clean()[:400]))
    half = [a for a in messages if a.topic == ODOMETRY or len(a.message.name) == 4]
    result, session = estimates(ROBOT, half)
    assert result == []
    assert obstacles(session) == [
        'joint missing: the joint states lack joint5, joint6, joint7; they hold joint1, joint2, joint3, joint4'
    ]
    assert missing_joints(session) == ('joint5', 'joint6', 'joint7')


def test_only_what_keeps_most_joint_states_from_use_counts_as_missing() -> None:
    spoil = changed(JOINTS, lambda m: setattr(m, 'name', list('abcdefg')))
    tail = clean()[600:800]
    for whole, missing in ((clean()[:100], ('joint1',)), (clean()[:600], ())):
        _, session = estimates(ROBOT, [*whole, *spoil(tail)])
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
    assert np.all(np.abs(result[-1].parameters - undisturbed().parameters) < 0.5 * result[-1].std)


def test_clocks_that_differ_are_reported() -> None:
    result, session = estimates(ROBOT, changed(JOINTS, shifted(100.0))(clean()[:400]))
    assert result == []
    text = 'the stamps of the joint states are 100 s ahead of those of the poses of the base'
    assert obstacles(session) == [f'{text}: these have stopped, or the clocks differ']
    assert obstacles(session) == remarks(session, stuck=True)
    assert remarks(session, stuck=False) == []  # a busy node reads one topic before the other
