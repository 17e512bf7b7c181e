"""A simulated capture: momentum goes on, poses and joint rates do not jump, both then move as one."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from benchmarks.precapture import free_model
from captured import LINK, alone, servicer_motion
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import rotation_from_quaternion
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.simulation.capture import CaptureSimulation, Target
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from simulated import robot, state

TIME = 3.33  # s, between two steps
STEP = 0.05
TARGET = Target(TIME, LINK, physical(alone()), np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015]))
INSTANTS = np.concatenate((np.arange(0.0, TIME, 0.1), [TIME - 1e-6, TIME], np.arange(TIME + 0.1, 8.0, 0.1)))


def make() -> CaptureSimulation:
    motion = servicer_motion()
    start = state(motion.start, motion.reference(0.0)[1], (0.01, -0.015, 0.02))
    return CaptureSimulation(free_model(), motion, start, STEP, TARGET)


@pytest.fixture(scope='module', name='truth')
def captured() -> Truth:
    return make().advance(INSTANTS)


def test_the_momentum_of_both_is_that_of_the_whole(truth: Truth) -> None:
    simulation = make()
    before = total_momentum(free_model(), truth[INSTANTS < TIME])
    after = total_momentum(simulation.joined, truth[INSTANTS >= TIME])
    assert before == pytest.approx(np.tile(before[0], (len(before), 1)), abs=1e-7)
    assert after == pytest.approx(np.tile(before[0] + simulation.brought, (len(after), 1)), abs=1e-7)
    assert simulation.momentum == pytest.approx(after[0], abs=1e-9)


def test_what_is_brought_is_the_target_s_own(truth: Truth) -> None:
    """The target's bodies as particles would have it: by the motion of its link, if it had been held."""
    at = truth[np.flatnonzero(INSTANTS == TIME)]
    model = free_model()
    kernel = MomentumKernel(model, LINK)
    rotation = rotation_from_quaternion(at.base_orientation)
    states = kernel.states_of(rotation, at.joint_position, 0.0 * at.joint_velocity, np.zeros((1, 6)))
    centre = states.position[0] + states.rotation[0] @ TARGET.body[1:4]
    # A base that turns with the target's spin, and whose origin moves so that the target's centre has its velocity.
    twist = np.concatenate((TARGET.velocity - np.cross(TARGET.spin, centre), TARGET.spin))
    held = kernel.states_of(rotation, at.joint_position, 0.0 * at.joint_velocity, twist[None])
    expected = (held.regressor @ alone())[0]
    expected[3:] += np.cross(at.base_position[0], expected[:3])
    assert make().brought == pytest.approx(expected, abs=1e-9)


def test_poses_and_joint_rates_go_on_and_the_base_s_twist_jumps(truth: Truth) -> None:
    before, after = (truth[np.flatnonzero(time == INSTANTS)] for time in (TIME - 1e-6, TIME))
    for name in ('base_position', 'base_orientation', 'joint_position', 'joint_velocity'):
        assert getattr(after, name) == pytest.approx(getattr(before, name), abs=1e-6)
    jump = after.base_linear_velocity - before.base_linear_velocity
    assert float(np.linalg.norm(jump)) > 1e-3


def test_after_it_both_move_as_one(truth: Truth) -> None:
    after = truth[INSTANTS >= TIME]
    joined = make().joined
    assert physical(joined.link(LINK).parameters) == pytest.approx(physical(robot('servicer7').link(LINK).parameters))
    velocity = np.concatenate((after.base_linear_velocity, after.base_angular_velocity, after.joint_velocity), axis=1)
    start = state(after.joint_position[0], after.joint_velocity[0])
    values = {**vars(start), 'base_position': after.base_position[0], 'base_orientation': after.base_orientation[0]}
    values['velocity'] = velocity[0]
    again = Simulation(joined, servicer_motion().later(TIME), type(start)(**values), 0.02)
    expected = again.advance(after.time - TIME)
    assert after.base_position == pytest.approx(expected.base_position, abs=1e-8)
    assert after.joint_position == pytest.approx(expected.joint_position, abs=1e-8)


def test_batches_make_no_difference(truth: Truth) -> None:
    simulation = make()
    parts = [simulation.advance(part) for part in np.array_split(INSTANTS, 7)]
    for item in fields(Truth):
        together = np.concatenate([getattr(part, item.name) for part in parts])
        assert np.array_equal(together, getattr(truth, item.name))
    assert len(simulation.advance(np.zeros(0))) == 0
    with pytest.raises(DataError, match='past instant'):
        simulation.advance(np.array([1.0]))
