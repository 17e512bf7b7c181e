"""The projection on real bodies: into the cone, onto the nearest one, and nothing where there is nothing to do."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, exp, unvec, vec
from mbaid_ros.core.results.physical_consistency import is_physical, project, project_planar
from mbaid_ros.core.robot.kinematics import Plane
from mbaid_ros.core.robot.momentum import physical, pseudo_inertia, standard

SEEDS = range(12)
SCALE = np.concatenate(([100.0], np.full(3, 100.0), np.full(6, 100.0)))


def random_covariance(rng: np.random.Generator, size: float) -> Array:
    factor = rng.normal(size=(10, 10)) * SCALE[:, None] * size
    return np.asarray(factor @ factor.T)


def random_body(rng: np.random.Generator) -> Array:
    factor = rng.normal(size=(4, 4)) * 5.0
    matrix = factor @ factor.T + 0.1 * np.eye(4)  # pseudo-inertia
    inertia = np.trace(matrix[:3, :3]) * np.eye(3) - matrix[:3, :3]
    return np.concatenate(([matrix[3, 3]], matrix[:3, 3], vec(inertia)))


def random_estimate(seed: int) -> tuple[Array, Array]:
    """Return an estimate that no real body has, and its covariance."""
    rng = np.random.default_rng(seed)
    while True:
        covariance = random_covariance(rng, 0.1)
        estimate = random_body(rng) + np.linalg.cholesky(covariance) @ rng.normal(size=10)
        if not is_physical(estimate):
            return estimate, covariance


def distance(body: Array, estimate: Array, covariance: Array) -> float:
    return float(np.sqrt((body - estimate) @ np.linalg.solve(covariance, body - estimate)))


@pytest.mark.parametrize('seed', SEEDS)
def test_the_projection_is_a_real_body(seed: int) -> None:
    estimate, covariance = random_estimate(seed)
    body, far = project(estimate, covariance, SCALE)
    assert is_physical(body)
    assert np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0.0
    assert body[0] > 0.0
    assert far == pytest.approx(distance(body, estimate, covariance), rel=1e-6)


@pytest.mark.parametrize('seed', SEEDS)
def test_no_real_body_is_nearer(seed: int) -> None:
    estimate, covariance = random_estimate(seed)
    body, far = project(estimate, covariance, SCALE)
    rng = np.random.default_rng(100 + seed)
    nearest = np.inf
    for size in np.repeat([1e-4, 1e-3, 1e-2, 0.1, 1.0], 40):
        # Real bodies at random, and around the projection: the cone is convex.
        other = body + size * (random_body(rng) - body)
        assert is_physical(other)
        nearest = min(nearest, distance(other, estimate, covariance))
    # The search ends within a thousandth of the distance, and the floor of the eigenvalues keeps it off the limit.
    assert far <= nearest * (1.0 + 1e-3)


@pytest.mark.parametrize('size', [1.0, 1e-3])
@pytest.mark.parametrize('seed', SEEDS)
def test_the_projection_is_the_nearest_of_all_real_bodies(seed: int, size: float) -> None:
    """The slope there, as a form on pseudo-inertias, is positive and vanishes on the projection: no body is nearer."""
    estimate, covariance = random_estimate(seed)
    covariance = covariance * size**2
    body, far = project(estimate, covariance, SCALE)
    slope = np.linalg.solve(covariance, body - estimate)
    units = np.array([pseudo_inertia(unit) for unit in np.eye(10)])
    gram = np.einsum('aij,bij->ab', units, units)
    dual = np.tensordot(np.linalg.solve(gram, slope), units, 1)
    values = np.linalg.eigvalsh(dual)
    assert far > 0.0
    assert values[0] > -1e-6 * values[-1]
    # Half the square of the distance, less what it is at the least.
    assert slope @ body < 1e-4 + 1e-5 * far**2


@pytest.mark.parametrize('seed', SEEDS)
def test_a_real_body_is_left_as_it_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body = random_body(rng)
    found, far = project(body, random_covariance(rng, 0.1), SCALE)
    assert found is body
    assert far == 0.0


def test_an_open_direction_is_filled_in() -> None:
    """Where the data say nothing about a parameter, any value will do that makes a body."""
    estimate = standard(np.array([100.0, 0.1, 0.2, 0.3, 20.0, 1.0, 2.0, 30.0, 3.0, -500.0]))
    covariance = np.diag((1e-3 * SCALE) ** 2)
    covariance[9, 9] = (1e5 * SCALE[9]) ** 2
    body, far = project(estimate, covariance, SCALE)
    assert is_physical(body)
    # What is known has not moved.
    assert far < 1e-2
    assert body[:9] == pytest.approx(estimate[:9], abs=1e-3 * SCALE[0])


@pytest.mark.parametrize('seed', SEEDS)
def test_a_covariance_that_rounding_has_spoilt(seed: int) -> None:
    rng = np.random.default_rng(seed)
    estimate, covariance = random_estimate(seed)
    values, vectors = np.linalg.eigh(covariance / SCALE / SCALE[:, None])
    spoilt = values * 10.0 ** rng.uniform(-20.0, 14.0, 10) * np.where(np.arange(10) < 2, -1.0, 1.0)
    body, far = project(estimate, (vectors * spoilt @ vectors.T) * SCALE * SCALE[:, None], SCALE)
    assert is_physical(body)
    assert np.isfinite(far)


@pytest.mark.parametrize(
    ('parameters', 'physical_body'),
    [
        ((2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0), True),
        ((-2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0), False),
        ((2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 2.5), False),  # Izz > Ixx + Iyy
        ((2.0, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0), False),  # no inertia is left about the CoM
        ((np.nan, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0), False),
        ((np.inf, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0), False),
    ],
)
def test_what_a_real_body_is(parameters: tuple[float, ...], physical_body: bool) -> None:
    assert is_physical(np.array(parameters)) == physical_body


PLANES = {
    'z': Plane(np.array([0.0, 0.0, 1.0]), np.eye(3)[:2]),
    '-y': Plane(np.array([0.0, -1.0, 0.0]), np.eye(3)[[0, 2]]),
    'tilted': Plane(exp(np.array([0.4, -0.7, 0.2]))[:, 2], exp(np.array([0.4, -0.7, 0.2]))[:, :2].T),
}


@pytest.mark.parametrize('plane', PLANES.values(), ids=PLANES.keys())
@pytest.mark.parametrize('moment', [25.0, -25.0])
@pytest.mark.parametrize('mass', [40.0, -40.0])
def test_in_the_plane_mass_and_moment_become_positive(plane: Plane, moment: float, mass: float) -> None:
    com = np.array([0.3, -0.5])
    about_hinge = moment + mass * float(com @ com)
    # The coordinates of Plane.basis: I_o = (moment about the normal) n n^T and nothing else.
    square = plane.normal[:, None] * plane.normal
    estimate = plane.basis @ np.array([mass, *(mass * com), about_hinge * float(np.linalg.norm(vec(square)))])
    known = plane.basis @ np.diag([10.0, 5.0, 5.0, 8.0]) ** 2 @ plane.basis.T
    body, far = project_planar(estimate, known + 1e8 * (np.eye(10) - plane.basis @ plane.basis.T), SCALE, plane)
    assert is_physical(body)
    found = physical(body)
    if mass > 0.0 and moment > 0.0:
        # What the motion tells stays, the rest is filled in like a ball's.
        assert far == 0.0
        assert found[0] == pytest.approx(mass)
        assert found[1:4] == pytest.approx(plane.across.T @ com, abs=1e-12)
        assert found[4:] == pytest.approx([moment, 0.0, 0.0, moment, 0.0, moment], abs=1e-9)
        assert plane.normal @ unvec(body[4:]) @ plane.normal == pytest.approx(about_hinge)
    else:
        assert far > 0.0
        assert found[0] > 0.0
        assert found[4] > 0.0
