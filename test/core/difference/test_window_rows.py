"""The equations of a window, the noise of their coefficients, and the likelihood that accounts for it."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from benchmarks.accuracy import estimates
from benchmarks.data import Case, momentum_of, motion, observed
from checked import central_difference
from linear_problems import EQUATIONS, TRUE, UNKNOWNS, exact_blocks, noise_information, noisy_blocks, with_errors
from mbaid_ros.core.difference import window_rows
from mbaid_ros.core.difference_solver import NormalSums, bias_compensated, maximum_likelihood, whitened
from mbaid_ros.core.geometry import Array, exp, skew
from mbaid_ros.core.samples import Samples, SensorNoise, with_rates
from mbaid_ros.simulation.simulation import Truth, total_momentum
from observed import MID, drifting, kernel, observe, windows

ORIGIN = np.array([0.3, -0.2, 0.5])


def unknowns(truth: Truth, origin: Array) -> Array:
    """Return the true (m, h, I_o, P_0, L_0), L_0 about the origin."""
    servicer = kernel('servicer7')
    total = total_momentum(servicer.model, truth[:1])[0]
    total[3:] -= np.cross(origin, total[:3])
    return np.concatenate((servicer.target.parameters, total))


def test_the_rows_are_the_mean_of_the_samples_equations(spatial: Truth) -> None:
    servicer = kernel('servicer7')
    samples = observe(spatial, MID, 0)[:35]
    blocks = window_rows(servicer, [samples[:10], samples[10:35]], MID, ORIGIN)
    for block, part in enumerate((slice(0, 10), slice(10, 35))):
        states = servicer.states(samples[part])
        # About the base at p, the angular momentum is L_0 - (p - origin) x P_0.
        transport = np.tile(np.eye(6), (len(states.position), 1, 1))
        transport[:, 3:, :3] = -skew(samples[part].base_position - ORIGIN)
        rows = np.concatenate((states.regressor, -transport), axis=2)
        assert blocks.rows[block] == pytest.approx(np.mean(rows, axis=0), rel=1e-12, abs=1e-12)
        assert blocks.offset[block] == pytest.approx(np.mean(states.known_momentum, axis=0), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize('speed', [0.0, 0.1])
def test_an_exact_motion_fulfils_the_equations(spatial: Truth, drift: Array, speed: float) -> None:
    truth = drifting(spatial, speed * drift)
    blocks = window_rows(kernel('servicer7'), windows(observe(truth, MID)), MID, ORIGIN)
    residual = blocks.rows @ unknowns(truth, ORIGIN) + blocks.offset
    # The integrator conserves momentum to 1e-10 of its size over this run.
    size = np.abs(blocks.offset).reshape(-1, 2, 3).max(axis=(0, 2)).repeat(3)
    assert residual / size == pytest.approx(np.zeros_like(residual), abs=1e-9)


def repeated(samples: Samples, times: int) -> Samples:
    return Samples(*(np.concatenate([getattr(samples, item.name)] * times) for item in fields(Samples)))


def test_the_noise_of_the_rows_is_what_sensors_make_it(spatial: Truth, drift: Array) -> None:
    """Compare the covariance of the residual at the truth with that of many noisy repetitions of one window."""
    servicer = kernel('servicer7')
    # One instant ten times, so that all samples have the derivatives of the middle one; a drift, so that the base's
    # position counts.
    still = spatial[np.full(10, 40)]
    truth = replace(drifting(still, 0.1 * drift), time=np.arange(10) * 0.05)
    noise = SensorNoise(2e-4, 1e-3, 2e-3, 3e-4, 1e-3, 2e-4)
    times = 1500
    many = Truth(*(np.concatenate([getattr(truth, item.name)] * times) for item in fields(Truth)))
    noisy = observe(many, noise, 3)
    blocks = window_rows(servicer, [noisy[10 * k : 10 * k + 10] for k in range(times)], noise, ORIGIN)
    exact = window_rows(servicer, [observe(truth, noise)], noise, ORIGIN)
    x = unknowns(truth, ORIGIN)
    residuals = blocks.rows @ x + blocks.offset
    factor = (exact.noise + exact.noise_rows @ x)[0]
    whitener = np.linalg.inv(np.linalg.cholesky(factor @ factor.T))
    white = (residuals - (exact.rows @ x + exact.offset)) @ whitener.T
    # Five standard errors of the elements of a covariance of so many draws; the second order of the noise is below.
    assert white.T @ white / times == pytest.approx(np.eye(6), abs=5.0 * np.sqrt(2.0 / times))
    assert np.mean(white, axis=0) == pytest.approx(np.zeros(6), abs=5.0 / np.sqrt(times))


def test_covariances_of_the_odometry_and_their_correlations_count(spatial: Truth) -> None:
    servicer = kernel('servicer7')
    samples = observe(spatial, MID)[np.full(10, 40)]
    rng = np.random.default_rng(4)
    factor = 1e-3 * rng.normal(size=(2, 6, 6))
    given = replace(
        samples,
        pose_covariance=np.tile(factor[0] @ factor[0].T, (10, 1, 1)),
        twist_covariance=np.tile(factor[1] @ factor[1].T, (10, 1, 1)),
    )
    none = replace(MID, joint_position=0.0, joint_velocity=0.0)
    unit = replace(
        samples, pose_covariance=np.tile(np.eye(6), (10, 1, 1)), twist_covariance=np.tile(np.eye(6), (10, 1, 1))
    )
    x = unknowns(spatial, ORIGIN)

    def spread(part: Samples) -> Array:
        block = window_rows(servicer, [part], none, ORIGIN)
        sources = (block.noise + block.noise_rows @ x)[0].reshape(6, 2, -1)  # at two samples of the window
        return np.asarray(sources[..., 2 * servicer.model.joints :].reshape(6, -1))

    derivative = spread(unit) * np.sqrt(10.0)
    errors: Array = np.zeros((12, 12))
    errors[:6, :6], errors[6:, 6:] = given.pose_covariance[0], given.twist_covariance[0]
    errors = np.kron(np.eye(2), errors)
    found = spread(given) @ spread(given).T
    assert found == pytest.approx(derivative @ errors @ derivative.T / 10.0, rel=1e-9, abs=1e-9 * np.abs(found).max())
    # Twice as many samples, half the variance.
    twice = spread(repeated(given, 2))
    assert twice @ twice.T == pytest.approx(0.5 * found, rel=1e-9, abs=1e-9 * np.abs(found).max())


def test_rates_taken_from_positions_are_as_noisy_as_the_equations_say(spatial: Truth) -> None:
    """Their errors tilt over a window, which counts where a fast arm changes the equations in it."""
    servicer = kernel('servicer7')
    exact, x = observe(spatial, MID)[140:165], unknowns(spatial, ORIGIN)
    rng = np.random.default_rng(5)
    noisy, untilted = [], []
    for _ in range(300):
        joints, place = (
            rng.normal(scale=deviation, size=shape.shape)
            for deviation, shape in (
                (MID.joint_position, exact.joint_position),
                (MID.base_position, exact.base_position),
            )
        )
        turned = exact.base_rotation @ exp(rng.normal(scale=MID.base_orientation, size=(len(exact), 3)))
        window = with_rates(
            replace(
                exact,
                joint_position=exact.joint_position + joints,
                joint_velocity=np.full_like(exact.joint_velocity, np.nan),
                base_position=exact.base_position + place,
                base_rotation=turned,
                base_linear_velocity=np.full_like(exact.base_linear_velocity, np.nan),
                base_angular_velocity=np.full_like(exact.base_angular_velocity, np.nan),
            )
        )
        noisy.append(window)
        untilted.append(replace(window, rate_tilt=np.ones_like(window.rate_tilt)))
    tilted, plain = (whitened(window_rows(servicer, each, MID, ORIGIN), x).cost / 1800.0 for each in (noisy, untilted))
    # Chi-square of 1800: its mean is known to 3 %.
    assert tilted == pytest.approx(1.0, abs=0.12)
    assert plain > 1.15


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
    assert whitened(blocks, x).cost == pytest.approx(expected, rel=1e-9)
    assert maximum_likelihood(blocks, x).cost == pytest.approx(expected, rel=1e-9)
    assert maximum_likelihood(blocks, x).equations == 7 * EQUATIONS


@pytest.mark.parametrize('seed', SEEDS)
def test_the_gradient_is_half_the_derivative_of_the_cost(seed: int) -> None:
    blocks = noisy_blocks(20, seed, noise=0.3, row_noise=0.3)
    x = TRUE + 0.3 * np.random.default_rng(seed).normal(size=UNKNOWNS)
    linear = maximum_likelihood(blocks, x)
    expected = 0.5 * central_difference(lambda at: np.array(whitened(blocks, at).cost), x, 1e-6)
    assert linear.gradient == pytest.approx(expected, rel=1e-6, abs=1e-6 * float(np.abs(linear.gradient).max()))
    assert np.array_equal(linear.information, linear.information.T)
    assert np.linalg.eigvalsh(linear.information)[0] > 0.0


def test_what_noise_adds_to_the_information() -> None:
    """Over many draws the information at the truth is that of the exact coefficients and the noise's own."""
    exact = exact_blocks(6, 2, 0.5, 0.5)
    rng = np.random.default_rng(3)
    draws = np.array([maximum_likelihood(with_errors(exact, rng), TRUE).information for _ in range(3000)])
    excess = np.mean(draws, axis=0) - maximum_likelihood(exact, TRUE).information
    error = np.std(draws, axis=0) / np.sqrt(len(draws))
    assert (np.abs(excess - noise_information(exact, TRUE)) < 5.0 * error).all()
    # It is no small matter here.
    assert np.trace(excess) > 0.3 * np.trace(maximum_likelihood(exact, TRUE).information)


def test_noise_in_the_coefficients_biases_plain_least_squares_only() -> None:
    blocks = noisy_blocks(4000, 5, 0.3, 0.3)

    def solve(*, compensate: bool) -> tuple[Array, float]:
        information, right_side = NormalSums(blocks, TRUE).weighted(compensate=compensate)
        solution = np.linalg.solve(information, right_side)
        return solution, normalised(solution - TRUE, information)

    # Chi-square of four unknowns: 18 is exceeded once in a thousand draws.
    assert solve(compensate=False)[1] > 500.0
    assert solve(compensate=True)[1] < 18.0
    x = solve(compensate=True)[0]
    for _ in range(5):
        linear = maximum_likelihood(blocks, x)
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
    draws = [bias_compensated(with_errors(exact, rng), far, spread)[0] for _ in range(4000)]
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
    found = NormalSums(blocks, TRUE).total_least_squares(NOTHING, NOWHERE)
    linear = maximum_likelihood(blocks, TRUE)
    own = linear.information - noise_information(blocks, TRUE)
    # Chi-square of four unknowns: 18 is exceeded once in a thousand draws. Plain least squares is 500 and more off.
    assert float((found - TRUE) @ own @ (found - TRUE)) < 18.0


def test_a_run_does_not_stay_with_a_body_that_its_data_refuse() -> None:
    """A robot that is known too little for twenty seconds: 301 kg +- 20 and an inertia below -1e7 kg m^2, once."""
    case, truth = Case('table1', 'high'), motion('table1')
    truth = truth[: int(np.searchsorted(truth.time, 20.0))]
    momentum, read = momentum_of(case.robot, truth), observed(truth, case, 15)
    found = estimates(case.robot, case.noise, momentum, 'difference', read)
    residuals: Array = np.array([one.residual for one in found])
    assert residuals[-10:].max() < 1.5
