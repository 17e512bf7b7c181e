"""The calibration: the trajectory filter over all motions, with every link as uncertain as its prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.calibration.iteration import CalibrationIteration, CalibrationSolution, Motion, converge
from mbaid_ros.calibration.misfit import bias_corrected
from mbaid_ros.calibration.result import Calibration
from mbaid_ros.calibration.unknowns import Prior, StandardNormals, make_prior
from mbaid_ros.core.forces import Thrusters
from mbaid_ros.core.geometry import Array, Flags, skew
from mbaid_ros.core.links import known_bodies
from mbaid_ros.core.method import thrusters
from mbaid_ros.core.results.innovations import widening
from mbaid_ros.core.robot.body import project
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import MomentumKernel, unknown_scale
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.state import MOMENTUM, Declared, UnknownsPrior
from mbaid_ros.core.target import KnownTarget
from mbaid_ros.errors import DataError

_NO_WINDOWS = 'the data contain no complete window; accepted: joint states and odometry that overlap in time'
# Range of a joint's window means, in standard deviations of one, from which it moves.
_MOVES = 20.0
_SMALLEST = 1e-9  # standard deviation in units of the prior's that counts as none: rounding


@dataclass(frozen=True)
class CalibrationSettings:
    """The settings of a calibration."""

    noise: SensorNoise  # of the joint sensors (the base's stands in the samples)
    # of each of the kernel's unknown links the (10, e) factor of the covariance of its standard parameters; None where
    # nothing is known
    priors: tuple[Array | None, ...]
    # unknowns but the known bodies, whose errors follow from `priors`, and priors of all else but the target
    declared: Declared = field(default_factory=Declared)
    window: float = 0.5  # s, longest
    orientation_measured: bool = True  # whether another sensor measures the orientation of the base


def calibrate(kernel: MomentumKernel, runs: Sequence[list[Samples]], settings: CalibrationSettings) -> Calibration:
    """Return the unknown links of a kernel, its joints and its odometry's mount after some motions of its robot.

    Raises ModelError: The prior cannot be used.
    Raises DataError: There are no windows, or none that can be weighed.

    Parameters
    ----------
    runs : motions, each as a list of windows; momentum is constant within one, and may differ from one to the next
    """
    prior = make_prior(kernel, settings.priors)
    runs = [run for run in runs if run]
    detectors, normal = _planes(kernel, runs, max((each.tilt for each in settings.declared.unknowns), default=0.0))
    solution, motions, normals = _solution(prior, kernel, (runs, detectors), settings)
    gaussian = solution.iteration.gaussian
    widened = normals.with_scaled_prior()
    values, covariance = widened.blocks()
    covariance = covariance * widening(gaussian.innovations, 1.0)
    values, corrections = _physical(values, covariance, kernel)
    momentum, momentum_covariance = _momenta(solution.iteration, motions)
    return Calibration(
        prior=prior,
        values=values,
        block_covariance=covariance,
        thrusters=thrusters(widened.values_of(Thrusters)),
        flexible=widened.passive_joints(kernel, max(float(run[-1].time[-1] - run[0].time[0]) for run in runs)),
        corrections=corrections,
        momentum=momentum,
        momentum_covariance=momentum_covariance,
        kernel=kernel,
        moving=_moving(kernel, runs, settings.noise),
        normal=normal,
        gains=np.linalg.eigvalsh(_information_gain(normals.of_the_robot))[::-1],
        prior_scales=normals.prior_scales.significant,
        residual=float(np.sqrt(gaussian.nis / max(gaussian.measured, 1))),
        converged=solution.converged,
        redundancy=gaussian.measured,
        located=bool(np.isfinite(runs[0][0].pose_covariance[0, 0, 0])),
        samples=sum(len(window) for run in runs for window in run),
        span=float(sum(run[-1].time[-1] - run[0].time[0] for run in runs)),
    )


def _solution(
    prior: Prior,
    kernel: MomentumKernel,
    seen: tuple[Sequence[list[Samples]], Sequence[PlaneDetector]],
    settings: CalibrationSettings,
) -> tuple[CalibrationSolution, list[Motion], StandardNormals]:
    """Return the result of the filter over all motions."""
    detectors = seen[1]
    # The first of the unknown links has the place of the filter's target, the others are known bodies with errors.
    robot = MomentumKernel(detectors[0].model, prior.links[0].name).with_errors(prior.errors(1))
    robot = robot.with_storage(kernel.storage).with_springs(kernel.springs)
    declared = settings.declared.with_links(known_bodies(robot.model, robot.errors))
    declared = replace(declared, target=KnownTarget(prior.mean[:10], prior.roots[0]))
    sensing = (settings.noise, settings.window, settings.orientation_measured)
    motions = [Motion.from_windows(run, robot, each, declared, sensing) for run, each in zip(*seen, strict=True)]
    if not any(motion.windows for motion in motions):
        raise DataError(_NO_WINDOWS)
    try:
        solution = bias_corrected(motions, converge(motions, prior.mean[:10]))
    except np.linalg.LinAlgError as error:
        raise DataError(f'the windows cannot be weighed: {error}; noise values above 0 are accepted') from error
    before = StandardNormals.from_prior(prior, robot, declared.unknowns)
    return solution, motions, before.conditioned(solution.iteration, motions[0].variables, detectors[0])


def _planes(
    kernel: MomentumKernel, runs: Sequence[list[Samples]], tilt: float
) -> tuple[list[PlaneDetector], Array | None]:
    """Return the plane of each motion, if all of them are planar, and its normal (3,) in the base link's frame."""
    if not runs:
        raise DataError(_NO_WINDOWS)
    detectors = []
    for run in runs:
        detector = PlaneDetector(kernel.model, tilt)
        for window in run:
            detector.update(window)
        detectors.append(detector)
    spatial = next((detector for detector in detectors if not detector.planar), None)
    if spatial is not None:
        detectors = [spatial] * len(runs)
    plane = detectors[0].plane(kernel.model.links[0])
    return detectors, None if plane is None else plane.normal


def _moving(kernel: MomentumKernel, runs: Sequence[list[Samples]], noise: SensorNoise) -> Flags:
    """Return which of the joints move, (n,)."""
    windows = [window for run in runs for window in run]
    means = np.array([np.mean(window.joint_position, axis=0) for window in windows])
    count = float(np.median([len(window) for window in windows]))
    position = float(np.median([noise.for_window(window).joint_position for window in windows]))
    moving: Flags = np.ptp(means, axis=0) > _MOVES * position / np.sqrt(count)
    moving[list(kernel.springs.joints)] = True
    return moving


def _physical(x: Array, covariance: Array, kernel: MomentumKernel) -> tuple[Array, Array]:
    """Return x with links that can exist, and by how much each had to give way.

    A link that is none moves in its own metric to the nearest that is; everything else follows by the covariance.
    """
    scale = unknown_scale(kernel)[:10]
    corrections = np.zeros(len(kernel.unknown))
    fixed = np.zeros(len(x), dtype=bool)
    for _ in range(len(kernel.unknown)):
        for index in range(len(kernel.unknown)):
            place = np.arange(10 * index, 10 * index + 10)
            body, distance = project(x[place], covariance[np.ix_(place, place)], scale)
            if distance == 0.0:
                continue
            corrections[index] = max(corrections[index], distance)
            fixed[place] = True
            change = np.linalg.solve(covariance[np.ix_(place, place)], body - x[place])
            follow = covariance[:, place] @ change
            x = np.where(fixed, x, x + follow)
            x[place] = body
    return x, corrections


def _information_gain(known: UnknownsPrior) -> Array:
    """Return the data's information on some numbers in units of the prior's, all else minimised over."""
    left, values, _ = np.linalg.svd(known.factor, full_matrices=False)
    return np.asarray((left * (np.maximum(values, _SMALLEST) ** -2 - 1.0)) @ left.T)


def _momenta(iteration: CalibrationIteration, motions: Sequence[Motion]) -> tuple[Array, Array]:
    """Return (P, L) of each motion, (R, 6), about the odometry origin, and their covariances, (R, 6, 6)."""
    values, covariances = np.zeros((len(motions), 6)), np.zeros((len(motions), 6, 6))
    for index, (motion, factor) in enumerate(zip(motions, iteration.momentum_factors, strict=True)):
        shift = np.eye(6)
        shift[3:, :3] = skew(motion.origin)
        values[index] = shift @ iteration.momenta[index]
        own = factor @ factor.T + motion.variables.covariance_outside[MOMENTUM, MOMENTUM]
        covariances[index] = shift @ own @ shift.T
    return values, covariances
