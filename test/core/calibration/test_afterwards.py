"""The capture after a calibration: what is still uncertain of the servicer enters the target's intervals."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scipy.stats import chi2

from benchmarks.precapture import free_model, perturbed
from mbaid_ros.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model_errors import calibrated
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion, estimator, kernel, nees, observe, true_body, windows
from servicing import PRIORS, all_unknown, free_motion

SEEDS = range(2)


@pytest.fixture(scope='module')
def afterwards() -> Truth:
    """Return the servicer with its target in hand."""
    return configured_motion('servicer7', 12.0, 20.0, 0.05)


@pytest.fixture(scope='module')
def servicers() -> list[MomentumKernel]:
    """Return the servicer as calibrations of as many runs have it, CAD errors and noise of each its own."""
    made = []
    for seed in SEEDS:
        cad = perturbed(free_model(), PRIORS, seed)
        before = windows(observe(free_motion(1, 60.0), MID, seed))
        found = calibrate(all_unknown(cad), [before], CalibrationSettings(MID, PRIORS))
        values = found.theta.reshape(-1, 10)
        links = tuple(replace(link, parameters=own) for link, own in zip(cad.links, values, strict=True))
        robot = MomentumKernel(replace(cad, links=links), 'link7')
        made.append(robot.with_uncertainty(calibrated(links, found.covariance, ['link7'])))
    return made


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_the_intervals_of_the_target_cover(servicers: list[MomentumKernel], afterwards: Truth, method: str) -> None:
    true = true_body(kernel('servicer7'))
    squares = []
    for seed, robot in zip(SEEDS, servicers, strict=True):
        data = windows(observe(afterwards, MID, 1000 + seed))
        last = estimator(robot, MID, method=method).update(data, 0)[-1]
        assert last.identifiable.all()
        squares.append(nees(last, true))
    # Twenty chi-squares, neither too large nor too small.
    assert chi2.ppf(1e-3, 20) < sum(squares) < 1.25 * chi2.isf(1e-3, 20)


def test_cad_values_taken_as_exact_make_them_too_narrow(afterwards: Truth) -> None:
    robot = MomentumKernel(perturbed(free_model(), PRIORS, 0), 'link7')
    exact = {name.replace('.', '__'): value for name, value in EXACT.items()}
    last = estimator(robot, MID, method='difference', **exact).update(windows(observe(afterwards, MID, 1000)), 0)[-1]
    assert nees(last, true_body(kernel('servicer7'))) > 3.0 * chi2.isf(1e-3, 10)
