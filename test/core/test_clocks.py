"""Streams of stamps and joints: gated, put in order, merged, unwrapped; and velocities taken from positions."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checked import some
from mbaid_ros.core.clocks import BAD_NANOSEC, POSITION_LATE, STRAY_STAMP, ZERO_STAMP, Gate, Reorder, position_late
from mbaid_ros.core.contracts import Motion, deviation_text
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.stream import NO_PARTNER, OFTEN, PARTNER_GAP, REDUNDANT, JointMerge, Joints
from mbaid_ros.core.outliers import REPEATED
from mbaid_ros.core.samples import NO_STAMP, JointStream, Samples, polynomial_fit, stamp_of, with_rates
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion, observe, windows

SECOND = 1_000_000_000


def passed(stamps: list[float]) -> tuple[list[float], list[float], dict[str, int]]:
    """Return the stamps (s) that pass, the jumps back and what is dropped."""
    gate, jumps = Gate(SECOND), []
    for stamp in stamps:
        jump = gate.add(round(stamp * SECOND), stamp)
        if jump:
            jumps.append(jump / SECOND)
            gate.confirm_jump(stamp)
    return gate.pop_all(), jumps, dict(gate.dropped)


@pytest.mark.parametrize(
    ('stamps', 'kept', 'jumps', 'dropped'),
    [
        ([5.0, 5.5, 5.4, 6.0], [5.0, 5.5, 5.4, 6.0], [], {}),
        ([5.0, 9.0, 5.5], [5.0, 5.5], [], {STRAY_STAMP: 1}),
        ([5.0, 1.0, 5.5], [5.0, 5.5], [], {STRAY_STAMP: 1}),
        ([5.0, 1.0, 1.5, 2.0], [5.0, 1.0, 1.5, 2.0], [4.0], {}),
        ([5.0, 9.0, 9.5], [5.0, 9.0, 9.5], [], {}),
        ([5.0, 9.0, 13.0, 17.0, 17.5], [5.0, 9.0, 13.0, 17.0, 17.5], [], {}),
        ([5.0, 3.0, 1.0, 1.5], [5.0, 1.0, 1.5], [4.0], {STRAY_STAMP: 1}),
        ([5.0, 9.0, 1.0, 1.5], [5.0, 1.0, 1.5], [4.0], {STRAY_STAMP: 1}),
        ([5.0, 1.0, 9.0, 9.5], [5.0, 9.0, 9.5], [], {STRAY_STAMP: 1}),
        ([0.0, 0.5, 1.0], [0.0, 0.5, 1.0], [], {}),
        ([0.0, 0.0, 0.0], [0.0], [], {ZERO_STAMP: 2}),
        ([5.0, 0.0, 0.0, 5.5], [5.0, 5.5], [], {ZERO_STAMP: 2}),
        ([5.0, 0.0, 0.1, 0.2], [5.0, 0.0, 0.1, 0.2], [5.0], {}),
        ([5.0, 0.0, 2.0, 5.5], [5.0, 5.5], [], {ZERO_STAMP: 1, STRAY_STAMP: 1}),
        ([-3.0, -2.5], [-3.0, -2.5], [], {}),
        # Copies two seconds late, up to the end; a bag that is played again after one; and one that is played again.
        ([1.0, 2.0, 3.0, 1.0, 4.0, 1.5, 2.5], [1.0, 2.0, 3.0, 4.0, 1.5, 2.5], [2.5], {REPEATED: 1}),
        ([1.0, 2.0, 3.0, 1.0, 4.0, 1.0, 2.0], [1.0, 2.0, 3.0, 4.0], [], {REPEATED: 3}),
        ([1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0], [3.0], {}),
    ],
)
def test_what_passes(stamps: list[float], kept: list[float], jumps: list[float], dropped: dict[str, int]) -> None:
    assert passed(stamps) == (kept, jumps, dropped)


@pytest.mark.parametrize('begin', [[], [5.0], [5.0, 9.0], [5.0, 4.9]])
@pytest.mark.parametrize(
    ('stamps', 'regular'),
    [
        ([], True),
        ([5.1, 5.2, 5.15, 6.2], True),
        ([5.1, 4.5, 6.1], True),
        ([5.1, 6.2], False),
        ([5.9, 4.8, 6.0], False),
        ([5.1, 0.0, 5.2], False),
    ],
)
def test_many_that_all_pass_are_taken_as_one_by_one(begin: list[float], stamps: list[float], *, regular: bool) -> None:
    singly, together = Gate(SECOND), Gate(SECOND)
    for gate in (singly, together):
        for stamp in begin:
            gate.add(round(stamp * SECOND), stamp)
    given = np.array([round(stamp * SECOND) for stamp in stamps], dtype=np.int64)
    # Nothing is known before the first stamp, and one that is far from the others waits for the next.
    assert together.all_pass(given) == ((regular and begin in ([5.0], [5.0, 4.9])) or not stamps)
    if together.all_pass(given):
        together.add_regular(given, stamps)
        for stamp in stamps:
            assert singly.add(round(stamp * SECOND), stamp) == 0
        assert (singly.newest, singly.dropped) == (together.newest, together.dropped)
        assert singly.pop_all() == together.pop_all()


LIMIT = 50
stamp_lists = st.lists(st.integers(0, 300), min_size=1, max_size=60)


def stream(stamps: list[int]) -> JointStream:
    values = np.array(stamps, dtype=float)[:, None]
    return JointStream(np.array(stamps, dtype=np.int64), values, np.arange(len(stamps))[:, None] * 1.0)


def released(stamps: list[int], cuts: list[int]) -> tuple[list[int], dict[str, int], int]:
    """Return the stamps in the order of release when the stream is cut at some places."""
    reorder, result = Reorder[JointStream](LIMIT), []
    whole = stream(stamps)
    edges = [0, *sorted(min(cut, len(stamps)) for cut in cuts), len(stamps)]
    for begin, end in itertools.pairwise(edges):
        part = JointStream(whole.stamp[begin:end], whole.position[begin:end], whole.velocity[begin:end])
        ordered = reorder.push(part)
        if ordered is not None:
            assert np.array_equal(ordered.position[:, 0], ordered.stamp)
            result += ordered.stamp.tolist()
    return result, dict(reorder.dropped), reorder.hold


@settings(max_examples=100, deadline=None)
@given(stamp_lists, st.lists(st.integers(0, 60), max_size=6))
def test_the_result_is_increasing_and_the_same_however_it_is_cut(stamps: list[int], cuts: list[int]) -> None:
    whole, dropped, hold = released(stamps, [])
    assert whole == sorted(set(whole))
    assert hold <= LIMIT
    assert len(whole) + sum(dropped.values()) <= len(stamps)
    assert released(stamps, cuts) == (whole, dropped, hold)


GAP = SECOND // 10


def motion(time: Array) -> tuple[Array, Array]:
    """Return four joints' positions and velocities."""
    phase = np.array([0.3, 0.7, 1.1, 1.9]) * time[:, None]
    return np.sin(phase), np.array([0.3, 0.7, 1.1, 1.9]) * np.cos(phase)


def part(joints: Joints, time: Array, *, rates: bool = True) -> tuple[Joints, JointStream]:
    position, velocity = motion(time)
    columns = list(joints)
    measured = velocity[:, columns] if rates else np.full((len(time), len(joints)), np.nan)
    return joints, JointStream(np.round(time * SECOND).astype(np.int64), position[:, columns], measured)


def merge(turning: int = 4, reorder: int = 0) -> JointMerge:
    return JointMerge(np.ones(turning, dtype=bool), GAP, reorder)


TIME = np.arange(0.0, 2.0, 0.01)


@pytest.mark.parametrize(('rates', 'error'), [(True, 1e-9), (False, 1e-4)])
def test_halves_make_a_whole_at_the_stamps_of_the_first(rates: bool, error: float) -> None:
    merger = merge()
    merged = some(merger.push(dict([part((2, 3), TIME, rates=rates), part((0, 1), TIME + 0.004, rates=rates)])))
    position, velocity = motion(merged.stamp / SECOND)
    assert merged.position == pytest.approx(position, abs=error)
    if rates:
        assert merged.velocity == pytest.approx(velocity, abs=1e-4)
    else:
        assert np.all(np.isnan(merged.velocity))
    assert len(merged.stamp) == len(TIME) - 1
    assert merger.dropped == {NO_PARTNER: 1}


@pytest.mark.parametrize('at_once', [1, 10, 200])
def test_a_leader_that_comes_late_loses_nothing(at_once: int) -> None:
    merger, used = merge(), 0
    leads, follows = part((0, 1), TIME)[1], part((2, 3), TIME + 0.004)[1]
    stamp = np.concatenate((leads.stamp + 25_000_000, follows.stamp))  # of arrival
    order = np.argsort(stamp, kind='stable')
    merger.push({(0, 1): leads[:1], (2, 3): follows[:0]})
    for begin in range(0, len(order), at_once):
        some_of = order[begin : begin + at_once]
        of_leader = np.sort(some_of[(some_of < len(TIME)) & (some_of > 0)])
        of_other = np.sort(some_of[some_of >= len(TIME)]) - len(TIME)
        merged = merger.push({(0, 1): leads[of_leader], (2, 3): follows[of_other]})
        used += 0 if merged is None else len(merged.stamp)
    assert used == len(TIME) - 1
    assert merger.dropped == {NO_PARTNER: 1}


def test_a_slower_partner_sets_the_rate() -> None:
    merger = merge()
    merged = some(merger.push(dict([part((0, 1), TIME), part((2, 3), TIME[::5])])))
    # Each of the slow messages but the last counts once.
    assert len(merged.stamp) == len(TIME[::5])
    assert merger.dropped[OFTEN] > 100


def test_gaps_of_a_partner_are_not_bridged() -> None:
    merger = merge()
    there = (TIME < 0.5) | (TIME > 1.0)
    merged = some(merger.push(dict([part((0, 1), TIME), part((2, 3), TIME[there])])))
    assert not np.any((merged.stamp > 0.5 * SECOND) & (merged.stamp < SECOND))
    assert merger.dropped[PARTNER_GAP] == np.sum(~there)


def test_messages_wait_until_every_joint_has_come() -> None:
    merger = merge()
    assert merger.push(dict([part((0, 1), TIME)])) is None
    assert list(merger.missing) == [2, 3]
    assert merger.push(dict([part((2,), TIME)])) is None
    assert list(merger.missing) == [3]
    merged = some(merger.push(dict([part((3,), TIME)])))
    assert len(merged.stamp) == len(TIME)
    assert merger.push(dict([part((1, 3), TIME + 5.0)])) is None
    assert merger.dropped == {REDUNDANT: len(TIME)}


@pytest.mark.parametrize('at_once', [1, 7, 200])
def test_angles_are_unwrapped_the_same_however_they_are_cut(at_once: int) -> None:
    turns = np.linspace(0.0, 40.0, 200, dtype=float)[:, None] * np.array([1.0, -1.0])
    wrapped = np.mod(turns + np.pi, 2.0 * np.pi) - np.pi
    merger = JointMerge(np.array([True, True]), GAP, 0)
    stamp = np.arange(200) * 10_000_000
    pieces = []
    for begin in range(0, 200, at_once):
        index = slice(begin, begin + at_once)
        piece = some(merger.push({(0, 1): JointStream(stamp[index], wrapped[index], wrapped[index])}))
        pieces.append(piece.position)
    assert np.concatenate(pieces) == pytest.approx(turns, abs=1e-12)


def test_what_is_no_joint_neither_sets_the_stamps_nor_costs_samples() -> None:
    """Its messages come first, and one for five of the joints'."""
    merger = JointMerge(np.ones(4, dtype=bool), GAP, 0, beside=2)
    seldom = part((2, 3), TIME[::5])
    merged = some(merger.push(dict([seldom, part((0, 1), TIME)])))
    last = int(np.flatnonzero(TIME[::5][-1] >= TIME)[-1])
    assert np.array_equal(merged.stamp, np.round(TIME[: last + 1] * SECOND).astype(np.int64))
    assert merged.velocity == pytest.approx(motion(merged.stamp / SECOND)[1], abs=3e-3)
    joints_alone = JointMerge(np.ones(4, dtype=bool), GAP, 0)
    assert joints_alone.push(dict([seldom, part((0, 1), TIME)])) is not None
    assert joints_alone.dropped[OFTEN] == 0  # the seldom one leads: no sample is used twice
    divided = merged.without_stored_momentum(2)
    assert np.array_equal(divided.stored, merged.velocity[:, 2:])
    assert np.array_equal(divided.position, merged.position[:, :2])


@cache
def configured(robot: str, seconds: float) -> Truth:
    return configured_motion(robot, seconds, 100.0)


def stripped(samples: Samples) -> Samples:
    nothing = {
        name: np.full_like(getattr(samples, name), np.nan)
        for name in ('joint_velocity', 'base_linear_velocity', 'base_angular_velocity')
    }
    return replace(samples, **nothing)


@pytest.mark.parametrize('count', [2, 3, 5, 6, 50])
def test_a_fit_is_exact_for_polynomials_it_can_hold(count: int) -> None:
    time = np.sort(np.random.default_rng(count).uniform(3.0, 3.5, count))
    degree = min(4, count - 1)
    coefficients = np.arange(1.0, degree + 2.0)
    signal = np.polyval(coefficients, time - 3.0)[:, None]
    values, slopes = polynomial_fit(time).smooth(signal)
    assert values == pytest.approx(signal)
    assert slopes[:, 0] == pytest.approx(np.polyval(np.polyder(coefficients), time - 3.0), rel=1e-6)


def test_rates_of_an_exact_motion_are_those_of_the_truth() -> None:
    exact = observe(configured('servicer7', 20.0)[:100], MID)
    for window in windows(exact):
        assert stripped(window).missing_rates == (True, True)
        derived = with_rates(stripped(window))
        for name in ('joint_velocity', 'base_linear_velocity', 'base_angular_velocity'):
            # Within the truncation of the fourth degree, a hundredth of the noise of a velocity sensor.
            assert getattr(derived, name) == pytest.approx(getattr(window, name), abs=2e-6), name


def test_measured_rates_are_left_alone() -> None:
    window = windows(observe(configured('servicer7', 20.0)[:100], MID, 1))[0]
    assert with_rates(window) is window
    half = replace(window, joint_velocity=window.joint_velocity.copy())
    half.joint_velocity[7, 2] = np.nan
    derived = with_rates(half)
    others = [0, 1, 3, 4, 5, 6]
    assert np.array_equal(derived.joint_velocity[:, others], window.joint_velocity[:, others])
    assert np.all(np.isnan(derived.joint_rate_gain[:, others]))
    assert np.all(derived.joint_rate_gain[:, 2] > 0.0)
    assert np.array_equal(derived.base_linear_velocity, window.base_linear_velocity)


def test_stamps_whose_nanosec_are_a_second_or_more_are_none() -> None:
    stamp = SimpleNamespace(sec=5, nanosec=SECOND - 1)
    message = SimpleNamespace(header=SimpleNamespace(stamp=stamp))
    assert stamp_of(message) == 6 * SECOND - 1
    stamp.nanosec += 1
    assert stamp_of(message) == NO_STAMP
    gate = Gate(SECOND)
    assert [gate.add(each, each) for each in (5, NO_STAMP, 6)] == [0, 0, 0]
    assert (gate.messages, gate.dropped[BAD_NANOSEC]) == ([5, 6], 1)
    assert gate.all_pass(np.array([7, 8])) is not gate.all_pass(np.array([7, NO_STAMP]))


def test_a_position_that_is_late_is_an_earlier_one_beside_its_orientation() -> None:
    motion = cast('Motion', SimpleNamespace(twist=np.arange(12.0).reshape(2, 6)))
    read = some(position_late(1e-4).measured('pose', motion))
    assert read[..., 0].tolist() == [[0.0, 0.0, 0.0, -3.0, -4.0, -5.0], [0.0, 0.0, 0.0, -9.0, -10.0, -11.0]]
    assert position_late(1e-4).measured('twist', motion) is None
    assert '+80 ms late against its orientation' in deviation_text(POSITION_LATE, np.array([0.08]))


def test_stamps_of_late_copies_are_remembered_however_many_pass_at_once_and_forgotten_after_a_jump_back() -> None:
    count = 20_500
    stamps = np.arange(1, count + 1) * SECOND // 100
    singly, together = Gate(SECOND), Gate(SECOND)
    together.add(int(stamps[0]), 0)
    together.add_regular(stamps[1:], stamps[1:].tolist())
    for stamp in stamps.tolist():
        singly.add(stamp, stamp)
    newest = int(stamps[-1])
    for gate in (singly, together):
        for late in (count // 2, count // 2, count - 1):  # the last one is too late to be known
            assert gate.add(int(stamps[-1 - late]), 0) == 0
            assert gate.add(newest, 0) == 0
        assert gate.dropped == {REPEATED: 2, STRAY_STAMP: 1}
        assert gate.add(0, 0) == gate.add(newest, 0) == 0
        assert [gate.add(each, 0) for each in (SECOND // 2, SECOND)] == [0, newest - SECOND // 2]
        gate.confirm_jump(0)
        # Those of the run before are no copies any more.
        assert gate.add(newest, 0) == gate.add(SECOND + 1, 0) == 0
        assert (gate.dropped[REPEATED], gate.dropped[STRAY_STAMP]) == (2, 2)
