"""An orbit that is no circle, nor as fast as declared: what is read and what gravity brings change by these columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, exp, log, rotate
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.orbit import Orbit, momentum_rates, of_bodies
from mbaid_ros.core.samples import BaseStream
from mbaid_ros.core.sensors.external_momentum import FallingFrame
from mbaid_ros.core.unknowns.declaration import Reading
from mbaid_ros.core.unknowns.environment import Circle, OrbitShape, orbit_shape
from observed import kernel
from orbiting import orbit

RATE = 1.1e-3
SMALL = 1e-4
TIME = np.array([0.0, 60.0, 200.0, 400.0])  # s, in which it turns by 0.44 rad
ORIGIN = np.array([8.0, -11.0, 5.0])
LAST = np.array([70.0, 7.0, -3.0, 20.0, 30.0, 1.0, -2.0, 32.0, 1.0, 12.0])


def circle(frame: str) -> Orbit:
    if frame == 'inertial':
        return orbit(RATE)
    return Orbit.turning_with(RATE, 'lvlh' if frame == 'lvlh' else 'hill')


def eccentric(around: Orbit, number: int) -> tuple[Orbit, Array]:
    """Return an orbit that is a little none, and its numbers."""
    numbers = SMALL * np.eye(3)[number]
    if number == 2:
        return replace(around, mean_motion=(1.0 + SMALL) * RATE), numbers
    return around.eccentric(SMALL, 0.0 if number == 0 else np.pi / 2.0), numbers


def shape(around: Orbit, *, relative: bool = True) -> OrbitShape:
    return orbit_shape(Circle(around, 0.002, relative))


def poses(seed: int) -> tuple[Array, Array]:
    """Return orientations and places, the latter from the run's origin, in the frame that falls along."""
    rng = np.random.default_rng(seed)
    return exp(rng.normal(size=(len(TIME), 3))), rng.normal(size=(len(TIME), 3))


def taken(true: Orbit, declared: Orbit, twist: Array, *, relative: bool) -> BaseStream:
    """Return poses and twists (N, 6) of the falling frame as they are read, taken for those of the declared orbit."""
    rotation, place = poses(0)
    back = np.swapaxes(true.turned(TIME), 1, 2)
    linear, angular = twist[:, :3], twist[:, 3:]
    if relative:
        rate = true.rate(TIME)
        linear, angular = linear - np.cross(rate, ORIGIN + place), angular - rate
    seen = BaseStream(
        np.round(TIME * 1e9).astype(np.int64),
        rotate(back, ORIGIN + place),
        back @ rotation,
        rotate(back, linear),
        rotate(back, angular),
        *np.zeros((2, len(TIME), 6, 6)),
    )
    return FallingFrame(declared, kernel('ets7').model, relative_twist=relative, epoch=0).falling(seen)


@pytest.mark.parametrize('relative', [True, False])
@pytest.mark.parametrize('number', range(3))
@pytest.mark.parametrize('frame', ['lvlh', 'hill'])
def test_what_is_read_turns_back(frame: str, number: int, *, relative: bool) -> None:
    around = circle(frame)
    true, numbers = eccentric(around, number)
    rotation, place = poses(0)
    still = np.zeros((len(TIME), 6))
    read = taken(true, around, still, relative=relative)
    nothing = np.zeros((len(TIME), 3, 3))
    motion = Reading(still, still, rotation, nothing, nothing, TIME, place, rotation, ORIGIN)
    pose, twist = (each @ numbers for each in shape(around, relative=relative).reading(motion))
    assert log(read.rotation @ np.swapaxes(rotation, 1, 2)) == pytest.approx(pose[:, :3], rel=1e-2, abs=1e-9)
    assert read.position - ORIGIN - place == pytest.approx(pose[:, 3:], rel=1e-2, abs=1e-7)
    assert read.angular_velocity == pytest.approx(twist[:, :3], rel=1e-2, abs=1e-10)
    # Velocities relative to the run's origin, which does not turn, are what the positions change by.
    assert read.linear_velocity == pytest.approx(twist[:, 3:], rel=1e-2, abs=2e-9)
    assert np.abs(pose).max() > 1e-6


@pytest.mark.parametrize('number', range(3))
@pytest.mark.parametrize('frame', ['inertial', 'lvlh', 'hill'])
def test_gravity_brings_what_the_true_orbit_does(frame: str, number: int) -> None:
    """About where the run is read to begin, of a robot where it is read to be, against the truth of both."""
    around, servicer = circle(frame), kernel('servicer7')
    true, numbers = eccentric(around, number)
    rotation, place = poses(1)
    angles = np.random.default_rng(2).normal(size=(len(TIME), servicer.model.joints))
    bodies = servicer.with_target(LAST)

    def brought(by: Orbit, turn: Array) -> Array:
        placed = servicer.kinematics.configure(turn @ rotation, angles)
        there = rotate(turn, ORIGIN + place)
        rates = of_bodies(momentum_rates(by, TIME, placed, there), bodies)
        rates[:, 3:] -= np.cross(ORIGIN, rates[:, :3])
        return np.asarray(rates)

    whole_turn = np.broadcast_to(np.eye(3), (len(TIME), 3, 3))
    back = around.turned(TIME) @ np.swapaxes(true.turned(TIME), 1, 2) if around.turning else whole_turn
    expected = brought(true, whole_turn) - brought(around, back)
    placed = servicer.kinematics.configure(rotation, angles)
    whole = np.sum(express(bodies, placed.rotation, place[:, None] + placed.position), axis=1)
    found = shape(around).momentum_rates(whole, ORIGIN, TIME, rotation) @ numbers
    assert found == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_its_prior_is_of_any_direction() -> None:
    unknown = shape(circle('hill'))
    assert unknown.factor @ unknown.factor.T == pytest.approx(0.5 * 0.002**2 * np.eye(3))
    assert set(unknown.labels) == {'orbit shape'}
