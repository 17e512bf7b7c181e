"""What momentum can tell of all bodies: rank and null space against theory, base parameters, and their words."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.calibration.structure import Mechanism, Structure, base_parameter, formula, structure
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel
from random_robots import random_state
from simulated import robot

NORMAL = {'table1': np.array([0.0, 0.0, 1.0]), 'servicer7': None, 'ets7': None}


def all_unknown(model: RobotModel) -> MomentumKernel:
    return MomentumKernel(model, *(link.name for link in model.links))


def mechanism(model: RobotModel, normal: Array | None = None, resting: tuple[int, ...] = ()) -> Mechanism:
    moving = np.ones(model.joints, dtype=bool)
    moving[list(resting)] = False
    return Mechanism(all_unknown(model), moving, np.linspace(-0.4, 0.9, model.joints), normal)


def theory(model: RobotModel, *, planar: bool) -> int:
    """Return the rank of the momentum of an n-joint serial chain of revolute joints that are not parallel."""
    joints = model.joints
    # In space three exchanges a joint: mass, first moment and a rod's inertia on the axis. In a plane mass alone.
    return 4 * (joints + 1) - joints if planar else 10 * (joints + 1) - 3 * joints


@pytest.mark.parametrize('name', NORMAL)
def test_the_rank_is_that_of_the_theory(name: str) -> None:
    model = robot(name)
    assert structure(mechanism(model, NORMAL[name])).rank == theory(model, planar=name == 'table1')


def momentum_of(kernel: MomentumKernel, direction: Array, resting: tuple[int, ...], posture: Array) -> Array:
    """Return the momentum of a direction of theta at states of the test's own."""
    rng = np.random.default_rng(77)
    position, velocity, rotation, twist = random_state(rng, kernel.model.joints, 30)
    position[:, list(resting)] = posture[list(resting)]
    velocity[:, list(resting)] = 0.0
    states = kernel.states_of(rotation, position, velocity, twist)
    return np.asarray(np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=2) @ direction)


def test_words_an_engineer_reads() -> None:
    what = mechanism(robot('table1'), NORMAL['table1'])
    found = structure(what)
    told = {base_parameter(what, each): each for each in found.base_parameters()}
    total = told['mass of base_link, with all the mass that joint1 carries']
    assert total.factors[::10] == pytest.approx(np.ones(5), abs=1e-9)
    # The bodies beyond hang at the next hinge, 4 m away.
    augmented = told['first moment along x of link3, with mass of link4']
    assert formula(what.kernel.unknown, augmented.factors) == 'link3.hx + 4 link4.m'
    assert isinstance(found, Structure)
