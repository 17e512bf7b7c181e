"""Ratios of moments of inertia: as their derivatives say, and free of the scale."""

from __future__ import annotations

import numpy as np
import pytest

from derivatives import central_difference
from mbaid_ros.core.geometry import Array, unvec
from mbaid_ros.core.results.physical_consistency import inertia_ratios

BODY = np.array([0.28, 1e-3, -2e-3, 3e-3, 2.2e-4, 1e-5, -2e-5, 3.1e-4, 1.5e-5, 4e-4])


def test_standard_deviations_are_those_of_the_derivatives() -> None:
    rng = np.random.default_rng(0)
    root = 1e-6 * rng.normal(size=(10, 10))
    covariance = root @ root.T
    found = inertia_ratios(BODY, covariance)

    def elements(body: Array) -> Array:
        return np.asarray(body[4:] / np.trace(unvec(body[4:])))

    def principal(body: Array) -> Array:
        return np.asarray(np.linalg.eigvalsh(unvec(elements(body))))

    for values, stds, function in (
        (found.elements, found.std, elements),
        (found.principal, found.principal_std, principal),
    ):
        slope = central_difference(function, BODY, np.maximum(1e-4 * np.abs(BODY), 1e-9))
        assert values == pytest.approx(function(BODY))
        assert stds == pytest.approx(np.sqrt(np.diag(slope @ covariance @ slope.T)), rel=1e-4)


def test_a_common_factor_is_none_of_them() -> None:
    direction = np.concatenate((np.zeros(4), BODY[4:]))
    known, open_ = np.diag((1e-4 * BODY) ** 2), 0.04 * np.outer(direction, direction)
    found = inertia_ratios(BODY, known + open_)
    assert found.scale_std == pytest.approx(0.2, rel=1e-3)
    assert found.std == pytest.approx(inertia_ratios(BODY, known).std)
    assert found.clearer
    assert not inertia_ratios(BODY, known).clearer


def test_moments_that_are_alike_have_ratios() -> None:
    ball = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    found = inertia_ratios(ball, 1e-6 * np.eye(10))
    assert found.principal == pytest.approx(np.full(3, 1.0 / 3.0))
    assert np.isfinite(found.principal_std).all()
