"""Poses, twists and the kernel's states: against pinocchio, and a batch as its samples to the last bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.paper.forms import angular_rows, linear_rows
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel, MomentumRows, momentum_rows
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import express, load_model
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum, sensitivity
from mbaid_ros.core.samples import Samples
from peer import Motion, Peer
from random_robots import random_state, random_storage, random_urdf
from simulated import robot

SEEDS = range(4)
COUNT = 67
SIZES = (1, 2, 5, 32)
QUANTITIES: dict[str, Callable[[MomentumKernel, BodyStates], Array]] = {
    'known momentum': lambda _, states: states.known_momentum,
    'regressor': lambda _, states: states.regressor,
    'hinge velocity': lambda _, states: states.hinge_velocity,
    'rotation': lambda _, states: states.rotation,
    'position': lambda _, states: states.position,
    'body twist': lambda _, states: states.body_twist,
    'joint twist': lambda _, states: states.configuration.joint_twist,
    'sensitivity of the known bodies': lambda kernel, states: sensitivity(kernel, states).known,
    'sensitivity of the target': lambda kernel, states: sensitivity(kernel, states).target,
    'linear rows of the paper': lambda _, states: linear_rows(states)[0],
    'angular rows of the paper': lambda _, states: angular_rows(states)[0],
    'angular right side of the paper': lambda _, states: angular_rows(states)[1],
}


def random_case(seed: int) -> tuple[MomentumKernel, list[Array]]:
    """Return a kernel and the arguments of `states_of`."""
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=int(rng.integers(2, 10))))
    position, velocity, rotation, twist = random_state(rng, model.joints, COUNT)
    return MomentumKernel(model, model.last_link), [rotation, position, velocity, twist]


def pieces(size: int) -> Iterator[slice]:
    return (slice(begin, begin + size) for begin in range(0, COUNT, size))


@pytest.mark.parametrize('quantity', QUANTITIES)
@pytest.mark.parametrize('seed', SEEDS)
def test_a_batch_is_its_samples_to_the_last_bit(seed: int, quantity: str) -> None:
    kernel, arguments = random_case(seed)
    of = QUANTITIES[quantity]
    together = of(kernel, kernel.states_of(*arguments))
    for size in SIZES:
        parts = [of(kernel, kernel.states_of(*(argument[piece] for argument in arguments))) for piece in pieces(size)]
        assert np.array_equal(np.concatenate(parts), together)


@pytest.mark.parametrize('quantity', QUANTITIES)
def test_states_picked_from_a_batch_are_those_samples(quantity: str) -> None:
    kernel, arguments = random_case(1)
    of = QUANTITIES[quantity]
    picked = np.array([3, 17, 18, 60])
    states = kernel.states_of(*arguments)
    assert np.array_equal(of(kernel, states[picked]), of(kernel, states)[picked])
    assert np.array_equal(of(kernel, states[5:9]), of(kernel, states)[5:9])


def test_an_unknown_target_is_refused() -> None:
    with pytest.raises(ModelError, match="link 'moon' is not in the robot description"):
        MomentumKernel(robot('table1'), 'moon')


def test_a_correction_of_the_known_bodies_leaves_the_kernel_as_it_was() -> None:
    kernel, arguments = random_case(2)
    before = kernel.states_of(*arguments).known_momentum
    corrected = kernel.corrected(0.5 * kernel.known)
    # Momentum is linear in the parameters; a sum of few terms.
    assert corrected.states_of(*arguments).known_momentum == pytest.approx(1.5 * before, rel=1e-12, abs=1e-10)
    assert np.array_equal(kernel.states_of(*arguments).known_momentum, before)


def rows_case(seed: int, count: int = COUNT) -> tuple[MomentumKernel, Samples]:
    """Return a tree with two unknown links, and states of it."""
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=int(rng.integers(4, 10))))
    position, velocity, rotation, twist = random_state(rng, model.joints, count)
    none = np.zeros((count, 6, 6))
    place = rng.normal(size=(count, 3))
    samples = Samples(
        np.arange(count) * 0.01, position, velocity, place, rotation, twist[:, :3], twist[:, 3:], none, none
    )
    kernel = MomentumKernel(model, model.last_link, model.links[1].name)
    if seed % 2:
        kernel = kernel.storing(random_storage(rng, model))
        samples = replace(samples, stored=rng.normal(size=(count, kernel.storage.count)))
    return kernel, samples


def arrays(rows: MomentumRows) -> list[Array]:
    return [rows.known, *rows.regressors]


@pytest.mark.parametrize('seed', SEEDS)
def test_they_are_those_of_the_states(seed: int) -> None:
    kernel, samples = rows_case(seed)
    rows, states = momentum_rows(kernel, samples), kernel.states(samples)
    assert pytest.approx(states.known_momentum, rel=1e-12, abs=1e-11) == rows.known.T
    for found, link in zip(rows.regressors, kernel.unknown, strict=True):
        assert np.moveaxis(found, -1, 0) == pytest.approx(states.regressor_of(link), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(('seed', 'size'), [*product(SEEDS, (1, 5, 32)), (0, 3500)])
def test_rows_of_a_batch_are_those_of_its_samples(seed: int, size: int) -> None:
    kernel, samples = rows_case(seed, max(COUNT, 2 * size + 1))
    together = arrays(momentum_rows(kernel, samples))
    parts = [arrays(momentum_rows(kernel, samples[k : k + size])) for k in range(0, len(samples), size)]
    for whole, cut in zip(together, zip(*parts, strict=True), strict=True):
        assert np.array_equal(np.concatenate(cut, axis=-1), whole)


INSTANTS = 33


@pytest.mark.parametrize('seed', range(4))
def test_the_whole_is_the_sum_of_the_bodies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=int(rng.integers(2, 10))))
    position, velocity, rotation, twist = random_state(rng, model.joints, INSTANTS)
    kinematics, parameters = Kinematics(model), model.body_parameters()
    bodies = kinematics.configure(rotation, position)
    twists = kinematics.body_twists(bodies, velocity, twist)
    mobility, total = mobility_and_momentum(parameters, bodies, twists)
    expressed = express(parameters, bodies.rotation, bodies.position)
    locked = np.sum(inertia_matrix(expressed), axis=1)
    assert mobility @ locked == pytest.approx(np.broadcast_to(np.eye(6), locked.shape), abs=1e-11)
    assert total == pytest.approx(np.sum(momentum(expressed, twists), axis=1), rel=1e-12, abs=1e-10)
    for size in (1, 2, 7):
        for begin in range(0, INSTANTS, size):
            part = slice(begin, begin + size)
            alone = kinematics.configure(rotation[part], position[part])
            found = mobility_and_momentum(parameters, alone, kinematics.body_twists(alone, velocity[part], twist[part]))
            assert np.array_equal(found[0], mobility[part])
            assert np.array_equal(found[1], total[part])


def test_mass_on_a_line_is_told() -> None:
    rng = np.random.default_rng(0)
    model = load_model(random_urdf(rng, joints=3))
    position, velocity, rotation, twist = random_state(rng, model.joints, 2)
    kinematics = Kinematics(model)
    bodies = kinematics.configure(rotation, position)
    point = np.zeros_like(model.body_parameters())
    point[0, 0] = 1.0  # all of it in the base's origin
    with pytest.raises(np.linalg.LinAlgError, match='no inertia'):
        mobility_and_momentum(point, bodies, kinematics.body_twists(bodies, velocity, twist))


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


def test_a_robot_without_joints_is_its_base() -> None:
    kinematics = Kinematics(load_model('<robot name="r"><link name="base"/></robot>'))
    _, _, rotation, twist = random_state(np.random.default_rng(0), 0, STATES)
    configuration = kinematics.configure(rotation, np.zeros((STATES, 0)))
    assert np.array_equal(configuration.rotation[:, 0], rotation)
    assert not configuration.position.any()
    assert np.array_equal(kinematics.body_twists(configuration, np.zeros((STATES, 0)), twist)[:, 0], twist)
