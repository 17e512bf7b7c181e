"""The predicted twist: the true one on exact motion, its derivatives against central differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import central_difference
from mbaid_ros.core.filter.knots import Midpoints
from mbaid_ros.core.filter.state import Layout
from mbaid_ros.core.filter.twist_prediction import Bodies, Prediction, gains_by_unknowns, joint_gains, predict
from mbaid_ros.core.geometry import Array, cross, exp, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.model_errors import KnownErrors
from mbaid_ros.core.robot.orbit import about, of_bodies
from mbaid_ros.core.unknowns.bodies import known_bodies, spin_inertias
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
            self.kernel = self.kernel.storing(random_storage(rng, model))
        count = 3
        joints, rates, rotation, twist = random_state(rng, model.joints, count)
        none, thrust = np.zeros((count, 3)), np.zeros((count, 6))
        stored = rng.normal(size=(count, self.kernel.storage.count))
        place = rng.normal(size=(count, 3))
        self.middle = Midpoints(joints, rates, rotation, place, twist, none, none, thrust, stored)
        if seed >= 2:
            brought = 0.1 * rng.normal(size=(count, 60 * len(self.kernel.known)))
            self.middle = replace(self.middle, tide=brought)
        uncertain = tuple(int(index) for index in np.flatnonzero(self.kernel.known[:, 0] > 0.0))[:2]
        errors = KnownErrors(uncertain, np.eye(10 * len(uncertain)))
        wheels = spin_inertias(self.kernel, [0.1] * self.kernel.storage.count)
        self.layout = Layout.of(self.kernel, (known_bodies(model, errors), wheels))
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


def brought(case: Case) -> Array:
    """Return what an orbit has brought to the momentum of all bodies."""
    columns = about(case.middle.tide, np.zeros((len(case.middle), 3)))
    return of_bodies(columns, case.kernel.model.body_parameters()) if columns.size else np.zeros((len(columns), 6))


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
    total -= brought(case)
    assert model.joints > 0
    for index, momentum in enumerate(total):
        point = np.concatenate((momentum, case.kernel.target.parameters))
        found = predicted(Layout.of(case.kernel, ()), middle[index : index + 1], point)[0].twist[0]
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
    count, layout = case.kernel.model.joints, Layout.of(case.kernel, ())

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
