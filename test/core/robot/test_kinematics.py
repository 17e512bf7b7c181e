"""Poses, twists and the kernel's states: against pinocchio, and a batch as its samples to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import exp
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import express, load_model
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum
from peer import Motion, Peer
from random_robots import random_state, random_urdf
from simulated import robot

INSTANTS = 33


@pytest.mark.parametrize('seed', range(4))
def test_the_whole_is_the_sum_of_the_bodies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=int(rng.integers(2, 10))))
    position, velocity, rotation, twist = random_state(rng, model.joints, INSTANTS)
    kinematics, parameters = Kinematics(model), model.body_parameters()
    bodies = kinematics.configure(rotation, position)
    twists = kinematics.body_twists(bodies, velocity, twist)
    mobility, total = mobility_and_momentum(express(parameters, bodies.rotation, bodies.position), twists)
    expressed = express(parameters, bodies.rotation, bodies.position)
    locked = np.sum(inertia_matrix(expressed), axis=1)
    assert mobility @ locked == pytest.approx(np.broadcast_to(np.eye(6), locked.shape), abs=1e-11)
    assert total == pytest.approx(np.sum(momentum(expressed, twists), axis=1), rel=1e-12, abs=1e-10)
    for size in (1, 2, 7):
        for begin in range(0, INSTANTS, size):
            part = slice(begin, begin + size)
            alone = kinematics.configure(rotation[part], position[part])
            own = express(parameters, alone.rotation, alone.position)
            found = mobility_and_momentum(own, kinematics.body_twists(alone, velocity[part], twist[part]))
            assert np.array_equal(found[0], mobility[part])
            assert np.array_equal(found[1], total[part])


def test_mass_on_a_line_is_refused() -> None:
    rng = np.random.default_rng(0)
    model = load_model(random_urdf(rng, joints=3))
    position, velocity, rotation, twist = random_state(rng, model.joints, 2)
    kinematics = Kinematics(model)
    bodies = kinematics.configure(rotation, position)
    point = np.zeros_like(model.body_parameters())
    point[0, 0] = 1.0  # all of it in the base's origin
    with pytest.raises(np.linalg.LinAlgError):
        mobility_and_momentum(
            express(point, bodies.rotation, bodies.position), kinematics.body_twists(bodies, velocity, twist)
        )


TREES = range(8)
STATES = 20
# Positions and velocities of size one at the end of up to nine joints.
ROUNDING = 1e-12


def tree_in_motion(seed: int) -> tuple[Kinematics, Motion]:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=9))
    position, velocity, rotation, twist = random_state(rng, model.joints, STATES)
    return Kinematics(model), Motion(rotation, position, velocity, twist)


@pytest.mark.parametrize('seed', TREES)
def test_poses_and_twists_are_those_of_pinocchio(seed: int) -> None:
    kinematics, motion = tree_in_motion(seed)
    model, peer = kinematics.model, Peer(kinematics.model)
    configuration = kinematics.configure(motion.base_rotation, motion.joint_position)
    twists = kinematics.body_twists(configuration, motion.joint_velocity, motion.base_twist)
    for index in range(STATES):
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


@pytest.mark.parametrize('seed', TREES)
def test_joint_twists_are_the_velocities_of_one_joint_alone(seed: int) -> None:
    kinematics, motion = tree_in_motion(seed)
    configuration = kinematics.configure(motion.base_rotation, motion.joint_position)
    for joint in range(kinematics.model.joints):
        velocity = np.zeros((STATES, kinematics.model.joints))
        velocity[:, joint] = 1.0
        twists = kinematics.body_twists(configuration, velocity, np.zeros((STATES, 6)))
        moved = kinematics.ancestors[:, joint] == 1.0
        assert np.array_equal(twists[:, ~moved], np.zeros_like(twists[:, ~moved]))
        expected = np.repeat(configuration.joint_twist[:, joint, None], int(moved.sum()), axis=1)
        assert np.array_equal(twists[:, moved], expected)


@pytest.mark.parametrize(('name', 'rank'), [('table1', 16), ('servicer7', 59), ('ets7', 52)])
def test_the_momentum_of_all_bodies_depends_on_as_many_combinations_as_in_theory(name: str, rank: int) -> None:
    model, rng, count = robot(name), np.random.default_rng(20), 200
    kernel = MomentumKernel(model, *(link.name for link in model.links))
    turn, twist = rng.normal(size=(count, 3)), rng.normal(size=(count, 6))
    if name == 'table1':  # in its plane
        turn[:, :2] = twist[:, 2:5] = 0.0
    joints = rng.uniform(-1.0, 1.0, (count, model.joints)), rng.normal(size=(count, model.joints))
    states = kernel.states_of(exp(turn), *joints, twist)
    rows = np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=-1)
    rows = (rows[:, [0, 1, 5]] if name == 'table1' else rows).reshape(-1, 10 * len(model.links))
    size = np.sqrt(np.sum(rows**2, axis=0))
    assert np.linalg.matrix_rank(rows / np.where(size > 0.0, size, 1.0), tol=1e-6) == rank
