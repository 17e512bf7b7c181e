"""The search for how joints are read, on residuals that are linear in the errors: which numbers are found, and kept."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import permutations, product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import generic, returned, some
from mbaid_ros.core.diagnosis import readings
from mbaid_ros.core.diagnosis.readings import (
    _GEARS,
    _ZEROS,
    Meaning,
    Motion,
    _accepted,
    _sparse,
    as_read,
    combined,
    joint_meaning,
    joints_by_another_clock,
    mapping_text,
    placed_bases,
    scaled_positions,
    singles,
    together,
)
from mbaid_ros.core.geometry import Array, exp
from observed import kernel

NOISE = 1e-3


class Linear:
    """Readings of n joints that mean something: residuals are linear in what a meaning's zeros and gears are off by."""

    goal, moved = 4.0 * NOISE**2, 1.0
    misfits = Motion.misfits

    def __init__(self, meant: Meaning, unseen: int | None = None) -> None:
        self._meant, joints = meant, len(meant.zeros)
        rng = np.random.default_rng(joints)
        self._slope, self._noise = rng.normal(size=(60, 2 * joints)), NOISE * rng.normal(size=60)
        if unseen is not None:
            self._slope[:, unseen] *= 1e-4

    def residuals(self, meanings: Iterable[Meaning], unit: float | None = None) -> Array:
        """Return those of each meaning: those with other columns or signs have large ones."""
        del unit
        return np.array([self._noise + self._slope @ self._off(each) + self._other(each) for each in meanings])

    def _off(self, meaning: Meaning) -> Array:
        gears = np.log(np.abs(meaning.gains)) - np.log(np.abs(self._meant.gains))
        return np.concatenate((meaning.zeros - self._meant.zeros, gears))

    def _other(self, meaning: Meaning) -> float:
        signs = np.array_equal(np.sign(meaning.gains), np.sign(self._meant.gains))
        return 0.0 if signs and np.array_equal(meaning.columns, self._meant.columns) else 10.0


def meaning(gains: Sequence[float], zeros: Sequence[float]) -> Meaning:
    return as_read(len(zeros))._replace(gains=np.array(gains, dtype=float), zeros=np.array(zeros, dtype=float))


def read_by(meant: Meaning, reading: Array) -> Array:
    """Return the joints' motion as a reading (n,) means it."""
    return np.asarray(meant.gains * reading[meant.columns] + meant.zeros)


def test_few_zeros_and_gears_are_left() -> None:
    """A zero of a tenth of a degree is dropped, as is what hardly shows; a gear is not looked for where none is."""
    meant = meaning([2.0, 1.0, 1.0, -1.0], [0.4, 0.002, 0.0, -0.6])
    motion: Any = Linear(meant, unseen=2)
    misfit, found = returned(_sparse(motion, meaning([1.8, 1.0, 1.0, -1.0], [0.3, 0.1, 0.7, -0.5])))
    assert found.zeros[[1, 2]].tolist() == [0.0, 0.0]
    assert found.zeros[[0, 3]] == pytest.approx([0.4, -0.6], abs=2e-3)
    assert found.gains == pytest.approx([2.0, 1.0, 1.0, -1.0], abs=5e-3)
    assert found.gains[1:].tolist() == [1.0, 1.0, -1.0]
    assert misfit < 10.0 * NOISE**2


@pytest.mark.parametrize(
    ('gains', 'named'),
    [
        ([2.0, 3.0, 0.5, 1.0], True),
        ([2.0, 3.0, 0.5, 1.5], False),
        ([3.9, 1.0, 1.0, 1.0], True),
        ([4.1, 1.0, 1.0, 1.0], False),
        ([1.0, 0.26, 1.0, 1.0], True),
        ([1.0, 0.24, 1.0, 1.0], False),
    ],
)
def test_a_meaning_has_few_gears_and_none_is_far_from_one(gains: list[float], named: bool) -> None:
    motion: Any = Linear(meaning(gains, [0.0] * 4))
    start = meaning([1.02 * each if each != 1.0 else 1.0 for each in gains], [0.1] * 4)
    other = start._replace(columns=np.array([1, 0, 2, 3]))  # another one, which explains nothing
    found = returned(_accepted(motion, motion, [(9.0, other), (5.0, start)], 8))
    assert (found is not None) is named
    assert found is None or found.gains == pytest.approx(gains, rel=5e-3)


def test_two_meanings_together_are_the_one_after_the_other() -> None:
    reading = generic(1, 4)
    first = meaning(*generic(2, 2, 4).tolist())._replace(columns=np.array([2, 0, 3, 1]))
    second = meaning(*generic(3, 2, 4).tolist())._replace(columns=np.array([1, 3, 0, 2]))
    assert read_by(together(first, second), reading) == pytest.approx(read_by(second, read_by(first, reading)))


def test_one_joint_may_be_exchanged_reversed_geared_or_off() -> None:
    reading = generic(4, 3)
    expected = [reading[list(order)] for order in ((1, 0, 2), (2, 1, 0), (0, 2, 1))]
    for joint, value in enumerate(reading):
        others = -value, *(value + _ZEROS), *(np.array(_GEARS) * value)
        expected += [np.where(np.arange(3) == joint, other, reading) for other in others]
    found = [read_by(each, reading) for each in singles(3)]
    assert {tuple(np.round(each, 9)) for each in found} == {tuple(np.round(each, 9)) for each in expected}
    assert len(found) == len(expected)


def test_several_joints_may_be_wrong_at_once() -> None:
    reading = generic(4, 3)
    found = {tuple(np.round(read_by(each, reading), 9)) for each in combined(3)}
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        assert tuple(np.round(reading[list(order)] * signs, 9)) in found
    one = [*singles(3)]
    assert all(
        tuple(np.round(read_by(together(*each), reading), 9)) in found for each in zip(one, one[9:], strict=False)
    )
    assert sum(1 for _ in combined(8)) == 36 * 35 // 2 + 16 * (28 + 8 * (1 + len(_ZEROS) + len(_GEARS)))


@pytest.mark.parametrize(('joints', 'read', 'count'), [(0, 0, 30), (2, 1, 30), (2, 2, 11)])
def test_nothing_is_looked_for_in_few_windows_or_joints(joints: int, read: int, count: int) -> None:
    without: Any = SimpleNamespace(model=SimpleNamespace(joints=joints, independent_joints=('j',) * read))
    windows: Any = [None] * count
    assert returned(joint_meaning(without, windows)) is None
    if read == joints:
        assert returned(placed_bases(without, windows, None)) == []
        assert returned(scaled_positions(without, windows)) == []


NAMES = [f'j{number}' for number in range(1, 6)]


def mapped(columns: Sequence[int] = range(5), gains: dict[int, float] | None = None, **zeros: float) -> str:
    """Return what is said of five joints with other columns, gains by index, and zeros by name (rad)."""
    meant = meaning([(gains or {}).get(place, 1.0) for place in range(5)], [zeros.get(name, 0.0) for name in NAMES])
    return mapping_text(NAMES, meant._replace(columns=np.array(columns)))


@pytest.mark.parametrize(
    ('meant', 'text'),
    [
        ({'j2': 0.5}, 'the zero is off, of j2 by -28.6 degrees: publish j2 = j2 + 0.5000'),
        (
            {'j2': 0.5, 'j5': -0.1},
            'the zeros are off, of j2 by -28.6 degrees, j5 by +5.7 degrees: publish j2 = j2 + 0.5000; j5 = j5 - 0.1000',
        ),
        ({'gains': {0: -1.0}}, 'the sign of j1 is wrong: publish j1 = -j1'),
        ({'gains': {0: -1.0, 3: -1.0}}, 'the signs of j1, j4 are wrong: publish j1 = -j1; j4 = -j4'),
        ({'gains': {2: -0.25}}, 'the sign of j3 is wrong, j3 reads 4 times its motion: publish j3 = -0.25 j3'),
        ({'columns': [0, 3, 2, 1, 4]}, 'j2 and j4 are swapped: publish j2 = j4; j4 = j2'),
        (
            {'columns': [1, 0, 2, 4, 3]},
            'j1 and j2 and j4 and j5 are swapped: publish j1 = j2; j2 = j1; j4 = j5; j5 = j4',
        ),
        (
            {'columns': [1, 2, 0, 3, 4]},
            'the readings of j1, j2, j3 stand under the wrong names: publish j1 = j2; j2 = j3; j3 = j1',
        ),
    ],
)
def test_a_meaning_is_said_with_the_mapping_to_publish(meant: dict[str, Any], text: str) -> None:
    assert mapped(**meant) == text


@pytest.mark.parametrize(
    ('columns', 'text'),
    [
        ([4, 0, 1, 2, 3], 'moved by 1'),
        ([1, 2, 3, 4, 0], 'moved by 1'),
        ([2, 3, 4, 0, 1], 'moved by 2'),
        ([3, 4, 0, 1, 2], 'moved by 2'),
        ([4, 3, 2, 1, 0], 'in reversed order'),
    ],
)
def test_names_that_are_moved_or_reversed_together_are_said_once(columns: list[int], text: str) -> None:
    assert mapped(columns).startswith(f'the joint readings stand under the wrong names, {text}: publish')


class Clocked:
    """A motion whose residuals grow with how far the rate of the joints' clock is from the true one."""

    def __init__(self, rate: float, true: float) -> None:
        self._rate, self._true = rate, true

    def residuals(self, _: object) -> Array:
        """Return them, of one meaning."""
        return np.array([[self._rate - self._true, 0.0]])


@pytest.mark.parametrize(
    ('true', 'length', 'found'),
    [
        (1.08, 20.0, 1.08),
        (0.91, 20.0, 0.91),
        (1.4, 20.0, 1.275),  # a quarter at most, and as much again as the last step
        (1.4, 100.0, 1.155),  # thirty steps at most, each of half a second at the end
        (1.02, 20.0, None),  # less than half a second at the end
        (1.03, 20.0, 1.03),
        (0.98, 20.0, None),
        (1.006, 100.0, 1.006),
        (1.004, 100.0, None),
    ],
)
def test_the_rate_of_another_clock_is_looked_for_as_far_as_a_run_is_long(
    true: float, length: float, found: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    last = SimpleNamespace(start=length - 0.5, length=0.5)
    tried: list[float] = []

    def restamped(windows: Any, rate: float) -> Any:
        tried.append(rate)
        return [rate] * (
            len(windows) if rate <= true + 0.06 else 11
        )  # where too few windows are left there is no motion

    monkeypatch.setattr(readings, 'restamped', restamped)
    monkeypatch.setattr(readings, 'motion_of', lambda _, windows, __: Clocked(windows[0], true))
    robot: Any = SimpleNamespace(model=SimpleNamespace(joints=3))
    windows: Any = [None] * 19 + [last]
    conventions = returned(joints_by_another_clock(robot, windows))
    assert len(conventions) == (found is not None)
    for each in conventions:
        assert some(some(each.repair).conversion).clock == pytest.approx(found, abs=1e-3)
        assert f'run {some(some(each.repair).conversion).clock:.3g} times as fast' in each.text
    assert returned(joints_by_another_clock(robot, windows[:11])) == []


@pytest.mark.parametrize(
    ('gains', 'zeros', 'searched', 'found'),
    [
        ([1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0], False, False),
        ([1.0, 1.0, 1.0, 1.0], [0.0, 0.6, 0.0, -0.4], False, True),
        ([1.0, 2.0, 1.0, 1.0], [0.0, 0.6, 0.0, 0.0], False, True),
        ([-1.0, 1.0, 1.0, 1.0], [0.0, 0.6, 0.0, 0.0], False, True),
        ([-1.0, -1.0, 1.0, 1.0], [0.0, 0.6, 0.0, 0.0], True, True),
        ([-2.0, -1.0, 1.0, 1.0], [0.0, 0.6, 0.0, 0.0], True, True),
        ([5.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0], True, False),  # no gear
    ],
)
def test_several_errors_are_combined_where_no_single_one_explains_the_readings(
    gains: list[float], zeros: list[float], searched: bool, found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion: Any = Linear(meaning(gains, zeros))
    asked: list[int] = []

    def several(joints: int) -> Iterable[Meaning]:
        asked.append(joints)
        return [meaning(signs, [0.0] * joints) for signs in product((1.0, -1.0), repeat=joints)]

    monkeypatch.setattr(readings, 'motion_of', lambda *_: motion)
    monkeypatch.setattr(readings, 'combined', several)
    monkeypatch.setattr(readings, '_REFINED', 4)
    monkeypatch.setattr(readings, '_WITH_GEARS', 2)
    robot: Any = SimpleNamespace(model=SimpleNamespace(joints=4, independent_joints=range(4)))
    windows: Any = [None] * 20
    result = returned(joint_meaning(robot, windows))
    assert bool(asked) is searched
    assert (result is not None) is found
    if result is not None:
        assert result.gains == pytest.approx(gains, rel=0.02)
        assert result.zeros == pytest.approx(zeros, abs=0.02)


def test_small_errors_of_continuous_numbers_are_no_reason_to_combine_discrete_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    motion: Any = Linear(meaning([-1.0, -1.0, 1.0, 1.0], [0.0] * 4))
    motion.moved = 1e9  # beside which all that is left is little
    monkeypatch.setattr(readings, 'motion_of', lambda *_: motion)
    monkeypatch.setattr(readings, 'combined', lambda _: pytest.fail('combined'))
    robot: Any = SimpleNamespace(model=SimpleNamespace(joints=4, independent_joints=range(4)))
    windows: Any = [None] * 20
    assert returned(joint_meaning(robot, windows)) is None


def test_body_momentum_and_known_thrust_together_explain_the_motion() -> None:
    """A momentum about the origin that thrust changes, in windows at random places: twists follow from it."""
    robot, count, rng = kernel('servicer7'), 12, np.random.default_rng(0)
    joints, rates, stored = (rng.normal(size=(count, size)) for size in (robot.model.joints, robot.model.joints, 0))
    rotation, position, impulse = exp(rng.normal(size=(count, 3))), rng.normal(size=(count, 3)), generic(1, count, 6)
    total = generic(2, 6) + impulse
    about_base = np.concatenate((total[:, :3], total[:, 3:] - np.cross(position, total[:, :3])), axis=1)

    def momentum(twist: Array) -> Array:
        states = robot.states_of(rotation, joints, rates, np.tile(twist, (count, 1)), stored)
        return np.asarray(states.known_momentum + states.regressor @ robot.target.parameters)

    still = momentum(np.zeros(6))
    inertia = np.stack([momentum(unit) - still for unit in np.eye(6)], axis=2)
    twist = np.linalg.solve(inertia, (about_base - still)[..., None])[..., 0]
    moved = Motion(robot, joints, rates, rotation, position, twist, impulse, stored, np.zeros(6))
    meant = as_read(robot.model.joints)
    assert moved.residuals([meant]) == pytest.approx(0.0, abs=1e-6 * np.abs(twist).max())
    without = replace(moved, impulse=0.0 * impulse).residuals([meant])
    assert np.abs(without).max() > 1e-3 * np.abs(twist).max()
