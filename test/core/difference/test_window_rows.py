"""The averaged momentum equations of windows: what they are, their noise, and their independence of the batch."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.window_rows import window_rows
from mbaid_ros.core.geometry import Array, exp, skew
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.sensors.rates import with_rates
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
    tilted, plain = (
        eiv.whitened(window_rows(servicer, each, MID, ORIGIN), x).cost / 1800.0 for each in (noisy, untilted)
    )
    # Chi-square of 1800: its mean is known to 3 %.
    assert tilted == pytest.approx(1.0, abs=0.12)
    assert plain > 1.15
