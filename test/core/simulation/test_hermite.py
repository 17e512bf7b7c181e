"""Interpolation between the steps of an integrator."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.simulation.hermite import HermiteSpline


def sine(step: float) -> HermiteSpline:
    time = step * np.arange(round(2.0 / step) + 1)[:, None]
    return HermiteSpline(step, np.sin(time), np.cos(time), -np.sin(time))


def errors(step: float) -> tuple[float, float]:
    time = np.linspace(0.0, 1.999, 777)
    interval = np.floor(time / step).astype(int)
    value, rate = sine(step).at(interval, time / step - interval)
    return float(np.abs(value[:, 0] - np.sin(time)).max()), float(np.abs(rate[:, 0] - np.cos(time)).max())


def test_a_quintic_is_exact() -> None:
    polynomial = np.polynomial.Polynomial([0.3, -1.0, 0.7, 0.4, -0.2, 0.1])

    def of(times: Array, order: int) -> Array:
        derived = polynomial.deriv(order) if order else polynomial
        values: Array = np.asarray(derived(times), dtype=float)
        return values[:, None]

    ends = np.array([0.0, 0.5, 1.0])
    nodes = HermiteSpline(0.5, of(ends, 0), of(ends, 1), of(ends, 2))
    time = np.array([0.0, 0.1, 0.499, 0.5, 0.8])
    interval = np.array([0, 0, 0, 1, 1])
    value, rate = nodes.at(interval, time / 0.5 - interval)
    assert value == pytest.approx(of(time, 0), abs=1e-15)
    assert rate == pytest.approx(of(time, 1), abs=1e-14)


def test_the_order_is_six_and_that_of_the_rate_five() -> None:
    coarse, fine = errors(0.2), errors(0.1)
    assert np.log2(coarse[0] / fine[0]) == pytest.approx(6.0, abs=0.2)
    assert np.log2(coarse[1] / fine[1]) == pytest.approx(5.0, abs=0.2)
