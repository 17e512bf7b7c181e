"""Measure the calibration on many seeds, and write the figures into docs/calibration.md.

usage: benchmark_calibration.py [--seeds N] [--results FILE] [--output docs]

Every seed draws its own robot, CAD errors and sensor noise. With --results the seeds that a file holds already are not
run again, so that a long measurement can be done in pieces.
"""

from __future__ import annotations

import argparse
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import precapture
from benchmarks.data import drawn, exact_samples, model
from benchmarks.data import motion as robot_motion
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.known_side import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.core.calibration.prior import LinkPrior
from mbaid_ros.core.calibration.result import Calibration
from mbaid_ros.core.geometry import Array, cross, exp, rotate
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import ModelErrors, displaced
from mbaid_ros.core.robot.true_robot import true_robot
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.simulation.drawn import ErrorSizes
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.session.known import KnownSide
from mbaid_ros.session.methods import make_estimator

SECONDS = 120.0
PLACE = re.compile(r'(<!-- figures -->\n).*?(<!-- end of figures -->)', re.DOTALL)
GENERAL = LinkPrior(precapture.MASS_STD, precapture.COM_STD, precapture.INERTIA_STD)
WEIGHED = LinkPrior(precapture.BASE_MASS_STD, precapture.COM_STD, precapture.INERTIA_STD)
LINKS = ('link7', 'base_link', *(f'link{index}' for index in range(1, 7)))
SIZES = ErrorSizes(0.0, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3)
UNCERTAIN = Uncertainty([1e-3] * 7, [1e-3] * 7, [1e-3] * 7, mount_position=2e-3, mount_orientation=2e-3)
NUMBERS = 10 * len(LINKS) + 6 * 7 + 6


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', type=int, default=50)
    parser.add_argument('--results', type=Path, help='JSON file of the seeds done so far')
    parser.add_argument('--output', type=Path, help='folder of calibration.md')
    arguments = parser.parse_args()
    known = arguments.results is not None and arguments.results.is_file()
    results: dict[str, dict[str, Any]] = json.loads(arguments.results.read_text(encoding='utf-8')) if known else {}
    for seed in range(arguments.seeds):
        if str(seed) not in results:
            results[str(seed)] = one_seed(seed)
            print(f'seed {seed}', flush=True)
            if arguments.results:
                arguments.results.write_text(json.dumps(results), encoding='utf-8')
    text = figures(list(results.values()))
    print(text)
    if arguments.output:
        page = arguments.output / 'calibration.md'
        content = page.read_text(encoding='utf-8')
        page.write_text(PLACE.sub(lambda found: f'{found[1]}{text}{found[2]}', content), encoding='utf-8')


def one_seed(seed: int) -> dict[str, Any]:
    """Return what one seed leads to."""
    errors = drawn('servicer7', SIZES, seed)
    fresh = exact_samples(precapture.motion(2, 60.0, 10.0, errors), precapture.NOISE, errors)
    before = precapture.windows(precapture.motion(1, SECONDS, model_errors=errors), seed, model_errors=errors)
    after = precapture.windows(robot_motion('servicer7', model_errors=errors), 1000 + seed, model_errors=errors)
    cad = load_model(precapture.cad_urdf(seed))
    found = _calibrated(cad, before, (GENERAL, WEIGHED, *(GENERAL,) * 6))
    loose = _calibrated(load_model(precapture.cad_urdf(seed, 0.05)), before, (GENERAL,) * 8)
    mass = _theta(precapture.free_model())[::10].sum()
    error = found.values - np.concatenate((_theta(precapture.free_model()), _placed(cad, errors)))
    none = ModelErrors.none(7)
    learnt = _with(cad, found)
    return {
        'cad': _momentum(cad, none.zeros, none.mount, fresh),
        'calibrated': _momentum(learnt, found.joints[:, 0], found.mount, fresh),
        'squares': float(error @ np.linalg.solve(found.block_covariance, error)),
        'factor': [float(loose.theta[::10].sum() / mass - 1.0), loose.scale.relative_std],
        'residual': found.residual,
        'determined': found.determined,
        'capture': {
            'cad': _target(after, MomentumKernel(cad, 'link7'), Uncertainty()),
            'carried': _target(
                after,
                MomentumKernel(cad, 'link7').doubted(found.prior.errors(1)),
                replace(UNCERTAIN, carried=found.carried),
            ),
            'true': _target(
                _exactly(after, errors), MomentumKernel(true_robot(model('servicer7'), errors), 'link7'), Uncertainty()
            ),
        },
    }


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


def _momentum(robot: RobotModel, zeros: Array, mount: Array, samples: Samples) -> list[float]:
    """Return mean squares of linear and angular momentum, about its mean, that a robot has by what is measured."""
    samples = _at(samples, zeros, mount)
    kernel = MomentumKernel(robot, 'link7')
    states = kernel.states(samples)
    momentum = states.known_momentum + (states.regressor @ kernel.target.parameters)
    momentum[:, 3:] += cross(samples.base_position, momentum[:, :3])
    changes = momentum - momentum.mean(axis=0)
    return np.mean(np.sum(changes.reshape(-1, 2, 3) ** 2, axis=2), axis=0).tolist()


def _at(samples: Samples, zeros: Array, mount: Array) -> Samples:
    """Return samples with right zeros, of the base's own frame."""
    arm = rotate(samples.base_rotation, np.broadcast_to(mount[3:], samples.base_position.shape))
    return replace(
        samples,
        joint_position=samples.joint_position + zeros,
        base_position=samples.base_position + arm,
        base_rotation=samples.base_rotation @ exp(mount[:3]),
        base_linear_velocity=samples.base_linear_velocity + cross(samples.base_angular_velocity, arm),
    )


def _exactly(windows: list[Samples], errors: ModelErrors) -> list[Samples]:
    return [_at(window, errors.zeros, errors.mount) for window in windows]


def _target(after: list[Samples], kernel: MomentumKernel, uncertainty: Uncertainty) -> list[float]:
    """Return errors of the target, mass and inertia relative, CoM in m; then its squared error in its covariance."""
    noise = {f'noise.{name}': value for name, value in vars(precapture.NOISE).items()}
    config = build(EstimatorConfig, {**EXACT, **noise, 'method': 'trajectory', 'target_link': 'link7'})
    last = make_estimator(config, kernel, KnownSide(kernel, uncertainty)).update(after, 0)[-1]
    true = physical(model('servicer7').link('link7').parameters)
    error = last.parameters - true
    size = np.sqrt(np.outer(true[[4, 7, 9]], true[[4, 7, 9]])[np.triu_indices(3)])
    return [
        abs(error[0]) / true[0],
        float(np.linalg.norm(error[1:4])),
        float(np.sqrt(np.mean((error[4:] / size) ** 2))),
        float(error @ np.linalg.solve(last.covariance, error)),
    ]


def figures(runs: list[dict[str, Any]]) -> str:
    """Return the figures as tables in Markdown."""
    wrong, left = (np.sqrt(np.mean([run[key] for run in runs], axis=0)) for key in ('cad', 'calibrated'))
    gains = np.array([np.sqrt(np.divide(run['cad'], run['calibrated'])) for run in runs])
    usual, least = (' and '.join(f'{x:.0f}' for x in each) for each in (np.median(gains, axis=0), gains.min(axis=0)))
    factors = np.array([run['factor'] for run in runs])
    off = 100.0 * np.sqrt(np.mean(factors[:, 0] ** 2))
    lines = [
        f'{len(runs)} robots, each with CAD errors, joints, mount and sensor noise of its own.',
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
            f'{np.mean([run["squares"] for run in runs]):.0f} on average; {NUMBERS} is right.'
        ),
        f'- Residual: {np.mean([run["residual"] for run in runs]):.3f} on average.',
        (
            f'- Without a weighed base the common factor is off by {off:.1f} % RMS; reported: '
            f'{100.0 * np.mean(factors[:, 1]):.1f} %.'
        ),
        '',
        '| target after the capture, RMS error | mass | CoM | inertia | squared error, normalised |',
        '|---|---|---|---|---|',
    ]
    for name, words in (
        ('cad', 'URDF taken as exact'),
        ('carried', 'from the calibration on'),
        ('true', 'true robot, known exactly'),
    ):
        errors = np.array([run['capture'][name] for run in runs])
        mass, com, inertia = np.sqrt(np.mean(errors[:, :3] ** 2, axis=0))
        lines.append(
            f'| {words} | {100.0 * mass:.3f} % | {1e3 * com:.2f} mm | {100.0 * inertia:.3f} % | '
            f'{np.mean(errors[:, 3]):.3g} |'
        )
    return '\n'.join(lines) + '\n'


if __name__ == '__main__':
    main()
