"""Real bodies: the projection on them, and the captured body alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.geometry import Array, exp, unvec, vec
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import _ball, is_physical, physical, project, project_planar, pseudo_inertia, standard
from mbaid_ros.core.robot.model import Plane
from mbaid_ros.core.target import debris

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


@pytest.mark.parametrize('size', [1.0, 1e-3])
@pytest.mark.parametrize('seed', SEEDS)
def test_the_projection_is_the_nearest_of_all_real_bodies(seed: int, size: float) -> None:
    """The slope there, as a form on pseudo-inertias, is positive and vanishes on the projection: no body is nearer."""
    estimate, covariance = random_estimate(seed)
    covariance = covariance * size**2
    body, far = project(estimate, covariance, SCALE)
    assert is_physical(body)
    assert far == pytest.approx(distance(body, estimate, covariance), rel=1e-6)
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
        # What the motion determines stays, the rest is filled in like a ball's.
        assert far == 0.0
        assert found[0] == pytest.approx(mass)
        assert found[1:4] == pytest.approx(plane.axes.T @ com, abs=1e-12)
        assert found[4:] == pytest.approx([moment, 0.0, 0.0, moment, 0.0, moment], abs=1e-9)
        assert plane.normal @ unvec(body[4:]) @ plane.normal == pytest.approx(about_hinge)
    else:
        assert far > 0.0
        assert found[0] > 0.0
        assert found[4] > 0.0


@pytest.mark.parametrize('seed', range(4))
def test_the_projection_in_a_plane_is_the_nearest_of_all_real_bodies(seed: int) -> None:
    """The slope there is positive along all point masses and moments, of which bodies are sums, and zero along it."""
    plane, rng = PLANES[list(PLANES)[seed % len(PLANES)]], np.random.default_rng(seed)
    root = np.diag([10.0, 5.0, 5.0, 8.0]) @ rng.normal(size=(4, 4))
    estimate = np.array([40.0, 30.0, -25.0, 3.0])  # too small a moment for a mass so far away
    covariance = plane.basis @ root @ root.T @ plane.basis.T + 1e8 * (np.eye(10) - plane.basis @ plane.basis.T)
    body, far = project_planar(plane.basis @ estimate, covariance, SCALE, plane)
    about = float(np.linalg.norm(vec(plane.normal[:, None] * plane.normal)))
    moment = float(plane.normal @ unvec(body[4:]) @ plane.normal)
    found = np.array([body[0], *(plane.axes @ body[1:4]), about * moment])
    off = np.linalg.solve(root, found - estimate)
    assert far == pytest.approx(float(np.linalg.norm(off)), rel=1e-6)
    slope = np.linalg.solve(root.T, off)
    places = 3.0 * rng.normal(size=(500, 2))
    masses = np.column_stack((np.ones(500), places, about * np.sum(places**2, axis=1)))
    size = float(np.linalg.norm(slope))
    assert np.min(masses @ slope) > -1e-4 * size
    assert slope[3] > 0.0
    assert abs(slope @ found) < 1e-4 + 1e-5 * far**2


LINK = standard(np.array([35.0, 0.2, -0.1, 0.3, 2.0, 0.1, -0.2, 3.0, 0.15, 2.5]))
BODY = np.array([155.0, 0.9, 0.2, -0.4, 40.0, 3.0, -2.0, 55.0, 4.0, 60.0])


def estimated(covariance: Array) -> Estimate:
    """Return the estimate of link and body together."""
    together = physical(standard(BODY) + LINK)
    return Estimate(
        'trajectory', 'converged', parameters=together, covariance=covariance, identifiable=np.ones(10, dtype=bool)
    )


def drawn_covariance(rng: np.random.Generator, size: float) -> Array:
    root = rng.normal(size=(10, 14)) * size * np.array([10.0, *(0.1,) * 3, *(5.0,) * 6])[:, None]
    return root @ root.T


def test_the_covariance_is_that_of_a_monte_carlo() -> None:
    rng = np.random.default_rng(1)
    covariance = drawn_covariance(rng, 1e-4)
    estimate = estimated(covariance)
    found = some(debris(estimate, LINK))
    assert found.parameters == pytest.approx(BODY)
    draws = rng.multivariate_normal(estimate.parameters, covariance, size=4000)
    alone = physical(standard(draws) - LINK)
    error = np.linalg.solve(np.linalg.cholesky(found.covariance), (alone - found.parameters).T)
    # Each element of the whitened covariance of 4000 draws has a standard deviation of 0.016 (0.022 on the diagonal).
    assert np.cov(error) == pytest.approx(np.eye(10), abs=0.1)


def test_an_uncertain_link_widens_it() -> None:
    rng = np.random.default_rng(5)
    link_std = 0.01 * np.array([35.0, *(7.0,) * 3, *(4.0,) * 6])
    estimate = estimated(drawn_covariance(rng, 1e-6))
    found = some(debris(estimate, LINK, link_covariance=np.diag(link_std**2)))
    links = LINK + link_std * rng.normal(size=(4000, 10))
    alone = physical(standard(estimate.parameters) - links)
    error = np.linalg.solve(np.linalg.cholesky(found.covariance), (alone - found.parameters).T)
    assert np.cov(error) == pytest.approx(np.eye(10), abs=0.1)


@pytest.mark.parametrize('missing', [0, 3, 9])
def test_nothing_where_a_parameter_is_not_determined(missing: int) -> None:
    estimate = estimated(np.eye(10))
    identifiable = estimate.identifiable.copy()
    identifiable[missing] = False
    assert debris(replace(estimate, identifiable=identifiable), LINK) is None


def test_the_search_for_a_body_begins_at_a_ball_within_reach() -> None:
    """Of the same mass, centre and mean moment, as far as a body of the robot's size has them."""
    scale = np.array([100.0, *[150.0] * 3, *[80.0] * 6])
    own = np.array([50.0, 0.3, -0.2, 0.5, 10.0, 0.5, -0.3, 14.0, 0.2, 12.0])
    assert physical(_ball(standard(own), scale)) == pytest.approx([*own[:4], 12.0, 0.0, 0.0, 12.0, 0.0, 12.0])
    far = standard(np.array([-2.0, 30.0, -20.0, 50.0, 10.0, 0.0, 0.0, 14.0, 0.0, 12.0]))
    found = physical(_ball(far, scale))
    assert found[0] == pytest.approx(0.1)
    assert found[1:4] == pytest.approx(-1.5 * np.array([30.0, -20.0, 50.0]) / np.sqrt(3800.0))
    assert found[[4, 7, 9]] == pytest.approx(np.full(3, 1e-3 * 0.1 * 0.8))
