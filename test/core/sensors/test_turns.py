"""Jumps of wrapped angles, of joints that turn slowly and of wheels that turn by more than a half between readings."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import JointStream
from mbaid_ros.core.sensors.joints import JointMerge

COUNT, SPACING = 200, 20_000_000  # ns
TIME = 1e-9 * SPACING * np.arange(COUNT)
RANDOM = np.random.default_rng(2)


def merged(position: Array, velocity: Array, pieces: int, time: Array = TIME) -> Array:
    """Return the positions (N, 1) that one turning joint has after the merge."""
    merge = JointMerge(np.array([True]), 100_000_000, 0)
    stamp, parts = np.round(1e9 * time).astype(np.int64), []
    for piece in np.array_split(np.arange(len(time)), pieces):
        found = merge.push({(0,): JointStream(stamp[piece], position[piece, None], velocity[piece, None])})
        parts += [] if found is None else [found.position[:, 0]]
    return np.concatenate(parts)


def wrapped_to_a_turn(angle: Array) -> Array:
    return np.asarray(np.angle(np.exp(1j * angle)))


@pytest.mark.parametrize('pieces', [1, 9, COUNT])
@pytest.mark.parametrize('speed', [-400.0, -170.0, -157.08, 0.3, 157.08, 1000.0])
@pytest.mark.parametrize('wrapped', [True, False])
def test_positions_follow_the_velocity(speed: float, pieces: int, *, wrapped: bool) -> None:
    angle = 0.3 + speed * 1e-9 * SPACING * np.arange(COUNT)
    read = wrapped_to_a_turn(angle) if wrapped else angle
    read += 1e-3 * RANDOM.standard_normal(COUNT)
    velocity = speed + 0.1 * RANDOM.standard_normal(COUNT)
    found = merged(read, velocity, pieces)
    assert np.ptp(found - angle) < 0.01


@pytest.mark.parametrize('velocity', [np.nan, 0.0, 1e4])
def test_a_velocity_that_is_missing_or_wrong_turns_nothing(velocity: float) -> None:
    angle = np.pi - 0.05 * np.cos(0.1 * np.arange(COUNT))
    found = merged(wrapped_to_a_turn(angle), np.full(COUNT, velocity), 1)
    assert np.ptp(found - angle) < 1e-9


@pytest.mark.parametrize('pieces', [1, 200])
@pytest.mark.parametrize('rate', [10.0, 50.0, 400.0])
@pytest.mark.parametrize('way', [1.0, -1.0])
def test_a_wheel_is_followed_as_it_spins_up_over_lost_messages(way: float, rate: float, pieces: int) -> None:
    time: Array = np.arange(0.0, 30.0, 1.0 / rate)
    kept = (RANDOM.random(len(time)) > 0.2) & ((time < 12.0) | (time > 12.5))
    time = time[kept]
    speed = way * (330.0 * np.sin(0.1 * time) + 2.0)
    angle = way * (2.0 * time - 3300.0 * np.cos(0.1 * time))
    read = wrapped_to_a_turn(angle) + 1e-3 * RANDOM.standard_normal(len(time))
    found = merged(read, speed + 0.05 * RANDOM.standard_normal(len(time)), pieces, time)
    assert np.ptp(found - angle) < 0.02


@pytest.mark.parametrize('pieces', [1, COUNT])
@pytest.mark.parametrize('velocity', [0.0, np.nan, 330.0])
def test_single_wrong_readings_of_a_wheel_leave_no_turns_behind(velocity: float, pieces: int) -> None:
    angle, speed = 0.3 + 330.0 * TIME, np.full(COUNT, 330.0)
    wrong = np.arange(COUNT) % 13 == 5
    read, speed[wrong] = np.where(wrong, 0.0, wrapped_to_a_turn(angle)), velocity
    found = merged(read, speed, pieces)
    assert np.ptp((found - angle)[~wrong]) < 1e-6


def test_an_arm_whose_velocities_are_in_degrees_turns_nowhere() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    angle = 2.0 * np.sin(0.5 * time)
    assert np.ptp(merged(angle, np.rad2deg(np.cos(0.5 * time)), 1, time) - angle) < 1e-9
