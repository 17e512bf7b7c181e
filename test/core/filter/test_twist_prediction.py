"""Knots of averaged samples, and the base's twist predicted between them, with its derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import central_difference, generic
from mbaid_ros.core.filter.linearise import predict
from mbaid_ros.core.geometry import Array, cross, exp, log, skew
from mbaid_ros.core.joints.model import gains_by_unknowns, joint_gains
from mbaid_ros.core.links import known_bodies
from mbaid_ros.core.robot.body import standard
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import KnownErrors, MomentumKernel, about_points, summed_over_bodies
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import Layout, trust_region
from mbaid_ros.core.wheels import spin_inertias
from mbaid_ros.core.windows import Bodies, Knots, Midpoints, Prediction, averages, bridged, midpoints
from random_robots import random_state, random_storage, random_urdf

SEEDS = range(4)
STEP = 1e-5
TARGET = slice(6, 16)  # the body among the parameters
TOLERANCE = 1e-7  # of the largest element


class Case:
    """A random robot in random motion."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        model = load_model(random_urdf(rng, joints=6))
        self.kernel = MomentumKernel(model, model.last_link)
        if seed % 2:
            self.kernel = self.kernel.with_storage(random_storage(rng, model))
        count = 3
        joints, rates, rotation, twist = random_state(rng, model.joints, count)
        none, thrust = np.zeros((count, 3)), np.zeros((count, 6))
        stored = rng.normal(size=(count, self.kernel.storage.count))
        place = rng.normal(size=(count, 3))
        self.middle = Midpoints(joints, rates, rotation, place, twist, none, none, thrust, stored)
        if seed >= 2:
            self.middle = replace(
                self.middle, gravity_columns=0.1 * rng.normal(size=(count, 60 * len(self.kernel.known)))
            )
        uncertain = tuple(int(index) for index in np.flatnonzero(self.kernel.known[:, 0] > 0.0))[:2]
        errors = KnownErrors(uncertain, np.eye(10 * len(uncertain)))
        wheels = spin_inertias(self.kernel, [0.1] * self.kernel.storage.count)
        self.layout = Layout.from_unknowns(self.kernel, (known_bodies(model, errors), wheels))
        changes = 0.01 * rng.normal(size=errors.count + wheels.count)
        self.point = np.concatenate((rng.normal(size=6), self.kernel.target.parameters, changes))

    def predicted(self, point: Array) -> tuple[Prediction, Bodies]:
        """Return what a point's parameters predict."""
        return predicted(self.layout, self.middle, point)

    def twist(self, point: Array) -> Array:
        """Return the predicted twists."""
        return self.predicted(point)[0].twist


def predicted(layout: Layout, middle: Midpoints, parameters: Array) -> tuple[Prediction, Bodies]:
    """Return what the parameters of a point predict."""
    state = np.zeros(layout.size)
    state[layout.parameters] = parameters
    return predict(layout, middle, layout.point(state))


def tidal_momentum(case: Case) -> Array:
    """Return the change of the momentum of all bodies by an orbit."""
    columns = about_points(case.middle.gravity_columns, np.zeros((len(case.middle), 3)))
    bodies = case.kernel.model.body_parameters()
    return summed_over_bodies(columns, bodies) if columns.size else np.zeros((len(columns), 6))


def close(found: Array, expected: Array) -> None:
    assert found == pytest.approx(expected, abs=TOLERANCE * float(np.abs(expected).max()))


@pytest.mark.parametrize('seed', SEEDS)
def test_the_predicted_twist_has_the_momentum(seed: int) -> None:
    case = Case(seed)
    model, middle = case.kernel.model, case.middle
    # Any twist at all is that of the momentum which goes with it, each instant with its own.
    states = case.kernel.states_of(
        middle.base_rotation, middle.joint_position, middle.joint_velocity, middle.base_twist, middle.stored
    )
    total = states.known_momentum + states.regressor @ case.kernel.target.parameters
    total[:, 3:] += cross(middle.base_position, total[:, :3])
    total -= tidal_momentum(case)
    assert model.joints > 0
    for index, momentum in enumerate(total):
        point = np.concatenate((momentum, case.kernel.target.parameters))
        found = predicted(Layout.from_unknowns(case.kernel, ()), middle[index : index + 1], point)[0].twist[0]
        assert found == pytest.approx(middle.base_twist[index], abs=1e-10)


def test_known_thrust_is_momentum_that_is_added() -> None:
    case = Case(0)
    impulse = np.random.default_rng(9).normal(size=(len(case.middle), 6))
    pushed, _ = predicted(case.layout, replace(case.middle, impulse=impulse), case.point)
    for index, brought in enumerate(impulse):
        point = case.point.copy()
        point[:6] += brought
        expected, _ = predicted(case.layout, case.middle[index : index + 1], point)
        assert pushed.twist[index] == pytest.approx(expected.twist[0], rel=1e-12)
        assert pushed.by_parameters[index] == pytest.approx(expected.by_parameters[0], rel=1e-12)
        assert pushed.by_pose_error[index] == pytest.approx(expected.by_pose_error[0], rel=1e-12)


def test_thrusters_bring_momentum_by_their_errors_even_if_one_is_exact() -> None:
    """As much as that about the base's own place, for each of two thrusters with five errors each."""
    case = Case(0)
    layout, columns = case.layout, np.random.default_rng(1).normal(size=(len(case.middle), 2, 6, 5))
    state = np.zeros(layout.size)
    state[layout.parameters] = case.point
    point = layout.point(state)
    errors = np.concatenate((np.zeros(5), generic(2, 5)))
    middle = replace(case.middle, thrust=columns.reshape(len(columns), -1))
    off = replace(point, nominal=replace(point.nominal, thrust=errors))
    brought = columns[:, 1] @ errors[5:]
    expected = predict(layout, replace(middle, impulse=brought), point)[0]
    assert predict(layout, middle, off)[0].twist == pytest.approx(expected.twist, rel=1e-12)


@pytest.mark.parametrize('seed', SEEDS)
def test_derivatives_by_parameters_and_known_bodies(seed: int) -> None:
    case = Case(seed)
    found = case.predicted(case.point)[0].by_parameters
    close(found, central_difference(case.twist, case.point, STEP))


@pytest.mark.parametrize('seed', SEEDS)
def test_derivatives_by_errors_of_the_pose(seed: int) -> None:
    case = Case(seed)
    prediction, _ = case.predicted(case.point)

    def twist(error: Array) -> Array:
        turn = exp(error[:3])
        middle = replace(
            case.middle,
            base_rotation=turn @ case.middle.base_rotation,
            base_position=case.middle.base_position + error[3:],
        )
        return predicted(case.layout, middle, case.point)[0].twist

    expected = central_difference(twist, np.zeros(6), STEP)
    # The turn of V itself, theta x V, is left out of the field.
    expected[:, :3, :3] += skew(prediction.twist[:, :3])
    expected[:, 3:, :3] += skew(prediction.twist[:, 3:])
    close(prediction.by_pose_error, expected)


@pytest.mark.parametrize('seed', SEEDS)
def test_derivatives_by_joints(seed: int) -> None:
    case = Case(seed)
    count, layout = case.kernel.model.joints, Layout.from_unknowns(case.kernel, ())

    def twist(error: Array) -> Array:
        middle = replace(
            case.middle,
            joint_position=case.middle.joint_position + error[:count],
            joint_velocity=case.middle.joint_velocity + error[count:],
        )
        return predicted(layout, middle, case.point[:16])[0].twist

    by_rate, by_position = joint_gains(case.kernel, predicted(layout, case.middle, case.point[:16])[1])
    expected = central_difference(twist, np.zeros(2 * count), STEP)
    close(by_position, expected[..., :count])
    close(by_rate, expected[..., count:])


@pytest.mark.parametrize('seed', SEEDS)
def test_what_joint_rates_make_depends_on_the_bodies(seed: int) -> None:
    case = Case(seed)

    def by_rate(bodies: Array) -> Array:
        point = np.concatenate((case.point[: TARGET.start], bodies))
        return joint_gains(case.kernel, case.predicted(point)[1])[0]

    bodies = case.point[TARGET.start :]
    predicted_bodies = case.predicted(case.point)[1]
    found = gains_by_unknowns(case.layout, case.kernel, predicted_bodies, by_rate(bodies))
    expected = central_difference(by_rate, bodies, STEP)  # (N, 6, n, 10 + e)
    close(found, np.swapaxes(expected, -1, -2))


COUNT = 14
MIDDLE = 1.3  # s


def rotation(time: Array) -> Array:
    """Return a motion that turns about two axes at once."""
    zero = np.zeros_like(time)
    return exp(np.stack((np.sin(time), 0.4 * time, zero), 1)) @ exp(np.stack((zero, zero, np.cos(0.7 * time)), 1))


def position(time: Array) -> Array:
    return np.stack((np.sin(time), np.cos(0.8 * time), 0.3 * time**2), axis=1)


def angles(time: Array) -> Array:
    return np.stack((np.sin(1.1 * time), np.cos(0.6 * time)), axis=1)


def rates(time: Array) -> Array:
    return np.stack((1.1 * np.cos(1.1 * time), -0.6 * np.sin(0.6 * time)), axis=1)


def sampled(time: Array) -> Samples:
    count = len(time)
    identity = np.tile(np.eye(6), (count, 1, 1))
    return Samples(
        time, angles(time), rates(time), position(time), rotation(time), position(time), angles(time) @ np.ones((2, 3)),
        identity, identity,
    )  # fmt: skip


def averaged(samples: Samples, start: float, spacing: float, count: int, origin: Array) -> Knots:
    return averages([samples], np.array([start]), spacing, count, origin)


def knots_of(spacing: float, samples: int, jitter: float = 0.0, interval: int = 5, late: float = 0.0) -> Knots:
    """Return knots of so many samples each, one interval of them about MIDDLE.

    Sample times jitter by a part of their spacing, symmetric in each knot, and are `late` by a part of a knot.
    """
    start = MIDDLE - (interval + 1) * spacing
    inner = (np.arange(samples) + 0.5) / samples - 0.5
    inner = inner + late + jitter * np.sin(7.0 * inner) / samples
    time = (start + (np.arange(COUNT) + 0.5)[:, None] * spacing + inner * spacing).ravel()
    return averaged(sampled(time), start, spacing, COUNT, np.zeros(3))


def order(error: list[float]) -> float:
    return float(np.log2(error[0] / error[1]))


@pytest.mark.parametrize('samples', [1, 2, 5])
@pytest.mark.parametrize(('jitter', 'late'), [(0.0, 0.0), (0.5, 0.0), (0.0, 0.1)])
def test_midpoints_are_of_fourth_order(samples: int, jitter: float, late: float) -> None:
    found: dict[str, list[float]] = {}
    for spacing in (0.2, 0.1):
        inner = midpoints(knots_of(spacing, samples, jitter, late=late), spacing)[5:6]
        time = np.array([MIDDLE])
        ends = (time - spacing / 2, time + spacing / 2)
        for name, error in (
            ('joints', inner.joint_position - angles(time)),
            ('rates', inner.joint_velocity - rates(time)),
            ('position', inner.base_position - position(time)),
            ('twist', inner.base_twist[:, :3] - position(time)),
            ('rotation', log(inner.base_rotation @ np.swapaxes(rotation(time), 1, 2))),
            ('turn', (inner.turn - log(rotation(ends[1]) @ np.swapaxes(rotation(ends[0]), 1, 2))) / spacing),
            ('step', (inner.step - (position(ends[1]) - position(ends[0]))) / spacing),
        ):
            found.setdefault(name, []).append(float(np.abs(error).max()))
    for name, sizes in found.items():
        least = 2.7 if late and name == 'turn' else 3.3  # two rotations over the offset count as commuting
        assert sizes[1] < 2e-7 or order(sizes) > least, (name, sizes)
        assert sizes[0] < 3e-4, name


def test_ends_follow_the_line_of_their_neighbours_corrections() -> None:
    error = []
    for spacing in (0.1, 0.05):
        middle = midpoints(knots_of(spacing, 5, interval=0), spacing)
        error.append(float(np.abs(middle.base_position[0] - position(np.array([MIDDLE]))[0]).max()))
    assert order(error) > 3.3


@pytest.mark.parametrize('place', [1, 5, COUNT - 2])
def test_a_knot_without_samples_is_bridged(place: int) -> None:
    sizes = []
    for spacing in (0.1, 0.05):
        full = knots_of(spacing, 5)
        start = MIDDLE - 6.0 * spacing
        time = (start + (np.arange(COUNT) + 0.5)[:, None] * spacing + (np.arange(5) - 2.0) / 5.0 * spacing).ravel()
        knots = averaged(sampled(time[np.arange(len(time)) // 5 != place]), start, spacing, COUNT, np.zeros(3))
        assert np.flatnonzero(knots.empty).tolist() == [place]
        whole = bridged(knots)
        assert not np.any(whole.empty)
        assert np.array_equal(
            np.delete(whole.joint_position, place, axis=0), np.delete(full.joint_position, place, axis=0)
        )
        turned = log(whole.base_rotation @ np.swapaxes(full.base_rotation, 1, 2))
        sizes.append([np.abs(whole.joint_position - full.joint_position).max(), np.abs(turned).max()])
    # Fourth order from four neighbours, second from the two that a knot next to the end has.
    ratio = np.array(sizes[0]) / np.array(sizes[1])
    assert np.all(ratio > (3.2 if place in (1, COUNT - 2) else 13.0))


BODY = standard(np.array([10.0, 0.1, 0.2, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0]))
POINT = np.concatenate((np.zeros(6), BODY, np.zeros(3)))


def test_a_step_is_as_long_as_changes_the_body_by_half_of_its_size() -> None:
    step = np.zeros_like(POINT)
    step[6] = 20.0
    assert trust_region(POINT, step) == pytest.approx(0.25)
    assert trust_region(POINT, -step) == pytest.approx(0.25)
    assert trust_region(POINT, 0.2 * step) == 1.0


@pytest.mark.parametrize('seed', SEEDS)
def test_a_robot_in_a_plane_is_predicted_to_stay_in_it(seed: int) -> None:
    """At any momentum of the state: the plane takes up the rest, and what is in it belongs to the twist."""
    case = Case(seed)
    turn = np.linalg.qr(generic(seed, 3, 3))[0]
    plane = np.zeros((3, 6))
    plane[:2, :3], plane[2, 3:] = turn[:2], turn[2]
    within = Layout.from_unknowns(case.kernel, case.layout.unknowns, plane=plane)
    found, free = predicted(within, case.middle, case.point)[0].twist, case.twist(case.point)
    assert found @ plane.T @ plane == pytest.approx(found, abs=1e-9)
    assert np.abs(free - free @ plane.T @ plane).max() > 1e-3
