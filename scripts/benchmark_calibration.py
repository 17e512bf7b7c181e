"""Write the figures of measured/calibration.md: the calibration on many robots, and the capture after it.

Every seed draws its own robot, CAD errors and sensor noise.
"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.data import NOISE, drawn, exact_samples, model, motion_of, target, true_model
from benchmarks.data import motion as robot_motion
from benchmarks.frame import Frame, Runs, declared
from benchmarks.precapture import GENERAL, WEIGHED, cad_model, factors, free_model, motion, windows
from mbaid_ros.calibration.calibration import CalibrationSettings, calibrate
from mbaid_ros.calibration.result import Calibration
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.contracts import NominalModel, uncertain
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.joints.model import joint_placements
from mbaid_ros.core.links import BodyDeviations
from mbaid_ros.core.odometry.model import odometry_mount
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import Kinematics, RobotModel, displaced
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import Declared
from mbaid_ros.parameters import build
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.robot import CalibratedModel, KnownRobot
from mbaid_ros.simulation.true_robot import ErrorStds, true_robot

SECONDS = 120.0
LINKS = ('link7', 'base_link', *(f'link{index}' for index in range(1, 7)))
PRIORS = (GENERAL, WEIGHED, *(GENERAL,) * 6)
SIZES = ErrorStds(0.0, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3)
NUMBERS = 10 * len(LINKS) + 6 * 7 + 6
KNOWN = ('URDF taken as exact', 'from the calibration on', 'true robot, known exactly')


@dataclass(frozen=True)
class Outcome(Runs):
    """Results of calibrations, and of captures after them."""

    cad: Array  # (..., 2) mean squares of the changes of linear and angular momentum, which are constant, with the URDF
    calibrated: Array  # (..., 2) the same calibrated
    error: Array  # (...) squared, of all numbers in the reported covariance
    factor: Array  # (...) relative error of all masses if nothing is weighed
    factor_std: Array  # (...) as reported
    residual: Array  # (...)
    capture: Array  # (..., 3, 4) errors of the target with each of KNOWN as by `_sizes`, and squared in the covariance
    reported: Array  # (..., 3) standard deviations of the target from the calibration on, as by `_sizes`


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/calibration.md', seeds=50)
    ((_, found),) = frame.outcomes(Outcome, run, {'': 'calibration'})
    text = figures(found, attainable())
    print(text)
    frame.write(figures=text)


def run(_row: str, seed: int) -> Outcome:
    """Return the results of one seed."""
    errors = drawn('servicer7', SIZES, seed)
    fresh = exact_samples(motion(2, 60.0, 10.0, errors), NOISE, errors)
    before = windows(motion(1, SECONDS, model_errors=errors), seed, model_errors=errors)
    after = windows(motion_of('servicer7', true_model('servicer7', errors)), 1000 + seed, model_errors=errors)
    cad = cad_model(seed, WEIGHED)
    found = _calibrated(cad, before, PRIORS)
    loose = _calibrated(cad_model(seed, GENERAL), before, (GENERAL,) * 8)
    theta = np.concatenate([free_model().link(name).parameters for name in LINKS])
    tilts = (np.swapaxes(Kinematics(cad).across, -1, -2) @ errors.tilts[..., None])[..., 0]
    placed = np.column_stack((errors.zeros, errors.origins, tilts)).ravel()
    error = found.values - np.concatenate((theta, placed, errors.mount))
    own = MomentumKernel(cad, 'link7')
    calibrated = NominalModel(MomentumKernel(_with(cad, found), 'link7'), found.joints[:, 0], found.mount, 0.0)
    ours = _target(after, *_continued(cad, found))
    truth = NominalModel(
        MomentumKernel(true_robot(model('servicer7'), errors), 'link7'), errors.zeros, errors.mount, 0.0
    )
    exact = _target([truth.corrected(window) for window in after], truth.kernel)
    return Outcome(
        cad=_momentum(NominalModel.nominal(own), fresh),
        calibrated=_momentum(calibrated, fresh),
        error=np.asarray(error @ np.linalg.solve(found.block_covariance, error)),
        factor=np.array(loose.theta[::10].sum() / theta[::10].sum() - 1.0),
        factor_std=np.array(loose.scale_std),
        residual=np.array(found.residual),
        capture=np.array([_compared(each) for each in (_target(after, own), ours, exact)]),
        reported=_sizes(ours.std),
    )


def _calibrated(cad: RobotModel, before: list[Samples], priors: tuple[BodyDeviations, ...]) -> Calibration:
    unknown = MomentumKernel(cad, *LINKS)
    return calibrate(unknown, [before], CalibrationSettings(NOISE, factors(unknown, priors), _uncertain(unknown)))


def _uncertain(kernel: MomentumKernel) -> Declared:
    """Return joints and a mount that are as uncertain as the true robots are wrong."""
    return Declared(uncertain(joint_placements(kernel, *([1e-3] * 7,) * 3), odometry_mount(2e-3, 2e-3)))


def _with(robot: RobotModel, found: Calibration) -> RobotModel:
    calibrated = dict(zip(LINKS, found.theta.reshape(-1, 10), strict=True))
    links = (replace(link, parameters=calibrated.get(link.name, link.parameters)) for link in robot.links)
    return displaced(replace(robot, links=tuple(links)), *found.displacements)


def _momentum(nominal: NominalModel, samples: Samples) -> Array:
    """Return mean squares of linear and angular momentum about its mean, which a robot has by its readings."""
    samples, kernel = nominal.corrected(samples), nominal.kernel
    states = kernel.states(samples)
    momentum = states.known_momentum + (states.regressor @ kernel.target.parameters)
    momentum[:, 3:] += cross(samples.base_position, momentum[:, :3])
    changes = momentum - momentum.mean(axis=0)
    return np.asarray(np.mean(np.sum(changes.reshape(-1, 2, 3) ** 2, axis=2), axis=0))


def attainable() -> Array:
    """Return standard deviations of the target, as by `_sizes`, attainable after a calibration, to first order.

    The filter reports them if every window is linearised at the truth: for a servicer that is its URDF, measured
    without noise, by an estimator with the usual priors.
    """
    found = _calibrated(free_model(), windows(motion(1, SECONDS), None), PRIORS)
    after = windows(robot_motion('servicer7'), None)
    return _sizes(_target(after, *_continued(free_model(), found)).std)


def _continued(cad: RobotModel, found: Calibration) -> tuple[MomentumKernel, Declared]:
    """Return a robot after its calibration, and its declaration, as the files of `calibrate` have them."""
    robot = _with(cad, found)
    links = tuple(robot.link(name) for name in LINKS)
    nominal = CalibratedModel(links, found.joints[:, 0], found.mount, found.block_covariance)
    kernel = MomentumKernel(robot, 'link7')
    kernel, unknowns, known = nominal.with_kernel(kernel, _uncertain(kernel).unknowns)
    return kernel, Declared(unknowns, joint_prior=known)


def _target(after: list[Samples], kernel: MomentumKernel, known: Declared | None = None) -> Estimate:
    """Return the last estimate of the target; without a declaration joints and mount are exact."""
    config = build(EstimatorConfig, {**EXACT, **declared(NOISE), 'method': 'trajectory', 'target_link': 'link7'})
    return make_estimator(config, kernel, KnownRobot(kernel, known or Declared())).update(after, 0)[-1]


def _compared(last: Estimate) -> Array:
    """Return (4,) errors of the target, as by `_sizes`, and its squared error in its covariance."""
    error = last.parameters - target('servicer7')
    return np.append(_sizes(error), error @ np.linalg.solve(last.covariance, error))


def _sizes(errors: Array) -> Array:
    """Return the (3,) sizes of errors of the target: of mass, relative; of the CoM, m; of the inertia, relative."""
    true = target('servicer7')
    relative = errors[4:] / np.sqrt(np.outer(true[[4, 7, 9]], true[[4, 7, 9]])[np.triu_indices(3)])
    return np.array([abs(errors[0]) / true[0], np.linalg.norm(errors[1:4]), np.sqrt(np.mean(relative**2))])


def figures(found: Outcome, best: Array) -> str:
    """Return the figures as Markdown; `best` is attainable of the target."""
    wrong, left = (np.sqrt(np.mean(squares, axis=0)) for squares in (found.cad, found.calibrated))
    gains = np.sqrt(found.cad / found.calibrated)
    usual, least = (' and '.join(f'{x:.0f}' for x in each) for each in (np.median(gains, axis=0), gains.min(axis=0)))
    off, reported = 100.0 * np.sqrt(np.mean(found.factor**2)), 100.0 * np.mean(found.factor_std)
    rows = []
    for words, every in zip(KNOWN, np.swapaxes(found.capture, 0, 1), strict=True):
        errors = every[np.isfinite(every[:, 3])]
        sizes = _row(np.sqrt(np.mean(errors[:, :3] ** 2, axis=0)))
        rows.append(f'| {words}, {len(errors)} with all ten numbers | {sizes} | {np.mean(errors[:, 3]):.3g} |')
    rows.append(f'| reported from the calibration on, RMS | {_row(np.sqrt(np.mean(found.reported**2, axis=0)))} | |')
    rows.append(f'| attainable from the calibration on | {_row(best)} | |')
    return _FIGURES.format(
        robots=len(found), wrong=wrong, left=left, gain=wrong / left, usual=usual, least=least, numbers=NUMBERS,
        error=np.mean(found.error), residual=np.mean(found.residual), off=off, reported=reported, rows='\n'.join(rows),
    )  # fmt: skip


def _row(sizes: Array) -> str:
    mass, com, inertia = sizes
    return f'{100.0 * mass:.3f} % | {1e3 * com:.2f} mm | {100.0 * inertia:.3f} %'


_FIGURES = """\
{robots} robots, each with CAD errors, joints, mount and sensor noise of its own.

| momentum on another motion, RMS change although it is constant | linear | angular |
|---|---|---|
| with the URDF | {wrong[0]:.3f} N s | {wrong[1]:.3f} N m s |
| calibrated | {left[0]:.4f} N s | {left[1]:.4f} N m s |
| times smaller | {gain[0]:.0f} | {gain[1]:.0f} |

- Times smaller in one run: median {usual}, least {least}.
- Squared error of all {numbers} numbers in the reported covariance: {error:.0f} on average; {numbers} is right.
- Residual: {residual:.3f} on average.
- Without a weighed base the common factor is off by {off:.1f} % RMS; reported: {reported:.1f} %.

| target after the capture, RMS error | mass | CoM | inertia | squared error, normalised |
|---|---|---|---|---|
{rows}"""


if __name__ == '__main__':
    main()
