"""Sensor noise: its statistics, its seeds, and the schedule of the readings."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from mbaid_ros.core.geometry import log, rotate_back, rotation_from_quaternion
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.sensors import (
    BaseReadings,
    JointReadings,
    SensedSimulation,
    Sensors,
)
from mbaid_ros.simulation.simulation import Simulation, Truth
from simulated import table1

NOISE = SensorNoise(1e-4, 2e-3, 3e-3, 4e-4, 5e-3, 6e-4)
NONE = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
COUNT = 20000


def still(count: int = COUNT) -> Truth:
    quaternion = np.array([0.1, -0.7, 0.5, 0.5])
    orientation = np.tile(quaternion / np.linalg.norm(quaternion), (count, 1))
    three, four = np.ones((count, 3)), np.ones((count, 4))
    return Truth(np.linspace(0.0, 1.0, count), four, four, four, three, orientation, three, three)


def run(seed: int = 0, noise: SensorNoise = NOISE, rates: tuple[float, float] = (100.0, 30.0)) -> SensedSimulation:
    model, start = table1()
    return SensedSimulation(Simulation(model, Passive(), start, 0.02), Sensors(noise, seed), *rates)


def test_every_channel_has_its_own_deviation() -> None:
    truth, sensors = still(), Sensors(NOISE, 1)
    joints, base = sensors.joints(truth), sensors.base(truth)
    turn = rotation_from_quaternion(base.orientation) @ np.swapaxes(
        rotation_from_quaternion(truth.base_orientation), 1, 2
    )
    channels = {
        'joint_position': joints.position - truth.joint_position,
        'joint_velocity': joints.velocity - truth.joint_velocity,
        'base_position': base.position - truth.base_position,
        'base_orientation': log(turn),  # about the fixed axes
        'base_linear_velocity': base.linear_velocity - truth.base_linear_velocity,
        'base_angular_velocity': base.angular_velocity - truth.base_angular_velocity,
    }
    for name, error in channels.items():
        deviation = getattr(NOISE, name)
        # Five standard errors of a mean and of a standard deviation of COUNT numbers.
        assert error.mean(axis=0) == pytest.approx(0.0, abs=5.0 * deviation / COUNT**0.5), name
        assert error.std(axis=0) == pytest.approx(deviation, rel=5.0 / (2.0 * COUNT) ** 0.5), name
        correlation = np.corrcoef(error.T) - np.eye(error.shape[1])
        assert np.abs(correlation).max() < 5.0 / COUNT**0.5, name
    assert np.array_equal(joints.effort, truth.joint_effort)


def test_the_covariances_are_those_of_the_noise() -> None:
    base = Sensors(NOISE, 1).base(still(1))
    assert np.diag(base.pose_covariance) == pytest.approx([9e-6] * 3 + [16e-8] * 3)
    assert np.diag(base.twist_covariance) == pytest.approx([25e-6] * 3 + [36e-8] * 3)


def test_without_noise_the_readings_are_the_truth() -> None:
    truth, sensors = still(10), Sensors(NONE, 1)
    assert np.array_equal(sensors.joints(truth).position, truth.joint_position)
    base = sensors.base(truth)
    assert np.array_equal(base.orientation, truth.base_orientation)
    assert np.array_equal(base.linear_velocity, truth.base_linear_velocity)
    assert not base.pose_covariance.any()


def test_the_noise_is_that_of_its_seed() -> None:
    first, again, other = (run(seed).read(1.0)[:2] for seed in (3, 3, 4))
    for kind in (0, 1):
        assert np.array_equal(first[kind].position, again[kind].position)
        assert not np.array_equal(first[kind].position, other[kind].position)


def test_the_readings_do_not_depend_on_the_batches() -> None:
    whole = run().read(2.0)[:2]
    pieces = run()
    parts = [pieces.read(until)[:2] for until in (0.0, 0.001, 0.5, 0.5, 1.234, 2.0)]
    for kind, (expected, columns) in enumerate(zip(whole, (JointReadings, BaseReadings), strict=True)):
        for field in fields(columns):
            if not field.name.endswith('covariance'):
                joined = np.concatenate([getattr(part[kind], field.name) for part in parts])
                assert np.array_equal(joined, getattr(expected, field.name)), field.name


def test_each_sensor_has_its_rate() -> None:
    joints, base = run(rates=(100.0, 30.0)).read(2.0)[:2]
    assert joints.time == pytest.approx(np.arange(201) / 100.0)
    assert base.time == pytest.approx(np.arange(61) / 30.0)


def test_sensors_of_different_rates_see_one_motion() -> None:
    joints, base = run(noise=NONE, rates=(50.0, 200.0)).read(1.0)[:2]
    both, alone = run(noise=NONE, rates=(200.0, 200.0)).read(1.0)[:2]
    assert np.array_equal(joints.position, both.position[::4])
    velocity = rotate_back(rotation_from_quaternion(base.orientation), base.linear_velocity)
    assert np.array_equal(velocity, rotate_back(rotation_from_quaternion(alone.orientation), alone.linear_velocity))
