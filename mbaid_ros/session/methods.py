"""From parameters to the method of identification, with a capture before it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.capture import CaptureEstimator
from mbaid_ros.core.difference import DifferenceEstimator, DifferenceSettings
from mbaid_ros.core.filter.posterior import Continuation
from mbaid_ros.core.links import declared_errors
from mbaid_ros.core.method import TrajectoryEstimator, TrajectorySettings, TwoStageEstimator
from mbaid_ros.core.paper import PaperEstimator, PaperSettings
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.verdict import IDENTIFIABLE_STD, LARGEST_RESIDUAL, Reporting
from mbaid_ros.core.robot.momentum import MomentumKernel, unknown_scale
from mbaid_ros.core.target import KnownTarget, TargetAtCapture, TargetTrack
from mbaid_ros.errors import ParameterError
from mbaid_ros.session.catalogue import conventions, hypotheses, inexact_robot, suspects
from mbaid_ros.session.robot import KnownRobot, nominal_model

_RELINEARISED_WINDOWS = 120  # at most, before the linearisation of trajectory freezes: bounds the time of an update
_DESCRIBED_WINDOWS = 600  # the same where the target has a prior or was tracked: hours, of which minutes lead nowhere
_ADAPT = True  # whether trajectory tries hypotheses of disturbances that walk
_SOLVED_WINDOWS = 40  # that difference solves again at each update; older ones are marginalised


def make_estimator(
    config: EstimatorConfig,
    kernel: MomentumKernel,
    known: KnownRobot | None = None,
    *,
    before: Continuation | None = None,
    tracked: TargetAtCapture | None = None,
) -> Estimator:
    """Return the method that the parameters name.

    Raises ParameterError: The method lacks a parameter.

    Parameters
    ----------
    kernel : of the robot, with the errors of its known bodies
    known : nominal model with its uncertainty; None for the one that the parameters declare
    before : the run that this one continues
    tracked : the target before its capture, where it was tracked
    """
    _check_imu(config)
    if not kernel.errors.count:
        kernel = kernel.with_errors(declared_errors(kernel, config.known_links))
    if before is not None and (config.method != 'trajectory' or _has_capture(config)):
        raise ParameterError(
            f"parameter 'continue_from' goes on with a run; method is {config.method}, capture.phase "
            f'{config.capture.phase}; accepted: trajectory, and no capture'
        )
    reporting = make_reporting(config, kernel)
    if config.method == 'difference':
        known = known or nominal_model(config, kernel)
        _refuse_unused(config, known)
        return _difference(config, known, reporting)
    if config.method == 'trajectory':
        known = known or nominal_model(config, kernel)
        second = _trajectory(config, known, reporting, before, tracked)
        if tracked is not None and tracked.grasp_known:  # the first stage knows nothing of it
            return TwoStageEstimator(None, second)
        if config.disturbance.constant != 'none' or not config.by_odometry or _has_varying_wrench(config):
            return second  # the first stage takes the momentum for constant, and needs poses
        if config.flexible.joints or config.odometry.turning_std > 0.0 or not kernel.model.joints:
            return (
                second  # nor does it know of joints that swing or of a frame that turns; without joints nothing differs
            )
        return TwoStageEstimator(_difference(config, known, reporting), second)
    return _paper(config, kernel)


def _has_varying_wrench(config: EstimatorConfig) -> bool:
    """Return whether a torque or force from outside is declared that varies in a motion."""
    push = config.disturbance
    return (push.torque_std > 0.0 and push.torque_time > 0.0) or (push.force_std > 0.0 and push.force_time > 0.0)


def make_reporting(config: EstimatorConfig, kernel: MomentumKernel) -> Reporting:
    """Return the thresholds of publication of a method."""
    relative = config.convergence.relative_std
    return Reporting(unknown_scale(kernel)[:10], IDENTIFIABLE_STD, relative, LARGEST_RESIDUAL)


def _trajectory(
    config: EstimatorConfig,
    known: KnownRobot,
    reporting: Reporting,
    before: Continuation | None,
    tracked: TargetAtCapture | None,
) -> TrajectoryEstimator:
    settings = TrajectorySettings(
        noise=config.noise.declared,
        window=config.window,
        kept=_DESCRIBED_WINDOWS if tracked or isinstance(known.declared.target, KnownTarget) else _RELINEARISED_WINDOWS,
        declared=known.declared,
        hypotheses=hypotheses(
            float(np.sum(known.kernel.known[:, 0])),
            config.noise.declared.base_position,
            config.disturbance.constant,
            adapt=_ADAPT and config.located,  # drifts show in poses only
        ),
        suspects=suspects(known.kernel, known.declared.sensors),
        conventions=(*conventions(known.declared.marker), partial(inexact_robot, config=config)),
        located=config.located,
        orientation_measured=config.oriented,
        before=before,
        tracked=tracked,
    )
    return TrajectoryEstimator(known.kernel, settings, reporting)


def _refuse_unused(config: EstimatorConfig, known: KnownRobot) -> None:
    """Raise a ParameterError if something is declared that the difference form by itself does not use."""
    disturbance, target = config.disturbance, known.declared.target
    unused = {
        f"'disturbance.constant' is '{disturbance.constant}'": disturbance.constant != 'none',
        "'disturbance.torque_time' or '.force_time' is above 0": _has_varying_wrench(config),
        f"'known_links.{known.kernel.target.name[:60]}' is of the link that is identified": isinstance(
            target, KnownTarget
        ),
        f"'known_links.total_mass' is {config.known_links.total_mass:g} kg": known.declared.total_mass is not None,
        f"'target_prior.mass_std' is {config.target_prior.mass_std:g} kg": config.target_prior.mass_std > 0.0,
    }
    for given, present in unused.items():
        if present:
            raise ParameterError(
                f'parameter {given} with method difference, which assumes constant momentum and has no prior of the '
                'target; accepted: none, or method trajectory'
            )


def _difference(config: EstimatorConfig, known: KnownRobot, reporting: Reporting) -> DifferenceEstimator:
    """Return the weighted difference form: a method by itself, and the first stage of trajectory."""
    settings = DifferenceSettings(
        noise=config.noise.declared,
        kept_windows=_SOLVED_WINDOWS,
        linear_momentum_std=config.momentum.linear_prior_std,
    )
    return DifferenceEstimator(known.kernel, settings, reporting, known.declared.unknowns, known.declared.joint_prior)


def _paper(config: EstimatorConfig, kernel: MomentumKernel) -> PaperEstimator:
    if config.orbit.mean_motion > 0.0:
        raise ParameterError(
            f"parameter 'orbit.mean_motion' is {config.orbit.mean_motion:g} rad/s with method {config.method}, which "
            'assumes constant momentum; accepted: 0, or methods trajectory and difference'
        )
    paper = config.paper
    settings = PaperSettings(
        form='main' if config.method == 'paper_main' else 'difference',
        forgetting_factor=paper.forgetting_factor,
        initial_covariance=paper.initial_covariance,
        reference='first' if paper.reference == 'first' else 'previous',
        lag=paper.lag,
        total_angular_momentum=paper.total_angular_momentum,
        settled=config.convergence.relative_std,
    )
    return PaperEstimator(kernel, settings)


def _check_imu(config: EstimatorConfig) -> None:
    """Refuse an IMU without poses that the other parameters contradict, and an orientation beside poses."""
    if config.poses.alone:
        _check_poses(config)
    if not config.imu.alone:
        if config.imu.orientation:
            raise ParameterError(
                "parameter 'imu.orientation' is true without 'imu.alone'; accepted: both; beside poses an IMU's "
                'orientation is not used'
            )
        return
    contradictions = {
        'poses.names is set; accepted: poses.alone in its place': bool(config.poses.used),
        'imu.noise_density is 0, which does not use the IMU; accepted: its noise': config.imu.noise_density == 0.0,
        f'method is {config.method}, which needs poses; accepted: trajectory': config.method != 'trajectory',
        'disturbance.constant is set, which needs poses; accepted: none': config.disturbance.constant != 'none',
        'orbit.mean_motion is set, which needs an orientation; accepted: 0, or imu.orientation true': (
            config.orbit.mean_motion > 0.0 and not config.imu.orientation
        ),
        'the run has a capture, which needs poses; accepted: capture.phase post_capture': _has_capture(config),
    }
    for problem, present in contradictions.items():
        if present:
            raise ParameterError(f"parameter 'imu.alone' is true, and {problem}")


def _check_poses(config: EstimatorConfig) -> None:
    """Refuse named poses without odometry that the other parameters contradict."""
    contradictions = {
        "'imu.alone' is true, too; accepted: one of them": config.imu.alone,
        f'method is {config.method}, which needs odometry; accepted: trajectory': config.method != 'trajectory',
        'the run has a capture, which needs odometry; accepted: capture.phase post_capture': _has_capture(config),
    }
    for problem, present in contradictions.items():
        if present:
            raise ParameterError(f"parameter 'poses.alone' is true, and {problem}")


def _has_capture(config: EstimatorConfig) -> bool:
    """Return whether a run begins before the capture."""
    return config.capture.phase != 'post_capture' or config.capture.time > 0.0


def _tracked(make: Callable[..., Estimator], target: TargetAtCapture) -> Estimator:
    return make(tracked=target)


def make_capture(
    config: EstimatorConfig, kernel: MomentumKernel, make: Callable[..., Estimator], track: TargetTrack
) -> CaptureEstimator | None:
    """Return the estimator of a run that begins before the capture, None of any other run.

    Parameters
    ----------
    kernel : of the robot
    make : makes the method after the capture, of a target that was tracked if given `tracked`
    track : of the target before the capture
    """
    if not _has_capture(config):
        return None
    capture = CaptureEstimator(
        kernel,
        make,
        config.noise.declared,
        LARGEST_RESIDUAL,
        detect=config.capture.detect,
        settling=config.capture.settling,
        track=track,
        make_tracked=partial(_tracked, make) if config.method == 'trajectory' else None,
    )
    capture.time = config.capture.time or None
    return capture
