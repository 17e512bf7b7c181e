"""Checks of closed windows by tables of motions: a base that is held, and rates against the steps of positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.faults import _path
from mbaid_ros.core.odometry.faults import _is_held, _shares, _weights
from mbaid_ros.core.pipeline import WindowChecks
from mbaid_ros.core.results.verdict import Reason
from mbaid_ros.core.samples import Samples

TIME = 0.5 * np.arange(40.0)
SWAY = np.stack((np.sin(0.5 * TIME), np.cos(0.4 * TIME), np.sin(0.3 * TIME + 1.0)), axis=1)  # of the centre of mass


@pytest.mark.parametrize(
    ('react', 'noise', 'size', 'held'),
    [
        (0.0, 0.0, 0.1, True),
        (0.0, 1e-3, 0.1, True),
        (-1.0, 1e-3, 0.1, False),  # a free base: it moves against the centre of mass
        (-0.1, 1e-4, 0.1, False),  # a heavy one moves little, but against it
        (-0.05, 4e-3, 0.1, False),  # beside noise too
        (0.0, 0.03, 0.1, False),  # too noisy to be sure
        (0.0, 0.0, 5e-4, False),  # nothing moves
    ],
)
def test_a_base_is_held_that_does_not_move_against_the_arm(react: float, noise: float, size: float, held: bool) -> None:
    """Apart from a drift that is even, or changes evenly."""
    rng = np.random.default_rng(0)
    drift = 0.3 * TIME[:, None] * np.array([1.0, -2.0, 0.5]) + 0.01 * TIME[:, None] ** 2
    base = drift + react * size * SWAY + noise * rng.normal(size=(len(TIME), 3))
    assert _is_held(np.column_stack((TIME, base, size * SWAY + 0.2 * TIME[:, None]))) is held


def test_a_base_that_moves_smoothly_by_itself_is_not_held() -> None:
    """Little, and not as the arm: a force acts, whose motion is no noise."""
    base = 0.01 * np.stack((np.sin(1.1 * TIME), np.cos(0.9 * TIME), np.sin(1.3 * TIME)), axis=1)
    assert not _is_held(np.column_stack((TIME, base, 0.1 * SWAY)))


def window(start: float) -> Samples:
    """Return a window of two joints that move."""
    time, nothing, covariance = start + 0.02 * np.arange(25), np.zeros((25, 3)), np.tile(1e-6 * np.eye(6), (25, 1, 1))
    place, turns = np.arange(2) + time[:, None], np.tile(np.eye(3), (25, 1, 1))
    return Samples(time, np.sin(place), np.cos(place), nothing, turns, nothing, nothing, covariance, covariance)


def test_the_path_of_a_rate_is_its_integral() -> None:
    time = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.05, 30))
    rate = np.stack((2.0 + 3.0 * time, -time), axis=1)
    exact = np.stack((2.0 * time + 1.5 * time**2, -0.5 * time**2), axis=1)
    assert _path(time, rate) == pytest.approx(exact - exact[0])


def test_a_rate_is_compared_with_the_step_between_the_thirds_at_either_end() -> None:
    """A step counts as many times as means of the ends contain it."""
    assert _shares(10) == pytest.approx(np.array([1, 2, 3, 3, 3, 3, 3, 2, 1]) / 3.0)
    time = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.05, 10))
    rate = 2.0 + 3.0 * time
    path = 2.0 * time + 1.5 * time**2
    assert _weights(time) @ rate == pytest.approx(np.mean(path[-3:]) - np.mean(path[:3]))


class Counting:
    """A check that finds fault with windows that begin from some time on."""

    def update(self, window: Samples) -> Reason | None:
        """Return the reason."""
        return Reason('late') if window.time[0] > 0.9 else None


def test_each_window_has_the_reasons_until_its_end() -> None:
    checks = WindowChecks([Counting()])
    made = [window(0.5 * place) for place in range(3)]
    kept: list[Array] = [each.joint_velocity for each in checks.with_valid_rates(made)]
    assert all(one is other.joint_velocity for one, other in zip(kept, made, strict=True))
    assert [[reason.text for reason in checks.reasons(float(each.time[-1]))] for each in made] == [[], [], ['late']]
    checks.with_valid_rates(made[:1])
    assert checks.reasons(float(made[2].time[-1])) == []


@pytest.mark.parametrize('part', ['joint_velocity', 'base_linear_velocity', 'base_angular_velocity'])
@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_one_number_that_is_none_is_a_missing_rate(part: str, value: float) -> None:
    whole = window(0.0)
    assert whole.missing_rates == (False, False)
    rates = getattr(whole, part).copy()
    rates[3, 1] = value
    assert replace(whole, **{part: rates}).missing_rates == (part[0] == 'j', part[0] == 'b')
