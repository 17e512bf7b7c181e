"""The swing along windows: the derivatives of the predicted twist by all parameters, against central differences."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.appendages import PANELS, SLOSH, with_fuel, with_panel_on_the_target, with_panels
from checked import generic
from mbaid_ros.core import swing
from mbaid_ros.core.contracts import in_stacks, stacked
from mbaid_ros.core.filter.linearise import predict
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import known_bodies
from mbaid_ros.core.passive import soft_grasp_warnings, spring_errors, starting_swing, swing_noise
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import KnownErrors, MomentumKernel, Springs
from mbaid_ros.core.state import BODY, LINEAR, Layout, Point
from mbaid_ros.core.swing import BESIDE, SwingTrajectory, transition_steps
from mbaid_ros.core.windows import KnotAveraging
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Environment
from mbaid_ros.simulation.environment import Springs as SimulatedSprings
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, total_momentum
from observed import MID, observe, windows

ROBOTS = {
    'panels': (with_panels(), PANELS, (0.3, 0.5)),
    'panel on the target': (with_panel_on_the_target(), PANELS[:1], (0.4,)),
    'propellant': (with_fuel(20.0), SLOSH, (0.2, 0.25, 0.3)),
    'grasp': (with_panels(), ('joint7',), (0.5,)),
}
SECONDS, KNOT = 4.0, 0.05


class Case:
    """Windows of a robot that swings, exactly measured, and the point of its true parameters."""

    def __init__(self, name: str) -> None:
        urdf, joints, frequencies = ROBOTS[name]
        self.model = load_model(urdf)
        places = tuple(self.model.joint_names.index(joint) for joint in joints)
        self.names = list(joints)
        rates = 2.0 * np.pi * np.array(frequencies)
        position, rate = np.full(self.model.joints, 0.4), 0.05 * np.cos(np.arange(self.model.joints))
        position[list(places)], rate[list(places)] = 0.02, 0.01
        twist = [0.001, -0.002, 0.0, 0.01, -0.015, 0.02]
        begin = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), position, np.concatenate((twist, rate)))
        simulated = SimulatedSprings.from_frequencies(self.model, joints, frequencies, [0.01] * len(joints))
        simulation = Simulation(self.model, Passive(), begin, environment=Environment(springs=simulated))
        truth = simulation.advance(np.arange(round(100.0 * SECONDS)) / 100.0)
        self.deflection = CubicSpline(truth.time, truth.joint_position[:, list(places)])
        start = np.array([self.deflection(KNOT), self.deflection(KNOT, 1)])  # between the first knots
        springs = Springs(places, rates, np.full(len(places), 0.01), start)
        samples = observe(truth, MID)
        for part in (samples.joint_position, samples.joint_velocity):
            part[:, list(places)] = 0.0
        kernel = MomentumKernel(self.model, 'link7').with_springs(springs)
        bodies = tuple(sorted({0, *(place + 1 for place in places)}))
        errors = KnownErrors(bodies, np.eye(10 * len(bodies)))
        unknowns = (
            known_bodies(self.model, errors),
            *(spring_errors(joints, [0.05] * len(places), [0.01] * len(places)),),
            *(
                starting_swing(joints, [0.05] * len(places), rates),
                swing_noise(joints, [1e-3] * len(places), rates, [0.01] * len(places)),
            ),
        )
        self.layout = Layout.from_unknowns(kernel, unknowns)
        averaged = KnotAveraging(MID, 0.5).average(windows(samples))
        self.windows = [each.ready for each in averaged if each.ready is not None]
        self.still_open = [each.still_open for each in averaged if each.still_open is not None]
        self.state: Array = np.zeros(self.layout.size)
        momentum = total_momentum(self.model, truth[:1])[0]
        self.state[LINEAR.start : LINEAR.start + 6] = momentum
        self.state[BODY] = kernel.target.parameters

    def point(self, parameters: Array) -> Point:
        """Return the point of some parameters of the prediction."""
        state = self.state.copy()
        state[self.layout.parameters] = parameters
        return self.layout.point(state)

    def predicted(self, parameters: Array) -> tuple[Array, Array, Array]:
        """Return the twists of own intervals, their derivatives, and the deflections there, window by window."""
        point, course = self.point(parameters), SwingTrajectory(self.layout, predict)
        twists: list[Array] = []
        derivatives: list[Array] = []
        deflections: list[Array] = []
        for stacks in in_stacks(self.windows, 3):
            begun = [stack.motion(point.nominal, BESIDE) for stack in stacks]
            motions, prediction, _, _ = course.predict(stacks, begun, point)
            parts = prediction.divided([motion.turn.shape[:2] for motion, _ in motions])
            windows_of: dict[int, tuple[Array, ...]] = {}
            for stack, part, (motion, inside) in zip(stacks, parts, motions, strict=True):
                for window, place in enumerate(stack.places):
                    joints = list(self.layout.kernel.springs.joints)
                    found = (part.twist, part.by_parameters, motion.joint_position[..., joints])
                    windows_of[place] = tuple(each[inside, window] for each in found)
            for place in sorted(windows_of):
                for every, each in zip((twists, derivatives, deflections), windows_of[place], strict=True):
                    every.append(each)
        return np.concatenate(twists), np.concatenate(derivatives), np.concatenate(deflections)


@pytest.mark.parametrize('name', ['panels', *(pytest.param(each, marks=pytest.mark.long) for each in list(ROBOTS)[1:])])
def test_derivatives_by_the_parameters(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(swing, '_CONVERGED', 1e-6)  # differences see what the last sweep leaves
    case = Case(name)
    parameters = case.state[case.layout.parameters]
    _, derivatives, _ = case.predicted(parameters)
    steps = np.concatenate((np.full(6, 1e-4), np.full(10, 1e-3), np.full(len(parameters) - 16, 1e-3)))
    count = len(parameters) - 2 * len(case.names)  # what excites beside the model has no place in the point
    for index in range(count):
        change = steps[index] * np.eye(len(parameters))[index]
        ahead, behind = (case.predicted(parameters + sign * change)[0] for sign in (1.0, -1.0))
        expected = (ahead - behind) / (2.0 * steps[index])
        size = float(np.abs(expected).max())
        assert derivatives[..., index] == pytest.approx(expected, abs=4e-3 * size + 1e-9), index


def test_a_state_is_taken_along_to_another_point_by_its_derivatives() -> None:
    rng = np.random.default_rng(0)
    columns, here, there = rng.normal(size=(5, 4, 8)), rng.normal(size=7), rng.normal(size=7)
    points: list[Any] = [SimpleNamespace(parameters=each) for each in (here, there)]
    found = swing._columns_at(columns, *points)
    assert found[..., 0] == pytest.approx(columns[..., 0] + columns[..., 1:] @ (there - here))
    np.testing.assert_array_equal(found[..., 1:], columns[..., 1:])


@pytest.mark.parametrize('first', ['closed', 'open'])
def test_windows_that_were_linearised_while_they_were_open_do_not_count(first: str) -> None:
    case = Case('panels')
    closed, still_open = case.windows[:4], case.still_open[:4]
    pairs = zip(closed, still_open, strict=True) if first == 'closed' else zip(still_open, closed, strict=True)
    together = [window for pair in pairs for window in pair]
    point, alone, beside = (
        case.point(case.state[case.layout.parameters]),
        *(SwingTrajectory(case.layout, predict) for _ in range(2)),
    )
    for course, some in ((alone, closed), (beside, together)):
        stacks = stacked(some)
        course.predict(stacks, [stack.motion(point.nominal, BESIDE) for stack in stacks], point)
    expected = alone.deflections(closed[-1])
    assert beside.deflections(closed[-1]) == pytest.approx(expected, rel=1e-9)
    for window in still_open:
        largest, *own = beside.deflections(window)
        assert largest == pytest.approx(np.maximum(expected[0], np.abs(own).max(axis=0)), rel=1e-9)


@pytest.mark.parametrize('name', ['panels', 'propellant'])
def test_deflections_are_those_of_the_simulator(name: str) -> None:
    case = Case(name)
    found = case.predicted(case.state[case.layout.parameters])[2]
    assert found == pytest.approx(case.deflection(KNOT * (np.arange(len(found)) + 1.0)), abs=1e-6)


def test_a_stiff_joint_that_is_pushed_slowly_stays_in_equilibrium() -> None:
    """A spring of 5 Hz whose stiffness and load change over a minute, at the knots of a joint of 3 Hz."""
    time, rate = 0.02 * np.arange(25) - 0.25, 2.0 * np.pi * 5.0
    stiffness = rate**2 * (1.0 + time / 60.0)
    by_state: Array = np.zeros((len(time), 2, 2))
    by_state[:, 0, 1], by_state[:, 1, 0] = 1.0, -stiffness
    force = np.zeros((len(time), 2, 1))
    force[:, 1, 0] = stiffness * (1.0 + time / 60.0)
    onward, gain = transition_steps(by_state.mean(axis=0), by_state, force, 0.02)
    deflections = np.column_stack((1.0 + time / 60.0, np.full(len(time), 1.0 / 60.0)))
    found = (onward @ deflections[:-1, :, None] + gain)[..., 0]
    assert found == pytest.approx(deflections[1:], abs=1e-8)


@pytest.mark.parametrize('stop', [5, 6])  # where knots follow, or none yet
def test_a_window_ends_half_an_interval_after_its_last_midpoint(stop: int) -> None:
    slopes, first = generic(1, 2, 3), generic(2, 2, 3)
    values = first + np.arange(6)[:, None, None] * slopes
    assert swing._at_the_end(values, slice(1, stop)) == pytest.approx(first + (stop - 0.5) * slopes)


def test_the_nearest_point_is_that_of_the_nearest_mass_and_unknowns() -> None:
    """The mass counts by its ratio, unknowns by their priors; a body far away may have the same."""
    numbers = np.concatenate((generic(1, 6), [20.0], generic(2, 12)))

    def far(place: int, change: float) -> float:
        points: list[Any] = [SimpleNamespace(parameters=numbers + each * np.eye(19)[place]) for each in (0.0, change)]
        return swing._distance(*points)

    assert far(6, 3.0) == pytest.approx(0.15**2)
    assert far(17, -0.3) == pytest.approx(0.3**2)
    assert far(2, 5.0) == 0.0


def test_only_a_grasp_that_gives_keeps_its_declaration() -> None:
    for name, (urdf, joints, frequencies) in ROBOTS.items():
        model = load_model(urdf)
        places = tuple(model.joint_names.index(joint) for joint in joints)
        rates = 2.0 * np.pi * np.array(frequencies)
        springs = Springs(places, rates, np.full(len(places), 0.01), np.zeros((2, len(places))))
        warnings = soft_grasp_warnings(MomentumKernel(model, 'link7').with_springs(springs))
        assert [text.split()[0] for text in warnings] == (['joint7'] if name == 'grasp' else [])


def test_the_largest_deflection_outlasts_the_windows_that_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(swing, '_WINDOWS', 8)
    case = Case('panels')
    course, largest = SwingTrajectory(case.layout, predict), 0.0
    point = case.point(case.state[case.layout.parameters])
    for place in range(30):
        columns = np.full((12, 1, 4, 3), 0.5)  # derivatives, and rates of s
        columns[..., :2, 0] = 0.2 if place == 2 else 0.001
        whole: Any = SimpleNamespace(inside=slice(0, 10), intervals=12, ends=(place,))
        course._remember(whole, columns, point)
        window: Any = SimpleNamespace(start=0.5 * place, length=0.5)
        monkeypatch.setattr(swing, '_end', lambda _, place=place: place)
        largest = course.deflections(window)[0, 0]
    assert largest == 0.2
