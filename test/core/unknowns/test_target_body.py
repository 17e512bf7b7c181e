"""What is known of the target beforehand, as the filter starts with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from floating import DEFAULT, RATE, make, normalised
from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.filter.variables import variables
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.unknowns.bodies import TargetPrior
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from observed import HIGH, configured_motion, kernel, observe, windows

MASS, MASS_STD = 160.0, 2.0  # kg
COM, COM_STD = (0.3, -0.2, 0.75), 0.004  # m
LIMIT = float(chi2.isf(1e-3, 4))


def prior(robot: MomentumKernel, target: TargetPrior) -> tuple[Array, Array]:
    """Return mean (10,) and covariance (10, 10) that the filter starts with."""
    space = variables(Layout.of(robot, ()), PlaneDetector(robot.model), Uncertainty(target=target))
    moments = MeanAndCovariance.of(SquareRootInformation.prior(space), space)
    factor = moments.factor[BODY]
    return moments.mean[BODY], factor @ factor.T


def test_nothing_is_known_of_it_where_nothing_is_said(servicer7: MomentumKernel) -> None:
    mean, covariance = prior(servicer7, TargetPrior(mass=MASS, com=COM))
    nothing = prior(servicer7, TargetPrior())
    assert np.array_equal(mean, nothing[0])
    assert np.array_equal(covariance, nothing[1])
    assert np.all(mean == 0.0)
    # By far more than the robot weighs.
    assert covariance[0, 0] > np.sum(servicer7.known[:, 0]) ** 2


def test_a_mass_that_is_known(servicer7: MomentumKernel) -> None:
    mean, covariance = prior(servicer7, TargetPrior(MASS, MASS_STD))
    assert mean == pytest.approx([MASS, *[0.0] * 9])
    assert covariance[0, 0] == pytest.approx(MASS_STD**2)
    assert covariance[1:, 1:] == pytest.approx(prior(servicer7, TargetPrior())[1][1:, 1:])


def test_a_mass_and_a_centre_of_mass_that_are_known(servicer7: MomentumKernel) -> None:
    mean, covariance = prior(servicer7, TargetPrior(MASS, MASS_STD, COM, COM_STD))
    assert mean[:4] == pytest.approx([MASS, *(MASS * np.array(COM))])
    # h = m c: of the centre h / m, to first order, only its own uncertainty is left.
    drawn = np.random.default_rng(2).multivariate_normal(mean[:4], covariance[:4, :4], 40_000)
    centre = drawn[:, 1:] / drawn[:, :1]
    assert centre.mean(axis=0) == pytest.approx(COM, abs=2e-4)
    assert np.cov(centre.T) == pytest.approx(COM_STD**2 * np.eye(3), abs=0.03 * COM_STD**2)
    assert np.std(drawn[:, 0]) == pytest.approx(MASS_STD, rel=0.02)


def test_a_centre_of_mass_alone_is_not_used(servicer7: MomentumKernel) -> None:
    alone, nothing = (prior(servicer7, each) for each in (TargetPrior(com=COM, com_std=COM_STD), TargetPrior()))
    assert np.array_equal(alone[0], nothing[0])
    assert np.array_equal(alone[1], nothing[1])


def test_a_mass_that_is_held_takes_the_centre_of_mass_along(servicer7: MomentumKernel) -> None:
    uncertainty = Uncertainty(target=TargetPrior(MASS, MASS_STD, COM, COM_STD))
    space = variables(Layout.of(servicer7, ()), PlaneDetector(servicer7.model), uncertainty)
    held = 100.0
    belief = SquareRootInformation.prior(space, mass=held)
    moments = MeanAndCovariance.of(belief, space)
    assert moments.mean[BODY][:4] == pytest.approx([held, *(held * np.array(COM))])
    # Nearer than it would be held is what is known of it.
    assert moments.deviation[BODY.start] == pytest.approx(MASS_STD)
    assert belief.log_likelihood == 0.0


def test_a_mass_that_is_known_is_the_one_to_start_from() -> None:
    """Poor encoders in a plane: bodies of quite other masses fit as well, but for what is declared."""
    robot = kernel('table1')
    mass = physical(robot.target.parameters)[0]
    cut = windows(observe(configured_motion('table1', 20.0, RATE, 0.05), HIGH, 3))
    starts = []
    for target in (TargetPrior(), TargetPrior(1.01 * mass, 0.01 * mass)):
        estimates = make(robot, HIGH, uncertainty=replace(DEFAULT, target=target)).update(cut, 0)
        told = [each for each in estimates if each.std[0] > 0.0]
        assert normalised(told[-1], robot) < LIMIT
        starts.append((told[0].time, told[-1].std[0]))
    without, known = starts
    assert known[0] < without[0]
    assert known[1] < min(without[1], 0.01 * mass)
