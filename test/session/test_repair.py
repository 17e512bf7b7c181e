"""Runs with a repair: the answer after a contradiction, the same live and in a replay, and nothing without one."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.data import NOISE, START
from benchmarks.frame import declared
from benchmarks.honesty.disturbed import CATALOGUE
from benchmarks.honesty.readings import read
from benchmarks.honesty.runs import published
from benchmarks.honesty.worlds import float_freely
from checked import some
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.repair import Conversion, Repair
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build, values_of
from mbaid_ros.sensor_messages import in_order
from mbaid_ros.session.repairing import MOST, RepairPolicy, repaired
from mbaid_ros.session.session import PART, Session
from sessions import URDF, session
from unchanged import Unchanged

SIGN = Repair('the sign of joint4 is wrong', conversion=Conversion(factors={'joint4': -1.0}))
ZERO = Repair('the zero of joint4 is off', {'known_joints.joint4.zero_std': 0.05})


def messages(name: str, seconds: float) -> list[tuple[str, Any]]:
    """Return the messages of a condition with their topics."""
    condition = CATALOGUE[name]
    world = replace(condition.world(0), seconds=seconds)
    readings = condition.defect(read(condition.view(float_freely(world)), NOISE, 0), np.random.default_rng([0, 3]))
    parts = published(readings, load_model(world.urdf), NOISE)
    return [
        (topic, message) for _, topic, message in in_order(parts, BAG_TYPES, lambda _, time: START + round(time * 1e9))
    ]


def started(**parameters: object) -> Session:
    """Return a session of the shipped robot with the declared noise."""
    return Session(build(EstimatorConfig, {**declared(NOISE), **parameters}), URDF)


def replayed(into: Session, given: Sequence[tuple[str, Any]]) -> list[Estimate]:
    """Return all estimates of a run that gets its messages at once."""
    take = {'joint_states': into.add_joint_state, 'odom': into.add_odometry}
    for topic, message in given:
        take[topic](message)
    return into.process()


def live(into: Session, given: Sequence[tuple[str, Any]]) -> list[Estimate]:
    """Return the estimates as a node gets them: few messages at a time, background work in between."""
    take = {'joint_states': into.add_joint_state, 'odom': into.add_odometry}
    found = []
    for topic, message in given:
        if take[topic](message):
            found += into.process(at_once=False)
            into.run_slice()
    while into.catching_up:
        into.run_slice()
    return found + into.process(at_once=False)


def same(one: Estimate, other: Estimate) -> bool:
    """Return whether two estimates are equal to the last bit."""
    arrays = ('parameters', 'covariance', 'momentum')
    return one.status == other.status and all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True) for name in arrays
    )


def test_a_run_with_a_wrong_sign_ends_with_the_true_inertia(unchanged: Unchanged) -> None:
    last = replayed(started(repair=True), messages("a joint's sign flipped", 17.0))[-1]
    unchanged(last)
    (repair,) = last.repairs
    assert repair.conversion == Conversion(factors={'joint3': -1.0})
    assert repair.parameters is None
    assert last.warnings[0] == str(repair)
    assert last.status == 'estimating'
    truth = physical(load_model(URDF).link('link7').parameters)
    known = last.identifiable
    assert known[:4].all()
    assert np.max(np.abs((last.parameters - truth) / last.std)[known]) < 4.0


@pytest.mark.long
def test_a_target_that_was_named_wrongly_is_replaced_and_said() -> None:
    name = 'the wrong target link'
    config = build(EstimatorConfig, {**declared(NOISE), 'repair': True, 'target_link': 'link6'})
    run = Session(config, CATALOGUE[name].believed(URDF))
    last = replayed(run, messages(name, 30.0))[-1]
    assert last.status == 'estimating'
    assert run.robot.target_link == 'link7'
    assert str(last.repairs[0]).endswith('link7, not link6 (as if target_link were link7)')


@pytest.mark.long
def test_a_robot_that_is_declared_exact_deviates_as_robots_do() -> None:
    given = messages('sinusoids of the shipped robot', 40.0)
    for topic, message in given:
        if topic == 'joint_states':
            message.position = np.asarray(message.position) + 1e-3 * np.array([0.0, 2.0, 0.0, 0.0, 0.0, -2.0, 0.0])
    last = replayed(started(**EXACT, repair=True), given)[-1]
    (repair,) = last.repairs
    assert repair.cause.startswith('the robot deviates from its URDF')
    assert last.status == 'estimating'
    truth = physical(load_model(URDF).link('link7').parameters)
    known = last.identifiable
    assert known[:4].all()
    assert np.max(np.abs((last.parameters - truth) / last.std)[known]) < 4.0


@pytest.mark.long
def test_a_force_that_was_taken_for_signs_goes_with_them() -> None:
    given = messages('sinusoids of the shipped robot', 40.0)
    for topic, message in given:
        if topic == 'joint_states':
            message.position = np.asarray(message.position) * [-1.0, -1.0, 1.0, -1.0, -1.0, -1.0, -1.0]
            message.velocity = np.asarray(message.velocity) * [-1.0, -1.0, 1.0, -1.0, -1.0, -1.0, -1.0]
    last = replayed(started(repair=True), given)[-1]
    (repair,) = last.repairs
    assert repair.cause.startswith('the signs of joint1, joint2, joint4, joint5, joint6, joint7 are wrong')
    assert last.status == 'estimating'


def test_a_run_without_a_contradiction_is_the_same_with_repair() -> None:
    given = messages('sinusoids of the shipped robot', 8.0)
    plain, asked = replayed(started(), given), replayed(started(repair=True), given)
    assert len(plain) == len(asked) > 10
    assert all(map(same, plain, asked))
    assert not asked[-1].repairs


def repair_once(monkeypatch: pytest.MonkeyPatch, repair: Repair) -> None:
    """Let the next run with `repair` make a repair at its first estimate, and no other one."""
    left = iter([repair])
    monkeypatch.setattr(RepairPolicy, 'repair', lambda *_: next(left, None))


def test_a_wrong_repair_is_taken_back_by_a_reset_and_where_the_stamps_jump_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = messages('sinusoids of the shipped robot', 7.0)
    right = replayed(started(), given)[-1]
    asked = started(repair=True)
    for reset in (False, True):
        repair_once(monkeypatch, SIGN)
        wrong = replayed(asked, given)[-1]
        assert wrong.repairs == (SIGN,)
        assert not same(wrong, right)
        if reset:
            asked.reset()
        # Without a reset, the stamps jump back: what has been found counts for the run before alone.
        again = replayed(asked, given)[-1]
        assert again.repairs == asked.repairs == ()
        assert same(again, right)
        asked.reset()


def test_a_repair_that_is_made_live_is_that_of_a_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    given, second = messages('sinusoids of the shipped robot', 7.0), started(repair=True)
    repair_once(monkeypatch, SIGN)
    one = replayed(started(repair=True), given)
    repair_once(monkeypatch, SIGN)
    other = live(second, given)
    assert one[-1].repairs == other[-1].repairs == (SIGN,)
    assert same(one[-1], other[-1])
    stamps = [each.stamp for each in other]
    assert stamps == sorted(set(stamps))  # none goes back
    second.reset()
    assert second.repairs == ()
    assert not values_of(second.config)['known_links.calibration']


def test_messages_that_come_while_a_run_catches_up_are_taken_together(monkeypatch: pytest.MonkeyPatch) -> None:
    given, run = messages('sinusoids of the shipped robot', 7.0), started(repair=True)
    repair_once(monkeypatch, SIGN)
    take, behind, due = {'joint_states': run.add_joint_state, 'odom': run.add_odometry}, 0, 0
    for topic, message in given:
        wanted = take[topic](message)
        behind, due = behind + run.catching_up, due + (run.catching_up and wanted)
        if wanted:
            run.process(at_once=False)
    assert behind > 200
    assert due * PART <= behind


def test_times_of_a_repair_stay_where_they_are_when_another_one_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    cut = Repair('the reading of joint1 repeats', conversion=Conversion(left_out=((-0.5, 2.0),)))
    left = iter([cut, SIGN])
    monkeypatch.setattr(RepairPolicy, 'repair', lambda *_: next(left, None))
    given, run = messages('sinusoids of the shipped robot', 7.0), started(repair=True)
    replayed(run, given)
    first, second = (some(each.conversion).origin for each in run.repairs)
    assert second - first == pytest.approx(2e9, abs=3e7)
    assert run.synchroniser is not None
    assert run._segment.identifier.origin == second


def test_an_estimate_is_of_the_link_that_its_repairs_name_also_where_the_stamps_have_jumped_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given, run = messages('sinusoids of the shipped robot', 7.0), started(repair=True)
    repair_once(monkeypatch, Repair('the body is on link6', {'target_link': 'link6'}))
    last = replayed(run, [*given, *given[:40]])[-1]
    assert run.restarted == 1
    assert (run.frames_of(last).target_link, run.robot_of(last).kernel.target.name) == ('link6', 'link6')
    assert run.frames.target_link == run.robot_of(Estimate('trajectory', 'waiting')).target_link == 'link7'
    assert run.is_described_by(URDF)


def test_messages_are_not_kept_for_a_run_without_estimates() -> None:
    (message,) = (each for topic, each in messages('sinusoids of the shipped robot', 0.001) if topic == 'joint_states')
    run, kept = started(repair=True), []
    for second in range(0, 1500, 10):
        later = deepcopy(message)
        later.header.stamp.sec += second
        kept.append(weakref.ref(later))
        run.add_joint_state(later)
        run.process()
        del later
    gone = [each() is None for each in kept]
    assert all(gone[:60])
    assert not all(gone)


@pytest.mark.long
@pytest.mark.parametrize(
    ('name', 'seconds'),
    [
        ("a joint's sign flipped", 26.0),
        ("a joint's zero 30 mrad off", 30.0),
        ('an encoder that slips by 10 mrad', 45.0),
        ('two joints swapped', 30.0),
        ('odometry in an orbit-fixed frame', 45.0),
    ],
)
def test_live_equals_replay_and_the_parameters_of_a_repair_give_its_numbers(name: str, seconds: float) -> None:
    given = messages(name, seconds)
    one, other = replayed(started(repair=True), given)[-1], live(started(repair=True), given)[-1]
    assert one.repairs
    assert one.repairs == other.repairs
    assert same(one, other)
    if all(each.by_parameters for each in one.repairs):
        found = {name: value for each in one.repairs for name, value in (each.parameters or {}).items()}
        assert same(replayed(started(**found), given)[-1], one)


def contradicted(*remedies: Repair, time: float = 0.0) -> Estimate:
    """Return an estimate that contradicts its model, with causes of equal likelihood."""
    causes = tuple((each.cause, 1000.0) for each in remedies)
    return Estimate('trajectory', 'inconsistent', time, causes=causes, remedies={each.cause: each for each in remedies})


def test_a_contradiction_has_to_last_before_a_repair() -> None:
    policy, config = RepairPolicy(), EstimatorConfig()
    decisions = [policy.repair(contradicted(ZERO), config, ()) for _ in range(16)]
    assert decisions == [None] * 15 + [ZERO]
    policy = RepairPolicy()
    for _ in range(15):
        policy.repair(contradicted(ZERO), config, ())
    assert policy.repair(Estimate('trajectory', 'estimating'), config, ()) is None
    assert policy.repair(contradicted(ZERO), config, ()) is None


def test_causes_that_are_as_likely_wait_for_more_windows() -> None:
    axis = Repair('the axis of joint5 is off', {'known_joints.joint5.axis_std': 0.05})
    policy, config = RepairPolicy(), EstimatorConfig()
    decisions = [policy.repair(contradicted(ZERO, axis), config, ()) for _ in range(32)]
    assert decisions[:31] == [None] * 31
    assert decisions[31] is not None
    assert set(decisions[31].parameters or ()) == {'known_joints.joint4.zero_std', 'known_joints.joint5.axis_std'}


def test_a_repair_is_not_made_twice_nor_after_three_nor_late() -> None:
    config = repaired(EstimatorConfig(), [ZERO])
    taken = RepairPolicy(), RepairPolicy(), RepairPolicy()
    for _ in range(20):
        assert taken[0].repair(contradicted(ZERO), config, (ZERO,)) is None
        assert taken[1].repair(contradicted(ZERO), EstimatorConfig(), (ZERO,) * MOST) is None
        assert taken[2].repair(contradicted(ZERO, time=301.0), EstimatorConfig(), ()) is None
    assert taken[2].over


@pytest.mark.parametrize(
    ('parameters', 'named'), [({'method': 'difference'}, 'method'), ({'capture__phase': 'pre_capture'}, 'capture')]
)
def test_runs_without_repairs_refuse_the_parameter(parameters: dict[str, object], named: str) -> None:
    with pytest.raises(ParameterError, match=f"'repair' is true.*{named}"):
        session(repair=True, **parameters)
