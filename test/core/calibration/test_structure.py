"""What momentum can tell of all bodies: rank and null space against theory, base parameters, and their words."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.calibration.structure import Mechanism, formula, structure
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel
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


def test_formulas_an_engineer_reads() -> None:
    what = mechanism(robot('table1'), NORMAL['table1'])
    total, *others = structure(what).base_parameters()
    assert total.factors[::10] == pytest.approx(np.ones(5), abs=1e-9)
    # The bodies beyond hang at the next hinge, 4 m away.
    assert 'link3.hx + 4 link4.m' in {formula(what.kernel.unknown, each.factors) for each in others}
