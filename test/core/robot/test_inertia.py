"""The ten parameters of a body in their two forms, against clouds of point masses."""

from __future__ import annotations

import numpy as np
import pytest

from derivatives import central_difference
from mbaid_ros.core.geometry import Array, skew, unvec, vec
from mbaid_ros.core.robot.momentum import (
    physical,
    physical_jacobian,
    pseudo_inertia,
    standard,
)

SEEDS = range(5)


def cloud(seed: int, points: int = 12) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0.2, 5.0, points), rng.normal(size=(points, 3)) + rng.normal(size=3)


def about(masses: Array, points: Array, centre: Array) -> Array:
    """Return the six elements of inertia of point masses about a centre: sum m (r.r 1 - r r^T)."""
    lever = skew(points - centre)
    return vec(-np.einsum('k,kij->ij', masses, lever @ lever))


def random_body(seed: int) -> Array:
    """Return standard parameters (m, h, I_o) of a cloud of point masses."""
    masses, points = cloud(seed)
    return np.concatenate(([masses.sum()], masses @ points, about(masses, points, np.zeros(3))))


@pytest.mark.parametrize('seed', SEEDS)
def test_the_physical_form_is_about_the_centre_of_mass(seed: int) -> None:
    masses, points = cloud(seed)
    centre = masses @ points / masses.sum()
    expected = np.concatenate(([masses.sum()], centre, about(masses, points, centre)))
    assert physical(random_body(seed)) == pytest.approx(expected, rel=1e-12)
    assert standard(expected) == pytest.approx(random_body(seed), rel=1e-12)


def test_both_forms_take_batches() -> None:
    bodies = np.array([random_body(seed) for seed in SEEDS])
    assert np.array_equal(physical(bodies), [physical(body) for body in bodies])
    assert standard(physical(bodies)) == pytest.approx(bodies, rel=1e-12)


def test_a_body_without_mass_has_no_centre() -> None:
    body = random_body(0)
    body[0] = 0.0
    assert physical(body)[0] == 0.0
    assert np.isnan(physical(body)[1:]).all()


@pytest.mark.parametrize('seed', SEEDS)
def test_the_jacobian_is_the_derivative(seed: int) -> None:
    body = random_body(seed)
    assert physical_jacobian(body) == pytest.approx(central_difference(physical, body, 1e-5), rel=1e-7, abs=1e-8)


@pytest.mark.parametrize('seed', SEEDS)
def test_the_pseudo_inertia_is_the_second_moment_of_the_mass(seed: int) -> None:
    masses, points = cloud(seed)
    homogeneous = np.concatenate((points, np.ones((len(points), 1))), axis=1)
    expected = np.einsum('k,ki,kj->ij', masses, homogeneous, homogeneous)
    assert pseudo_inertia(random_body(seed)) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_the_pseudo_inertia_is_positive_exactly_within_the_triangle_inequality() -> None:
    def smallest(moments: tuple[float, float, float]) -> float:
        inertia = vec(np.diag(moments))
        return float(np.linalg.eigvalsh(pseudo_inertia(np.concatenate(([2.0, 0.0, 0.0, 0.0], inertia))))[0])

    assert smallest((1.0, 2.0, 2.9)) > 0.0
    assert smallest((1.0, 2.0, 3.0)) == pytest.approx(0.0, abs=1e-15)
    # The inertia alone is positive definite still, but no body has it.
    assert np.linalg.eigvalsh(unvec(np.array([1.0, 0.0, 0.0, 2.0, 0.0, 3.1])))[0] > 0.0
    assert smallest((1.0, 2.0, 3.1)) < 0.0
