"""The search for how joints are read, on residuals that are linear in the errors: which numbers are found, and kept."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import permutations, product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import generic, returned
from mbaid_ros.core.diagnosis.readings import (
    _GEARS,
    _ZEROS,
    Meaning,
    _accepted,
    _lengths,
    _rounded,
    _sparse,
    _without,
    as_read,
    combined,
    joint_meaning,
    motion_of,
    placed_bases,
    singles,
    together,
)
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.windows import AFTER, BEFORE
from observed import kernel
from windowed import joint_window

NOISE = 1e-3


class Linear:
    """Readings of n joints that mean something: residuals are linear in what a meaning's zeros and gears are off by."""

    goal, moved = 4.0 * NOISE**2, 1.0

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


@pytest.mark.parametrize('place', range(6))
def test_one_number_is_as_read_and_the_others_stay(place: int) -> None:
    found = _without(meaning([2.0, -3.0, 0.5], [0.1, 0.2, 0.3]), place)
    expected = np.array([0.1, 0.2, 0.3, 2.0, -3.0, 0.5])
    expected[place] = np.array([0.0, 0.0, 0.0, 1.0, -1.0, 1.0])[place]
    assert np.concatenate((found.zeros, found.gains)).tolist() == expected.tolist()


def test_windows_are_taken_evenly_with_the_noise_of_their_mean_rates() -> None:
    rng, knots = np.random.default_rng(2), BEFORE + 10 + AFTER
    pose = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])  # angular first
    windows = [joint_window(np.full((knots, 1), float(place)), 0.5 * place) for place in range(30)]
    windows = [replace(each, noise=replace(each.noise, pose=np.diag(pose), samples=80)) for each in windows]
    found = motion_of(kernel('servicer7'), windows, 4)
    assert found.joints[:, 0] == pytest.approx([0.0, 10.0, 19.0, 29.0])
    assert len(motion_of(kernel('servicer7'), windows, 40).joints) == 30
    # From one mean of eight samples to another one, ten knots of 0.05 s later.
    ends = rng.normal(size=(100_000, 2, 8)).mean(axis=2)
    assert found.noise == pytest.approx(np.roll(pose, 3) * np.var(np.diff(ends, axis=1) / 0.5), rel=0.03)


def test_a_turn_counts_by_the_radius_of_gyration() -> None:
    assert _lengths(np.linalg.inv(np.diag([4.0] * 3 + [9.0, 1.0, 2.0]))[None]) == pytest.approx([1.5])


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
    every: Any = Linear(meaning(gains, [0.5, 0.0, 0.0, 0.0]))  # all of the motion means something else
    every.goal = -1.0
    assert returned(_accepted(motion, every, [(5.0, start)], 8)) is None
    # With zeros alone free, gears are not found.
    assert returned(_accepted(motion, motion, [(5.0, start._replace(gains=np.ones(4)))], 4)) is None


def test_gears_are_rounded_to_such_as_people_build_and_zeros_to_half_a_turn() -> None:
    zeros = [3.5, -3.5, 0.1, 6.3, -6.3]
    found = _rounded(meaning([1.99, -0.505, 1.05, -57.0, 1.01], zeros))
    assert found.gains == pytest.approx([2.0, -0.5, 1.05, -np.rad2deg(1.0), 1.0])
    assert found.zeros == pytest.approx(
        np.array([3.5, -3.5, 0.1, 6.3, -6.3]) + 2.0 * np.pi * np.array([-1, 1, 0, -1, 1])
    )


def test_two_meanings_together_are_the_one_after_the_other() -> None:
    reading = generic(1, 4)
    first = Meaning(np.array([2, 0, 3, 1]), *generic(2, 2, 4), np.zeros(3), np.zeros(3), 1.0)
    second = Meaning(np.array([1, 3, 0, 2]), *generic(3, 2, 4), np.zeros(3), np.zeros(3), 1.0)
    assert read_by(together(first, second), reading) == pytest.approx(read_by(second, read_by(first, reading)))


def test_one_joint_may_be_exchanged_reversed_geared_or_off() -> None:
    reading = generic(4, 3)
    expected = [reading[list(order)] for order in ((1, 0, 2), (2, 1, 0), (0, 2, 1))]
    for joint, value in enumerate(reading):
        others = -value, *(value + _ZEROS), *(np.array(_GEARS) * value)
        expected += [np.where(np.arange(3) == joint, other, reading) for other in others]
    found, expected_rows = (
        np.array(sorted(np.round(each, 9).tolist() for each in rows))
        for rows in ([read_by(each, reading) for each in singles(3)], expected)
    )
    assert found == pytest.approx(expected_rows)


def test_several_joints_may_be_wrong_at_once() -> None:
    reading = generic(4, 3)
    found = {tuple(np.round(read_by(each, reading), 9)) for each in combined(3)}
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        assert tuple(np.round(reading[list(order)] * signs, 9)) in found
    one = [*singles(3)]
    assert all(
        tuple(np.round(read_by(together(*each), reading), 9)) in found for each in zip(one, one[9:], strict=False)
    )
    # Of many joints only exchanges and signs are combined, and rows with one more.
    assert all(np.all(np.abs(each.gains) > 0.0) for each in combined(8))
    assert sum(1 for _ in combined(8)) == 36 * 35 // 2 + 16 * (28 + 8 * (1 + len(_ZEROS) + len(_GEARS)))


@pytest.mark.parametrize(('joints', 'read', 'count'), [(0, 0, 30), (2, 1, 30), (2, 2, 11)])
def test_nothing_is_looked_for_in_few_windows_or_joints(joints: int, read: int, count: int) -> None:
    without: Any = SimpleNamespace(model=SimpleNamespace(joints=joints, independent_joints=('j',) * read))
    windows: Any = [None] * count
    assert returned(joint_meaning(without, windows)) is None
    if read == joints:
        assert returned(placed_bases(without, windows, None)) == []
