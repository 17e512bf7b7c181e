from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.config.simulator import InitialConfig, MotionConfig, SimulatorConfig
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.simulated_run import SimulatedRun
from mbaid_ros.simulation.motion import random_sinusoids
from mbaid_ros.simulation.steered import Steered, made_to_follow
from simulated import CONFIG, robot

NOTHING = np.zeros((0, 0))
SERVICER = robot('servicer7')
TIMES = np.array([0.0, 2.0])


def to(goal: float, begin: float = 0.0, time: float = 0.0) -> JointTrajectory:
    position, rest = np.array([[begin], [goal]]), np.zeros((2, 1))
    return JointTrajectory(('joint3',), TIMES + time, position, rest, rest)


def test_a_trajectory_takes_over_from_where_the_joints_are_and_as_they_move() -> None:
    first = random_sinusoids(np.zeros(7), 0, 2, 0.01, 5.0, 9.0)
    motion = Steered(first)
    for order in range(3):
        assert motion.reference(0.7)[order] == pytest.approx(first.reference(0.7)[order])
    motion.follow(to(0.2), SERVICER, 1.0)
    assert motion.reference(1.0)[0] == pytest.approx(first.reference(1.0)[0])
    assert motion.reference(1.0)[1][2] == pytest.approx(first.reference(1.0)[1][2])
    assert motion.reference(0.99)[0] == pytest.approx(first.reference(0.99)[0])
    end = motion.reference(3.5)
    assert end[0][2] == pytest.approx(0.2)
    assert np.delete(end[0], 2) == pytest.approx(np.delete(first.reference(1.0)[0], 2))
    assert not end[1].any()
    later = motion.later(0.5)
    assert later.reference(3.0)[0] == pytest.approx(end[0])
    later.follow(to(0.1, 0.2), SERVICER, 4.0)
    assert motion.reference(9.0)[0][2] == pytest.approx(0.1)


def test_a_first_point_that_is_still_to_come_is_gone_to() -> None:
    motion = made_to_follow(to(0.5, 0.4, time=1.0), SERVICER, np.zeros(7), 0.0)
    assert motion.reference(0.0)[0][2] == 0.0
    assert motion.reference(1.0)[0][2] == pytest.approx(0.4)


def test_a_trajectory_of_other_joints_or_another_place_is_refused() -> None:
    other = JointTrajectory(('elbow',), np.zeros(1), np.zeros((1, 1)), NOTHING, NOTHING)
    with pytest.raises(DataError, match="moves 'elbow'; accepted: joints among joint1, joint2"):
        made_to_follow(other, SERVICER, None, 0.0)
    with pytest.raises(DataError, match=r"begins with 'joint3' at 0.3, which is at 0; accepted: within 0.05 of it"):
        made_to_follow(to(0.5, 0.3), SERVICER, np.zeros(7), 0.0)


def test_a_run_is_told_to_follow_on_the_way() -> None:
    path = str(CONFIG / 'servicer7.urdf')
    config = SimulatorConfig(
        robot_description_file=path, joint_rate=10.0, odometry_rate=10.0, step=0.05, motion=MotionConfig(kind='random')
    )
    run = SimulatedRun(config, SERVICER.urdf, BAG_TYPES)
    before = [timed.message for timed in run.read(1.0) if timed.topic == 'joint_states']
    place = float(before[-1].position[2])
    begin = run.follow(to(place + 0.1, place))
    assert begin == pytest.approx(1.1)
    after = [timed.message for timed in run.read(4.0) if timed.topic == 'joint_states']
    assert after[-1].position[2] == pytest.approx(place + 0.1, abs=2e-3)
    assert np.abs(after[-1].velocity).max() < 0.02


def test_joints_that_nothing_drives_follow_nothing() -> None:
    initial = InitialConfig()
    run = SimulatedRun(SimulatorConfig(initial=initial), SERVICER.urdf, BAG_TYPES)
    with pytest.raises(DataError, match=r"motion.kind is 'passive'"):
        run.follow(to(0.1))
