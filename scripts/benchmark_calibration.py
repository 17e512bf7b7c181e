"""Measure the calibration on many seeds, and write the figures into docs/calibration.md.

usage: benchmark_calibration.py [--seeds N] [--processes N] [--store FOLDER] [--output docs]

Every seed draws its own robot, CAD errors and sensor noise.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import precapture
from benchmarks.data import drawn, exact_samples, model
from benchmarks.data import motion as robot_motion
from benchmarks.driver import add_run_arguments, driving, parser_of
from benchmarks.store import Runs
from mbaid_ros.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.calibration.result import Calibration
from mbaid_ros.calibration.unknowns import LinkPrior
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import ModelErrors, displaced
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.core.unknowns.declaration import NominalModel
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.posterior import KnownRobot
from mbaid_ros.simulation.true_robot import ErrorSizes, true_robot

SECONDS = 120.0
PLACE = re.compile(r'(<!-- figures -->\n).*?(<!-- end of figures -->)', re.DOTALL)
GENERAL = LinkPrior(precapture.MASS_STD, precapture.COM_STD, precapture.INERTIA_STD)
WEIGHED = LinkPrior(precapture.BASE_MASS_STD, precapture.COM_STD, precapture.INERTIA_STD)
PRIORS = (GENERAL, WEIGHED, *(GENERAL,) * 6)  # of LINKS
LINKS = ('link7', 'base_link', *(f'link{index}' for index in range(1, 7)))
SIZES = ErrorSizes(0.0, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3)
UNCERTAIN = Uncertainty([1e-3] * 7, [1e-3] * 7, [1e-3] * 7, mount_position=2e-3, mount_orientation=2e-3)
NUMBERS = 10 * len(LINKS) + 6 * 7 + 6


KNOWN = ('URDF taken as exact', 'from the calibration on', 'true robot, known exactly')


@dataclass(frozen=True)
class Found(Runs):
    """What a seed, or many of them, led to.

    Attributes
    ----------
    cad, calibrated : (..., 2) mean squares of the changes of linear and angular momentum, which are constant, with the
        URDF and calibrated
    error : (...) squared, of all numbers in the covariance that is reported
    factor, factor_std : (...) that all masses are off by where nothing is weighed, and what is reported of it
    residual : (...)
    capture : (..., 3, 4) what `_compared` says of the target with each of KNOWN
    reported : (..., 3) standard deviations of the target from the calibration on, as `_sizes`
    """

    cad: Array
    calibrated: Array
    error: Array
    factor: Array
    factor_std: Array
    residual: Array
    capture: Array
    reported: Array


def main() -> None:
    """Run."""
    parser = parser_of(__doc__)
    add_run_arguments(parser, 50, 50)
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write into the calibration.md there')
    arguments = parser.parse_args()
    with driving(arguments.seeds, arguments.processes, arguments.store) as driver:
        found = driver.completed(Found, 'calibration', range(arguments.seeds), one_seed)
    text = figures(found, attainable())
    print(text)
    if arguments.output:
        page = arguments.output / 'calibration.md'
        content = page.read_text(encoding='utf-8')
        page.write_text(PLACE.sub(lambda place: f'{place[1]}{text}{place[2]}', content), encoding='utf-8')


def one_seed(seed: int) -> Found:
    """Return what one seed leads to."""
    errors = drawn('servicer7', SIZES, seed)
    fresh = exact_samples(precapture.motion(2, 60.0, 10.0, errors), precapture.NOISE, errors)
    before = precapture.windows(precapture.motion(1, SECONDS, model_errors=errors), seed, model_errors=errors)
    after = precapture.windows(robot_motion('servicer7', model_errors=errors), 1000 + seed, model_errors=errors)
    cad = load_model(precapture.cad_urdf(seed))
    found = _calibrated(cad, before, PRIORS)
    loose = _calibrated(load_model(precapture.cad_urdf(seed, 0.05)), before, (GENERAL,) * 8)
    mass = _theta(precapture.free_model())[::10].sum()
    error = found.values - np.concatenate((_theta(precapture.free_model()), _placed(cad, errors)))
    own = MomentumKernel(cad, 'link7')
    nominal = NominalModel.nominal(own)
    learnt = NominalModel(MomentumKernel(_with(cad, found), 'link7'), found.joints[:, 0], found.mount, 0.0)
    ours = _target(after, *_learnt(own, found))
    truth = NominalModel(
        MomentumKernel(true_robot(model('servicer7'), errors), 'link7'), errors.zeros, errors.mount, 0.0
    )
    return Found(
        cad=_momentum(nominal, fresh),
        calibrated=_momentum(learnt, fresh),
        error=np.asarray(error @ np.linalg.solve(found.block_covariance, error)),
        factor=np.array(loose.theta[::10].sum() / mass - 1.0),
        factor_std=np.array(loose.scale.relative_std),
        residual=np.array(found.residual),
        capture=np.array(
            [
                _compared(_target(after, own)),
                _compared(ours),
                _compared(_target([truth.corrected(window) for window in after], truth.kernel)),
            ]
        ),
        reported=_sizes(ours.std),
    )


def _calibrated(cad: RobotModel, before: list[Samples], priors: tuple[LinkPrior, ...]) -> Calibration:
    settings = CalibrationSettings(precapture.NOISE, priors, UNCERTAIN)
    return calibrate(MomentumKernel(cad, *LINKS), [before], settings)


def _theta(robot: RobotModel) -> Array:
    return np.concatenate([robot.link(name).parameters for name in LINKS])


def _placed(cad: RobotModel, errors: ModelErrors) -> Array:
    """Return what a calibration should find of joints and mount."""
    across = Kinematics(cad).axial[1:, :, :2]
    tilts = (np.swapaxes(across, -1, -2) @ errors.tilts[..., None])[..., 0]
    return np.concatenate((np.column_stack((errors.zeros, errors.origins, tilts)).ravel(), errors.mount))


def _with(robot: RobotModel, found: Calibration) -> RobotModel:
    """Return the robot as it has been found."""
    for name, values in zip(LINKS, found.theta.reshape(-1, 10), strict=True):
        robot = precapture.with_link(robot, name, values)
    return displaced(robot, *found.displacements)


def _momentum(side: NominalModel, samples: Samples) -> Array:
    """Return mean squares of linear and angular momentum, about its mean, that a robot has by what is measured."""
    samples, kernel = side.corrected(samples), side.kernel
    states = kernel.states(samples)
    momentum = states.known_momentum + (states.regressor @ kernel.target.parameters)
    momentum[:, 3:] += cross(samples.base_position, momentum[:, :3])
    changes = momentum - momentum.mean(axis=0)
    return np.asarray(np.mean(np.sum(changes.reshape(-1, 2, 3) ** 2, axis=2), axis=0))


def attainable() -> Array:
    """Return deviations of the target, as `_sizes`, that are attainable after a calibration.

    It is what the filter reports, to first order, where every window is linearised at the truth: of a servicer that is
    its URDF, measured without noise, by one that knows nothing of that.
    """
    free = precapture.free_model()
    found = _calibrated(free, precapture.windows(precapture.motion(1, SECONDS), None), PRIORS)
    after = precapture.windows(robot_motion('servicer7'), None)
    last = _target(after, *_learnt(MomentumKernel(free, 'link7'), found))
    return _sizes(last.std)


def _learnt(own: MomentumKernel, found: Calibration) -> tuple[MomentumKernel, Uncertainty]:
    """Return a robot that goes on from a calibration, and what is uncertain of it."""
    return own.with_uncertainty(found.prior.errors(1)), replace(UNCERTAIN, carried=found.carried)


def _target(after: list[Samples], kernel: MomentumKernel, uncertainty: Uncertainty | None = None) -> Estimate:
    """Return the last estimate of the target; without an uncertainty joints and mount are exact."""
    noise = {f'noise.{name}': value for name, value in vars(precapture.NOISE).items()}
    config = build(EstimatorConfig, {**EXACT, **noise, 'method': 'trajectory', 'target_link': 'link7'})
    return make_estimator(config, kernel, KnownRobot(kernel, uncertainty or Uncertainty())).update(after, 0)[-1]


def _compared(last: Estimate) -> Array:
    """Return errors of the target, as `_sizes`; then its squared error in its covariance, (4,)."""
    error = last.parameters - _true_target()
    return np.append(_sizes(error), error @ np.linalg.solve(last.covariance, error))


def _sizes(errors: Array) -> Array:
    """Return how large errors of the target are, (3,): of mass, relative; of the CoM, m; of the inertia, relative."""
    true = _true_target()
    size = np.sqrt(np.outer(true[[4, 7, 9]], true[[4, 7, 9]])[np.triu_indices(3)])
    relative = errors[4:] / size
    return np.array([abs(errors[0]) / true[0], np.linalg.norm(errors[1:4]), np.sqrt(np.mean(relative**2))])


def _true_target() -> Array:
    return physical(model('servicer7').link('link7').parameters)


def figures(found: Found, best: Array) -> str:
    """Return the figures as tables in Markdown; `best` is what is attainable of the target."""
    wrong, left = (np.sqrt(np.mean(squares, axis=0)) for squares in (found.cad, found.calibrated))
    gains = np.sqrt(found.cad / found.calibrated)
    usual, least = (' and '.join(f'{x:.0f}' for x in each) for each in (np.median(gains, axis=0), gains.min(axis=0)))
    off = 100.0 * np.sqrt(np.mean(found.factor**2))
    lines = [
        f'{len(found)} robots, each with CAD errors, joints, mount and sensor noise of its own.',
        '',
        '| momentum on another motion, RMS change of what is constant | linear | angular |',
        '|---|---|---|',
        f'| with the URDF | {wrong[0]:.3f} N s | {wrong[1]:.3f} N m s |',
        f'| calibrated | {left[0]:.4f} N s | {left[1]:.4f} N m s |',
        f'| times smaller | {wrong[0] / left[0]:.0f} | {wrong[1] / left[1]:.0f} |',
        '',
        f'- Times smaller in one run: median {usual}, least {least}.',
        (
            f'- Squared error of all {NUMBERS} numbers in the reported covariance: '
            f'{np.mean(found.error):.0f} on average; {NUMBERS} is right.'
        ),
        f'- Residual: {np.mean(found.residual):.3f} on average.',
        (
            f'- Without a weighed base the common factor is off by {off:.1f} % RMS; reported: '
            f'{100.0 * np.mean(found.factor_std):.1f} %.'
        ),
        '',
        '| target after the capture, RMS error | mass | CoM | inertia | squared error, normalised |',
        '|---|---|---|---|---|',
    ]
    for words, every in zip(KNOWN, np.swapaxes(found.capture, 0, 1), strict=True):
        errors = every[np.isfinite(every[:, 3])]
        sizes = _row(np.sqrt(np.mean(errors[:, :3] ** 2, axis=0)))
        lines.append(f'| {words}, {len(errors)} with all ten numbers | {sizes} | {np.mean(errors[:, 3]):.3g} |')
    lines.append(f'| reported from the calibration on, RMS | {_row(np.sqrt(np.mean(found.reported**2, axis=0)))} | |')
    lines.append(f'| attainable from the calibration on | {_row(best)} | |')
    return '\n'.join(lines) + '\n'


def _row(sizes: Array) -> str:
    mass, com, inertia = sizes
    return f'{100.0 * mass:.3f} % | {1e3 * com:.2f} mm | {100.0 * inertia:.3f} %'


if __name__ == '__main__':
    main()
