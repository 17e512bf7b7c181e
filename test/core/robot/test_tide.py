"""What an orbit does to the momentum of random robots, in their standard parameters, against their points of mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.geometry import Array, exp, vec
from mbaid_ros.core.robot.kernel import MomentumKernel, momentum_rows
from mbaid_ros.core.robot.kinematics import Configuration
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.orbit import (
    about,
    brought,
    momentum_rates,
    of_bodies,
    of_link,
)
from mbaid_ros.core.sensors.external_momentum import FallingFrame
from mbaid_ros.core.sensors.streams import Windows
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulation.simulation import total_momentum
from observed import MID, configured_motion, observe
from orbiting import declared, orbit
from random_robots import random_state, random_urdf
from simulated import CONFIG, robot


@pytest.mark.parametrize('seed', range(4))
def test_columns_are_those_of_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    around, time = orbit(0.03), rng.uniform(0.0, 100.0, 2)
    points, masses = rng.normal(size=(2, 9, 3)), rng.uniform(0.5, 3.0, (2, 9))
    bodies = []
    for at, mass in zip(points, masses, strict=True):
        moments = np.einsum('k,ki,kj->ij', mass, at, at)
        bodies.append(np.concatenate(([mass.sum()], mass @ at, vec(np.trace(moments) * np.eye(3) - moments))))
    rotation, position = exp(rng.normal(size=(2, 2, 3))), rng.normal(size=(2, 2, 3))
    base = rng.normal(size=(2, 3))
    rates = momentum_rates(around, time, Configuration(rotation, position, np.zeros((2, 1, 6))), base)
    found = of_bodies(rates, np.array(bodies))
    for instant, up in enumerate(around.upward(time)):
        expected: Array = np.zeros(6)
        for body in range(2):
            at = base[instant] + position[instant, body] + points[body] @ rotation[instant, body].T
            pulls = 0.03**2 * masses[body][:, None] * (3.0 * (at @ up)[:, None] * up - at)
            expected += np.concatenate((pulls.sum(axis=0), np.cross(at, pulls).sum(axis=0)))
        assert found[instant] == pytest.approx(expected, rel=1e-11, abs=1e-14)


@pytest.mark.parametrize('seed', range(4))
def test_the_rows_lack_what_the_orbit_has_brought(seed: int) -> None:
    """The same for the fast rows and the states of single bodies, the unknown links' columns in their own frames."""
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=6))
    kernel = MomentumKernel(model, model.last_link, model.links[1].name)
    truth = configured_motion('servicer7', 1.0, 20.0, 0.05)
    positions, rates, rotation, twist = random_state(rng, model.joints, len(truth))
    samples = replace(
        observe(truth, MID),
        joint_position=positions,
        joint_velocity=rates,
        base_rotation=rotation,
        base_linear_velocity=twist[:, :3],
        base_angular_velocity=twist[:, 3:],
        base_position=rng.normal(size=(len(truth), 3)),
        joint_rate_gain=np.zeros((0, 0)),
        rate_tilt=np.zeros((0, 0)),
    )
    with_tide = FallingFrame(orbit(0.5), model, relative_twist=True).applied(samples, 0)
    plain, rows = momentum_rows(kernel, samples), momentum_rows(kernel, with_tide)
    columns = about(with_tide.tide, with_tide.base_position)
    assert kernel.states(with_tide).tide == pytest.approx(columns)
    assert rows.known == pytest.approx(plain.known - of_bodies(columns, kernel.known).T, rel=1e-12, abs=1e-12)
    whole = with_tide.impulse[-1] + brought(with_tide, model.body_parameters())
    parts = plain.known[:, -1] - rows.known[:, -1]
    for link, before, after in zip(kernel.unknown, plain.regressors, rows.regressors, strict=True):
        assert before - after == pytest.approx(np.moveaxis(of_link(columns, link), 0, -1), abs=1e-12)
        parts += (before - after)[..., -1] @ link.parameters
    parts[3:] += np.cross(with_tide.base_position[-1], parts[:3])
    assert parts == pytest.approx(whole, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize('size', [1, 7, 40])
def test_windows_one_at_a_time_have_the_same_to_the_last_bit(size: int) -> None:
    samples = observe(configured_motion('ets7', 2.0, 20.0, 0.05), MID)

    def through(parts: list[int]) -> Array:
        falling, cutter, found = FallingFrame(orbit(), robot('ets7'), relative_twist=True), Windows(0.5), []
        for begin in parts:
            found += [falling.applied(window, 0).tide for window in cutter.push(samples[begin : begin + parts[1]])]
        return np.concatenate(found)

    assert np.array_equal(through(list(range(0, 40, size)) if size < 40 else [0, 40]), through([0, 20]))


@pytest.mark.parametrize('name', ['servicer7', 'ets7'])
def test_what_is_left_of_a_simulated_robot_is_constant(name: str) -> None:
    """The simulator's bodies, the estimator's columns: P and L less what the orbit has brought, over a minute."""
    values = load_parameter_file(CONFIG / f'{name}_simulator.yaml', 'simulator')
    values |= {**declared(mean_motion=0.02), 'initial.base_position': [8.0, -4.0, 6.0], 'step': 0.05}
    model = robot(name)
    truth = make_simulation(build(SimulatorConfig, values), model).advance(np.arange(1200) * 0.05)
    samples = FallingFrame(orbit(0.02), model, relative_twist=True).applied(observe(truth, MID), 0)
    total = total_momentum(model, truth)
    columns = about(samples.tide, np.zeros((len(samples), 3)))
    left = total - of_bodies(columns, model.body_parameters())
    moved = np.ptp(total, axis=0)
    assert moved.max() > 10.0
    # The trapezoidal rule at 20 Hz.
    assert np.ptp(left, axis=0).max() < 2e-6 * moved.max()
