"""A gravity gradient that nobody has declared: what it does to the momentum is what an orbit does."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.orbit import Orbit, momentum_rates, of_bodies
from mbaid_ros.core.unknowns.environment import gravity, rate_of
from observed import kernel

RATE = 1.1e-3


def orbit(rng: np.random.Generator) -> Orbit:
    normal = rng.normal(size=3)
    return Orbit.inertial(RATE, np.cross(normal, rng.normal(size=3)), normal)


def numbers(around: Orbit) -> Array:
    """Return the ten numbers of an orbit's gradient at the begin, and of how it changes."""
    before, now, after = around.gradient(np.array([-1.0, 0.0, 1.0]))
    both = np.array([now, (after - before) / 2.0])
    mixed = np.sqrt(2.0) * np.column_stack((both[:, 0, 1], both[:, 0, 2], both[:, 1, 2]))
    across = (both[:, 0, 0] - both[:, 1, 1]) / np.sqrt(2.0)
    along = -3.0 * both[:, 2, 2] / np.sqrt(6.0)
    return np.column_stack((mixed, across, along)).ravel()


@pytest.mark.parametrize('seed', range(3))
def test_it_changes_the_momentum_as_an_orbit_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    servicer, around = kernel('servicer7'), orbit(rng)
    rotation = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]
    rotation *= np.linalg.det(rotation)[:, None, None]
    place, origin = rng.normal(size=(4, 3)), np.array([8.0, -11.0, 5.0])
    placed = servicer.kinematics.configure(rotation, rng.normal(size=(4, servicer.model.joints)))
    bodies = servicer.with_target(np.array([70.0, 7.0, -3.0, 20.0, 30.0, 1.0, -2.0, 32.0, 1.0, 12.0]))
    whole = np.sum(express(bodies, placed.rotation, place[:, None] + placed.position), axis=1)
    time = np.array([0.0, 10.0, 20.0, 30.0])  # s, in which it turns by 0.07 rad
    found = gravity(RATE).momentum_rates(whole, origin, time, rotation) @ numbers(around)
    expected = of_bodies(momentum_rates(around, time, placed, origin + place), bodies)
    expected[:, 3:] -= np.cross(origin, expected[:, :3])
    size = np.abs(expected).max()
    assert np.all(np.abs(found - expected)[0] < 1e-9 * size)  # at the begin it is that of the orbit
    assert np.all(np.abs(found - expected) < 0.01 * size)  # then up to what turning is of second order
    assert rate_of(numbers(around)) == pytest.approx(RATE, rel=1e-9)


def test_its_prior_is_that_of_orbits_in_all_planes() -> None:
    rng = np.random.default_rng(0)
    unknown = gravity(RATE)
    size = np.sqrt(np.diag(unknown.factor @ unknown.factor.T))
    drawn = np.array([numbers(orbit(rng)) / size for _ in range(1500)])
    assert drawn.T @ drawn / len(drawn) == pytest.approx(np.eye(10), abs=0.15)
    assert gravity(0.0).count == 0
