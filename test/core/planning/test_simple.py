"""Motions that nobody has planned keep the limits of planned ones."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.planning.limits import BaseLimits
from mbaid_ros.planning.unplanned import SIMPLE, simple_motion
from planned import FASTEST, Begun, planner

TURN = np.radians(0.5)


@pytest.mark.parametrize('kind', SIMPLE)
def test_simple_motions_keep_the_limits_and_come_close_to_one(servicer: Begun, kind: str) -> None:
    motions = planner(servicer, duration=14.0).motions
    free, held = (simple_motion(kind, motions, base, 3) for base in (BaseLimits(), BaseLimits(rotation=TURN)))
    times = np.linspace(0.0, 14.0, 1401)
    for trajectory in (free, held):
        position, rate, bend = trajectory.at(times)
        assert trajectory.duration == 14.0
        assert position[0] == pytest.approx(motions.start)
        assert rate[[0, -1]] == pytest.approx(0.0, abs=1e-12)
        assert np.all((position >= motions.limits.lower) & (position <= motions.limits.upper))
        assert np.abs(rate).max() <= FASTEST
        assert np.abs(bend).max() <= 0.1
    use = (np.abs(free.at(times)[1]).max(axis=0) / FASTEST, np.abs(free.at(times)[2]).max(axis=0) / 0.1)
    assert np.all(np.maximum(*use) > 0.95)
    turned = motions.excursion_along(held, motions.floating)[0]
    assert 0.85 * TURN < turned < 1.01 * TURN
    assert motions.excursion_along(free, motions.floating)[0] > turned


@pytest.mark.parametrize('kind', SIMPLE)
def test_simple_motions_may_be_short(servicer: Begun, kind: str) -> None:
    motion = simple_motion(kind, planner(servicer, duration=0.4).motions, BaseLimits(), 0)
    position, rate, _ = motion.at(np.linspace(0.0, 0.4, 101))
    assert np.any(position != position[0])
    assert rate[[0, -1]] == pytest.approx(0.0, abs=1e-12)


def test_the_seed_decides(servicer: Begun) -> None:
    motions = planner(servicer, duration=10.0).motions
    drawn = [simple_motion('trapezoids', motions, BaseLimits(), seed).position for seed in (0, 0, 1)]
    assert np.array_equal(drawn[0], drawn[1])
    assert not np.allclose(drawn[0], drawn[2])
    alone = simple_motion('one_by_one', motions, BaseLimits(), 0).at(np.linspace(0.0, 10.0, 400))[1]
    assert np.all(np.sort(np.abs(alone), axis=1)[:, :-1] < 5e-3)
