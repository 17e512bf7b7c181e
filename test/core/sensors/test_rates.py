"""Velocities taken from positions: right, as noisy as they say, and good enough to identify a body with."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.rates import fit, with_rates
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion, observe, windows


@cache
def motion(robot: str, seconds: float) -> Truth:
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
    values, slopes = fit(time).smooth(signal)
    assert values == pytest.approx(signal)
    assert slopes[:, 0] == pytest.approx(np.polyval(np.polyder(coefficients), time - 3.0), rel=1e-6)


def test_rates_of_an_exact_motion_are_those_of_the_truth() -> None:
    exact = observe(motion('servicer7', 20.0)[:100], MID)
    for window in windows(exact):
        assert stripped(window).missing_rates == (True, True)
        derived = with_rates(stripped(window))
        for name in ('joint_velocity', 'base_linear_velocity', 'base_angular_velocity'):
            # Within the truncation of the fourth degree, a hundredth of the noise of a velocity sensor.
            assert getattr(derived, name) == pytest.approx(getattr(window, name), abs=2e-6), name


def test_measured_rates_are_left_alone() -> None:
    window = windows(observe(motion('servicer7', 20.0)[:100], MID, 1))[0]
    assert with_rates(window) is window
    half = replace(window, joint_velocity=window.joint_velocity.copy())
    half.joint_velocity[7, 2] = np.nan
    derived = with_rates(half)
    others = [0, 1, 3, 4, 5, 6]
    assert np.array_equal(derived.joint_velocity[:, others], window.joint_velocity[:, others])
    assert np.all(np.isnan(derived.joint_rate_gain[:, others]))
    assert np.all(derived.joint_rate_gain[:, 2] > 0.0)
    assert np.array_equal(derived.base_linear_velocity, window.base_linear_velocity)
