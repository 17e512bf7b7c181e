"""The momentum, its regressor and its derivatives, against pinocchio and central differences."""

from __future__ import annotations

import numpy as np
import pytest

from checked import central_difference
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.model import express, load_model
from mbaid_ros.core.robot.momentum import BodyStates, MomentumKernel, inertia_matrix, momentum, regressor, sensitivity
from random_robots import Motion, Peer, random_state, random_storage, random_urdf

SEEDS = range(8)
COUNT = 30


def random_bodies(seed: int) -> tuple[Array, Array]:
    """Return parameters (N, 10), of real bodies or not: the equations are linear in them; and twists (N, 6)."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(COUNT, 10)), rng.normal(size=(COUNT, 6))


def random_case(seed: int) -> tuple[MomentumKernel, Motion]:
    """Return a random tree with a random link of it as the target, and random states."""
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=8))
    target = model.links[int(rng.integers(len(model.links)))].name
    position, velocity, rotation, twist = random_state(rng, model.joints, COUNT)
    return MomentumKernel(model, target), Motion(rotation, position, velocity, twist)


def size_of(values: Array) -> Array:
    """Return the largest linear and angular momentum, as a scale for (N, 6) differences."""
    return np.asarray(np.repeat(np.abs(values).reshape(-1, 2, 3).max(axis=(0, 2)), 3))


def test_the_inertia_matrix_times_the_twist_is_the_momentum() -> None:
    parameters, twist = random_bodies(0)
    matrix = inertia_matrix(parameters)
    assert np.array_equal(matrix, np.swapaxes(matrix, 1, 2))
    assert (matrix @ twist[..., None])[..., 0] == pytest.approx(momentum(parameters, twist), abs=1e-14)


@pytest.mark.parametrize('seed', SEEDS)
def test_the_regressor_times_the_parameters_is_the_momentum(seed: int) -> None:
    parameters, twist = random_bodies(seed)
    rng = np.random.default_rng(seed)
    rotation, position = exp(rng.normal(size=(COUNT, 3))), 3.0 * rng.normal(size=(COUNT, 3))
    found = (regressor(rotation, position, twist) @ parameters[..., None])[..., 0]
    expected = momentum(express(parameters, rotation, position), twist)
    assert (found - expected) / size_of(expected) == pytest.approx(np.zeros((COUNT, 6)), abs=1e-13)


@pytest.mark.parametrize('seed', SEEDS)
def test_known_bodies_and_target_together_have_the_momentum_of_the_robot(seed: int) -> None:
    kernel, motion = random_case(seed)
    states = kernel.states_of(motion.base_rotation, motion.joint_position, motion.joint_velocity, motion.base_twist)
    total = states.known_momentum + states.regressor @ kernel.target.parameters
    peer = Peer(kernel.model)
    expected = np.empty((COUNT, 6))
    for index in range(COUNT):
        peer.to(motion, index)
        expected[index] = peer.momentum()
    # Relative 1e-12: sums of nine bodies with levers of several metres.
    assert (total - expected) / size_of(expected) == pytest.approx(np.zeros((COUNT, 6)), abs=1e-12)


@pytest.mark.parametrize('seed', SEEDS)
def test_the_target_own_inertial_never_enters(seed: int) -> None:
    kernel, motion = random_case(seed)
    target = kernel.target.name
    heavy = kernel.model.urdf.replace(f'<link name="{target}"><inertial>', f'<link name="{target}"><visual>', 1)
    position = heavy.index('</inertial>', heavy.index(f'<link name="{target}">'))
    without = MomentumKernel(
        load_model(heavy[:position] + '</visual>' + heavy[position + len('</inertial>') :]), target
    )
    arguments = motion.base_rotation, motion.joint_position, motion.joint_velocity, motion.base_twist
    assert not without.target.parameters.any()
    assert np.array_equal(without.states_of(*arguments).known_momentum, kernel.states_of(*arguments).known_momentum)


STEP = 1e-5
# Central differences err by STEP^2 and by rounding / STEP, both about 1e-10 of the largest derivative.
TOLERANCE = 1e-8


class Measured:
    """A random robot, whose momentum is taken as a function of errors z of the measurements."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        model = load_model(random_urdf(rng, joints=7))
        # One unknown link, two or three.
        unknown = rng.choice(len(model.links), size=1 + seed % 3, replace=False)
        self.kernel = MomentumKernel(model, *(model.links[index].name for index in unknown))
        if seed % 2:
            self.kernel = self.kernel.with_storage(random_storage(rng, model))
        self.readings = rng.normal(size=(1, self.kernel.storage.count))
        self.joints = model.joints
        position, velocity, rotation, twist = random_state(rng, model.joints, 1)
        self.position, self.velocity, self.rotation = position[0], velocity[0], rotation[0]
        # The base's twist is measured in its own axes: it turns with them.
        self.twist = np.concatenate((self.rotation.T @ twist[0, :3], self.rotation.T @ twist[0, 3:]))

    @property
    def sources(self) -> int:
        """Number of measured quantities."""
        return 2 * self.joints + 9

    def states(self, error: Array) -> BodyStates:
        """Return the states at an error z of joints, joint rates, orientation, linear and angular velocity."""
        count = self.joints
        rotation = exp(error[2 * count : 2 * count + 3]) @ self.rotation
        twist = self.twist + error[2 * count + 3 :]
        twist = np.concatenate((rotation @ twist[:3], rotation @ twist[3:]))
        return self.kernel.states_of(
            rotation[None],
            (self.position + error[:count])[None],
            (self.velocity + error[count : 2 * count])[None],
            twist[None],
            self.readings,
        )


@pytest.mark.parametrize('seed', SEEDS)
def test_sensitivities_are_derivatives_of_known_momentum_and_regressors(seed: int) -> None:
    measured = Measured(seed)
    zero = np.zeros(measured.sources)
    found = sensitivity(measured.kernel, measured.states(zero))

    def regressors(error: Array) -> Array:
        states = measured.states(error)
        return np.concatenate([states.regressor_of(link)[0] for link in measured.kernel.unknown], axis=-1)

    known = central_difference(lambda error: measured.states(error).known_momentum[0], zero, STEP)
    unknown = np.swapaxes(central_difference(regressors, zero, STEP), 1, 2)  # (6, z, 10 k)
    for value, expected in ((found.known[0], known), (found.target[0], unknown)):
        assert value == pytest.approx(expected, abs=TOLERANCE * np.abs(expected).max())
