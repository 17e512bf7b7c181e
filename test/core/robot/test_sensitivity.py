"""The derivatives of the momentum by every measured quantity, against central differences on random trees."""

from __future__ import annotations

import numpy as np
import pytest

from derivatives import central_difference
from mbaid_ros.core import geometry
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.sensitivity import force_cross, motion_cross, sensitivity, sensitivity_to_joints
from random_robots import random_state, random_storage, random_urdf

SEEDS = range(8)
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
            self.kernel = self.kernel.storing(random_storage(rng, model))
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
        rotation = geometry.exp(error[2 * count : 2 * count + 3]) @ self.rotation
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
def test_the_known_bodies(seed: int) -> None:
    measured = Measured(seed)
    zero = np.zeros(measured.sources)
    found = sensitivity(measured.kernel, measured.states(zero)).known[0]
    expected = central_difference(lambda error: measured.states(error).known_momentum[0], zero, STEP)
    assert found == pytest.approx(expected, abs=TOLERANCE * np.abs(expected).max())


@pytest.mark.parametrize('seed', SEEDS)
def test_the_unknown_links(seed: int) -> None:
    measured = Measured(seed)
    zero = np.zeros(measured.sources)
    found = sensitivity(measured.kernel, measured.states(zero)).target[0]

    def regressors(error: Array) -> Array:
        states = measured.states(error)
        return np.concatenate([states.regressor_of(link)[0] for link in measured.kernel.unknown], axis=-1)

    expected = np.swapaxes(central_difference(regressors, zero, STEP), 1, 2)  # (6, z, 10 k)
    assert found == pytest.approx(expected, abs=TOLERANCE * np.abs(expected).max())


def test_products_of_twists_and_momenta() -> None:
    rng = np.random.default_rng(0)
    left, right, momentum = (rng.normal(size=(20, 6)) for _ in range(3))
    assert motion_cross(left, right) == pytest.approx(-motion_cross(right, left), abs=1e-14)
    assert motion_cross(left, left) == pytest.approx(np.zeros((20, 6)), abs=1e-14)
    # Power does not depend on the frame: (S x V) . h + V . (S x* h) = 0.
    power = np.sum(motion_cross(left, right) * momentum, axis=1) + np.sum(right * force_cross(left, momentum), axis=1)
    assert power == pytest.approx(np.zeros(20), abs=1e-13)


@pytest.mark.parametrize('seed', SEEDS)
def test_the_joints_alone_are_as_among_all(seed: int) -> None:
    measured = Measured(seed)
    states = measured.states(np.zeros(measured.sources))
    known = sensitivity(measured.kernel, states).known
    positions, velocities = sensitivity_to_joints(measured.kernel, states)
    assert positions == pytest.approx(known[..., : measured.joints], rel=1e-10, abs=1e-10)
    assert velocities == pytest.approx(known[..., measured.joints : 2 * measured.joints], rel=1e-10, abs=1e-10)
