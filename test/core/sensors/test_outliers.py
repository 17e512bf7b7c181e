"""Single poses that are off, and poses that are repeated."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest

from mbaid_ros.core.geometry import Flags, exp
from mbaid_ros.core.samples import BaseStream, Stamps
from mbaid_ros.core.sensors.outliers import OUTLIER, REPEATED_POSE, Outliers, Repeats
from measured import base_stream, piece

GAP = 100_000_000  # ns
POSITION, ORIENTATION = 1e-3, 1e-4  # m, rad: noise


def noisy(count: int, seed: int, understated: float = 1.0) -> BaseStream:
    """Return poses with noise, of which less is declared."""
    rng = np.random.default_rng(seed)
    base = base_stream(1_700_000_000_000_000_000 + np.round(1e7 * np.arange(count)).astype(np.int64))
    declared = np.diag(np.repeat([POSITION, ORIENTATION], 3) / understated) ** 2
    return replace(
        base,
        position=base.position + POSITION * rng.normal(size=(count, 3)),
        rotation=exp(ORIENTATION * rng.normal(size=(count, 3))) @ base.rotation,
        pose_covariance=np.repeat(declared[None], count, axis=0),
    )


def thrown(base: BaseStream, hit: Flags, seed: int, length: float = 0.2, angle: float = 0.087) -> BaseStream:
    """Return poses of which some are off by a length (m) and an angle (rad)."""
    way = np.random.default_rng([seed, 1]).normal(size=(len(hit), 2, 3))
    way *= hit[:, None, None] / np.linalg.norm(way, axis=2, keepdims=True)
    return replace(base, position=base.position + length * way[:, 0], rotation=exp(angle * way[:, 1]) @ base.rotation)


def passed(base: BaseStream, cuts: list[int] | None = None) -> tuple[Stamps, int]:
    """Return the stamps of what passes, handed over in pieces, and how many are dropped."""
    outliers = Outliers(GAP)
    parts = [
        outliers.push(piece(base, begin, end)) for begin, end in pairwise([0, *sorted(cuts or []), len(base.stamp)])
    ]
    return np.concatenate([part.stamp for part in parts if part is not None]), outliers.dropped[OUTLIER]


def hits(share: float, count: int, seed: int) -> Flags:
    """Return which poses are hit; none of the first and last few, of which less is known."""
    hit = np.random.default_rng([seed, 2]).random(count) < share
    hit[:8] = hit[-5:] = False
    return np.asarray(hit)


@pytest.mark.parametrize('understated', [1.0, 10.0])
@pytest.mark.parametrize('share', [0.01, 0.05])
def test_all_outliers_go_and_nothing_else(share: float, understated: float) -> None:
    for seed in range(4):
        hit = hits(share, 3000, seed)
        base = thrown(noisy(3000, seed, understated=understated), hit, seed)
        stamps, dropped = passed(base)
        np.testing.assert_array_equal(stamps, base.stamp[~hit])
        assert dropped == np.sum(hit)


@pytest.mark.parametrize('place', [2, 3, 7])
def test_the_first_poses_may_be_outliers(place: int) -> None:
    for seed in range(8):
        hit = np.arange(100) == place
        base = thrown(noisy(100, seed), hit, seed)
        np.testing.assert_array_equal(passed(base)[0], base.stamp[~hit])


@pytest.mark.parametrize(('length', 'angle'), [(0.2, 0.0), (0.0, 0.087)])
def test_a_pose_that_is_off_in_one_part_is_an_outlier(length: float, angle: float) -> None:
    hit = hits(0.01, 2000, 1)
    base = thrown(noisy(2000, 1), hit, 1, length, angle)
    np.testing.assert_array_equal(passed(base)[0], base.stamp[~hit])


@pytest.mark.parametrize('understated', [0.3, 1.0, 3.0, 10.0])
def test_noise_alone_is_no_outlier(understated: float) -> None:
    assert not sum(passed(noisy(3000, seed, understated=understated))[1] for seed in range(5))


@pytest.mark.parametrize('jump', [0.01, 0.2, 3.0])
def test_a_jump_that_stays_is_none(jump: float) -> None:
    base = noisy(400, 3)
    base.position[200:] += jump
    assert passed(base)[1] == 0


def test_a_sudden_change_of_the_velocity_is_none() -> None:
    base = noisy(400, 4)
    later = np.maximum(np.arange(400) - 200, 0)[:, None]
    base = replace(
        base, position=base.position + 0.01 * later, rotation=exp(0.002 * later * np.ones(3)) @ base.rotation
    )
    assert passed(base)[1] == 0


def test_a_motion_without_noise_that_begins_and_ends_has_none() -> None:
    time = 0.01 * np.arange(600)
    way = np.clip(time - 1.0, 0.0, 2.0)
    base = noisy(600, 0, understated=1e9)
    moving = replace(
        base,
        position=0.02 * (way - np.sin(np.pi * way) / np.pi)[:, None] * np.ones(3),
        rotation=exp(0.1 * (way - np.sin(np.pi * way) / np.pi)[:, None] * np.ones(3)),
    )
    assert passed(moving)[1] == 0


SECOND = 1_000_000_000


def told_again(plateaus: list[int], step: int = 10_000_000) -> tuple[BaseStream, Stamps]:
    """Return odometry of which each pose comes so many times, every step (ns), and where each comes first."""
    source = np.repeat(np.cumsum([0, *plateaus[:-1]]), plateaus)
    stamps = 1_700_000_000 * SECOND + step * np.arange(len(source))
    moving = base_stream(stamps)
    held = {item.name: getattr(moving, item.name)[source] for item in fields(BaseStream) if item.name != 'stamp'}
    return BaseStream(stamp=stamps, **held), np.unique(source)


def without_repeats(base: BaseStream, cuts: list[int]) -> tuple[Stamps, int]:
    """Return the stamps of what passes, handed over in pieces, and how many are dropped."""
    repeats = Repeats()
    ends = [0, *sorted(cuts), len(base.stamp)]
    parts = [repeats.push(piece(base, begin, end)) for begin, end in pairwise(ends)]
    stamps = [part.stamp for part in parts if part is not None]
    return np.concatenate([np.zeros(0, dtype=np.int64), *stamps]), repeats.dropped[REPEATED_POSE]


def test_a_base_that_stands_still_goes_on() -> None:
    base, _ = told_again([5, 101, 3])
    stamps, dropped = without_repeats(base, [])
    # The one of five and the one of three, and the second at rest from its begin on.
    np.testing.assert_array_equal(stamps, base.stamp[[0, *range(5, 107)]])
    assert dropped == 4  # the last two are not known yet to be repeated or at rest
