"""Robots that are not their URDF in any block: found within one covariance, and carried to the capture."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.precapture import WEIGHED, factors, free_model, perturbed
from declarations import exact_but
from mbaid_ros.calibration.calibration import CalibrationSettings, calibrate
from mbaid_ros.calibration.result import Calibration
from mbaid_ros.core.geometry import Array, vec
from mbaid_ros.core.links import BodyDeviations, calibrated_errors
from mbaid_ros.core.robot.model import Kinematics, Link, RobotModel
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ErrorStds, ModelErrors, draw, generator, true_robot
from observed import MID, configured_motion, estimator, kernel, nees, observe, true_body, windows
from servicers import PRIORS, all_unknown, free_motion, motion_of, standard_parameters
from simulated import robot

SIZES = ErrorStds(0.0, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3)
TABLE: dict[str, object] = {
    'known_joints__zero_std': 1e-3,
    'known_joints__origin_std': 1e-3,
    'odometry_mount__position_std': 2e-3,
    'odometry_mount__orientation_std': 2e-3,
    'time_offset__estimate': False,
}
SERVICER = {**TABLE, 'known_joints__axis_std': 1e-3, 'time_offset__estimate': True, 'time_offset__prior_std': 1e-3}


def planar_basis(found: Calibration, link: Link) -> Array:
    """Return the (10, 4) orthonormal basis of what planar motion can tell of a link: mass, first moment, moment."""
    kernel = found.kernel
    configuration = kernel.kinematics.configure(np.eye(3)[None], np.zeros((1, kernel.model.joints)))
    normal = configuration.link_pose(link)[0][0].T @ np.asarray(found.normal)
    basis = np.zeros((10, 4))
    basis[0, 0] = 1.0
    basis[1:4, 1:3] = np.linalg.svd(normal[None])[2][1:].T
    about = vec(normal[:, None] * normal)
    basis[4:, 3] = about / np.linalg.norm(about)
    return basis


def errors_of(seed: int, sizes: ErrorStds = SIZES) -> ModelErrors:
    return draw(free_model(), 'link7', sizes, generator(seed))


@cache
def moved(errors: tuple[int, ErrorStds], seed: int, seconds: float) -> Truth:
    """Return a motion of the free arm of a robot that is not its URDF."""
    return motion_of(true_robot(free_model(), errors_of(*errors), ('link7',)), seed, seconds)


def data(robot_seed: int, seed: int, seconds: float = 40.0, sizes: ErrorStds = SIZES) -> list[Samples]:
    errors = (robot_seed, sizes)
    return windows(observe(moved(errors, seed, seconds), MID, seed, errors_of(*errors)))


def wrong(model: RobotModel, errors: ModelErrors) -> Array:
    """Return the true values of joints and mount, as a calibration has them, (6 n + 6,)."""
    across = Kinematics(model).across
    tilts = (np.swapaxes(across, -1, -2) @ errors.tilts[..., None])[..., 0]
    return np.concatenate((np.column_stack((errors.zeros, errors.origins, tilts)).ravel(), errors.mount))


def found_of(seed: int, sizes: ErrorStds = SIZES) -> tuple[Calibration, Array]:
    """Return the calibration of a drawn robot, and the errors of all its values."""
    cad = perturbed(free_model(), PRIORS, seed)
    run = data(seed, 10 + seed, sizes=sizes)
    unknown = all_unknown(cad)
    found = calibrate(
        unknown, [run], CalibrationSettings(MID, factors(unknown, PRIORS), exact_but(unknown, **SERVICER))
    )
    true = np.concatenate((standard_parameters(free_model()), wrong(cad, errors_of(seed, sizes))))
    return found, found.values - true


def test_links_joints_and_mount_are_found_within_their_covariance() -> None:
    squares, deviations, learnt = 0.0, [], []
    for seed in range(3):
        found, error = found_of(seed)
        assert found.converged
        assert found.residual == pytest.approx(1.0, abs=0.1)
        squares += float(error @ np.linalg.solve(found.block_covariance, error))
        deviations.append(error / found.stds)
        before = np.sqrt(np.diag(found.prior.covariance))
        learnt.append(found.stds / np.concatenate((before, np.tile([1e-3] * 6, 7), [2e-3] * 6)))
    numbers = 3 * len(error)
    assert chi2.ppf(1e-4, numbers) < squares < chi2.isf(1e-4, numbers)
    assert np.abs(deviations).max() < 4.7  # one of 384 once in 1000
    # The data determine something of every block: of one number at least, a quarter of the prior's variance.
    ratios = np.mean(learnt, axis=0)
    placed = ratios[80:-6].reshape(7, 6)
    assert ratios[:80].min() < 0.05
    assert max(placed[:, 0].min(), placed[:, 1:4].min(), ratios[-3:].min()) < 0.85
    assert max(placed[:, 4:].min(), ratios[-6:-3].min()) < 0.75


def test_zeros_further_off_than_declared_are_reported_and_widen_the_prior_to_come() -> None:
    found, error = found_of(3, replace(SIZES, zero_std=3e-3))
    assert dict(found.prior_scales)['zero'] > 2.0
    assert np.abs(error / found.stds).max() < 4.0
    assert float(error @ np.linalg.solve(found.block_covariance, error)) < chi2.isf(1e-4, len(error))
    # What a run goes on with is as wide.
    declared, _ = found_of(3)
    assert found.stds[80:-6:6].mean() > 1.2 * declared.stds[80:-6:6].mean()
    assert not dict(declared.prior_scales)


@pytest.mark.parametrize('seed', [3, 4])
def test_a_planar_robot(seed: int) -> None:
    """CAD has its bodies' centres of mass off across the plane, too, which its motion knows nothing of."""
    model = robot('table1')
    rng = np.random.default_rng(seed)
    none = ModelErrors.zero(4)
    origins, mount = 1e-3 * rng.normal(size=(4, 3)), 2e-3 * rng.normal(size=6)
    origins[:, 2] = mount[[0, 1, 5]] = 0.0
    errors = ModelErrors(none.bodies, 1e-3 * rng.normal(size=4), origins, none.tilts, mount)
    priors = (WEIGHED, *(BodyDeviations(0.05, 0.05, 0.05),) * 4)
    run = windows(observe(configured_motion('table1', 30.0, 50.0, errors), MID, seed, errors))
    unknown = all_unknown(perturbed(model, priors, seed))
    found = calibrate(unknown, [run], CalibrationSettings(MID, factors(unknown, priors), exact_but(unknown, **TABLE)))
    assert found.planar
    assert found.residual == pytest.approx(1.0, abs=0.1)
    bases = [planar_basis(found, link) for link in found.kernel.unknown]
    rows = np.zeros((20, len(found.values)))
    for index, basis in enumerate(bases):
        rows[4 * index : 4 * index + 4, 10 * index : 10 * index + 10] = basis.T
    seen = np.concatenate(([50 + 6 * joint + each for joint in range(4) for each in (0, 1, 2)], [76, 77, 78]))
    rows = np.concatenate((rows, np.eye(len(found.values))[seen]))
    error = rows @ (found.values - np.concatenate((standard_parameters(model), wrong(model, errors))))
    squares = float(error @ np.linalg.solve(rows @ found.block_covariance @ rows.T, error))
    assert chi2.ppf(1e-4, len(rows)) < squares < chi2.isf(1e-4, len(rows))
    # What lies across the plane is as well known as before: origins' heights and the mount's tilt.
    assert found.stds[[53, 59]] == pytest.approx(1e-3, rel=1e-6)
    assert found.stds[-6:-4] == pytest.approx(2e-3, rel=1e-6)


SEEDS = range(2)


@pytest.fixture(scope='module')
def afterwards() -> Truth:
    """Return the servicer with its target in hand."""
    return configured_motion('servicer7', 12.0, 20.0)


@pytest.fixture(scope='module')
def servicers() -> list[MomentumKernel]:
    """Return the servicer as calibrations of as many runs have it, CAD errors and noise of each its own."""
    made = []
    for seed in SEEDS:
        cad = perturbed(free_model(), PRIORS, seed)
        before = windows(observe(free_motion(1, 60.0), MID, seed))
        unknown = all_unknown(cad)
        found = calibrate(unknown, [before], CalibrationSettings(MID, factors(unknown, PRIORS)))
        values = found.theta.reshape(-1, 10)
        links = tuple(replace(link, parameters=own) for link, own in zip(cad.links, values, strict=True))
        robot = MomentumKernel(replace(cad, links=links), 'link7')
        made.append(robot.with_errors(calibrated_errors(links, found.covariance, ['link7'])))
    return made


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_the_intervals_of_the_target_cover(servicers: list[MomentumKernel], afterwards: Truth, method: str) -> None:
    true = true_body(kernel('servicer7'))
    squares = []
    for seed, servicer in zip(SEEDS, servicers, strict=True):
        data = windows(observe(afterwards, MID, 1000 + seed))
        last = estimator(servicer, MID, method=method).update(data, 0)[-1]
        assert last.identifiable.all()
        squares.append(nees(last, true))
    # Twenty chi-squares, neither too large nor too small.
    assert chi2.ppf(1e-3, 20) < sum(squares) < 1.25 * chi2.isf(1e-3, 20)
