"""From parameters to the method of identification: with a capture before it, and a calibration before that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, cast

from mbaid_ros.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.calibration.result import Calibration
from mbaid_ros.calibration.unknowns import LinkPrior, make_prior
from mbaid_ros.config.capture import SelfCalibrationConfig
from mbaid_ros.config.estimator import ConvergenceConfig, EstimatorConfig
from mbaid_ros.core.capture.estimator import CaptureEstimator
from mbaid_ros.core.capture.handover import Calibrate, Chaser, Handover
from mbaid_ros.core.difference.estimator import DifferenceEstimator, DifferenceSettings
from mbaid_ros.core.errors import DataError, ParameterError, listing
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.paper.estimator import PaperEstimator, PaperSettings
from mbaid_ros.core.results.reporting import Reporting
from mbaid_ros.core.robot.kernel import MomentumKernel, unknown_scale
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.robot.model_errors import calibrated, displaced
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.trajectory.estimator import TrajectoryEstimator
from mbaid_ros.core.trajectory.target_runs import TrajectorySettings
from mbaid_ros.core.two_stage import TwoStageEstimator
from mbaid_ros.core.unknowns.bodies import KnownTarget
from mbaid_ros.core.unknowns.catalogue import catalogue, underestimated_text
from mbaid_ros.session.known_robot import KnownRobot, declared_errors, nominal_model
from mbaid_ros.session.settings import declared_uncertainty

START_WINDOWS = 10  # before the first estimate of trajectory: 5 s of motion, from which a batch start converges
_RELINEARISED_WINDOWS = 120  # at most, before the linearisation of trajectory freezes: bounds the time of an update
_DESCRIBED_WINDOWS = 600  # the same where the target has a prior: hours of a station, of which minutes lead nowhere
_ADAPT = True  # whether trajectory tries hypotheses of disturbances that walk
_SOLVED_WINDOWS = 40  # that difference solves again at each update; older ones are marginalised


def make_estimator(
    config: EstimatorConfig,
    kernel: MomentumKernel,
    known: KnownRobot | None = None,
    *,
    judge: Callable[[EstimatorConfig, MomentumKernel], Reporting] | None = None,
) -> Estimator:
    """Return the method that the parameters name.

    Raises ParameterError: The method lacks a parameter.

    Parameters
    ----------
    kernel : of the robot, with the errors of its known bodies
    known : nominal model with its uncertainty; None for the one that the parameters declare
    judge : makes the thresholds of publication; `make_reporting` where not given
    """
    _check_imu(config)
    if not kernel.errors.count:
        kernel = kernel.with_uncertainty(declared_errors(kernel, config.known_links))
    reporting = (judge or make_reporting)(config, kernel)
    if config.method == 'difference':
        return _difference(config, known or nominal_model(config, kernel), reporting)
    if config.method == 'trajectory':
        known = known or nominal_model(config, kernel)
        second = _trajectory(config, known, reporting)
        if config.disturbance.constant != 'none' or config.imu.alone or _varies(config):
            return second  # the first stage takes the momentum for constant, and needs poses
        if config.flexible.joints:
            return second  # nor does it know of joints that swing
        return TwoStageEstimator(_difference(config, known, reporting), second)
    return _paper(config, kernel)


def _varies(config: EstimatorConfig) -> bool:
    """Return whether a torque or force from outside is declared that varies in a motion."""
    push = config.disturbance
    return (push.torque_std > 0.0 and push.torque_time > 0.0) or (push.force_std > 0.0 and push.force_time > 0.0)


def make_reporting(config: EstimatorConfig, kernel: MomentumKernel) -> Reporting:
    """Return the thresholds of publication of a method."""
    reporting = Reporting(unknown_scale(kernel)[:10], 0.0, 0.0, 0.0, 0.0)
    set_thresholds(reporting, config.convergence)
    return reporting


def set_thresholds(reporting: Reporting, convergence: ConvergenceConfig) -> None:
    """Change the thresholds of publication, from the next window on."""
    reporting.identifiable_std = convergence.identifiable_std
    reporting.converged_std = convergence.relative_std
    reporting.length = convergence.length
    reporting.largest_residual = convergence.largest_residual


def _trajectory(config: EstimatorConfig, known: KnownRobot, reporting: Reporting) -> TrajectoryEstimator:
    settings = TrajectorySettings(
        noise=config.noise.declared,
        window=config.window,
        start=START_WINDOWS,
        kept=_DESCRIBED_WINDOWS if isinstance(known.uncertainty.target, KnownTarget) else _RELINEARISED_WINDOWS,
        uncertainty=known.uncertainty,
        adapt=_ADAPT,
        constant=cast("Literal['none', 'inertial', 'body']", config.disturbance.constant),
        gyro=config.imu.noise_density,
        located=not config.imu.alone,
        orientation_measured=not config.imu.alone or config.imu.orientation,
    )
    return TrajectoryEstimator(known.kernel, settings, reporting)


def _difference(config: EstimatorConfig, known: KnownRobot, reporting: Reporting) -> DifferenceEstimator:
    """Return the weighted difference form: a method by itself, and the first stage of trajectory."""
    if config.disturbance.constant != 'none':
        raise ParameterError(
            f"parameter 'disturbance.constant' is '{config.disturbance.constant}' with method difference, which "
            'assumes constant momentum; accepted: none, or method trajectory'
        )
    if _varies(config):
        raise ParameterError(
            "parameters 'disturbance.torque_time' and '.force_time' are set with method difference, which assumes both "
            'constant in a motion; accepted: 0, or method trajectory'
        )
    if config.method == 'difference' and isinstance(known.uncertainty.target, KnownTarget):
        raise ParameterError(
            f"parameter 'known_links.{known.kernel.target.name[:60]}' is of the link that is identified, with method "
            'difference, which takes nothing of the target for known; accepted: none, or method trajectory'
        )
    if config.method == 'difference' and config.target_prior.mass_std > 0.0:
        raise ParameterError(
            f"parameter 'target_prior.mass_std' is {config.target_prior.mass_std:g} kg with method difference, which "
            'uses no prior of the target; accepted: 0, or method trajectory'
        )
    settings = DifferenceSettings(
        noise=config.noise.declared,
        kept_windows=_SOLVED_WINDOWS,
        linear_momentum_std=config.momentum.linear_prior_std,
    )
    unknowns = catalogue(known.kernel, known.uncertainty)
    return DifferenceEstimator(known.kernel, settings, reporting, unknowns, known.uncertainty.carried)


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
        length=config.convergence.length,
    )
    return PaperEstimator(kernel, settings)


def _check_imu(config: EstimatorConfig) -> None:
    """Refuse an IMU without poses that the other parameters contradict, and an orientation beside poses."""
    if not config.imu.alone:
        if config.imu.orientation:
            raise ParameterError(
                "parameter 'imu.orientation' is true without 'imu.alone'; accepted: both; beside poses an IMU's "
                'orientation is not used'
            )
        return
    contradictions = {
        'imu.noise_density is 0, which does not use the IMU; accepted: its noise': config.imu.noise_density == 0.0,
        f'method is {config.method}, which needs poses; accepted: trajectory': config.method != 'trajectory',
        'disturbance.constant is set, which needs poses; accepted: none': config.disturbance.constant != 'none',
        'orbit.mean_motion is set, which needs an orientation; accepted: 0, or imu.orientation true': (
            config.orbit.mean_motion > 0.0 and not config.imu.orientation
        ),
        'the run has a capture, which needs poses; accepted: capture.phase post_capture': (
            config.capture.phase != 'post_capture' or config.capture.time > 0.0
        ),
    }
    for problem, present in contradictions.items():
        if present:
            raise ParameterError(f"parameter 'imu.alone' is true, and {problem}")


# A capture during the run, and the calibration at it

# Where the priors of bodies are declared for a calibration at the capture; the others are those of any run.
_DECLARED = {
    'link': 'calibration.mass_relative_std, .com_std, .inertia_relative_std',
    'mass': 'calibration.mass_relative_std',
}


def make_capture(
    config: EstimatorConfig, kernel: MomentumKernel, known: KnownRobot | None, make: Callable[..., Estimator]
) -> CaptureEstimator | None:
    """Return the estimator of a run that begins before the capture, None of any other run.

    Raises ModelError, ParameterError: A calibration is asked for, and its parameters cannot be used.

    Parameters
    ----------
    kernel : of the robot before the capture
    known : nominal model with its uncertainty; None for the one that the parameters declare
    make : makes the method after the capture, of a kernel and a nominal model
    """
    calibrate_robot = _self_calibration(config, kernel, make)
    if config.capture.phase == 'post_capture' and config.capture.time == 0.0:
        if calibrate_robot is not None:
            raise ParameterError(
                "parameter 'calibration.enabled' is true in a run that begins after the capture; accepted: with "
                'capture.phase: pre_capture or a capture.time'
            )
        return None
    capture = CaptureEstimator(
        kernel,
        make(kernel, known),
        config.noise.declared,
        config.capture.margin,
        config.convergence.largest_residual,
        detect=config.capture.detect,
        calibrate=calibrate_robot,
        again=partial(make, kernel, known),
    )
    capture.time = config.capture.time or None
    return capture


def _self_calibration(
    config: EstimatorConfig, kernel: MomentumKernel, make: Callable[..., Estimator]
) -> Calibrate | None:
    """Return the function that calibrates the robot from the windows before its capture, None if not enabled."""
    if not config.calibration.enabled:
        return None
    known = config.known_links
    declared = 'calibration' if known.calibration else next(iter(known.links), '')
    if declared:
        raise ParameterError(
            f"parameter 'known_links.{declared}' is given; with 'calibration.enabled', which estimates all "
            'links, none is accepted'
        )
    model, target = kernel.model, kernel.target
    # The target link comes first: the filter has it unknown after the capture.
    massive = [link for link in model.links if link.parameters[0] > 0.0 and link.name != target.name]
    links = [target, *massive]
    robot = MomentumKernel(model, *(link.name for link in links)).storing(kernel.storage).swinging(kernel.springs)
    settings = CalibrationSettings(
        noise=config.noise.declared,
        priors=_link_priors(config.calibration, links),
        uncertainty=declared_uncertainty(config, model),
        window=config.window,
        gyro=config.imu.noise_density,
    )
    make_prior(robot, settings.priors)  # refuses wrong parameters now, not at the capture

    def calibrate_before(windows: list[Samples]) -> Handover:
        found = calibrate(robot, [windows], settings)
        if not found.settled:
            raise DataError('the data before it lead to no convergent solution; accepted: a URDF nearer to the robot')
        if found.determined == 0:
            raise DataError('the data before it add nothing to the URDF; accepted: a run in which all joints move')
        after = MomentumKernel(_calibrated_model(model, found), target.name).storing(kernel.storage)
        after = after.swinging(kernel.springs)
        after = after.with_uncertainty(calibrated(links, found.covariance, [target.name]))
        # From now on the target link may be anything; the rest keeps its posterior, correlations included.
        before = kernel.with_uncertainty(found.prior.errors(1))
        known = KnownRobot(before, replace(settings.uncertainty, carried=found.carried))
        return Handover(
            kernel=after,
            after=make(after, known),
            again=partial(make, after, known),
            chaser=Chaser(found.momentum[0], found.momentum_covariance[0], found.residual, found.samples),
            link_covariance=found.covariance[:10, :10] if target.parameters[0] > 0.0 else None,
            calibration=_summary(found),
        )

    return calibrate_before


def _calibrated_model(model: RobotModel, found: Calibration) -> RobotModel:
    """Return the robot with the bodies and joint frames of a calibration."""
    values = dict(zip((link.name for link in found.prior.links), found.theta.reshape(-1, 10), strict=True))
    links = (
        replace(link, parameters=values[link.name]) if link.name in values and link.parameters[0] > 0.0 else link
        for link in model.links
    )
    return displaced(replace(model, links=tuple(links)), *found.displacements)


def _link_priors(config: SelfCalibrationConfig, links: Sequence[Link]) -> tuple[LinkPrior, ...]:
    if len(config.weighed_links) != len(config.weighed_stds):
        raise ParameterError(
            f"parameter 'calibration.weighed_stds' has {len(config.weighed_stds)} numbers; accepted: "
            f"{len(config.weighed_links)}, one for each of 'calibration.weighed_links'"
        )
    weighed = dict(zip(config.weighed_links, config.weighed_stds, strict=True))
    names = [link.name for link in links if link.parameters[0] > 0.0]
    foreign = [name for name in weighed if name not in names]
    if foreign:
        raise ParameterError(
            f"parameter 'calibration.weighed_links' has '{foreign[0][:60]}'; accepted: links with an <inertial>: "
            f'{listing(names)}'
        )
    return tuple(
        LinkPrior(weighed.get(link.name, config.mass_relative_std), config.com_std, config.inertia_relative_std)
        if link.parameters[0] > 0.0
        else LinkPrior(0.0, 0.0, 0.0, empty=True)
        for link in links
    )


def _summary(found: Calibration) -> str:
    bodies = sum(not std.empty for std in found.prior.stds)
    further_off = ''.join('; ' + underestimated_text(kind, size, _DECLARED) for kind, size in found.further_off)
    return (
        f'{bodies} bodies calibrated from the {found.span:.3g} s before the capture: '
        f'they improve {found.determined} combinations over the URDF, total mass known to '
        f'{100.0 * found.scale.relative_std:.2g} %, residual {found.residual:.2f}{further_off}'
    )
