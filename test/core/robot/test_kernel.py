"""The one kernel: what it says of a batch is what it says of each sample, to the last bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.paper.forms import angular_rows, linear_rows
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.sensitivity import sensitivity
from random_robots import random_state, random_urdf
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
