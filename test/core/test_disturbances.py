"""A torque and a force from outside, constant in a motion or slowly varying."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.data import NOISE, history
from benchmarks.frame import declared
from benchmarks.honesty.conditions import servicer
from benchmarks.honesty.readings import read
from benchmarks.honesty.runs import published
from benchmarks.honesty.worlds import float_freely
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.forces import DisturbanceModel, disturbances
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from simulated import robot

TURNED = exp(np.array([[0.3, -0.2, 0.9]]))
WHOLE = np.array([[10.0, 1.0, -2.0, 5.0, *np.zeros(6)]])  # centre of mass (0.1, -0.2, 0.5) m


@pytest.mark.parametrize(('axes', 'rotation'), [('body', TURNED[0]), ('inertial', np.eye(3))])
def test_a_force_acts_through_the_common_centre_of_mass_in_the_declared_axes(axes: str, rotation: Array) -> None:
    push = DisturbanceModel(0.5, 30.0, axes)  # type: ignore[arg-type]
    torque, force = disturbances(push, push)
    where = WHOLE, np.zeros(3), np.zeros(1), TURNED
    np.testing.assert_allclose(torque.momentum_rates(*where)[0], np.vstack((np.zeros((3, 3)), rotation)))
    rates = force.momentum_rates(*where)[0]
    np.testing.assert_allclose(rates[:3], rotation)
    np.testing.assert_allclose(rates[3:], np.cross([0.1, -0.2, 0.5], rotation, axisb=0, axisc=0))
    np.testing.assert_array_equal(force.time_constants, [30.0] * 3)
    np.testing.assert_array_equal(force.factor, 0.5 * np.eye(3))


def test_axes_of_the_orbit_turn_with_it() -> None:
    orbit = Orbit.inertial(1e-3, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))
    push = DisturbanceModel(0.5, 30.0, 'orbit', orbit)
    times = np.array([0.0, 0.5e3 * np.pi])
    first, later = push.rotation(times, np.tile(np.eye(3), (2, 1, 1)))
    np.testing.assert_allclose(first[:, 2], [0.0, 0.0, 1.0], atol=1e-12)  # z of LVLH is down
    np.testing.assert_allclose(first[:, 1], [0.0, -1.0, 0.0], atol=1e-12)  # y against the normal
    np.testing.assert_allclose(np.linalg.det(first), 1.0)
    turned = exp(np.array([[0.0, 0.5 * np.pi, 0.0]]))[0]
    np.testing.assert_allclose(later, turned @ first, atol=1e-12)


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'disturbance.torque_std': 0.1, 'disturbance.torque_time': 0.1}, 'at least window'),
        ({'disturbance.force_std': 0.1, 'disturbance.force_time': 9.0, 'method': 'difference'}, 'method trajectory'),
        ({'disturbance.force_std': 0.1, 'disturbance.axes': 'orbit'}, 'orbit.mean_motion'),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, object], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        Session(build(EstimatorConfig, {'target_link': 'link7', **values}), robot('servicer7').urdf)


SECONDS, SIZE, TIME = 30.0, 0.3, 30.0  # s, N m, s


def varying(seed: int) -> tuple[Estimate, Array]:
    """Return the last estimate of a run in which a declared torque varies, and the true parameters."""
    rng, step = np.random.default_rng([seed, 7]), 0.25
    times = np.arange(0.0, SECONDS + 1.0, step)
    values, kept = [rng.normal(size=3)], np.exp(-step / TIME)
    for _ in times[1:]:
        values.append(kept * values[-1] + np.sqrt(1.0 - kept**2) * rng.normal(size=3))
    course = SIZE * np.array(values)

    def wrench(time: float, rotation: Array, _position: Array, _whole: Array) -> Array:
        now = np.array([np.interp(time, times, column) for column in course.T])
        return np.concatenate((np.zeros(3), rotation @ now))

    world = replace(servicer(seed), seconds=SECONDS, wrench=wrench)
    model = load_model(world.urdf)
    push = {'disturbance.torque_std': SIZE, 'disturbance.torque_time': TIME}
    config = build(EstimatorConfig, {**EXACT, 'target_link': 'link7', **declared(NOISE), **push})
    session = Session(config, world.urdf)
    readings = read(float_freely(world), NOISE, seed)
    return history(session, published(readings, model, NOISE))[-1], physical(model.link('link7').parameters)


@pytest.mark.long
def test_a_torque_that_varies_as_declared_leaves_right_intervals() -> None:
    distances = []
    for seed in range(3):
        last, truth = varying(seed)
        assert last.status in {'estimating', 'converged'}
        known = last.identifiable
        distances.append((last.parameters - truth)[known] / last.std[known])
    assert np.sqrt(np.mean(np.concatenate(distances) ** 2)) < 1.8
    assert np.max(np.abs(np.concatenate(distances))) < 4.0
