"""Inputs as they really arrive: each defect changes the estimate by less than it is uncertain."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

import defects
from benchmarks.honesty import readings
from checked import some
from defects import JOINTS, ODOMETRY, Arrival, Defect, arrivals, changed, estimates, shifted
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.method import FIRST_ESTIMATE
from mbaid_ros.core.outliers import OUTLIER, REPEATED_POSE
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.samples import stamp_of
from mbaid_ros.parameters import build
from mbaid_ros.session.explanation import intake_warnings
from mbaid_ros.session.session import Session
from recorded import of
from sessions import first_columns
from simulated import CONFIG, robot
from unchanged import Unchanged

ROBOT, SECONDS = 'servicer7', 12.0
QUATERNION = np.array([0.1, 0.2, -0.3, 0.9]) / np.sqrt(0.95)
PLACE = np.array([0.3, -0.2, 0.5])
MARKER: dict[str, object] = {'marker.position': PLACE.tolist(), 'marker.orientation': QUATERNION.tolist()}

# What changes nothing but a little of what is known: the defect and the parameters that it needs.
HARMLESS: dict[str, tuple[Defect, dict[str, object]]] = {
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
    'a map that is corrected three times': (changed(ODOMETRY, defects.map_corrected), {}),
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


@pytest.mark.parametrize('defect', HARMLESS)
def test_the_estimate_stays_within_two_standard_deviations(defect: str, unchanged: Unchanged) -> None:
    spoil, parameters = HARMLESS[defect]
    last = estimates(ROBOT, spoil(clean()), parameters)[0][-1]
    unchanged(last)
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


@pytest.mark.parametrize('twist', [True, False])
def test_corrections_of_a_map_are_named_as_such(twist: bool) -> None:
    """No thrust pulse, and no other body, is seen in them."""
    messages = changed(ODOMETRY, defects.map_corrected)(
        clean() if twist else changed(ODOMETRY, defects.no_twist)(clean())
    )
    found, _ = estimates(ROBOT, messages)
    jumps = [[text for text in each.warnings if 'the poses of the base jump' in text] for each in found]
    assert [len(each) for each in jumps] == [int(each.time > 3.2) for each in found]
    assert 'by up to 190 mm and 5.2 degrees at 3.2, 6.4 and 9.0 s, as by corrections of the map' in jumps[-1][0]
    assert found[-1].status in {'estimating', 'converged'}
    assert not found[-1].events
    assert not found[-1].causes


@pytest.mark.parametrize('at_once', [1_000_000, 7])
def test_repeated_poses_make_no_difference(at_once: int) -> None:
    poses = [arrival for arrival in clean() if arrival.topic == ODOMETRY][::5]
    without = defects.in_order([*poses, *(arrival for arrival in clean() if arrival.topic == JOINTS)])
    repeated = [
        Arrival(ODOMETRY, pose.time + later, defects.stamped(pose.message, pose.time + later))
        for pose in poses[:-1]
        for later in range(10_000_000, 50_000_000, 10_000_000)
    ]
    again = defects.in_order([*without, *repeated])
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
        noise = some(last.noise)
        assert noise.correlation_time > 0.7 * constant
        assert noise.twist_correlation_time > 0.7 * constant
        wrong = any('the noise set for the odometry is wrong: base position' in text for text in last.warnings)
        assert wrong or 0.5 < declared < 2.0
        within.append(np.abs(last.parameters - truth) / last.std)
    assert np.all(np.concatenate(within) < 5.0)
    assert np.mean(np.square(within)) < 1.64


@pytest.mark.long
@pytest.mark.parametrize(
    ('delay', 'seconds', 'how'),
    [(0.2, 18.0, '200 ms late'), (-0.1, 24.0, '100 ms early'), (-0.32, 24.0, '300 ms early')],
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
    assert some(last.noise).estimated == pytest.approx([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4], rel=0.12)
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
    young = [FIRST_ESTIMATE in each.warnings for each in reported]
    assert young == [each.time < reported[0].time + 6.0 for each in reported]
    assert young[0]
    assert not young[-1]


def test_undeclared_noise_is_estimated(unchanged: Unchanged) -> None:
    silent = changed(ODOMETRY, defects.no_covariance)(clean())
    last = estimates(ROBOT, silent)[0][-1]
    unchanged(last)
    assert last.status == undisturbed().status
    noise = some(last.noise)
    assert noise.used.all()
    assert np.isnan(noise.declared).all()
    assert noise.estimated == pytest.approx([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4], rel=0.12)
    assert noise.differences()[-1].startswith('no noise is set for joint position (')
    assert np.all(np.abs(last.std / undisturbed().std - 1.0) < 0.15)
    # Of one sensor it is declared, five times too large: that one counts as declared.
    declared = estimates(ROBOT, silent, {'noise.base_position': 5e-3, 'noise.trust_declared': True})[0][-1]
    assert some(declared.noise).used.tolist() == [True, True, False, True, True, True]
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
    assert some(last.noise).estimated[2] == pytest.approx(0.02, rel=0.2)


def test_slow_odometry_that_is_declared_ten_times_too_precise_contradicts_nothing(unchanged: Unchanged) -> None:
    precise = defects.scaled_covariances(1e-2)
    messages = changed(ODOMETRY, precise)(arrivals(ROBOT, SECONDS, 2, odometry_times=np.arange(0.0, SECONDS, 0.1)))
    last = estimates(ROBOT, messages)[0][-1]
    unchanged(last)
    assert last.status in {'estimating', 'converged'}
    assert any('the noise set for the odometry is wrong: base position' in text for text in last.warnings)
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
