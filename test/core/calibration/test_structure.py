"""What momentum can tell of all bodies: rank and null space against theory, base parameters, and their words."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.calibration.structure import Mechanism, Structure, base_parameter, exchanges, formula, structure
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from random_robots import random_state, random_urdf
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


@pytest.mark.parametrize('name', NORMAL)
def test_base_parameters_hold_all_that_momentum_tells(name: str) -> None:
    model = robot(name)
    found = structure(mechanism(model, NORMAL[name]))
    parameters = found.base_parameters()
    assert len(parameters) == found.rank
    theta = np.random.default_rng(1).normal(size=found.unknowns)
    values = [parameter.factors @ theta / found.scale[parameter.leading] for parameter in parameters]
    leading = found.regressor[:, [parameter.leading for parameter in parameters]]
    whole = found.regressor @ (theta / found.scale)
    assert leading @ values == pytest.approx(whole, abs=1e-5 * float(np.abs(whole).max()))


def momentum_of(kernel: MomentumKernel, direction: Array, resting: tuple[int, ...], posture: Array) -> Array:
    """Return the momentum of a direction of theta at states of the test's own."""
    rng = np.random.default_rng(77)
    position, velocity, rotation, twist = random_state(rng, kernel.model.joints, 30)
    position[:, list(resting)] = posture[list(resting)]
    velocity[:, list(resting)] = 0.0
    states = kernel.states_of(rotation, position, velocity, twist)
    return np.asarray(np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=2) @ direction)


@pytest.mark.parametrize('seed', range(6))
def test_exchanges_span_the_null_space_of_any_tree(seed: int) -> None:
    """Random trees with sliding and fixed joints, some of them braked."""
    model = load_model(random_urdf(np.random.default_rng(seed), joints=6))
    resting = (1,) if seed % 2 and model.joints > 1 else ()
    what = mechanism(model, resting=resting)
    found = structure(what)
    exchanged = exchanges(what, found)
    directions = np.column_stack([each.directions for each in exchanged])
    scaled = directions / found.scale[:, None]
    assert np.linalg.matrix_rank(scaled / np.linalg.norm(scaled, axis=0), tol=1e-6) == found.unknowns - found.rank
    size = np.abs(found.regressor).max() * np.linalg.norm(scaled, axis=0).max()
    assert np.abs(momentum_of(what.kernel, directions, resting, what.posture)).max() < 1e-6 * size
    assert all('a combination' not in each.words for each in exchanged)


def test_words_an_engineer_reads() -> None:
    what = mechanism(robot('table1'), NORMAL['table1'])
    found = structure(what)
    assert [each.words for each in exchanges(what, found)] == [
        'mass between base_link and link1: on the axis of joint1',
        'mass between link1 and link2: on the axis of joint2',
        'mass between link2 and link3: on the axis of joint3',
        'mass between link3 and link4: on the axis of joint4',
        'everything out of the plane of motion, of every body',
    ]
    told = {base_parameter(what, each): each for each in found.base_parameters()}
    total = told['mass of base_link, with all the mass that joint1 carries']
    assert total.factors[::10] == pytest.approx(np.ones(5), abs=1e-9)
    # The bodies beyond hang at the next hinge, 4 m away.
    augmented = told['first moment along x of link3, with mass of link4']
    assert formula(what.kernel.unknown, augmented.factors) == 'link3.hx + 4 link4.m'
    assert isinstance(found, Structure)
