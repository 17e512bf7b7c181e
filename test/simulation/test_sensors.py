"""Simulated sensors, captures and thrust: noise as declared, momentum as it must be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.honesty.paths import servicer
from benchmarks.precapture import free_model
from mbaid_ros.core.forces import Thrust
from mbaid_ros.core.geometry import Array, log, rotation_from_quaternion
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation.changes import CaptureSimulation, Pulse, Target, ThrustSimulation
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Motion, Passive
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from observed import LOW, observe
from servicers import LINK, alone
from simulated import robot, state

NOISE = SensorNoise(1e-4, 2e-3, 3e-3, 4e-4, 5e-3, 6e-4)
COUNT = 20000


def still(count: int = COUNT) -> Truth:
    quaternion = np.array([0.1, -0.7, 0.5, 0.5])
    orientation = np.tile(quaternion / np.linalg.norm(quaternion), (count, 1))
    three, four = np.ones((count, 3)), np.ones((count, 4))
    return Truth(np.linspace(0.0, 1.0, count), four, four, four, three, orientation, three, three)


def test_every_channel_has_its_own_deviation() -> None:
    truth, sensors = still(), Sensors(NOISE, 1)
    joints, base = sensors.joints(truth), sensors.base(truth)
    turn = rotation_from_quaternion(base.orientation) @ np.swapaxes(
        rotation_from_quaternion(truth.base_orientation), 1, 2
    )
    channels = {
        'joint_position': joints.position - truth.joint_position,
        'joint_velocity': joints.velocity - truth.joint_velocity,
        'base_position': base.position - truth.base_position,
        'base_orientation': log(turn),  # about the fixed axes
        'base_linear_velocity': base.linear_velocity - truth.base_linear_velocity,
        'base_angular_velocity': base.angular_velocity - truth.base_angular_velocity,
    }
    for name, error in channels.items():
        deviation = getattr(NOISE, name)
        # Five standard errors of a mean and of a standard deviation of COUNT numbers.
        assert error.mean(axis=0) == pytest.approx(0.0, abs=5.0 * deviation / COUNT**0.5), name
        assert error.std(axis=0) == pytest.approx(deviation, rel=5.0 / (2.0 * COUNT) ** 0.5), name
        correlation = np.corrcoef(error.T) - np.eye(error.shape[1])
        assert np.abs(correlation).max() < 5.0 / COUNT**0.5, name
    assert np.array_equal(joints.effort, truth.joint_effort)


def test_the_covariances_are_those_of_the_noise() -> None:
    base = Sensors(NOISE, 1).base(still(1))
    assert np.diag(base.pose_covariance) == pytest.approx([9e-6] * 3 + [16e-8] * 3)
    assert np.diag(base.twist_covariance) == pytest.approx([25e-6] * 3 + [36e-8] * 3)


TIME = 3.33  # s
TARGET = Target(TIME, LINK, physical(alone()), np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015]))
INSTANTS = np.concatenate((np.arange(0.0, TIME, 0.1), [TIME - 1e-6, TIME], np.arange(TIME + 0.1, 8.0, 0.1)))


def capturing() -> CaptureSimulation:
    motion = servicer()
    start = state(motion.start, motion.reference(0.0)[1], (0.01, -0.015, 0.02))
    return CaptureSimulation(free_model(), motion, start, TARGET)


@pytest.fixture(scope='module', name='truth')
def captured() -> Truth:
    return capturing().advance(INSTANTS)


def test_the_momentum_of_both_is_that_of_the_whole(truth: Truth) -> None:
    simulation = capturing()
    before = total_momentum(free_model(), truth[INSTANTS < TIME])
    after = total_momentum(simulation.joined_model, truth[INSTANTS >= TIME])
    assert before == pytest.approx(np.tile(before[0], (len(before), 1)), abs=1e-7)
    assert after == pytest.approx(np.tile(before[0] + simulation.target_momentum, (len(after), 1)), abs=1e-7)
    assert simulation.total_momentum == pytest.approx(after[0], abs=1e-9)


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
    assert capturing().target_momentum == pytest.approx(expected, abs=1e-9)


def test_after_it_both_move_as_one(truth: Truth) -> None:
    after = truth[INSTANTS >= TIME]
    joined = capturing().joined_model
    assert physical(joined.link(LINK).parameters) == pytest.approx(physical(robot('servicer7').link(LINK).parameters))
    velocity = np.concatenate((after.base_linear_velocity, after.base_angular_velocity, after.joint_velocity), axis=1)
    start = state(after.joint_position[0], after.joint_velocity[0])
    values = {**vars(start), 'base_position': after.base_position[0], 'base_orientation': after.base_orientation[0]}
    values['velocity'] = velocity[0]
    again = Simulation(joined, servicer().from_time(TIME), type(start)(**values))
    expected = again.advance(after.time - TIME)
    assert after.base_position == pytest.approx(expected.base_position, abs=1e-8)
    assert after.joint_position == pytest.approx(expected.joint_position, abs=1e-8)


WRENCH = np.array([6.0, -6.0, 5.0, 3.0, 2.7, -3.0])
ODOM = 'odom'
BEGIN, END = 1.013, 1.527  # s
TIMES = np.arange(0.0, 3.0, 0.01)


def start() -> State:
    motion = servicer()
    turning = state(motion.start, motion.reference(0.0)[1], (0.01, -0.015, 0.02))
    return replace(turning, base_position=np.array([2.0, -1.0, 3.0]))


def thrusting(frame: str = 'base_link', motion: Motion | None = None, wrench: Array = WRENCH) -> ThrustSimulation:
    pulse = Pulse(BEGIN, END, None if frame == ODOM else robot('servicer7').link(frame), wrench)
    return ThrustSimulation(robot('servicer7'), motion or servicer(), start(), pulse)


@pytest.mark.parametrize('frame', ['base_link', 'link4', ODOM])
@pytest.mark.parametrize('passive', [False, True])
def test_the_momentum_changes_by_the_impulse(frame: str, passive: bool) -> None:
    truth = thrusting(frame, Passive() if passive else None).advance(TIMES)
    momentum = total_momentum(robot('servicer7'), truth)
    # The estimator's own account of the same thrust, at a hundred samples a second.
    known = Thrust(robot('servicer7'))
    known.odometry_frame = ODOM
    known.add_command(frame, round(BEGIN * 1e9), WRENCH, None)
    known.add_command(frame, round(END * 1e9), np.zeros(6), None)
    expected = known.with_momentum(observe(truth, LOW), 0).impulse
    assert np.linalg.norm(expected[-1, :3]) == pytest.approx((END - BEGIN) * np.linalg.norm(WRENCH[:3]), rel=1e-3)
    # Between two samples it takes the mean of both poses.
    assert momentum - momentum[0] == pytest.approx(expected, abs=3e-4)
