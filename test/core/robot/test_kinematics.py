"""Poses and twists of random trees with all types of joints, against pinocchio's forward kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import load_model
from peer import Motion, Peer
from random_robots import random_state, random_urdf

SEEDS = range(8)
COUNT = 20
# Positions and velocities of size one at the end of up to nine joints.
ROUNDING = 1e-12


def random_case(seed: int) -> tuple[Kinematics, Motion]:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=9))
    position, velocity, rotation, twist = random_state(rng, model.joints, COUNT)
    return Kinematics(model), Motion(rotation, position, velocity, twist)


@pytest.mark.parametrize('seed', SEEDS)
def test_poses_and_twists_are_those_of_pinocchio(seed: int) -> None:
    kinematics, motion = random_case(seed)
    model, peer = kinematics.model, Peer(kinematics.model)
    configuration = kinematics.configure(motion.base_rotation, motion.joint_position)
    twists = kinematics.body_twists(configuration, motion.joint_velocity, motion.base_twist)
    for index in range(COUNT):
        peer.to(motion, index)
        for body in range(model.joints + 1):
            rotation, position = peer.placement(body)
            assert configuration.rotation[index, body] == pytest.approx(rotation, abs=ROUNDING)
            assert configuration.position[index, body] == pytest.approx(position, abs=ROUNDING)
            assert twists[index, body] == pytest.approx(peer.twist(body), abs=10.0 * ROUNDING)
        for link in model.links:
            rotation, position = peer.link(link.name)
            found_rotation, found_position = configuration.link(link)
            assert found_rotation[index] == pytest.approx(rotation, abs=ROUNDING)
            assert found_position[index] == pytest.approx(position, abs=ROUNDING)


@pytest.mark.parametrize('seed', SEEDS)
def test_joint_twists_are_the_velocities_of_one_joint_alone(seed: int) -> None:
    kinematics, motion = random_case(seed)
    configuration = kinematics.configure(motion.base_rotation, motion.joint_position)
    for joint in range(kinematics.model.joints):
        velocity = np.zeros((COUNT, kinematics.model.joints))
        velocity[:, joint] = 1.0
        twists = kinematics.body_twists(configuration, velocity, np.zeros((COUNT, 6)))
        moved = kinematics.ancestors[:, joint] == 1.0
        assert np.array_equal(twists[:, ~moved], np.zeros_like(twists[:, ~moved]))
        expected = np.repeat(configuration.joint_twist[:, joint, None], int(moved.sum()), axis=1)
        assert np.array_equal(twists[:, moved], expected)


def test_a_robot_without_joints_is_its_base() -> None:
    kinematics = Kinematics(load_model('<robot name="r"><link name="base"/></robot>'))
    _, _, rotation, twist = random_state(np.random.default_rng(0), 0, COUNT)
    configuration = kinematics.configure(rotation, np.zeros((COUNT, 0)))
    assert np.array_equal(configuration.rotation[:, 0], rotation)
    assert not configuration.position.any()
    assert np.array_equal(kinematics.body_twists(configuration, np.zeros((COUNT, 0)), twist)[:, 0], twist)
