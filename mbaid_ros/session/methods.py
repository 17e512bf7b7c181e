"""From parameters to the method of identification they name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal

from mbaid_ros.config.estimator import ConvergenceConfig, EstimatorConfig
from mbaid_ros.core.capture import CaptureEstimator
from mbaid_ros.core.difference.estimator import DifferenceEstimator, DifferenceSettings
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.paper.estimator import PaperEstimator, PaperSettings
from mbaid_ros.core.results.reporting import Reporting
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.scale import unknown_scale
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.trajectory.estimator import TrajectoryEstimator
from mbaid_ros.core.trajectory.target_runs import TrajectorySettings
from mbaid_ros.core.two_stage import TwoStageEstimator
from mbaid_ros.core.unknowns.catalogue import catalogue
from mbaid_ros.session.posterior import KnownRobot, declared_errors, nominal_model
from mbaid_ros.session.self_calibration import self_calibration


def capture_of(
    config: EstimatorConfig, kernel: MomentumKernel, known: KnownRobot | None, make: Callable[..., Estimator]
) -> CaptureEstimator | None:
    """Return what stands before a method in a run that begins before the capture, None in any other run.

    Parameters
    ----------
    config : EstimatorConfig
    kernel : of the robot as it is known before
    known : how well all of it is known then; None leaves that to the parameters
    make : what makes the method after the capture, of a kernel and of how well the robot is known

    Raises
    ------
    ModelError, ParameterError
        A calibration is asked for, and its parameters cannot be used.
    """
    calibrate = self_calibration(config, kernel, make)
    if config.capture.phase == 'post_capture' and config.capture.time == 0.0:
        if calibrate is not None:
            raise ParameterError(
                "parameter 'calibration.enabled' is true in a run that begins after the capture; accepted: with "
                'capture.phase: pre_capture or a capture.time'
            )
        return None
    noise = config.noise.declared
    capture = CaptureEstimator(
        kernel,
        make(kernel, known),
        noise,
        config.capture.margin,
        config.convergence.largest_residual,
        detect=config.capture.detect,
        calibrate=calibrate,
        again=partial(make, kernel, known),
    )
    capture.time = config.capture.time or None
    return capture


def make_reporting(config: EstimatorConfig, kernel: MomentumKernel) -> Reporting:
    """Return the thresholds of what a method publishes."""
    convergence = config.convergence
    return Reporting(
        scale=unknown_scale(kernel)[:10],
        identifiable_std=convergence.identifiable_std,
        converged_std=convergence.relative_std,
        length=convergence.length,
        largest_residual=convergence.largest_residual,
    )


def set_thresholds(reporting: Reporting, convergence: ConvergenceConfig) -> None:
    """Let what is published be judged by parameters, from the next window on."""
    reporting.identifiable_std = convergence.identifiable_std
    reporting.converged_std = convergence.relative_std
    reporting.length = convergence.length
    reporting.largest_residual = convergence.largest_residual


def make_estimator(
    config: EstimatorConfig,
    kernel: MomentumKernel,
    known: KnownRobot | None = None,
    *,
    judge: Callable[[EstimatorConfig, MomentumKernel], Reporting] = make_reporting,
) -> Estimator:
    """Return the method that the parameters name.

    Parameters
    ----------
    config : EstimatorConfig
    kernel : of the robot, with the errors of its known bodies
    known : how well all of the robot is known; None leaves that to the parameters
    judge : makes the thresholds of what is published

    Raises
    ------
    ParameterError
        The method lacks a parameter.
    """
    _check_imu(config)
    if not kernel.errors.count:
        kernel = kernel.with_uncertainty(declared_errors(kernel, config.known_links))
    noise = config.noise.declared
    reporting = judge(config, kernel)
    if config.method == 'difference':
        return _difference(config, known or nominal_model(config, kernel), noise, reporting)
    if config.method == 'trajectory':
        known = known or nominal_model(config, kernel)
        second = TrajectoryEstimator(
            known.kernel,
            TrajectorySettings(
                noise=noise,
                window=config.window,
                start=config.trajectory.start_windows,
                kept=config.trajectory.kept_windows,
                uncertainty=known.uncertainty,
                adapt=config.trajectory.adapt,
                constant=_axes(config.disturbance.constant),
                gyro=config.imu.noise_density,
                located=not config.imu.alone,
                orientation_measured=not config.imu.alone or config.imu.orientation,
            ),
            reporting,
        )
        if config.disturbance.constant != 'none' or config.imu.alone:
            return second  # the first stage takes the momentum for constant, and needs poses
        return TwoStageEstimator(_difference(config, known, noise, reporting), second)
    if config.orbit.mean_motion > 0.0:
        raise ParameterError(
            f"parameter 'orbit.mean_motion' is {config.orbit.mean_motion:g} rad/s with method {config.method}, which "
            'takes the momentum for constant; accepted: 0, or methods trajectory and difference'
        )
    paper = config.paper
    return PaperEstimator(
        kernel,
        PaperSettings(
            form='main' if config.method == 'paper_main' else 'difference',
            forgetting_factor=paper.forgetting_factor,
            initial_covariance=paper.initial_covariance,
            reference='first' if paper.reference == 'first' else 'previous',
            lag=paper.lag,
            total_angular_momentum=paper.total_angular_momentum,
            settled=config.convergence.relative_std,
            length=config.convergence.length,
        ),
    )


def _check_imu(config: EstimatorConfig) -> None:
    """Refuse what an IMU alone cannot do, or one beside poses.

    Raises
    ------
    ParameterError
        It is to be alone, and is none, or the rest of the parameters needs poses.
    """
    if not config.imu.alone:
        if config.imu.orientation:
            raise ParameterError(
                "parameter 'imu.orientation' is true without 'imu.alone'; accepted: both, for beside poses an IMU's "
                'orientation is not used'
            )
        return
    needs = {
        'imu.noise_density is 0, which does not use the IMU; accepted: its noise': config.imu.noise_density == 0.0,
        f'method is {config.method}, which needs poses; accepted: trajectory': config.method != 'trajectory',
        'disturbance.constant is set, which needs poses; accepted: none': config.disturbance.constant != 'none',
        'orbit.mean_motion is set, which needs poses; accepted: 0': config.orbit.mean_motion > 0.0,
        'the run has a capture, which needs poses; accepted: capture.phase post_capture': (
            config.capture.phase != 'post_capture' or config.capture.time > 0.0
        ),
    }
    for problem, there in needs.items():
        if there:
            raise ParameterError(f"parameter 'imu.alone' is true, and {problem}")


def _difference(
    config: EstimatorConfig, known: KnownRobot, noise: SensorNoise, reporting: Reporting
) -> DifferenceEstimator:
    """Return the weighted difference form: a method by itself, and the first stage of another."""
    if config.disturbance.constant != 'none':
        raise ParameterError(
            f"parameter 'disturbance.constant' is '{config.disturbance.constant}' with method difference, which takes "
            'the momentum for constant; accepted: none, or method trajectory'
        )
    if config.method == 'difference' and config.target_prior.mass_std > 0.0:
        raise ParameterError(
            f"parameter 'target_prior.mass_std' is {config.target_prior.mass_std:g} kg with method difference, which "
            'takes nothing of the target for known; accepted: 0, or method trajectory'
        )
    settings = DifferenceSettings(
        noise=noise,
        kept_windows=config.difference.kept_windows,
        forgetting_time=config.difference.forgetting_time,
        window=config.window,
        linear_momentum_std=config.momentum.linear_prior_std,
    )
    unknowns = catalogue(known.kernel, known.uncertainty)
    return DifferenceEstimator(known.kernel, settings, reporting, unknowns, known.uncertainty.carried)


def _axes(name: str) -> Literal['none', 'inertial', 'body']:
    """Return the axes of a constant force that a parameter names."""
    return 'inertial' if name == 'inertial' else 'body' if name == 'body' else 'none'
