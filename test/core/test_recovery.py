"""Robots off as much as declared, found within their covariance; and knowledge of target and robot beforehand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from floating import DEFAULT, RATE, float_freely, make, normalised
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.gyro import GyroErrors, gyro
from mbaid_ros.core.links import independent_errors, known_bodies
from mbaid_ros.core.odometry.model import OdometryMount
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import BODY, Declared, Layout, UnknownsPrior, variables
from mbaid_ros.core.target import TargetPrior
from mbaid_ros.session.robot import CalibratedModel
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.true_robot import ModelErrors
from observed import HIGH, MID, configured_motion, identify, kernel, observe, true_body, windows
from unchanged import Unchanged
from wrong_robots import LINKS, Wrong, declared_beside_links

SECONDS = 25.0


@dataclass(frozen=True)
class Case:
    """A robot and its motion: that of the joints, and the momentum (6,)."""

    robot: MomentumKernel
    joints: Sinusoids
    momentum: Array
    planar: bool


@dataclass(frozen=True)
class Run:
    """The last estimate of a run, and the errors of the unknowns' numbers (e,) with their covariance (e, e)."""

    case: Case
    samples: Samples
    last: Estimate
    error: Array
    covariance: Array

    @property
    def misfit(self) -> float:
        """Squared error of the target in units of its covariance."""
        return normalised(self.last, self.case.robot)


def planar_case() -> Case:
    """Return the paper's robot, its joints swinging, as it turns within its plane."""
    robot = kernel('table1')
    frequency = np.array([[0.05, 0.11], [0.07, 0.13], [0.06, 0.15], [0.09, 0.17]])
    phase = np.arange(8.0).reshape(4, 2)
    joints = Sinusoids(np.array([1.0, -1.0, -1.0, 1.0]), np.full((4, 2), 0.3), frequency, phase)
    momentum = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 4600.0])
    return Case(robot, joints, momentum, planar=True)


CASES = (('space', 2), ('plane', 2))


@pytest.fixture(scope='module', params=[*CASES, pytest.param(('space', 5), marks=pytest.mark.long)])
def runs(request: pytest.FixtureRequest, servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> list[Run]:
    """Return runs of robots with errors drawn at their declared size."""
    name, seeds = request.param
    case = planar_case() if name == 'plane' else Case(servicer7, joints, start, planar=False)
    return [_run(case, seed) for seed in range(seeds)]


def _run(case: Case, seed: int) -> Run:
    robot = case.robot
    declared = declared_beside_links(robot)
    unknowns = declared.with_links(known_bodies(robot.model, independent_errors(robot.known, LINKS))).unknowns
    if case.planar:
        unknowns = tuple(unknown.in_plane(PlaneDetector(robot.model)) for unknown in unknowns)
    rng = np.random.default_rng([seed, 3])
    numbers = tuple(rng.normal(size=unknown.count) for unknown in unknowns)
    wrong = Wrong.by(unknowns, numbers, robot.model.joints)
    truth = float_freely(wrong.robot(robot), case.joints, case.momentum, SECONDS)
    samples = observe(wrong.read(truth), MID, seed)
    estimator = make(robot, MID, known_std=LINKS, declared=declared)
    last = estimator.update(windows(samples), 0)[-1]
    assert estimator.run is not None
    distribution = estimator.run.distribution()
    # The catalogue's order is that of the state: what is only read comes last in both.
    found, factor = distribution.mean[BODY.stop :], distribution.factor[BODY.stop :]
    return Run(case, samples, last, found - np.concatenate(numbers), factor @ factor.T)


def test_the_target_is_found_within_what_is_reported(runs: list[Run]) -> None:
    count = 4 if runs[0].case.planar else 10
    for run in runs:
        assert int(np.sum(run.last.identifiable)) == count
        assert run.misfit < chi2.isf(1e-3, count)
        assert run.last.status in {'estimating', 'converged'}
        assert all('planar motion' in warning or 'of the variance' in warning for warning in run.last.warnings)
    low, high = chi2.interval(0.998, count * len(runs))
    assert low < sum(run.misfit for run in runs) < high


def test_the_innovations_are_as_large_as_they_should_be(runs: list[Run]) -> None:
    assert 0.9 < np.mean([run.last.residual**2 for run in runs]) < 1.15


def test_the_unknowns_are_found_within_what_is_reported(runs: list[Run]) -> None:
    for run in runs:
        low, high = chi2.interval(0.998, len(run.error))
        assert low < float(run.error @ np.linalg.solve(run.covariance, run.error)) < high
        # Some are learnt to a tenth of what was declared, and none is less known than before.
        deviation = np.sqrt(np.diag(run.covariance))
        assert deviation.min() < 0.12
        assert deviation.max() < 1.0 + 1e-9


@pytest.mark.parametrize('runs', CASES[:1], indirect=True)
def test_taken_for_exact_they_lead_astray_which_shows(runs: list[Run]) -> None:
    run = runs[0]
    robot = run.case.robot
    exact = make(robot, MID).update(windows(run.samples)[:24], 0)[-1]  # they show within 12 s
    # Far beyond the intervals that the noise alone would give; correlated innovations widen them.
    assert normalised(exact, robot) > normalised(run.last, robot)
    assert exact.status == 'inconsistent'
    assert any('does not explain the data' in warning for warning in exact.warnings)


@pytest.mark.parametrize('share', [0.02, pytest.param(-0.02, marks=pytest.mark.long)])
def test_of_bodies_that_are_off_as_a_whole_the_target_is_found_within_what_is_reported(
    share: float, unchanged: Unchanged
) -> None:
    """No motion determines a factor of all bodies: the target is as far off as they are, and so is its interval."""
    robot = kernel('ets7')
    errors = replace(ModelErrors.zero(robot.model.joints), bodies=share * robot.known)
    truth = configured_motion('ets7', 30.0, 20.0, errors)
    last = unchanged.course(identify(robot, truth, MID, 1, method='trajectory', known_links__relative_std=0.01))
    away = (last.parameters - true_body(robot)) / last.std
    assert last.identifiable.all()
    assert last.parameters[0] / true_body(robot)[0] - 1.0 == pytest.approx(-share, abs=0.005)
    assert np.abs(away).max() < 2.5


MASS, MASS_STD = 160.0, 2.0  # kg
COM, COM_STD = (0.3, -0.2, 0.75), 0.004  # m
LIMIT = float(chi2.isf(1e-3, 4))


def prior(robot: MomentumKernel, target: TargetPrior) -> tuple[Array, Array]:
    """Return mean (10,) and covariance (10, 10) that the filter starts with."""
    space = variables(Layout.from_unknowns(robot, ()), PlaneDetector(robot.model), Declared(target=target))
    distribution = MeanAndCovariance.from_gaussian(SquareRootInformation.prior(space), space)
    factor = distribution.factor[BODY]
    return distribution.mean[BODY], factor @ factor.T


@pytest.mark.parametrize('given', [TargetPrior(mass=MASS, com=COM), TargetPrior(com=COM, com_std=COM_STD)])
def test_nothing_is_known_of_it_where_no_mass_is_known(servicer7: MomentumKernel, given: TargetPrior) -> None:
    mean, covariance = prior(servicer7, given)
    nothing = prior(servicer7, TargetPrior())
    assert np.array_equal(mean, nothing[0])
    assert np.array_equal(covariance, nothing[1])
    assert np.all(mean == 0.0)
    # By far more than the robot weighs.
    assert covariance[0, 0] > np.sum(servicer7.known[:, 0]) ** 2


def test_a_mass_and_a_centre_of_mass_that_are_known(servicer7: MomentumKernel) -> None:
    mean, covariance = prior(servicer7, TargetPrior(MASS, MASS_STD, COM, COM_STD))
    assert mean[:4] == pytest.approx([MASS, *(MASS * np.array(COM))])
    # h = m c: of the centre h / m, to first order, only its own uncertainty is left.
    drawn = np.random.default_rng(2).multivariate_normal(mean[:4], covariance[:4, :4], 40_000)
    centre = drawn[:, 1:] / drawn[:, :1]
    assert centre.mean(axis=0) == pytest.approx(COM, abs=2e-4)
    assert np.cov(centre.T) == pytest.approx(COM_STD**2 * np.eye(3), abs=0.03 * COM_STD**2)
    assert np.std(drawn[:, 0]) == pytest.approx(MASS_STD, rel=0.02)


def test_a_mass_that_is_held_takes_the_centre_of_mass_along(servicer7: MomentumKernel) -> None:
    declared = Declared(target=TargetPrior(MASS, MASS_STD, COM, COM_STD))
    space = variables(Layout.from_unknowns(servicer7, ()), PlaneDetector(servicer7.model), declared)
    held = 100.0
    gaussian = SquareRootInformation.prior(space, mass=held)
    distribution = MeanAndCovariance.from_gaussian(gaussian, space)
    assert distribution.mean[BODY][:4] == pytest.approx([held, *(held * np.array(COM))])
    # Nearer than it would be held is what is known of it.
    assert distribution.deviation[BODY.start] == pytest.approx(MASS_STD)
    assert gaussian.log_likelihood == 0.0


def test_a_mass_that_is_known_is_the_one_to_start_from() -> None:
    """Poor encoders in a plane: bodies of quite other masses fit as well, but for what is declared."""
    robot = kernel('table1')
    mass = physical(robot.target.parameters)[0]
    cut = windows(observe(configured_motion('table1', 20.0, RATE), HIGH, 3))
    starts = []
    for target in (TargetPrior(), TargetPrior(1.01 * mass, 0.01 * mass)):
        estimates = make(robot, HIGH, declared=replace(DEFAULT, target=target)).update(cut, 0)
        reported = [each for each in estimates if each.std[0] > 0.0]
        assert normalised(reported[-1], robot) < LIMIT
        starts.append((reported[0].time, reported[-1].std[0]))
    without, known = starts
    assert known[0] < without[0]
    assert known[1] < min(without[1], 0.01 * mass)


@pytest.mark.parametrize('alone', [False, True])
def test_an_imu_alone_has_no_odometry_mount(alone: bool) -> None:
    """The rest is declared alike."""
    robot = kernel('servicer7')
    joints, rng = robot.model.joints, np.random.default_rng(1)
    factor = 1e-3 * rng.normal(size=(16 + 6 * joints, 16 + 6 * joints))
    nominal = CalibratedModel((robot.model.links[0],), np.full(joints, 1e-3), np.full(6, 0.01), factor @ factor.T)
    declared = (gyro(GyroErrors(bias=1e-3, alone=alone)),)
    _, unknowns, carried = nominal.with_kernel(robot, declared, located=not alone)
    assert any(isinstance(unknown, OdometryMount) for unknown in unknowns) is not alone
    assert len(carried.mean) == sum(unknown.count for unknown in unknowns)
    kept = carried.factor[: 10 + 6 * joints]
    scale = np.concatenate([np.linalg.norm(unknown.factor, axis=0) for unknown in unknowns])[: len(kept)]
    covariance = kept @ kept.T * scale * scale[:, None]
    assert np.diag(covariance)[10:] == pytest.approx(np.diag(factor @ factor.T)[10:-6], rel=1e-6)


def test_numbers_without_variance_leave_the_others_as_they_are() -> None:
    factor = np.random.default_rng(0).normal(size=(4, 4))
    factor[[1, 3]] = 0.0
    carried = UnknownsPrior(np.zeros(4), factor)
    some = [0, 2]
    assert np.all(np.isfinite(carried.triangle))
    white = carried.whitening[np.ix_(some, some)] @ factor[some]
    assert white @ white.T == pytest.approx(np.eye(2), abs=1e-9)
