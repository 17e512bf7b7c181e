"""Passive joints on random robots: momenta and rates against pinocchio, derivatives against central differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio
import pytest

from checked import assert_derivative, generic
from mbaid_ros.core.filter.linearise import predict
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.joints.model import joint_gains
from mbaid_ros.core.links import known_bodies
from mbaid_ros.core.passive import spring_errors
from mbaid_ros.core.robot.model import load_model, parse
from mbaid_ros.core.robot.momentum import KnownErrors, MomentumKernel, Springs
from mbaid_ros.core.state import BODY, LINEAR, Layout, Point
from mbaid_ros.core.swing import spring_constants
from mbaid_ros.core.windows import Bodies, Midpoints, Prediction, Swing
from mbaid_ros.simulation import environment as simulated
from mbaid_ros.simulation.dynamics import Dynamics, State
from mbaid_ros.simulation.environment import Environment
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation
from random_robots import random_urdf

SEEDS = range(6)
STEP = 1e-5


class Case:
    """A random tree with two passive joints at an instant of its motion, the base's axes those of the odometry."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.model = load_model(random_urdf(rng, joints=6, chain=seed % 2 == 0))
        count = self.model.joints
        joints = tuple(sorted(rng.choice(count, 2, replace=False).tolist())) if count > 1 else (0,)
        size = len(joints)
        springs = Springs(joints, rng.uniform(1.0, 4.0, size), rng.uniform(0.0, 0.05, size), np.zeros((2, size)))
        self.kernel = MomentumKernel(self.model, self.model.last_link).with_springs(springs)
        self.joints = list(joints)
        self.position, self.rate = rng.uniform(-1.0, 1.0, count), rng.normal(size=count)
        self.twist = rng.normal(size=6)
        self.layout = Layout.from_unknowns(self.kernel, ())

    def state(self) -> State:
        """Return the state, and so its momentum."""
        return State(
            np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), self.position, np.concatenate((self.twist, self.rate))
        )

    def momenta(self, state: State) -> Array:
        """Return M(q) v by pinocchio: the base's in its own axes, then along each joint."""
        robot = parse(self.model)
        mass = np.triu(pinocchio.crba(robot, robot.createData(), Dynamics(self.model)._configuration(state)))
        return np.asarray((mass + np.triu(mass, 1).T) @ state.velocity)

    def point(self, momentum: Array) -> Point:
        """Return the point of a total momentum about the origin, and the body as described."""
        values = np.zeros(self.layout.size)
        values[LINEAR.start : LINEAR.start + 6], values[BODY] = momentum, self.kernel.target.parameters
        return self.layout.point(values)

    def moving(self, state: State, along: Array, turn: Array | None = None) -> tuple[Swing, Array]:
        """Return how x changes by s (f,) at a state's configuration, with the momentum of the case, and base twist.

        `turn` (3, 3) are the base's axes, in which the momentum is as in its own; else those of the odometry.
        """
        rotation: Array = np.eye(3) if turn is None else turn
        total = self.momenta(self.state())[:6]
        point = self.point(np.concatenate((rotation @ total[:3], rotation @ total[3:])))
        prediction, bodies = predict(self.layout, self.middle(state, rotation), point, along[None])
        assert bodies.passive is not None
        return bodies.passive, prediction.twist[0]

    def middle(self, state: State, rotation: Array) -> Midpoints:
        """Return the midpoint of an interval at a state, its passive joints at rest."""
        rate = state.joint_velocity.copy()
        rate[self.joints] = 0.0
        none = np.zeros((1, 3))
        middle = Midpoints(
            *(state.joint_position[None], rate[None], rotation[None], state.base_position[None]),
            *(np.zeros((1, 6)), none, none, np.zeros((1, 6))),
        )
        return replace(middle, gravity_columns=np.zeros((1, 0)), thrust=np.zeros((1, 0)))


@pytest.mark.parametrize('seed', SEEDS)
def test_momenta_and_rates_are_those_of_pinocchio(seed: int) -> None:
    case = Case(seed)
    along = case.momenta(case.state())[6:][case.joints]
    found, twist = case.moving(case.state(), along)
    assert found.slope[0, : len(case.joints)] == pytest.approx(case.rate[case.joints], rel=1e-9, abs=1e-9)
    assert twist == pytest.approx(case.twist, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize('seed', SEEDS)
def test_momenta_along_the_joints_change_as_in_the_simulator(seed: int) -> None:
    """Against the articulated-body algorithm: s a moment before and after, all other joints free of torque."""
    case = Case(seed)
    known = case.kernel.body_parameters(case.kernel.target.parameters)
    stiffness, damping = spring_constants(case.kernel, known)
    springs, names = case.kernel.springs, [case.model.joint_names[joint] for joint in case.joints]
    frequencies, ratios = (springs.frequency / (2.0 * np.pi)).tolist(), springs.damping_ratio.tolist()
    ours = simulated.Springs.from_frequencies(case.model, names, frequencies, ratios)
    assert ours.stiffness == pytest.approx(stiffness, rel=1e-12)
    assert ours.damping == pytest.approx(damping, rel=1e-12)
    start = case.state()

    def after(length: float) -> Array:
        around = Environment(springs=ours)
        truth = Simulation(case.model, Passive(), start, environment=around).advance(np.array([length]))
        velocity = np.concatenate(
            (truth.base_linear_velocity, truth.base_angular_velocity, truth.joint_velocity), axis=1
        )
        there = State(truth.base_position[0], truth.base_orientation[0], truth.joint_position[0], velocity[0])
        return case.momenta(there)[6:][case.joints]

    found, _ = case.moving(start, case.momenta(start)[6:][case.joints])
    change = (
        -25.0 * after(0.0) + 48.0 * after(1e-3) - 36.0 * after(2e-3) + 16.0 * after(3e-3) - 3.0 * after(4e-3)
    ) / 12e-3
    assert found.slope[0, len(case.joints) :] == pytest.approx(change, rel=1e-6, abs=1e-6 * float(np.abs(change).max()))


@pytest.mark.parametrize('seed', SEEDS)
def test_derivatives_by_the_state(seed: int) -> None:
    case = Case(seed)
    start, size = case.state(), len(case.joints)
    along = case.momenta(start)[6:][case.joints]
    found, _ = case.moving(start, along)

    def rates(change: Array) -> Array:
        position = start.joint_position.copy()
        position[case.joints] += change[:size]
        moved, _ = case.moving(replace(start, joint_position=position), along + change[size:])
        return moved.slope[0]

    for place in range(2 * size):
        step = STEP * np.eye(2 * size)[place]
        expected = (rates(step) - rates(-step)) / (2.0 * STEP)
        assert found.by_state[0][:, place] == pytest.approx(expected, rel=1e-5, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize('seed', SEEDS[:3])
def test_derivatives_by_the_parameters(seed: int) -> None:
    """Momentum, target, the base and other bodies on either side of the passive joints, and their springs last."""
    case = Case(seed)
    start, kernel = replace(case.state(), base_position=generic(1, 3)), case.kernel
    others = tuple(body for body in range(1, case.model.joints + 1) if kernel.known[body, 0] > 0.0)
    bodies = [
        known_bodies(case.model, KnownErrors(some, 0.1 * generic(2, 30 * len(some)).reshape(-1, 3)))
        for some in ((0,), others)
    ]
    names = [case.model.joint_names[joint] for joint in case.joints]
    springs = spring_errors(names, [0.2] * len(names), [0.1] * len(names))
    layout = Layout.from_unknowns(kernel, (*bodies, springs))
    state = np.zeros(layout.size)
    momenta = case.momenta(case.state())
    state[LINEAR.start : LINEAR.start + 6], state[BODY] = momenta[:6], kernel.target.parameters

    def moving(parameters: Array) -> tuple[Array, Swing, Array]:
        values = state.copy()
        values[layout.parameters] = parameters
        along = momenta[6:][case.joints][None]
        prediction, bodies = predict(layout, case.middle(start, exp(generic(3, 3))), layout.point(values), along)
        assert bodies.passive is not None
        return prediction.twist[0], bodies.passive, prediction.by_parameters[0]

    def rates(parameters: Array) -> Array:
        twist, passive, _ = moving(parameters)
        return np.concatenate((twist, passive.slope[0]))

    here = state[layout.parameters]
    _, passive, of_twist = moving(here)
    assert_derivative(np.concatenate((of_twist, passive.by_parameters[0])), rates, here)


@pytest.mark.parametrize('seed', SEEDS[:3])
def test_the_twist_depends_on_the_rates_of_other_joints_as_their_gains_say(seed: int) -> None:
    """While the momenta along the passive joints stay: these follow."""
    case = Case(seed)
    start, along = case.state(), case.momenta(case.state())[6:][case.joints]
    others = [joint for joint in range(case.model.joints) if joint not in case.joints]
    momentum = case.momenta(start)[:6]

    def predicted(rates: Array) -> tuple[Prediction, Bodies]:
        velocity = start.velocity.copy()
        velocity[6 + np.array(others)] = rates
        middle = case.middle(replace(start, velocity=velocity), np.eye(3))
        return predict(case.layout, middle, case.point(momentum), along[None])

    here = case.rate[others]
    by_rate, _ = joint_gains(case.kernel, predicted(here)[1])
    assert_derivative(by_rate[0][:, others], lambda rates: predicted(rates)[0].twist[0], here)


def test_the_momenta_do_not_depend_on_the_axes() -> None:
    case = Case(1)
    turn = exp(np.array([0.3, -0.2, 0.5]))
    start = case.state()
    along = case.momenta(start)[6:][case.joints]
    straight, _ = case.moving(start, along)
    found, twist = case.moving(start, along, turn)
    assert found.slope == pytest.approx(straight.slope, rel=1e-9)
    assert twist == pytest.approx(np.concatenate((turn @ case.twist[:3], turn @ case.twist[3:])), rel=1e-9)
