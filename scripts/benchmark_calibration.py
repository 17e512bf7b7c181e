"""Measure the calibration on many seeds, and write the figures into docs/calibration.md.

usage: benchmark_calibration.py [--seeds N] [--results FILE] [--output docs]

Every seed draws its own CAD errors and sensor noise. With --results the seeds that a file holds already are not run
again, so that a long measurement can be done in pieces.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import precapture
from benchmarks.data import exact_samples, model
from benchmarks.data import motion as robot_motion
from mbaid_ros.core.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.core.calibration.prior import LinkPrior, make_prior
from mbaid_ros.core.calibration.result import Calibration
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.simulation.run import Truth

SECONDS = 120.0
PLACE = re.compile(r'(<!-- figures -->\n).*?(<!-- end of figures -->)', re.DOTALL)
NOTHING = LinkPrior(0.0, 0.0, 0.0)
GENERAL = LinkPrior(precapture.MASS_STD, precapture.COM_STD, precapture.INERTIA_STD)
WEIGHED = LinkPrior(precapture.BASE_MASS_STD, precapture.COM_STD, precapture.INERTIA_STD)
LINKS = ('base_link', *(f'link{index}' for index in range(1, 8)))


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
    text = figures(results)
    print(text)
    if arguments.output:
        page = arguments.output / 'calibration.md'
        content = page.read_text(encoding='utf-8')
        page.write_text(PLACE.sub(lambda found: f'{found[1]}{text}{found[2]}', content), encoding='utf-8')


def one_seed(seed: int) -> dict[str, Any]:
    """Return what one seed leads to."""
    truth, rows = precapture.motion(1, SECONDS), _rows(precapture.motion(2, 60.0, 10.0))
    before, after = precapture.windows(truth, seed), precapture.windows(robot_motion('servicer7'), 1000 + seed)
    cad, unweighed = (load_model(precapture.cad_urdf(seed, std)) for std in (precapture.BASE_MASS_STD, 0.05))
    weighed = _calibrated(cad, before, (WEIGHED, *(GENERAL,) * 7))
    loose = _calibrated(unweighed, before, (GENERAL,) * 8)
    factor = float(np.sum(loose.theta[::10]) / np.sum(_theta(precapture.free_model())[::10]))
    models = {'cad': cad, 'calibrated': _with(cad, weighed.theta), 'true': precapture.free_model()}
    return {
        'weighed': {**_prediction(weighed, weighed.theta, rows), 'error': _nees(weighed)},
        'unweighed': {
            **_prediction(loose, loose.theta / factor, rows),
            'error': _nees(loose),
            'factor': factor - 1.0,
            'factor_std': loose.scale.relative_std,
        },
        'capture': {name: _capture(each, after) for name, each in models.items()},
        'both': _base_mass_and_target(after),
        'residual': weighed.residual,
        'determined': weighed.determined,
    }


def _rows(fresh: Truth) -> Array:
    """Return Y of all links of the true servicer on another motion, (N, 6, 80)."""
    kernel = MomentumKernel(precapture.free_model(), *LINKS)
    states = kernel.states(exact_samples(fresh, precapture.NOISE))
    return np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=2)


def _theta(robot: RobotModel) -> Array:
    return np.concatenate([robot.link(name).parameters for name in LINKS])


def _calibrated(cad: RobotModel, before: list[Samples], priors: tuple[LinkPrior, ...]) -> Calibration:
    return calibrate(MomentumKernel(cad, *LINKS), [before], CalibrationSettings(precapture.NOISE, priors))


def _prediction(found: Calibration, theta: Array, rows: Array) -> dict[str, object]:
    """Return sizes of the errors of the momentum, before and after, and the part within the 95 % interval."""
    true = _theta(precapture.free_model())
    wrong, left = rows @ (found.prior.mean - true), rows @ (theta - true)
    std = np.sqrt(np.einsum('nij,jk,nik->ni', rows, found.covariance, rows))
    return {'cad': _size(wrong), 'calibrated': _size(left), 'covered': float(np.mean(np.abs(left) < 1.96 * std))}


def _size(momenta: Array) -> list[float]:
    """Return the mean squares of linear and angular momentum."""
    return np.mean(np.sum(momenta.reshape(-1, 2, 3) ** 2, axis=2), axis=0).tolist()


def _nees(found: Calibration) -> float:
    error = found.theta - _theta(precapture.free_model())
    return float(error @ np.linalg.solve(found.covariance, error))


def _capture(known: RobotModel, after: list[Samples]) -> list[float]:
    """Return errors of the target: mass and inertia relative, CoM in m, with these values of the other links."""
    found = calibrate(MomentumKernel(known, 'link7'), [after], CalibrationSettings(precapture.NOISE, (NOTHING,)))
    true = physical(model('servicer7').link('link7').parameters)
    error = physical(found.theta) - true
    size = np.sqrt(np.outer(true[[4, 7, 9]], true[[4, 7, 9]])[np.triu_indices(3)])
    return [
        abs(error[0]) / true[0],
        float(np.linalg.norm(error[1:4])),
        float(np.sqrt(np.mean((error[4:] / size) ** 2))),
    ]


def _with(robot: RobotModel, theta: Array) -> RobotModel:
    for index, name in enumerate(LINKS):
        robot = precapture.with_link(robot, name, theta[10 * index : 10 * index + 10])
    return robot


def _base_mass_and_target(after: list[Samples]) -> list[float]:
    """Return the errors of base mass and of the target's ten parameters in their standard deviations."""
    robot = model('servicer7')
    priors = (LinkPrior(0.0, 1e-5, 1e-5), NOTHING)
    settings = CalibrationSettings(precapture.NOISE, priors)
    base, target = calibrate(MomentumKernel(robot, 'base_link', 'link7'), [after], settings).links
    true = physical(robot.link('link7').parameters)
    deviations = np.concatenate(([(base.parameters[0] - 560.0) / base.std[0]], (target.parameters - true) / target.std))
    return [*deviations.tolist(), base.std[0] / 560.0, target.std[0] / true[0]]


def figures(results: dict[str, dict[str, Any]]) -> str:
    """Return the figures as a table in Markdown."""
    runs = list(results.values())
    lines = [
        f'{len(runs)} seeds, each with CAD errors and sensor noise of its own.',
        '',
        '| | linear | angular |',
        '|---|---|---|',
    ]
    for case, words in (('weighed', 'base mass known to 0.1 %'), ('unweighed', 'all masses to 5 %, up to one factor')):
        wrong, left = (_root_mean(runs, case, key) for key in ('cad', 'calibrated'))
        lines += [
            f'| {words}: RMS error of the momentum with CAD values | {wrong[0]:.3f} N s | {wrong[1]:.3f} N m s |',
            f'| calibrated | {left[0]:.4f} N s | {left[1]:.4f} N m s |',
            f'| times smaller | {wrong[0] / left[0]:.0f} | {wrong[1] / left[1]:.0f} |',
        ]
    lines += _statements(results)
    lines += ['', '| target after the capture, RMS error | mass | CoM | inertia |', '|---|---|---|---|']
    for name, words in (('cad', 'CAD values'), ('calibrated', 'calibrated'), ('true', 'true values')):
        mass, com, inertia = np.sqrt(np.mean(np.square([run['capture'][name] for run in runs]), axis=0))
        lines.append(f'| {words} | {100.0 * mass:.3f} % | {1e3 * com:.2f} mm | {100.0 * inertia:.3f} % |')
    both = np.array([run['both'] for run in runs])
    base, target = (np.sqrt(np.mean(both[:, place] ** 2)) for place in (slice(0, 1), slice(1, 11)))
    largest, masses = np.abs(both[:, :11]).max(), np.abs(both[:, :2]).max()
    sentence = (
        f'Base mass and target unknown at once: errors of {base:.2f} (base mass) and {target:.2f} (target) standard '
        f'deviations RMS, the largest of {both[:, :2].size} masses {masses:.1f}, of all {both[:, :11].size} numbers '
        f'{largest:.1f}; the standard deviations of the two masses are {100.0 * both[0, 11]:.2f} % and '
        f'{100.0 * both[0, 12]:.2f} %.'
    )
    return '\n'.join([*lines, '', sentence]) + '\n'


def _statements(results: dict[str, dict[str, Any]]) -> list[str]:
    runs = list(results.values())
    covered = 100.0 * np.mean([run['weighed']['covered'] for run in runs])
    squares = np.mean([run['weighed']['error'] for run in runs])
    before = np.mean([_prior_error(int(seed)) for seed in results])
    gains = np.array([np.sqrt(np.divide(run['weighed']['cad'], run['weighed']['calibrated'])) for run in runs])
    usual, least = (
        ' and '.join(f'{x:.0f}' for x in each) for each in (np.median(gains, axis=0), np.min(gains, axis=0))
    )
    factors = np.array([run['unweighed']['factor'] for run in runs])
    reported = 100.0 * np.mean([run['unweighed']['factor_std'] for run in runs])
    off = 100.0 * np.sqrt(np.mean(factors**2))
    return [
        '',
        f'- Times smaller in one run: median {usual}, least {least}.',
        f'- Within the reported 95 % interval: {covered:.0f} % of the predicted momenta (base mass known).',
        f'- Squared error of all 80 parameters in the reported covariance: {squares:.0f} on average; 80 is right.',
        f'- That of the CAD values in the covariance of the prior: {before:.0f}.',
        f'- Without a weighed base the common factor is off by {off:.1f} % RMS; reported: {reported:.1f} %.',
    ]


def _prior_error(seed: int) -> float:
    """Return the squared error of the CAD values in the covariance of the prior."""
    cad = load_model(precapture.cad_urdf(seed))
    prior = make_prior(MomentumKernel(cad, *LINKS), (WEIGHED, *(GENERAL,) * 7))
    error = prior.mean - _theta(precapture.free_model())
    return float(error @ np.linalg.solve(prior.covariance, error))


def _root_mean(runs: list[dict[str, Any]], case: str, key: str) -> Array:
    return np.sqrt(np.mean([run[case][key] for run in runs], axis=0))


if __name__ == '__main__':
    main()
