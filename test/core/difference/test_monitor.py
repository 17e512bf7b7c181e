"""The tests for disturbances where there is next to nothing to test."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.difference.monitor import Nuisance, inverse, jumps


def test_what_is_left_by_rounding_alone_is_nothing() -> None:
    # What a run left of the momentum before its first window, whose every change the momentum itself explains.
    whole = np.diag([498.0, 349.0, 255.0, 1555.0, 2874.0, 2426.0])
    left = np.diag([0.0, 1.3e-11, 3.9e-12, 1.0e-11, -2.3e-10, 1.7e-11])
    left[0, 1:] = left[1:, 0] = 1e-11
    assert np.array_equal(inverse(left, whole), np.zeros((6, 6)))


def test_an_inverse_whose_directions_are_partly_open() -> None:
    rng = np.random.default_rng(0)
    factor, size = rng.normal(size=(5, 3)), np.array([1e-4, 1.0, 1e3, 1e-2, 10.0])
    information = (factor @ factor.T) * size * size[:, None]
    inverted = inverse(information)
    assert information @ inverted @ information == pytest.approx(information, rel=1e-6, abs=1e-9)


def test_a_momentum_that_jumps_before_the_first_window_explains_nothing() -> None:
    rng = np.random.default_rng(1)
    momentum = slice(10, 16)
    for exponent in range(-8, 9):
        rows = rng.normal(size=(30, 6, 16)) * 10.0 ** rng.uniform(-3.0, 3.0, 16) * 10.0**exponent
        residual = rng.normal(size=(30, 6))
        information = np.einsum('kri,krj->ij', rows, rows)
        # At the solution: the gradient vanishes.
        residual -= np.einsum(
            'kri,i->kr', rows, np.linalg.lstsq(rows.reshape(-1, 16), residual.reshape(-1), rcond=None)[0]
        )
        gradient = np.einsum('kri,kr->i', rows, residual)
        nuisance = Nuisance.of(information, gradient, np.zeros((16, 0)), np.zeros(0))
        bordered = np.concatenate((rows, residual[..., None]), axis=2)
        falls = jumps(bordered, np.zeros(16), momentum, np.zeros(0, dtype=int), nuisance)
        assert falls[0] == 0.0
        assert np.all(np.isfinite(falls))
        assert 1.0 < np.mean(falls[1:]) < 12.0  # chi-square of six
