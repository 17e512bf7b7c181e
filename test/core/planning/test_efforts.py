from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.planning.collisions import Efforts
from mbaid_ros.planning.limits import BaseLimits
from mbaid_ros.simulation.dynamics import Dynamics, State
from planned import Begun, planner
from simulated import robot

BODY = np.array([90.0, 0.2, 0.1, -0.3, 20.0, 1.0, -2.0, 25.0, 0.5, 30.0])


def weaker(model: RobotModel, effort: float) -> RobotModel:
    return replace(model, limits=tuple(replace(limit, effort=effort) for limit in model.limits))


@pytest.mark.parametrize('name', ['servicer7', 'ets7', 'table1'])
def test_torques_are_those_that_drive_the_simulated_robot_with_the_estimated_body(name: str) -> None:
    model = robot(name)
    kernel = MomentumKernel(model, model.last_link)
    heavy = load_model(replace_inertial(model.urdf, model.last_link, BODY), model.base_link)
    bodies = kernel.with_target(MomentumKernel(heavy, model.last_link).target.parameters)
    generator = np.random.default_rng(0)
    place, rate, bend = generator.standard_normal((3, 5, model.joints))
    twist = generator.standard_normal((5, 6))
    found = Efforts(model, bodies).torques(place, rate, bend, twist)
    driven = Dynamics(heavy)
    for index, torque in enumerate(found):
        state = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), place[index], np.append(twist[index], rate[index]))
        assert torque == pytest.approx(driven.torque(state, bend[index]), rel=1e-9, abs=1e-9)


def test_limits_are_those_of_the_urdf() -> None:
    model = robot('servicer7')
    bodies = model.body_parameters()
    assert Efforts(model, bodies).limits == pytest.approx([80.0, 80.0, 80.0, 60.0, 40.0, 40.0, 40.0])
    assert not Efforts(weaker(model, np.inf), bodies).limited


def test_a_motion_keeps_the_effort_limits_and_names_them_where_they_bind(servicer: Begun) -> None:
    strong, weak = planner(servicer, duration=6.0), planner(servicer, duration=6.0)
    weak.motions.efforts.limits = np.full(7, 2.0)
    plan, held = strong.plan(), weak.plan()
    assert plan.use[3].max() > 0.05
    assert held.use[3].max() * 2.0 < 0.9 * (plan.use[3] * strong.motions.efforts.limits).max()
    assert 0.9 < held.use[3].max() <= 1.0
    assert 'the effort limits of the joints' in held.binding
    assert held.verdict.endswith('the effort limits of the joints')
    assert held.ratio > plan.ratio


def test_efforts_hold_beside_limits_of_the_base(servicer: Begun) -> None:
    weak = planner(servicer, duration=6.0, base=BaseLimits(rotation=np.radians(1.0)))
    weak.motions.efforts.limits = np.full(7, 3.0)
    plan = weak.plan()
    assert plan.use[3].max() <= 1.0
    assert plan.bounds.sure[0] <= np.radians(1.0) + 1e-9


def test_what_it_takes_to_hold_joints_is_no_motions_to_make_smaller(servicer: Begun) -> None:
    weak = planner(servicer, duration=6.0)
    holding = weak.motions.holding * weak.motions.efforts.limits
    weak.motions.efforts.limits = 2.0 * holding + 0.01
    del weak.motions.__dict__['holding']
    plan = weak.plan()
    assert 0.9 < plan.use[3].max() <= 1.0
    assert np.ptp(plan.trajectory.position, axis=0).max() > 1e-4


def test_joints_that_cannot_be_held_are_named(servicer: Begun) -> None:
    weak = planner(servicer, duration=6.0)
    weak.motions.efforts.limits[2] = 1e-4
    del weak.motions.__dict__['holding']
    with pytest.raises(ParameterError, match="to hold joint 'joint3' while the base tumbles takes"):
        weak.motions.require_hold()
    assert planner(servicer, duration=6.0, stuck=('joint3',)).motions.holding[2] == 0.0
