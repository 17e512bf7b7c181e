"""Equations whose coefficients carry noise: the likelihood's derivatives, bias removed, and first solutions."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy import Identification
from benchmarks.data import Case, kernel, momentum_of, motion, observed
from checked import central_difference
from linear_problems import EQUATIONS, TRUE, UNKNOWNS, exact_blocks, noise_information, noisy_blocks, with_errors
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.errors_in_variables import Sums
from mbaid_ros.core.geometry import Array

SEEDS = range(5)


def normalised(error: Array, information: Array) -> float:
    return float(error @ information @ error)


@pytest.mark.parametrize('seed', SEEDS)
def test_the_cost_is_that_of_the_normalised_residuals(seed: int) -> None:
    blocks = noisy_blocks(7, seed)
    x = TRUE + 0.1 * np.random.default_rng(seed).normal(size=UNKNOWNS)
    expected = 0.0
    for k in range(len(blocks)):
        residual = blocks.rows[k] @ x + blocks.offset[k]
        spread = blocks.noise[k] + blocks.noise_rows[k] @ x
        expected += residual @ np.linalg.inv(spread @ spread.T) @ residual
    assert eiv.cost(blocks, x) == pytest.approx(expected, rel=1e-9)
    assert eiv.maximum_likelihood(blocks, x).cost == pytest.approx(expected, rel=1e-9)
    assert eiv.maximum_likelihood(blocks, x).equations == 7 * EQUATIONS


@pytest.mark.parametrize('seed', SEEDS)
def test_the_gradient_is_half_the_derivative_of_the_cost(seed: int) -> None:
    blocks = noisy_blocks(20, seed, noise=0.3, row_noise=0.3)
    x = TRUE + 0.3 * np.random.default_rng(seed).normal(size=UNKNOWNS)
    linear = eiv.maximum_likelihood(blocks, x)
    expected = 0.5 * central_difference(lambda at: np.array(eiv.cost(blocks, at)), x, 1e-6)
    assert linear.gradient == pytest.approx(expected, rel=1e-6, abs=1e-6 * float(np.abs(linear.gradient).max()))
    assert np.array_equal(linear.information, linear.information.T)
    assert np.linalg.eigvalsh(linear.information)[0] > 0.0


def test_what_noise_adds_to_the_information() -> None:
    """Over many draws the information at the truth is that of the exact coefficients and the noise's own."""
    exact = exact_blocks(6, 2, 0.5, 0.5)
    rng = np.random.default_rng(3)
    draws = np.array([eiv.maximum_likelihood(with_errors(exact, rng), TRUE).information for _ in range(3000)])
    excess = np.mean(draws, axis=0) - eiv.maximum_likelihood(exact, TRUE).information
    error = np.std(draws, axis=0) / np.sqrt(len(draws))
    assert (np.abs(excess - noise_information(exact, TRUE)) < 5.0 * error).all()
    # It is no small matter here.
    assert np.trace(excess) > 0.3 * np.trace(eiv.maximum_likelihood(exact, TRUE).information)


def test_noise_in_the_coefficients_biases_plain_least_squares_only() -> None:
    blocks = noisy_blocks(4000, 5, 0.3, 0.3)

    def solve(*, compensate: bool) -> tuple[Array, float]:
        information, right_side = Sums(blocks, TRUE).weighted(compensate=compensate)
        solution = np.linalg.solve(information, right_side)
        return solution, normalised(solution - TRUE, information)

    # Chi-square of four unknowns: 18 is exceeded once in a thousand draws.
    assert solve(compensate=False)[1] > 500.0
    assert solve(compensate=True)[1] < 18.0
    x = solve(compensate=True)[0]
    for _ in range(5):
        linear = eiv.maximum_likelihood(blocks, x)
        x = x - np.linalg.solve(linear.information, linear.gradient)
    own = linear.information - noise_information(blocks, x)
    assert normalised(x - TRUE, own) < 18.0
    # As many squared residuals as there are equations: the noise is fully explained.
    redundancy = linear.equations - UNKNOWNS
    assert linear.cost / redundancy == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / redundancy))


def test_the_compensated_form_is_right_on_average_wherever_its_weights_are_taken() -> None:
    exact = exact_blocks(6, 10, 0.4, 0.3)
    rng = np.random.default_rng(11)
    far, spread = TRUE + np.array([3.0, -2.0, 1.0, 2.0]), 0.5 * np.eye(UNKNOWNS)
    draws = [eiv.compensated(with_errors(exact, rng), far, spread)[0] for _ in range(4000)]
    information = np.array([draw.information for draw in draws])
    slope = np.array([draw.gradient + draw.information @ TRUE for draw in draws])
    costs = np.array([draw.cost + 2.0 * draw.gradient @ TRUE + TRUE @ draw.information @ TRUE for draw in draws])

    def close(values: Array, expected: Array | float) -> bool:
        return bool((np.abs(values.mean(axis=0) - expected) < 5.0 * values.std(axis=0) / np.sqrt(len(values))).all())

    # Weights of the exact equations: the noise at `far` and what its uncertainty adds.
    own_noise = exact.noise + exact.noise_rows @ far
    weights = np.linalg.inv(
        own_noise @ np.swapaxes(own_noise, 1, 2)
        + 0.25 * np.einsum('krzu,kszu->krs', exact.noise_rows, exact.noise_rows)
    )
    assert close(information, np.einsum('kri,krs,ksj->ij', exact.rows, weights, exact.rows))
    assert close(slope, 0.0)
    # The cost at the truth is what is expected of as many equations, with the variance at `far`.
    assert close(costs, float(np.einsum('krs,krz,ksz->', weights, own_noise, own_noise)))


NOWHERE = np.zeros(UNKNOWNS)
NOTHING = 1e-12 * np.eye(UNKNOWNS)


@pytest.mark.parametrize('seed', range(5))
def test_noise_in_the_coefficients_does_not_bias_it(seed: int) -> None:
    blocks = noisy_blocks(4000, seed, 0.3, 0.3)
    found = Sums(blocks, TRUE).total_least_squares(NOTHING, NOWHERE)
    linear = eiv.maximum_likelihood(blocks, TRUE)
    own = linear.information - noise_information(blocks, TRUE)
    # Chi-square of four unknowns: 18 is exceeded once in a thousand draws. Plain least squares is 500 and more off.
    assert float((found - TRUE) @ own @ (found - TRUE)) < 18.0


def test_a_run_does_not_stay_with_a_body_that_its_data_refuse() -> None:
    """A robot that is known too little for twenty seconds: 301 kg +- 20 and an inertia below -1e7 kg m^2, once."""
    case, truth = Case('table1', 'high'), motion('table1')
    truth = truth[: int(np.searchsorted(truth.time, 20.0))]
    task = Identification(kernel(case.robot), case.noise, momentum_of(case.robot, truth))
    residuals: Array = np.array([one.residual for one in task.estimates('difference', *observed(truth, case, 15))])
    assert residuals[-10:].max() < 1.5
