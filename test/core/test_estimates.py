"""What unknowns make of their own estimates: causes of a contradiction, and how a search takes them first."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.clocks import time_offset
from mbaid_ros.core.contracts import Unknown
from mbaid_ros.core.orbit import Orbit, OrbitConfig, gradient_numbers, gravity, make_orbit
from mbaid_ros.core.passive import spring_errors, starting_swing, swing_noise
from mbaid_ros.parameters import build

RATE = 1.1e-3  # rad/s


def test_a_gradient_far_from_zero_is_an_undeclared_orbit() -> None:
    unknown = gravity(RATE)
    mean = np.zeros(unknown.count)
    mean[0], covariance = 1.0, 0.1**2 * np.eye(unknown.count)
    found = unknown.finding(mean, covariance)
    assert found is not None
    assert found.gain == pytest.approx(50.0)
    assert 'orbit' in found.text
    assert unknown.finding(mean, np.eye(unknown.count)) is None  # as large by noise


@pytest.mark.parametrize('seed', range(5))
def test_an_orbit_in_axes_that_do_not_turn_is_declared_as_it_is_found(seed: int) -> None:
    rng, unknown = np.random.default_rng(seed), gravity(RATE)
    normal = rng.normal(size=3)
    true = Orbit.inertial(0.8 * RATE, np.cross(normal, rng.normal(size=3)), normal)
    # The rate of change is known thirty times worse, as after a minute of 0.07 rad.
    spread = np.diag([0.05] * 5 + [1.5] * 5)
    covariance = np.linalg.inv(np.linalg.inv(spread**2) + np.eye(10))
    read = np.linalg.solve(unknown.factor, gradient_numbers(true)) + spread @ rng.normal(size=10)
    found = unknown.finding(covariance @ np.linalg.solve(spread**2, read), covariance)
    assert found is not None
    assert found.repair is not None
    settings = found.repair.parameters
    assert settings is not None
    config = build(OrbitConfig, {name.removeprefix('orbit.'): value for name, value in settings.items()})
    orbit = make_orbit(config)
    assert orbit is not None
    error = np.linalg.solve(unknown.factor, gradient_numbers(orbit) - gradient_numbers(true))
    assert np.all(np.abs(error[:5]) < 3.5 * 0.05)
    assert np.linalg.norm(error[:5]) > 0.0


def test_a_gradient_that_is_none_of_an_orbit_may_be_a_frame_that_turns() -> None:
    unknown, mean = gravity(RATE), np.zeros(10)
    mean[3] = 1.0  # diag(1, -1, 0): in an orbit two of three would be alike
    found = unknown.finding(mean, 0.05**2 * np.eye(10))
    assert found is not None
    assert found.repair is not None
    assert list(found.repair.parameters or ()) == ['odometry.turning_std']


def test_no_other_estimate_contradicts_the_model_by_itself() -> None:
    unknown = time_offset(0.01)
    assert unknown.finding(np.full(unknown.count, 1e3), np.eye(unknown.count)) is None


def held(unknowns: tuple[Unknown, ...]) -> list[bool]:
    """Return of each unknown of springs whether windows are linearised at its declaration."""
    return [not each.linearisation_value(np.ones(each.count), np.ones(each.count)).any() for each in unknowns]


def test_a_search_begins_with_springs_as_declared_and_a_loose_swing() -> None:
    unknowns = (
        spring_errors(['panel'], [0.1], [0.01]),
        starting_swing(['panel'], [0.05], [6.0]),
        swing_noise(['panel'], [1e-6], [6.0], [0.01]),
    )
    start, noise = unknowns[1:]
    loosest = tuple(each.eased(1.0, unknowns) for each in unknowns)
    assert held(loosest) == [True, True, True]  # the noise always is
    assert loosest[2].factor == pytest.approx(start.factor)
    later = tuple(each.eased(0.01, unknowns) for each in unknowns)
    assert held(later) == [False, False, True]
    assert later[2].factor == pytest.approx(np.maximum(noise.factor, 0.01 * start.factor))


def test_without_a_swing_at_the_start_nothing_is_eased() -> None:
    unknowns = spring_errors(['panel'], [0.1], [0.01]), time_offset(0.01)
    assert all(each.eased(1.0, unknowns) is each for each in unknowns)
