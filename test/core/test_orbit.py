"""Circular orbits: their directions, and odometry that turns with them, seen from the frame that falls along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, exp, rotate, rotation_from_quaternion, skew
from mbaid_ros.core.robot.orbit import Orbit, Turning
from mbaid_ros.core.samples import BaseStream
from mbaid_ros.core.sensors.external_momentum import FallingFrame
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.simulation import Truth, seen_from_orbit
from orbiting import MEAN_MOTION, NADIR, NORMAL, orbit
from simulated import robot

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND
FRAMES: tuple[Turning, ...] = ('lvlh', 'hill')


def random_orbit(seed: int) -> Orbit:
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    return Orbit.inertial(float(rng.uniform(1e-4, 1e-1)), np.cross(normal, rng.normal(size=3)), normal)


@pytest.mark.parametrize('seed', range(4))
def test_gravity_pulls_apart_upwards_and_together_across(seed: int) -> None:
    around, time = random_orbit(seed), np.array([0.0, 3.0, 700.0])
    gradient, up, square = around.gradient(time), around.upward(time), around.mean_motion**2
    assert np.trace(gradient, axis1=1, axis2=2) == pytest.approx(np.zeros(3), abs=1e-12 * square)
    assert rotate(gradient, up) == pytest.approx(2.0 * square * up, rel=1e-12, abs=1e-15 * square)
    assert rotate(gradient, np.broadcast_to(around.normal, (3, 3))) == pytest.approx(
        np.broadcast_to(-square * around.normal, (3, 3)), rel=1e-9, abs=1e-12 * square
    )
    assert np.linalg.norm(up, axis=1) == pytest.approx(np.ones(3))
    # Up turns with the frame that turns.
    assert up == pytest.approx(rotate(around.turned(time), np.broadcast_to(around.up, (3, 3))), abs=1e-12)
    assert around.later(3.0).upward(np.array([697.0])) == pytest.approx(up[2:], abs=1e-9)


@pytest.mark.parametrize('eccentricity', [0.001, 0.3, 0.9])
def test_an_eccentric_orbit_is_that_of_a_point_about_a_centre(eccentricity: float) -> None:
    """The second derivative of r up, by differences, is -mu / r^3 of it: Newton's law."""
    around, step = orbit(0.02).eccentric(eccentricity, 0.7), 1e-2

    def place(time: Array) -> Array:
        distance = (around.strength(time) / around.mean_motion**2) ** (-1.0 / 3.0)  # over the semi-major axis
        return np.asarray(distance[:, None] * around.upward(time))

    time = np.linspace(-200.0, 500.0, 31)
    found = (place(time + step) - 2.0 * place(time) + place(time - step)) / step**2
    pull = around.strength(time)[:, None] * place(time)
    assert found == pytest.approx(-pull, abs=1e-4 * np.abs(pull).max())
    turned = (around.swept(time + step) - around.swept(time - step)) / (2.0 * step)
    whole_turns = np.round((turned - around.rate(time) @ around.normal) * step / np.pi)
    assert turned - whole_turns * np.pi / step == pytest.approx(around.rate(time) @ around.normal, rel=1e-3)
    later = around.later(40.0)
    assert later.upward(time - 40.0) == pytest.approx(around.upward(time), abs=1e-9)
    assert later.strength(time - 40.0) == pytest.approx(around.strength(time), rel=1e-9)


def test_the_directions_of_ccsds() -> None:
    """LVLH: z down, y against the normal, x along the motion. Hill's: x up, z the normal, y along the motion."""
    for frame, along in (('lvlh', [1.0, 0.0, 0.0]), ('hill', [0.0, 1.0, 0.0])):
        turning = Orbit.turning_with(MEAN_MOTION, 'lvlh' if frame == 'lvlh' else 'hill')
        assert np.cross(turning.normal, turning.up).tolist() == along
    inertial = Orbit.inertial(MEAN_MOTION, NADIR, NORMAL)
    assert inertial.up == pytest.approx(-NADIR, abs=1e-15)
    assert inertial.normal == pytest.approx(NORMAL, abs=1e-15)


def moving(seed: int, time: Array) -> Truth:
    """Return a smooth motion in the falling frame with its exact derivatives."""
    rng = np.random.default_rng(seed)
    centre, size, rate = rng.normal(size=(3, 3))
    axis = rng.normal(size=3)
    angle = 0.7 * np.sin(0.3 * time)
    spin = (0.21 * np.cos(0.3 * time))[:, None] * axis
    orientation = quaternions.exp(angle[:, None] * axis)
    back = quaternions.conjugate(orientation)
    nothing = np.zeros((len(time), 1))
    return Truth(
        time=time,
        joint_position=nothing,
        joint_velocity=nothing,
        joint_effort=nothing,
        base_position=20.0 * centre + size * np.sin(rate * time[:, None]),
        base_orientation=orientation,
        base_linear_velocity=quaternions.rotate(back, size * rate * np.cos(rate * time[:, None])),
        base_angular_velocity=quaternions.rotate(back, spin),
    )


def odometry(truth: Truth) -> BaseStream:
    """Return a motion as the reader of Odometry gives it."""
    rng = np.random.default_rng(5)
    factor = rng.normal(size=(len(truth), 6, 6))
    covariance = factor @ np.swapaxes(factor, 1, 2)
    return BaseStream(
        EPOCH + np.round(truth.time * SECOND).astype(np.int64),
        truth.base_position,
        rotation_from_quaternion(truth.base_orientation),
        quaternions.rotate(truth.base_orientation, truth.base_linear_velocity),
        quaternions.rotate(truth.base_orientation, truth.base_angular_velocity),
        covariance,
        covariance,
    )


@pytest.mark.parametrize('eccentricity', [0.0, 0.3])
@pytest.mark.parametrize('relative', [True, False])
@pytest.mark.parametrize('frame', FRAMES)
@pytest.mark.parametrize('seed', range(3))
def test_there_and_back(frame: Turning, seed: int, eccentricity: float, *, relative: bool) -> None:
    around = Orbit.turning_with(0.02, frame).eccentric(eccentricity, 1.0)
    truth = moving(seed, np.arange(0.0, 200.0, 7.0))
    seen = odometry(seen_from_orbit(around, truth, relative_twist=relative))
    falling = FallingFrame(around, robot('ets7'), relative_twist=relative, epoch=EPOCH).falling(seen)
    expected = odometry(truth)
    for name in ('position', 'rotation', 'linear_velocity', 'angular_velocity'):
        assert getattr(falling, name) == pytest.approx(getattr(expected, name), abs=1e-12), name
    # The noise turns along: that of the pose is in the axes of the frame, that of the twist in the base's.
    turn = around.turned(truth.time)
    assert falling.pose_covariance[:, :3, 3:] == pytest.approx(
        turn @ seen.pose_covariance[:, :3, 3:] @ np.swapaxes(turn, 1, 2), abs=1e-12
    )
    assert np.array_equal(falling.twist_covariance, seen.twist_covariance)


@pytest.mark.parametrize('eccentricity', [0.0, 0.3])
@pytest.mark.parametrize('frame', FRAMES)
def test_what_is_seen_moves_as_its_twist_says(frame: Turning, eccentricity: float) -> None:
    """The relative twist is the derivative of the pose that is seen, what is found of it that of the found pose."""
    step, time = 1e-4, np.arange(1.0, 60.0, 5.0)
    around = Orbit.turning_with(0.05, frame).eccentric(eccentricity, 2.0)
    before, now, after = (
        odometry(seen_from_orbit(around, moving(1, time + shift), relative_twist=True)) for shift in (-step, 0.0, step)
    )
    falling = FallingFrame(around, robot('ets7'), relative_twist=True, epoch=EPOCH)
    for each in ((before, now, after), tuple(falling.falling(part) for part in (before, now, after))):
        slope = (each[2].position - each[0].position) / (2.0 * step)
        assert slope == pytest.approx(each[1].linear_velocity, abs=1e-6)
        turning = (each[2].rotation - each[0].rotation) / (2.0 * step)
        assert turning == pytest.approx(skew(each[1].angular_velocity) @ each[1].rotation, abs=1e-6)


def test_the_first_measurement_is_the_epoch_where_none_is_given() -> None:
    around = Orbit.turning_with(0.05, 'hill')
    falling = FallingFrame(around, robot('ets7'), relative_twist=True)
    measured = odometry(seen_from_orbit(around, moving(0, np.array([10.0, 11.0])), relative_twist=True))
    first = falling.falling(measured[:1])
    assert falling.epoch == EPOCH + 10 * SECOND
    assert first.position == pytest.approx(measured.position[:1], abs=1e-14)
    later = falling.falling(measured[1:])
    assert later.rotation == pytest.approx(exp(0.05 * around.normal) @ measured.rotation[1:], abs=1e-12)


def test_a_twist_that_is_not_measured_stays_so() -> None:
    around = Orbit.turning_with(0.05, 'hill')
    measured = odometry(moving(0, np.array([0.0, 1.0])))
    nothing = np.full((2, 3), np.nan)
    falling = FallingFrame(around, robot('ets7'), relative_twist=True)
    found = falling.falling(replace(measured, linear_velocity=nothing, angular_velocity=nothing))
    assert np.all(np.isnan(found.linear_velocity))
    assert np.all(np.isfinite(found.position))


def test_a_frame_that_falls_along_is_left_alone() -> None:
    measured = odometry(moving(0, np.array([0.0, 1.0])))
    assert FallingFrame(orbit(), robot('ets7'), relative_twist=True).falling(measured) is measured
