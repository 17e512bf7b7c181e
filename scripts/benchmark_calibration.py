"""Measure the calibration on many seeds, and write the figures into docs/calibration.md.

usage: benchmark_calibration.py [--seeds N] [--processes N] [--store FOLDER] [--output docs]

Every seed draws its own CAD errors and sensor noise.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import precapture
from benchmarks.data import exact_samples, model
from benchmarks.data import motion as robot_motion
from benchmarks.driver import add_run_arguments, driving, parser_of
from benchmarks.store import Runs
from mbaid_ros.core.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.core.calibration.prior import LinkPrior
from mbaid_ros.core.calibration.result import Calibration
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.simulation.run import Truth
from mbaid_ros.replay.campaigns.monte_carlo import coverage

SECONDS = 120.0
PLACE = re.compile(r'(<!-- figures -->\n).*?(<!-- end of figures -->)', re.DOTALL)
NOTHING = LinkPrior(0.0, 0.0, 0.0)
GENERAL = LinkPrior(precapture.MASS_STD, precapture.COM_STD, precapture.INERTIA_STD)
WEIGHED = LinkPrior(precapture.BASE_MASS_STD, precapture.COM_STD, precapture.INERTIA_STD)
LINKS = ('base_link', *(f'link{index}' for index in range(1, 8)))


CASES = {'weighed': 'base mass known to 0.1 %', 'unweighed': 'all masses to 5 %, up to one factor'}
VALUES = {'cad': 'CAD values', 'calibrated': 'calibrated', 'true': 'true values'}


@dataclass(frozen=True)
class Found(Runs):
    """What a seed, or many of them, led to.

    Attributes
    ----------
    before, after : (..., 2, 2) mean squares of the errors of linear and angular momentum, with CAD values and
        calibrated, in each of CASES
    covered : (...) part of the momenta within their 95 % interval, with the base weighed
    error, prior_error : (...) squared, of all parameters in the covariance that is reported, and of CAD in the prior's
    factor, factor_std : (...) that all masses are off by where nothing is weighed, and what is reported of it
    capture : (..., 3, 3) errors of the target with each of VALUES: mass and inertia relative, CoM in m
    both : (..., 13) what `_base_mass_and_target` says
    """

    before: Array
    after: Array
    covered: Array
    error: Array
    prior_error: Array
    factor: Array
    factor_std: Array
    capture: Array
    both: Array


def main() -> None:
    """Run."""
    parser = parser_of(__doc__)
    add_run_arguments(parser, 50, 50)
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write into the calibration.md there')
    arguments = parser.parse_args()
    with driving(arguments.seeds, arguments.processes, arguments.store) as driver:
        found = driver.completed(Found, 'calibration', range(arguments.seeds), one_seed)
    text = figures(found)
    print(text)
    if arguments.output:
        page = arguments.output / 'calibration.md'
        content = page.read_text(encoding='utf-8')
        page.write_text(PLACE.sub(lambda place: f'{place[1]}{text}{place[2]}', content), encoding='utf-8')


def one_seed(seed: int) -> Found:
    """Return what one seed leads to."""
    truth, rows = precapture.motion(1, SECONDS), _rows(precapture.motion(2, 60.0, 10.0))
    before, after = precapture.windows(truth, seed), precapture.windows(robot_motion('servicer7'), 1000 + seed)
    cad, unweighed = (load_model(precapture.cad_urdf(seed, std)) for std in (precapture.BASE_MASS_STD, 0.05))
    weighed = _calibrated(cad, before, (WEIGHED, *(GENERAL,) * 7))
    loose = _calibrated(unweighed, before, (GENERAL,) * 8)
    true = _theta(precapture.free_model())
    factor = float(np.sum(loose.theta[::10]) / np.sum(true[::10]))
    left = rows @ (weighed.theta - true)
    std = np.sqrt(np.einsum('nij,jk,nik->ni', rows, weighed.covariance, rows))
    prior = weighed.prior
    models = {'cad': cad, 'calibrated': _with(cad, weighed.theta), 'true': precapture.free_model()}
    return Found(
        before=np.array([_size(rows @ (found.prior.mean - true)) for found in (weighed, loose)]),
        after=np.array([_size(left), _size(rows @ (loose.theta / factor - true))]),
        covered=np.asarray(np.mean(coverage(left, std))),
        error=_squared(weighed.theta - true, weighed.covariance),
        prior_error=_squared(prior.mean - true, prior.covariance),
        factor=np.array(factor - 1.0),
        factor_std=np.array(loose.scale.relative_std),
        capture=np.array([_capture(models[name], after) for name in VALUES]),
        both=np.array(_base_mass_and_target(after)),
    )


def _rows(fresh: Truth) -> Array:
    """Return Y of all links of the true servicer on another motion, (N, 6, 80)."""
    kernel = MomentumKernel(precapture.free_model(), *LINKS)
    states = kernel.states(exact_samples(fresh, precapture.NOISE))
    return np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=2)


def _theta(robot: RobotModel) -> Array:
    return np.concatenate([robot.link(name).parameters for name in LINKS])


def _calibrated(cad: RobotModel, before: list[Samples], priors: tuple[LinkPrior, ...]) -> Calibration:
    return calibrate(MomentumKernel(cad, *LINKS), [before], CalibrationSettings(precapture.NOISE, priors))


def _size(momenta: Array) -> Array:
    """Return the mean squares of linear and angular momentum."""
    return np.asarray(np.mean(np.sum(momenta.reshape(-1, 2, 3) ** 2, axis=2), axis=0))


def _squared(error: Array, covariance: Array) -> Array:
    return np.asarray(error @ np.linalg.solve(covariance, error))


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


def figures(found: Found) -> str:
    """Return the figures as a table in Markdown."""
    lines = [
        f'{len(found)} seeds, each with CAD errors and sensor noise of its own.',
        '',
        '| | linear | angular |',
        '|---|---|---|',
    ]
    for place, words in enumerate(CASES.values()):
        wrong, left = (np.sqrt(np.mean(squares[:, place], axis=0)) for squares in (found.before, found.after))
        lines += [
            f'| {words}: RMS error of the momentum with CAD values | {wrong[0]:.3f} N s | {wrong[1]:.3f} N m s |',
            f'| calibrated | {left[0]:.4f} N s | {left[1]:.4f} N m s |',
            f'| times smaller | {wrong[0] / left[0]:.0f} | {wrong[1] / left[1]:.0f} |',
        ]
    lines += _statements(found)
    lines += ['', '| target after the capture, RMS error | mass | CoM | inertia |', '|---|---|---|---|']
    for words, (mass, com, inertia) in zip(VALUES.values(), np.sqrt(np.mean(found.capture**2, axis=0)), strict=True):
        lines.append(f'| {words} | {100.0 * mass:.3f} % | {1e3 * com:.2f} mm | {100.0 * inertia:.3f} % |')
    both = found.both
    base, target = (np.sqrt(np.mean(both[:, place] ** 2)) for place in (slice(0, 1), slice(1, 11)))
    largest, masses = np.abs(both[:, :11]).max(), np.abs(both[:, :2]).max()
    sentence = (
        f'Base mass and target unknown at once: errors of {base:.2f} (base mass) and {target:.2f} (target) standard '
        f'deviations RMS, the largest of {both[:, :2].size} masses {masses:.1f}, of all {both[:, :11].size} numbers '
        f'{largest:.1f}; the standard deviations of the two masses are {100.0 * both[0, 11]:.2f} % and '
        f'{100.0 * both[0, 12]:.2f} %.'
    )
    return '\n'.join([*lines, '', sentence]) + '\n'


def _statements(found: Found) -> list[str]:
    gains = np.sqrt(found.before[:, 0] / found.after[:, 0])
    usual, least = (
        ' and '.join(f'{x:.0f}' for x in each) for each in (np.median(gains, axis=0), np.min(gains, axis=0))
    )
    covered, reported = 100.0 * np.mean(found.covered), 100.0 * np.mean(found.factor_std)
    off, squares = 100.0 * np.sqrt(np.mean(found.factor**2)), np.mean(found.error)
    return [
        '',
        f'- Times smaller in one run: median {usual}, least {least}.',
        f'- Within the reported 95 % interval: {covered:.0f} % of the predicted momenta (base mass known).',
        f'- Squared error of all 80 parameters in the reported covariance: {squares:.0f} on average; 80 is right.',
        f'- That of the CAD values in the covariance of the prior: {np.mean(found.prior_error):.0f}.',
        f'- Without a weighed base the common factor is off by {off:.1f} % RMS; reported: {reported:.1f} %.',
    ]


if __name__ == '__main__':
    main()
