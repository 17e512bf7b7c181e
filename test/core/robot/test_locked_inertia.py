"""The whole robot at once: the sum of what its bodies are one by one, the same for an instant alone as among others."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import express, load_model
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum
from random_robots import random_state, random_urdf

COUNT = 33


@pytest.mark.parametrize('seed', range(4))
def test_the_whole_is_the_sum_of_the_bodies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=int(rng.integers(2, 10))))
    position, velocity, rotation, twist = random_state(rng, model.joints, COUNT)
    kinematics, parameters = Kinematics(model), model.body_parameters()
    bodies = kinematics.configure(rotation, position)
    twists = kinematics.body_twists(bodies, velocity, twist)
    mobility, total = mobility_and_momentum(parameters, bodies, twists)
    expressed = express(parameters, bodies.rotation, bodies.position)
    locked = np.sum(inertia_matrix(expressed), axis=1)
    assert mobility @ locked == pytest.approx(np.broadcast_to(np.eye(6), locked.shape), abs=1e-11)
    assert total == pytest.approx(np.sum(momentum(expressed, twists), axis=1), rel=1e-12, abs=1e-10)
    for size in (1, 2, 7):
        for begin in range(0, COUNT, size):
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
