"""Reaction wheels are joints like others: with their speeds the estimate holds, without them the methods object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from floating import RATE, float_freely, normalised
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth
from observed import MID, identify
from wheels import FREQUENCY, TOP, spinning, unaware, wheeled

SECONDS = 20.0
# Ten parameters, one run in a thousand.
LIMIT = float(chi2.isf(1e-3, 10))


@pytest.fixture(scope='module')
def run(joints: Sinusoids) -> Truth:
    momentum = np.array([16.0, -8.0, 24.0, 30.0, -35.0, 60.0])
    return float_freely(wheeled(), spinning(joints), momentum, SECONDS)


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_wheels_that_are_read_make_no_difference(run: Truth, method: str) -> None:
    assert run.joint_velocity.max() == pytest.approx(TOP * np.sin(2.0 * np.pi * FREQUENCY * (SECONDS - 1.0 / RATE)))
    last = identify(wheeled(), run, MID, 3, method=method)[-1]
    assert normalised(last, wheeled()) < LIMIT
    assert not last.events
    assert last.status in {'estimating', 'converged'}


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_wheels_that_nobody_tells_of_are_noticed(run: Truth, method: str) -> None:
    arm = [index for index, name in enumerate(wheeled().model.joint_names) if not name.startswith('wheel')]
    robot = MomentumKernel(load_model(unaware()), 'link7')
    assert robot.model.joint_names == tuple(wheeled().model.joint_names[index] for index in arm)
    told = replace(
        run,
        joint_position=run.joint_position[:, arm],
        joint_velocity=run.joint_velocity[:, arm],
        joint_effort=run.joint_effort[:, arm],
    )
    last = identify(robot, told, MID, 3, method=method)[-1]
    assert last.status == 'inconsistent' or last.events
    assert method == 'difference' or last.causes
