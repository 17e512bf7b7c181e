"""What is known beforehand of the target, and of a robot after a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from floating import DEFAULT, RATE, make, normalised
from mbaid_ros.core.filter.square_root import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.filter.variables import variables
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.unknowns.base import OdometryMount
from mbaid_ros.core.unknowns.bodies import TargetPrior
from mbaid_ros.core.unknowns.catalogue import CalibratedSide, Uncertainty, catalogue
from mbaid_ros.core.unknowns.priors import UnknownsPrior
from mbaid_ros.core.unknowns.sensors import GyroErrors
from observed import HIGH, configured_motion, kernel, observe, windows

MASS, MASS_STD = 160.0, 2.0  # kg
COM, COM_STD = (0.3, -0.2, 0.75), 0.004  # m
LIMIT = float(chi2.isf(1e-3, 4))


def prior(robot: MomentumKernel, target: TargetPrior) -> tuple[Array, Array]:
    """Return mean (10,) and covariance (10, 10) that the filter starts with."""
    space = variables(Layout.of(robot, ()), PlaneDetector(robot.model), Uncertainty(target=target))
    distribution = MeanAndCovariance.of(SquareRootInformation.prior(space), space)
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
    uncertainty = Uncertainty(target=TargetPrior(MASS, MASS_STD, COM, COM_STD))
    space = variables(Layout.of(servicer7, ()), PlaneDetector(servicer7.model), uncertainty)
    held = 100.0
    gaussian = SquareRootInformation.prior(space, mass=held)
    distribution = MeanAndCovariance.of(gaussian, space)
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
        estimates = make(robot, HIGH, uncertainty=replace(DEFAULT, target=target)).update(cut, 0)
        told = [each for each in estimates if each.std[0] > 0.0]
        assert normalised(told[-1], robot) < LIMIT
        starts.append((told[0].time, told[-1].std[0]))
    without, known = starts
    assert known[0] < without[0]
    assert known[1] < min(without[1], 0.01 * mass)


@pytest.mark.parametrize('alone', [False, True])
def test_an_imu_alone_has_no_odometry_mount(alone: bool) -> None:
    """Of the rest it is told the same."""
    robot = kernel('servicer7')
    joints, rng = robot.model.joints, np.random.default_rng(1)
    factor = 1e-3 * rng.normal(size=(16 + 6 * joints, 16 + 6 * joints))
    side = CalibratedSide((robot.model.links[0],), np.full(joints, 1e-3), np.full(6, 0.01), factor @ factor.T)
    known, uncertainty = side.known_to(robot, Uncertainty(gyro=GyroErrors(bias=1e-3, alone=alone)))
    unknowns = catalogue(known, uncertainty)
    assert any(isinstance(unknown, OdometryMount) for unknown in unknowns) is not alone
    assert uncertainty.carried is not None
    assert len(uncertainty.carried.mean) == sum(unknown.count for unknown in unknowns)
    kept = uncertainty.carried.factor[: 10 + 6 * joints]
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
