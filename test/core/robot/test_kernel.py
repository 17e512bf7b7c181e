"""A kernel: slices of states, other unknown links, typical sizes, and derivatives by the joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import assert_derivative, generic
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.body import physical, physical_jacobian, physical_shift, standard
from mbaid_ros.core.robot.model import PlaneDetector, express
from mbaid_ros.core.robot.momentum import MomentumKernel, Springs, sensitivity_to_joints, unknown_scale
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.swing import passive_momenta
from mbaid_ros.simulation.true_robot import ModelErrors
from observed import kernel
from random_robots import random_storage, spatial
from simulated import robot


def whole(seed: int) -> tuple[MomentumKernel, Array, Array, Array, Array]:
    """Return a robot all of whose bodies are known, and two states of it: rotation, joints, rates, twist."""
    model = spatial(seed)
    made = MomentumKernel(model, model.last_link)
    target = np.zeros_like(made.known)
    target[made.target.body] = express(made.target.parameters, made.target.rotation, made.target.position)
    joints, rates = generic(seed, 2, 2, model.joints)
    return made.with_body_changes(target), exp(generic(seed + 1, 2, 3)), joints, rates, generic(seed + 2, 2, 6)


@pytest.mark.parametrize('seed', range(2))
def test_the_momentum_depends_on_each_joint_as_its_derivatives_say(seed: int) -> None:
    made, rotation, joints, rates, twist = whole(seed)
    by_position, by_velocity = sensitivity_to_joints(made, made.states_of(rotation, joints, rates, twist))
    nothing = np.zeros(made.model.joints)

    def momentum(position: Array, velocity: Array) -> Array:
        return made.states_of(rotation, joints + position, rates + velocity, twist).known_momentum

    assert_derivative(by_position, lambda change: momentum(change, nothing), nothing)
    assert_derivative(by_velocity, lambda change: momentum(nothing, change), nothing)


@pytest.mark.parametrize('seed', range(3))
def test_momenta_along_passive_joints_are_those_of_unit_rates(seed: int) -> None:
    """The momentum along a joint: its unit twist times the momentum of all that it carries."""
    made, rotation, joints, _, _ = whole(seed)
    count, springs = made.model.joints, (1, 3)
    made = made.with_springs(Springs(springs, np.ones(2), np.zeros(2), np.zeros((2, 2))))
    axes = made.kinematics.configure(rotation, joints).joint_twist
    carried = made.kinematics.ancestors.T

    def moving(rate: Array) -> tuple[Array, Array]:
        states = made.states_of(rotation, joints, np.tile(rate, (2, 1)), np.zeros((2, 6)))
        below = carried @ states.momenta
        return states.known_momentum, np.sum(axes * below, axis=-1)[:, list(springs)]

    gamma = np.stack([moving(unit)[0] for unit in np.eye(count)], axis=-1)
    expected = np.stack([moving(unit)[1] for unit in np.eye(count)], axis=-1)
    assert passive_momenta(made, axes, gamma) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_a_slice_of_states_is_of_all_that_belongs_to_them() -> None:
    made, rotation, joints, rates, twist = whole(1)
    made = made.with_storage(random_storage(np.random.default_rng(0), made.model))
    readings = generic(5, 2, made.storage.count)
    states = made.states_of(rotation, joints, rates, twist, readings)
    last = states[1:]
    assert last.known_momentum == pytest.approx(states.known_momentum[1:])
    assert last.regressor == pytest.approx(states.regressor[1:])
    alone = made.states_of(rotation[1:], joints[1:], rates[1:], twist[1:], readings[1:])
    assert last.known_momentum == pytest.approx(alone.known_momentum)
    # The target's origin moves as its point of the base does, and by the turn about that.
    assert states.hinge_velocity == pytest.approx(states.twist[:, :3] + np.cross(states.twist[:, 3:], states.position))


@pytest.mark.parametrize('thrusters', [0, 2])
@pytest.mark.parametrize('orbit', [False, True])
def test_impulses_of_thrusters_and_of_an_orbit_are_about_the_base_with_or_without_each_other(
    thrusters: int, *, orbit: bool
) -> None:
    made = kernel('table1')
    bodies, (rotation,), place, nothing = len(made.known), exp(generic(1, 1, 3)), generic(2, 2, 3), np.zeros((2, 3))
    joints, covariance = generic(3, 2, made.model.joints), np.zeros((2, 6, 6))
    thrust = generic(4, 120).reshape(2, 2, 6, 5)[:, :thrusters]
    gravity = generic(5, 120 * bodies).reshape(2, bodies, 6, 10)[:, : bodies * orbit]
    samples = Samples(
        *(0.1 * np.arange(2), joints, joints, place, np.tile(rotation, (2, 1, 1)), nothing, nothing),
        *(covariance, covariance),
        gravity_columns=gravity.reshape(2, 60 * bodies * orbit),
        thrust=thrust.reshape(2, 30 * thrusters),
    )
    states = made.states(samples)
    for found, given in ((states.thrust, thrust), (states.gravity_columns, gravity)):
        expected = given.copy()
        expected[..., 3:, :] -= np.cross(place[:, None, :, None], given[..., :3, :], axis=2)
        assert found.reshape(expected.shape) == pytest.approx(expected)


def test_another_unknown_link_leaves_the_one_before_as_described() -> None:
    made = kernel('servicer7')
    other = made.with_unknown_link('link3')
    assert (other.target.name, [link.name for link in other.unknown]) == ('link3', ['link3'])
    assert other.known == pytest.approx(MomentumKernel(made.model, 'link3').known)
    change = generic(0, *made.known.shape)
    moved = made.with_body_changes(change).with_unknown_link('link3')
    assert moved.known == pytest.approx(other.known + change)


def test_typical_sizes_are_those_of_the_known_bodies_stretched_out() -> None:
    """Mass, mass times length, mass times its square; momentum at 1 m/s and 1 rad/s."""
    made = kernel('servicer7')
    mass = float(made.known[:, 0].sum())
    steps = [*made.model.positions, made.target.position]
    length = sum(float(np.linalg.norm(step)) for step in steps)
    sizes = unknown_scale(made)
    powers = np.array([0, *[1] * 3, *[2] * 6, *[0] * 3, *[1] * 3])
    assert sizes == pytest.approx(mass * length**powers)


@pytest.mark.parametrize(('rate', 'planar'), [(0.04, True), (0.06, False)])
def test_a_gyro_alone_decides_by_how_it_turns_out_of_the_plane(rate: float, planar: bool) -> None:
    """Where no orientation is measured; in base axes, despite its bias."""
    count, time = 25, 0.02 * np.arange(25)
    nothing, unknown = np.zeros((count, 3)), np.full((count, 6, 6), np.nan)
    joints = np.zeros((count, robot('table1').joints))
    turned = time[:, None] * np.array([0.0, rate, 3.0])
    window = Samples(time, joints, joints, nothing, exp(0.0 * nothing), nothing, nothing * np.nan, unknown, unknown)
    detector = PlaneDetector(robot('table1'))
    detector.update(replace(window, further=turned))
    assert detector.planar is planar
    assert (detector.normal is not None) is planar


@pytest.mark.parametrize('name', ['bodies', 'zeros', 'origins', 'tilts', 'mount'])
def test_a_robot_with_any_error_is_not_exactly_its_description(name: str) -> None:
    exact = ModelErrors.zero(2)
    assert exact.is_zero
    changed = np.array(getattr(exact, name))
    changed.flat[-1] = 1e-3
    assert not replace(exact, **{name: changed}).is_zero


def test_physical_numbers_and_their_shift() -> None:
    body = standard(np.array([120.0, 0.3, -0.2, 0.7, 28.0, -3.0, 1.3, 37.0, -1.0, 30.0]))
    assert_derivative(physical_jacobian(body), physical, body, step=1e-4)
    # To first order the shift is that of the standard parameters; with the step taken, that of a body elsewhere.
    step = 1e-3 * body
    there = physical(body + step) - physical(body)
    found = physical_shift(body, step, step)
    assert physical_jacobian(body) @ found == pytest.approx(there)
