"""Odometry of any orbit, in any frame that turns with it: to the frame that falls along and back, and back and to it.

What falls freely moves in Hill's frame as Clohessy and Wiltshire say.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from mbaid_ros.core.geometry import Array, quaternion_from_rotation, rotation_from_quaternion
from mbaid_ros.core.robot.orbit import Orbit, Turning
from mbaid_ros.core.samples import BaseStream
from mbaid_ros.core.sensors.external_momentum import FallingFrame
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.simulation import Truth, seen_from_orbit
from simulated import robot

SECOND = 1_000_000_000
POSE = ('position', 'rotation', 'linear_velocity', 'angular_velocity')


@st.composite
def orbits(draw: st.DrawFn) -> Orbit:
    """Return an orbit of minutes to days, from a circle to a comet's."""
    frame: Turning = draw(st.sampled_from(('lvlh', 'hill')))
    around = Orbit.turning_with(10.0 ** draw(st.floats(-5.0, -1.0)), frame)
    return around.eccentric(draw(st.sampled_from((0.0, 0.001, 0.3, 0.9))), draw(st.floats(-np.pi, np.pi)))


@st.composite
def motions(draw: st.DrawFn) -> Truth:
    """Return poses and twists at instants before and after the epoch; they need not be those of one motion."""
    time = np.array(sorted(draw(st.lists(st.integers(-4_000_000, 4_000_000), min_size=1, max_size=5)))) * 1e-3
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values, orientation = rng.normal(size=(3, len(time), 3)), rng.normal(size=(len(time), 4))
    return truth_of(time, 30.0 * values[0], quaternions.normalised(orientation), *values[1:])


def truth_of(time: Array, position: Array, orientation: Array, linear: Array, angular: Array) -> Truth:
    nothing = np.zeros((len(time), 1))
    return Truth(time, nothing, nothing, nothing, position, orientation, linear, angular)


def measured(truth: Truth) -> BaseStream:
    """Return a motion as the reader of Odometry gives it, the epoch at 0."""
    return BaseStream(
        np.round(truth.time * SECOND).astype(np.int64),
        truth.base_position,
        rotation_from_quaternion(truth.base_orientation),
        quaternions.rotate(truth.base_orientation, truth.base_linear_velocity),
        quaternions.rotate(truth.base_orientation, truth.base_angular_velocity),
        *np.zeros((2, len(truth), 6, 6)),
    )


def as_truth(stream: BaseStream) -> Truth:
    """Return what a stream says as a motion, its twist in the axes of the base."""
    orientation = quaternion_from_rotation(stream.rotation)
    back = quaternions.conjugate(orientation)
    twist = (quaternions.rotate(back, each) for each in (stream.linear_velocity, stream.angular_velocity))
    return truth_of(stream.stamp / SECOND, stream.position, orientation, *twist)


@settings(max_examples=200, deadline=None)
@given(orbits(), motions(), st.booleans())
def test_there_and_back_and_back_and_there(around: Orbit, motion: Truth, relative: bool) -> None:
    falling = FallingFrame(around, robot('ets7'), relative_twist=relative, epoch=0).falling
    once = falling(measured(seen_from_orbit(around, motion, relative_twist=relative)))
    other = measured(seen_from_orbit(around, as_truth(falling(measured(motion))), relative_twist=relative))
    for name in POSE:
        expected = getattr(measured(motion), name)
        assert getattr(once, name) == pytest.approx(expected, abs=1e-9), name
        assert getattr(other, name) == pytest.approx(expected, abs=1e-9), name


def clohessy_wiltshire(n: float, time: Array, start: Array) -> Array:
    """Return (N, 6) places and velocities (x up, y along, z across) of what falls freely from a (6,) start."""
    x, y, z, u, v, w = start
    sine, cosine = np.sin(n * time), np.cos(n * time)
    drift = 6.0 * n * x + 3.0 * v
    return np.column_stack(
        (
            4.0 * x + 2.0 * v / n + u / n * sine - (3.0 * x + 2.0 * v / n) * cosine,
            y - 2.0 * u / n + (6.0 * x + 4.0 * v / n) * sine + 2.0 * u / n * cosine - drift * time,
            z * cosine + w / n * sine,
            u * cosine + (3.0 * n * x + 2.0 * v) * sine,
            (6.0 * n * x + 4.0 * v) * cosine - 2.0 * u * sine - drift,
            w * cosine - n * z * sine,
        )
    )


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-3, 1e-1), st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_what_falls_freely_moves_as_clohessy_and_wiltshire_say(rate: float, begin: list[float]) -> None:
    around, time = Orbit.turning_with(rate, 'hill'), np.linspace(0.0, 2.0 * np.pi / rate, 9)
    start = np.array(begin) * np.repeat((30.0, 30.0 * rate), 3)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (9, 1))
    there = clohessy_wiltshire(rate, time, start)
    seen = truth_of(time, there[:, :3], still, there[:, 3:], np.zeros((9, 3)))
    found = FallingFrame(around, robot('ets7'), relative_twist=True, epoch=0).falling(measured(seen))

    def pull(now: float, state: Array) -> Array:
        return np.concatenate((state[3:], around.gradient(np.array([now]))[0] @ state[:3]))

    first = np.concatenate((found.position[0], found.linear_velocity[0]))
    fallen = solve_ivp(pull, (0.0, time[-1]), first, 'DOP853', time, rtol=1e-11, atol=1e-11).y.T
    assert found.position == pytest.approx(fallen[:, :3], abs=1e-5)
    assert found.linear_velocity == pytest.approx(fallen[:, 3:], abs=1e-5 * rate)
