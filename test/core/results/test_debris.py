"""The captured body alone: exact parameters, and a covariance that a Monte Carlo confirms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, exp, unvec, vec
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.publication import Frame, debris
from mbaid_ros.core.robot.momentum import physical, standard

LINK = standard(np.array([35.0, 0.2, -0.1, 0.3, 2.0, 0.1, -0.2, 3.0, 0.15, 2.5]))
SAME = Frame('hand', np.eye(3), np.zeros(3))
GRASP = Frame('grasp', exp(np.array([0.4, -0.8, 1.1])), np.array([0.3, -0.2, 0.5]))
BODY = np.array([155.0, 0.9, 0.2, -0.4, 40.0, 3.0, -2.0, 55.0, 4.0, 60.0])


def estimated(covariance: Array) -> Estimate:
    """Return the estimate of link and body together."""
    together = physical(standard(BODY) + LINK)
    return Estimate(
        'trajectory', 'converged', parameters=together, covariance=covariance, identifiable=np.ones(10, dtype=bool)
    )


def random_covariance(rng: np.random.Generator, size: float) -> Array:
    root = rng.normal(size=(10, 14)) * size * np.array([10.0, *(0.1,) * 3, *(5.0,) * 6])[:, None]
    return root @ root.T


def test_parameters_are_exact() -> None:
    found = debris(estimated(np.eye(10)), LINK, SAME)
    assert found is not None
    assert found.parameters == pytest.approx(BODY, rel=1e-12)


def test_two_point_masses() -> None:
    # A link of 1 kg at x = 0 and a body of 3 kg at x = 1: together 4 kg at 0.75 with m1 m2 / (m1 + m2) = 0.75 kg m^2.
    together = np.array([4.0, 0.75, 0.0, 0.0, *vec(np.diag([0.0, 0.75, 0.75]))])
    link = standard(np.array([1.0, *(0.0,) * 9]))
    found = debris(replace(estimated(np.eye(10)), parameters=together), link, SAME)
    assert found is not None
    assert found.parameters == pytest.approx(np.array([3.0, 1.0, *(0.0,) * 8]), abs=1e-12)


def test_a_link_without_mass_leaves_everything_as_it_is() -> None:
    covariance = random_covariance(np.random.default_rng(0), 1e-3)
    estimate = estimated(covariance)
    found = debris(estimate, np.zeros(10), SAME)
    assert found is not None
    assert found.parameters == pytest.approx(estimate.parameters)
    assert found.covariance == pytest.approx(covariance)
    assert found.std == pytest.approx(estimate.std)


@pytest.mark.parametrize('frame', [SAME, GRASP], ids=['link', 'grasp'])
def test_the_covariance_is_that_of_a_monte_carlo(frame: Frame) -> None:
    rng = np.random.default_rng(1)
    covariance = random_covariance(rng, 1e-4)
    estimate = estimated(covariance)
    found = debris(estimate, LINK, frame)
    assert found is not None
    draws = rng.multivariate_normal(estimate.parameters, covariance, size=4000)
    alone = physical(in_frame(standard(draws) - LINK, frame))
    error = np.linalg.solve(np.linalg.cholesky(found.covariance), (alone - found.parameters).T)
    # Each element of the whitened covariance of 4000 draws has a standard deviation of 0.016 (0.022 on the diagonal).
    assert np.cov(error) == pytest.approx(np.eye(10), abs=0.1)


def test_an_uncertain_link_widens_it() -> None:
    rng = np.random.default_rng(5)
    link_std = 0.01 * np.array([35.0, *(7.0,) * 3, *(4.0,) * 6])
    estimate = estimated(random_covariance(rng, 1e-6))
    found = debris(estimate, LINK, GRASP, link_covariance=np.diag(link_std**2))
    assert found is not None
    links = LINK + link_std * rng.normal(size=(4000, 10))
    alone = physical(in_frame(standard(estimate.parameters) - links, GRASP))
    error = np.linalg.solve(np.linalg.cholesky(found.covariance), (alone - found.parameters).T)
    assert np.cov(error) == pytest.approx(np.eye(10), abs=0.1)


def in_frame(parameters: Array, frame: Frame) -> Array:
    """Return standard parameters in a frame: moved there by the axes' and the origin's own definition."""
    m, com, inertia = parameters[:, :1], parameters[:, 1:4] / parameters[:, :1], unvec(physical(parameters)[:, 4:])
    turned = frame.rotation.T @ inertia @ frame.rotation
    return standard(np.concatenate((m, (com - frame.position) @ frame.rotation, vec(turned)), axis=1))


def test_a_chosen_frame() -> None:
    found = debris(estimated(np.eye(10)), LINK, GRASP)
    assert found is not None
    assert found.frame.name == 'grasp'
    assert found.parameters == pytest.approx(physical(in_frame(standard(BODY[None]), GRASP))[0])


def test_its_own_principal_axes() -> None:
    covariance = random_covariance(np.random.default_rng(3), 1e-3)
    found = debris(estimated(covariance), LINK, replace(SAME, name='own'), in_principal_axes=True)
    assert found is not None
    assert found.frame.name == 'own'
    assert found.frame.position == pytest.approx(BODY[1:4])
    moments = np.linalg.eigvalsh(unvec(BODY[4:]))
    assert found.parameters == pytest.approx(np.array([BODY[0], 0, 0, 0, moments[0], 0, 0, moments[1], 0, moments[2]]))
    assert found.frame.rotation @ np.diag(moments) @ found.frame.rotation.T == pytest.approx(unvec(BODY[4:]))
    # To first order a principal moment changes as the element of the inertia on its axis does.
    rng = np.random.default_rng(4)
    draws = rng.multivariate_normal(estimated(covariance).parameters, 1e-4 * covariance, size=4000)
    spread = np.std(np.linalg.eigvalsh(unvec(physical(standard(draws) - LINK)[:, 4:])), axis=0)
    assert found.std[[4, 7, 9]] == pytest.approx(100.0 * spread, rel=0.05)


@pytest.mark.parametrize('missing', [0, 3, 9])
def test_nothing_where_a_parameter_is_not_determined(missing: int) -> None:
    estimate = estimated(np.eye(10))
    identifiable = estimate.identifiable.copy()
    identifiable[missing] = False
    assert debris(replace(estimate, identifiable=identifiable), LINK, SAME) is None


def test_nothing_without_a_covariance_or_a_mass_left() -> None:
    assert debris(estimated(np.diag([90.0**2, *(1.0,) * 9])), LINK, SAME) is None
    assert debris(estimated(np.full((10, 10), np.nan)), LINK, SAME) is None
    assert debris(estimated(np.eye(10)), standard(BODY) + LINK, SAME) is None
