"""Joints of several publishers, and angles that wrap, to one stream."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import JointStream
from mbaid_ros.core.sensors.joints import (
    NO_PARTNER,
    OFTEN,
    PARTNER_GAP,
    REDUNDANT,
    JointMerge,
    Joints,
)

SECOND = 1_000_000_000
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
    merged = merger.push(dict([part((2, 3), TIME, rates=rates), part((0, 1), TIME + 0.004, rates=rates)]))
    assert merged is not None
    position, velocity = motion(merged.stamp / SECOND)
    assert merged.position == pytest.approx(position, abs=error)
    if rates:
        assert merged.velocity == pytest.approx(velocity, abs=1e-4)
    else:
        assert np.all(np.isnan(merged.velocity))
    assert len(merged.stamp) == len(TIME) - 1
    assert merger.dropped == {NO_PARTNER: 1}


@pytest.mark.parametrize('at_once', [1, 3, 50])
def test_the_result_is_the_same_however_the_streams_are_cut(at_once: int) -> None:
    jitter = np.random.default_rng(0).uniform(0.0, 0.009, len(TIME))
    streams = dict([part((0, 2), TIME), part((1, 3), np.sort(TIME + jitter))])
    whole = merge().push(streams)
    merger, pieces = merge(), []
    for begin in range(0, len(TIME), at_once):
        index = slice(begin, begin + at_once)
        cut = {key: JointStream(s.stamp[index], s.position[index], s.velocity[index]) for key, s in streams.items()}
        piece = merger.push(cut)
        if piece is not None:
            pieces.append(piece)
    assert whole is not None
    for name in ('stamp', 'position', 'velocity'):
        assert np.array_equal(np.concatenate([getattr(piece, name) for piece in pieces]), getattr(whole, name))


def test_a_slower_partner_sets_the_rate() -> None:
    merger = merge()
    merged = merger.push(dict([part((0, 1), TIME), part((2, 3), TIME[::5])]))
    assert merged is not None
    # Each of the slow messages but the last counts once.
    assert len(merged.stamp) == len(TIME[::5])
    assert merger.dropped[OFTEN] > 100


def test_gaps_of_a_partner_are_not_bridged() -> None:
    merger = merge()
    there = (TIME < 0.5) | (TIME > 1.0)
    merged = merger.push(dict([part((0, 1), TIME), part((2, 3), TIME[there])]))
    assert merged is not None
    assert not np.any((merged.stamp > 0.5 * SECOND) & (merged.stamp < SECOND))
    assert merger.dropped[PARTNER_GAP] == np.sum(~there)


def test_messages_wait_until_every_joint_has_come() -> None:
    merger = merge()
    assert merger.push(dict([part((0, 1), TIME)])) is None
    assert list(merger.missing) == [2, 3]
    assert merger.push(dict([part((2,), TIME)])) is None
    assert list(merger.missing) == [3]
    merged = merger.push(dict([part((3,), TIME)]))
    assert merged is not None
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
        piece = merger.push({(0, 1): JointStream(stamp[index], wrapped[index], wrapped[index])})
        assert piece is not None
        pieces.append(piece.position)
    assert np.concatenate(pieces) == pytest.approx(turns, abs=1e-12)


def test_sliding_joints_do_not_wrap() -> None:
    position = np.array([[0.0], [10.0], [20.0]])
    merged = JointMerge(np.array([False]), GAP, 0).push({(0,): JointStream(np.arange(3), position, position)})
    assert merged is not None
    assert np.array_equal(merged.position, position)


def test_what_is_no_joint_neither_sets_the_stamps_nor_costs_samples() -> None:
    """Its messages come first, and one for five of the joints'."""
    merger = JointMerge(np.ones(4, dtype=bool), GAP, 0, beside=2)
    seldom = part((2, 3), TIME[::5])
    merged = merger.push(dict([seldom, part((0, 1), TIME)]))
    assert merged is not None
    last = int(np.flatnonzero(TIME[::5][-1] >= TIME)[-1])
    assert np.array_equal(merged.stamp, np.round(TIME[: last + 1] * SECOND).astype(np.int64))
    assert merged.velocity == pytest.approx(motion(merged.stamp / SECOND)[1], abs=3e-3)
    joints_alone = JointMerge(np.ones(4, dtype=bool), GAP, 0)
    assert joints_alone.push(dict([seldom, part((0, 1), TIME)])) is not None
    assert joints_alone.dropped[OFTEN] == 0  # the seldom one leads: no sample is used twice
    divided = merged.divided(2)
    assert np.array_equal(divided.stored, merged.velocity[:, 2:])
    assert np.array_equal(divided.position, merged.position[:, :2])
