"""Circular and eccentric orbits: odometry that turns with them, and what gravity brings to the momentum."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from benchmarks.data import simulator_config
from checked import generic, some
from mbaid_ros.core.difference import window_rows
from mbaid_ros.core.geometry import Array, exp, rotation_from_quaternion, skew, unvec
from mbaid_ros.core.odometry.model import odometry_turning
from mbaid_ros.core.odometry.stream import orientation_only
from mbaid_ros.core.orbit import (
    FallingFrame,
    Orbit,
    OrbitConfig,
    Turning,
    declared_gravity,
    gradient_numbers,
    gravity,
    likeliest_orbit,
    orbit_rate,
)
from mbaid_ros.core.robot.model import Kinematics, express, load_model
from mbaid_ros.core.robot.momentum import (
    MomentumKernel,
    about_points,
    link_columns,
    momentum_change,
    summed_over_bodies,
)
from mbaid_ros.core.samples import BaseStream
from mbaid_ros.parameters import build
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.simulation import Truth, seen_from_orbit, total_momentum
from observed import MID, configured_motion, observe
from random_robots import random_state, random_urdf
from servicers import pushed
from sessions import MEAN_MOTION, NADIR, NORMAL, declared, orbit
from simulated import robot

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND
FRAMES: tuple[Turning, ...] = ('lvlh', 'hill')
KERNEL = MomentumKernel(robot('table1'), robot('table1').last_link)


@pytest.mark.parametrize('eccentricity', [0.001, 0.3, 0.9])
def test_an_eccentric_orbit_is_that_of_a_point_about_a_centre(eccentricity: float) -> None:
    """The second derivative of r up, by differences, is -mu / r^3 of it: Newton's law."""
    around, step = orbit(0.02).with_eccentricity(eccentricity, 0.7), 1e-2

    def place(time: Array) -> Array:
        distance = (around.gradient_strength(time) / around.mean_motion**2) ** (-1.0 / 3.0)  # over the semi-major axis
        return np.asarray(distance[:, None] * around.zenith_at(time))

    time = np.linspace(-200.0, 500.0, 31)
    found = (place(time + step) - 2.0 * place(time) + place(time - step)) / step**2
    pull = around.gradient_strength(time)[:, None] * place(time)
    assert found == pytest.approx(-pull, abs=1e-4 * np.abs(pull).max())
    turned = (around.swept_angle(time + step) - around.swept_angle(time - step)) / (2.0 * step)
    whole_turns = np.round((turned - around.rate(time) @ around.normal) * step / np.pi)
    assert turned - whole_turns * np.pi / step == pytest.approx(around.rate(time) @ around.normal, rel=1e-3)
    later = around.with_epoch(40.0)
    assert later.zenith_at(time - 40.0) == pytest.approx(around.zenith_at(time), abs=1e-9)
    assert later.gradient_strength(time - 40.0) == pytest.approx(around.gradient_strength(time), rel=1e-9)


def test_the_directions_of_ccsds() -> None:
    """LVLH: z down, y against the normal, x along the motion. Hill's: x up, z the normal, y along the motion."""
    for frame, along in (('lvlh', [1.0, 0.0, 0.0]), ('hill', [0.0, 1.0, 0.0])):
        turning = Orbit.rotating(MEAN_MOTION, 'lvlh' if frame == 'lvlh' else 'hill')
        assert np.cross(turning.normal, turning.zenith).tolist() == along
    inertial = Orbit.inertial(MEAN_MOTION, NADIR, NORMAL)
    assert inertial.zenith == pytest.approx(-NADIR, abs=1e-15)
    assert inertial.normal == pytest.approx(NORMAL, abs=1e-15)
    roughly = Orbit.inertial(MEAN_MOTION, 2.0 * NADIR + 0.3 * NORMAL, 3.0 * NORMAL)  # projected, and of any length
    assert roughly.zenith == pytest.approx(-NADIR, abs=1e-15)
    assert roughly.normal == pytest.approx(NORMAL, abs=1e-15)


def truth_of(time: Array, position: Array, orientation: Array, linear: Array, angular: Array) -> Truth:
    nothing = np.zeros((len(time), 1))
    return Truth(time, nothing, nothing, nothing, position, orientation, linear, angular)


def moving(seed: int, time: Array) -> Truth:
    """Return a smooth motion in the falling frame with its exact derivatives."""
    rng = np.random.default_rng(seed)
    centre, size, rate = rng.normal(size=(3, 3))
    axis = rng.normal(size=3)
    spin = (0.21 * np.cos(0.3 * time))[:, None] * axis
    orientation = quaternions.exp(0.7 * np.sin(0.3 * time)[:, None] * axis)
    back = quaternions.conjugate(orientation)
    velocity = size * rate * np.cos(rate * time[:, None])
    place = 20.0 * centre + size * np.sin(rate * time[:, None])
    twist = (quaternions.rotate(back, each) for each in (velocity, spin))
    return truth_of(time, place, orientation, *twist)


def odometry(truth: Truth, epoch: int = EPOCH) -> BaseStream:
    """Return a motion as the reader of Odometry gives it."""
    factor = np.random.default_rng(5).normal(size=(len(truth), 6, 6))
    covariance = factor @ np.swapaxes(factor, 1, 2)
    return BaseStream(
        epoch + np.round(truth.time * SECOND).astype(np.int64),
        truth.base_position,
        rotation_from_quaternion(truth.base_orientation),
        quaternions.rotate(truth.base_orientation, truth.base_linear_velocity),
        quaternions.rotate(truth.base_orientation, truth.base_angular_velocity),
        *(covariance, covariance),
    )


@pytest.mark.parametrize('eccentricity', [0.0, 0.3])
@pytest.mark.parametrize('frame', FRAMES)
def test_what_is_seen_moves_as_its_twist_says(frame: Turning, eccentricity: float) -> None:
    """The relative twist is the derivative of the pose that is seen, what is found of it that of the found pose."""
    step, time = 1e-4, np.arange(1.0, 60.0, 5.0)
    around = Orbit.rotating(0.05, frame).with_eccentricity(eccentricity, 2.0)
    before, now, after = (
        odometry(seen_from_orbit(around, moving(1, time + shift), relative_twist=True)) for shift in (-step, 0.0, step)
    )
    falling = FallingFrame(around, robot('ets7'), relative_twist=True, epoch=EPOCH)
    found = tuple(falling.to_falling_frame(part) for part in (before, now, after))
    stamps: Any = now.stamp
    assert falling.turned(stamps) @ now.rotation == pytest.approx(found[1].rotation)
    assert falling.gradient(stamps) == pytest.approx(around.gradient(time), abs=1e-12)
    # The noise turns along: that of the pose is in the axes of the frame, that of the twist in the base's.
    turn = around.to_inertial(time)
    assert found[1].pose_covariance[:, :3, 3:] == pytest.approx(
        turn @ now.pose_covariance[:, :3, 3:] @ np.swapaxes(turn, 1, 2), abs=1e-12
    )
    assert np.array_equal(found[1].twist_covariance, now.twist_covariance)
    for each in ((before, now, after), found):
        slope = (each[2].position - each[0].position) / (2.0 * step)
        assert slope == pytest.approx(each[1].linear_velocity, abs=1e-6)
        turning = (each[2].rotation - each[0].rotation) / (2.0 * step)
        assert turning == pytest.approx(skew(each[1].angular_velocity) @ each[1].rotation, abs=1e-6)


def test_the_first_measurement_is_the_epoch_where_none_is_given() -> None:
    around = Orbit.rotating(0.05, 'hill')
    falling = FallingFrame(around, robot('ets7'), relative_twist=True)
    measured = odometry(seen_from_orbit(around, moving(0, np.array([10.0, 11.0])), relative_twist=True))
    first = falling.to_falling_frame(measured[:1])
    assert falling.epoch == EPOCH + 10 * SECOND
    assert first.position == pytest.approx(measured.position[:1], abs=1e-14)
    later = falling.to_falling_frame(measured[1:])
    assert later.rotation == pytest.approx(exp(0.05 * around.normal) @ measured.rotation[1:], abs=1e-12)


@st.composite
def orbits(draw: st.DrawFn) -> Orbit:
    """Return an orbit of minutes to days, from a circle to a comet's."""
    frame: Turning = draw(st.sampled_from(('lvlh', 'hill')))
    around = Orbit.rotating(10.0 ** draw(st.floats(-5.0, -1.0)), frame)
    return around.with_eccentricity(draw(st.sampled_from((0.0, 0.001, 0.3, 0.9))), draw(st.floats(-np.pi, np.pi)))


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
    around, time = Orbit.rotating(rate, 'hill'), np.linspace(0.0, 2.0 * np.pi / rate, 9)
    start = np.array(begin) * np.repeat((30.0, 30.0 * rate), 3)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (9, 1))
    there = clohessy_wiltshire(rate, time, start)
    seen = truth_of(time, there[:, :3], still, there[:, 3:], np.zeros((9, 3)))
    found = FallingFrame(around, robot('ets7'), relative_twist=True, epoch=0).to_falling_frame(odometry(seen, 0))

    def pull(now: float, state: Array) -> Array:
        return np.concatenate((state[3:], around.gradient(np.array([now]))[0] @ state[:3]))

    first = np.concatenate((found.position[0], found.linear_velocity[0]))
    fallen = solve_ivp(pull, (0.0, time[-1]), first, 'DOP853', time, rtol=1e-11, atol=1e-11).y.T
    assert found.position == pytest.approx(fallen[:, :3], abs=1e-5)
    assert found.linear_velocity == pytest.approx(fallen[:, 3:], abs=1e-5 * rate)


@pytest.mark.parametrize('seed', range(4))
def test_the_rows_lack_what_the_orbit_has_brought(seed: int) -> None:
    """The unknown links' columns are in their own frames."""
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=6))
    kernel = MomentumKernel(model, model.last_link, model.links[1].name)
    truth = configured_motion('servicer7', 1.0, 20.0)
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
    with_tide = FallingFrame(orbit(0.5), model, relative_twist=True).with_momentum(samples, 0)
    plain, rows = (
        window_rows(kernel, [each[k : k + 1] for k in range(len(each))], MID, np.zeros(3))
        for each in (samples, with_tide)
    )
    columns = about_points(with_tide.gravity_columns, with_tide.base_position)
    assert kernel.states(with_tide).gravity_columns == pytest.approx(columns)
    assert rows.offset == pytest.approx(plain.offset - summed_over_bodies(columns, kernel.known), rel=1e-12, abs=1e-12)
    whole = with_tide.impulse[-1] + momentum_change(with_tide, model.body_parameters())
    parts = plain.offset[-1] - rows.offset[-1]
    for link, place in zip(kernel.unknown, (slice(10), slice(10, 20)), strict=True):
        change = (plain.rows - rows.rows)[..., place]
        assert change == pytest.approx(link_columns(columns, link), abs=1e-12)
        parts += change[-1] @ link.parameters
    parts[3:] += np.cross(with_tide.base_position[-1], parts[:3])
    assert parts == pytest.approx(whole, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize('name', ['ets7', pytest.param('servicer7', marks=pytest.mark.long)])
def test_what_is_left_of_a_simulated_robot_is_constant(name: str) -> None:
    """The simulator's bodies, the estimator's columns: P and L less what the orbit has brought, over a minute."""
    config = simulator_config(name, {**declared(mean_motion=0.02), 'initial.base_position': [8.0, -4.0, 6.0]})
    model = robot(name)
    truth = make_simulation(config, model).advance(np.arange(1200) * 0.05)
    samples = FallingFrame(orbit(0.02), model, relative_twist=True).with_momentum(observe(truth, MID), 0)
    total = total_momentum(model, truth)
    columns = about_points(samples.gravity_columns, np.zeros((len(samples), 3)))
    left = total - summed_over_bodies(columns, model.body_parameters())
    moved = np.ptp(total, axis=0)
    assert moved.max() > 10.0
    # The trapezoidal rule at 20 Hz.
    assert np.ptp(left, axis=0).max() < 2e-6 * moved.max()


# -- A robot that nothing locates: gravity turns it about its common centre of mass, and moves it nowhere.

RATE = 1.1e-3  # rad/s


def test_it_is_the_gravity_gradient_torque_about_the_common_centre_of_mass() -> None:
    model = robot('servicer7')
    orbit = Orbit.inertial(RATE, np.array([0.3, 0.2, 1.0]), np.array([0.0, 1.0, -0.2]))
    samples = observe(pushed(), MID)[:2]
    frame = FallingFrame(orbit, model, relative_twist=True, located=False)
    gravity_columns = frame.with_momentum(samples, 0).gravity_columns
    bodies, length = model.body_parameters(), float(samples.time[1] - samples.time[0])
    rate = summed_over_bodies(gravity_columns.reshape(2, -1, 6, 10), bodies)[1] / length
    placed = Kinematics(model).configure(samples.base_rotation, samples.joint_position)
    whole = np.sum(express(bodies, placed.rotation, placed.position), axis=1)[0]
    centre = whole[1:4] / whole[0]
    inertia = unvec(whole[4:]) + whole[0] * skew(centre) @ skew(centre)
    up = orbit.zenith
    np.testing.assert_array_equal(rate[:3], 0.0)
    torque = 3.0 * RATE**2 * np.cross(up, inertia @ up)  # at the first sample; the tide is the mean until the second
    np.testing.assert_allclose(rate[3:], torque, atol=1e-2 * float(np.linalg.norm(torque)))


def test_an_orientation_in_an_orbit_fixed_frame_is_turned_without_a_position() -> None:
    model, stamps = robot('servicer7'), np.array([0, 10**12], dtype=np.int64)
    fixed = np.tile(np.eye(3), (2, 1, 1))
    base = orientation_only(stamps, fixed, np.tile(np.diag([1e-6, 4e-6, 9e-6]), (2, 1, 1)))
    frame = FallingFrame(Orbit.rotating(RATE, 'lvlh'), model, relative_twist=True, located=False)
    seen = frame.to_falling_frame(base)
    turned = exp(np.array([[0.0, -RATE * 1e3, 0.0]]))[0]
    np.testing.assert_allclose(seen.rotation[1], turned, atol=1e-9)
    np.testing.assert_allclose(seen.pose_covariance[1, 3:, 3:], turned @ np.diag([1e-6, 4e-6, 9e-6]) @ turned.T)
    assert np.isnan(seen.pose_covariance[:, :3, :3]).all()


@pytest.mark.parametrize(('frame', 'axis'), [('lvlh', [0.0, -1.0, 0.0]), ('hill', [0.0, 0.0, 1.0])])
def test_a_frame_that_turns_along_an_orbits_normal_is_declared_as_such(frame: str, axis: list[float]) -> None:
    unknown, std = odometry_turning(1e-3), np.full(3, 4e-5)
    along = unknown.repair('turning', 1.13e-3 * np.array(axis) + 8e-5 * np.array([1.0, 0.0, 0.0]), std, KERNEL)
    assert along.parameters == {
        'orbit.mean_motion': pytest.approx(1.13e-3),
        'orbit.frame': frame,
        'orbit.gradient_relative_std': pytest.approx(0.2),
        'odometry.turning_std': pytest.approx(1e-4),
    }
    for other in (-1.13e-3 * np.array(axis), 1.13e-3 * np.array(axis) + 3e-4 * np.array([1.0, 0.0, 0.0])):
        assert list(unknown.repair('turning', other, std, KERNEL).parameters or ()) == ['odometry.turning_std']


def test_the_gradient_of_a_declared_orbit_may_be_wrong() -> None:
    config = build(OrbitConfig, {'mean_motion': 1.13e-3, 'frame': 'lvlh', 'gradient_relative_std': 0.2})
    beside, alone = declared_gravity(config, located=True), gravity(1.13e-3)
    assert beside.factor == pytest.approx(0.2 * alone.factor)
    assert alone.finding(np.ones(10), 1e-4 * np.eye(10)) is not None
    assert beside.finding(np.ones(10), 1e-4 * np.eye(10)) is None  # an orbit is declared already
    assert declared_gravity(replace(config, gradient_relative_std=0.0), located=True).count == 0


TILTED = Orbit.inertial(0.02, np.array([2.0, -1.0, 2.0]) / 3.0, np.array([1.0, -2.0, -2.0]) / 3.0)


def test_the_numbers_of_a_gradient_are_those_of_its_epoch_and_of_its_change() -> None:
    around, second = TILTED, 1e-2
    before, now, after = (gradient_numbers(around.with_epoch(time))[:5] for time in (-second, 0.0, second))
    numbers = gradient_numbers(around)
    assert numbers[:5] == pytest.approx(now, rel=1e-12)
    change = (after - before) / (2.0 * second)
    assert numbers[5:] == pytest.approx(change, abs=1e-3 * float(np.abs(change).max()))
    assert np.abs(change).min() > 0.0
    assert orbit_rate(numbers) == pytest.approx(0.02)


def test_the_orbit_of_a_gradient_is_found_and_none_of_any_other_disturbance() -> None:
    """In units in which the ten numbers have unit variance, with errors that are a hundredth of theirs."""
    around, factor = TILTED, 1e-4 * (np.eye(10) + 0.2 * generic(1, 10, 10))
    mean = np.linalg.solve(factor, gradient_numbers(around))
    root = 0.01 * (np.eye(10) + 0.2 * generic(2, 10, 10))
    found = some(likeliest_orbit(factor, mean, root @ root.T))
    assert found.mean_motion == pytest.approx(0.02, rel=1e-3)
    assert not found.is_rotating
    up, across = np.sign(found.zenith @ around.zenith), np.sign(found.normal @ around.normal)
    assert up * found.zenith == pytest.approx(around.zenith, abs=1e-3)  # a gradient has no sense of up
    assert across * found.normal == pytest.approx(around.normal, abs=1e-3)
    assert up * across * np.cross(around.normal, around.zenith) == pytest.approx(
        np.cross(found.normal, found.zenith), abs=1e-3
    )
    assert likeliest_orbit(factor, -mean, root @ root.T) is None  # masses push instead of pull


def test_the_rate_of_an_orbit_is_that_of_the_best_known_numbers() -> None:
    """How the gradient changes is known here, and the gradient itself is 0.3 deviations off and hardly known."""
    true, off = gradient_numbers(TILTED) / 1e-4, 0.3 * np.repeat([1.0, 0.0], 5) * generic(3, 10)
    variance = np.repeat([0.3, 1e-3], 5) ** 2  # after the data, whose own is v / (1 - v)
    mean = (1.0 - variance) * (true + off)
    assert orbit_rate(1e-4 * mean) == pytest.approx(0.019, rel=1e-3)
    found = some(likeliest_orbit(1e-4 * np.eye(10), mean, np.diag(variance)))
    assert found.mean_motion == pytest.approx(0.02, rel=1e-3)
    assert abs(found.normal @ TILTED.normal) == pytest.approx(1.0, abs=1e-4)
