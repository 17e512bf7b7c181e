"""A free body by its tracked poses, against the flight of another integrator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp
from scipy.linalg import expm
from scipy.signal import lfilter
from scipy.stats import chi2

from checked import central_difference, generic
from mbaid_ros.core import free_flight as module
from mbaid_ros.core.free_flight import (
    LEVER,
    FreeFlight,
    PoseNoise,
    Track,
    _estimated,
    _first_guess,
    _held,
    _linearised,
    _step,
    _typical_misfit,
    _whitened,
    free_fall,
    free_flight,
    gravity_torque,
    inertia_of,
    tumbled,
)
from mbaid_ros.core.geometry import Array, exp, log, skew, unvec
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.simulation.changes import Target
from mbaid_ros.simulation.tumbling import FreeMotion
from unchanged import Unchanged

BODY = np.array([155.0, 0.34, -0.22, 0.78, 24.0, -2.5, 2.0, 33.0, -0.5, 29.0])
PLACE = np.array([0.1, 0.0, 0.2])
VELOCITY, AXIS = np.array([0.004, -0.006, 0.003]), np.array([0.6, -0.7, 0.4]) / np.sqrt(1.01)
RARE = 1e-3


def numbers(flight: FreeFlight) -> list[object]:
    """Return all of a flight but its rows, of which the covariance shows."""
    shown = ('centre', 'velocity', 'spin', 'lever', 'shape', 'noise', 'misfit', 'used', 'dropped', 'largest')
    return [*(getattr(flight, name) for name in shown), np.sqrt(np.diag(flight.covariance))]


def flown(degrees: float, seed: int = 0, seconds: float = 60.0) -> tuple[FreeMotion, Track]:
    """Return the flight of a body that spins, and exact poses of it at 5 Hz until half a second before the capture."""
    turn, place = exp(np.random.default_rng(seed).standard_normal(3)), np.array([1.0, -0.5, 2.0])
    target = Target(seconds, 'link7', BODY, VELOCITY, np.deg2rad(degrees) * AXIS)
    motion, time = FreeMotion(target, turn, place), np.arange(0.0, seconds - 0.5, 0.2)
    position, rotation = motion.poses(time, PLACE)
    return motion, Track(time - seconds, position, rotation)


def noisy(track: Track, seed: int, size: float = 5e-3) -> Track:
    rng = np.random.default_rng(seed)
    away, turn = size * rng.standard_normal((2, *track.position.shape))
    return Track(track.time, track.position + away, exp(turn) @ track.rotation)


def test_the_orientations_are_those_of_another_integrator() -> None:
    _, track = flown(90.0)
    shape = shape_of(BODY)
    spin = track_spin(track)
    turned = tumbled(track.time - track.time[-1], spin[None], shape[None])[0]
    away = log(np.swapaxes(track.rotation, 1, 2) @ (track.rotation[-1] @ turned))
    assert np.max(np.abs(away)) < 1e-3  # after 15 turns


def track_spin(track: Track) -> Array:
    """Return the spin of the last of exact poses, body axes, by a finer flight about it."""
    step = 1e-4
    target = Target(60.0, 'link7', BODY, VELOCITY, np.deg2rad(90.0) * AXIS)
    turn = exp(np.random.default_rng(0).standard_normal(3))
    motion = FreeMotion(target, turn, np.array([1.0, -0.5, 2.0]))
    end = 60.0 + track.time[-1]
    _, rotation = motion.poses(np.array([end - step, end + step]), PLACE)
    return np.asarray(log(rotation[0].T @ rotation[1])) / (2.0 * step)


def shape_of(body: Array) -> Array:
    """Return the shape whose ratios of moments are a body's, by Newton's method."""
    wanted = unvec(body[4:])
    wanted = 3.0 * wanted / np.trace(wanted)
    shape = np.zeros(5)
    for _ in range(20):
        steps = 1e-6 * np.eye(5)
        slope = np.array([(inertia_of(shape + each) - inertia_of(shape - each)).ravel() / 2e-6 for each in steps]).T
        shape = shape + np.linalg.lstsq(slope, (wanted - inertia_of(shape)).ravel())[0]
    assert inertia_of(shape) == pytest.approx(wanted, abs=1e-9)
    return shape


def test_every_shape_is_that_of_a_body() -> None:
    moments = np.linalg.eigvalsh(inertia_of(3.0 * np.random.default_rng(1).standard_normal((200, 5))))
    assert moments.sum(axis=1) == pytest.approx(np.full(200, 3.0))
    assert np.all(moments[:, 0] + moments[:, 1] > moments[:, 2] - 1e-9)


def test_derivatives() -> None:
    _, track = flown(20.0, seconds=20.0)
    few = track[::25]
    flight = free_flight(track, PoseNoise(1e-3, 1e-3))

    def residual(step: Array) -> Array:
        return _linearised(flight.moved(step), few)[0].ravel()

    columns = _linearised(flight, few)[1].reshape(-1, 20)
    expected = central_difference(residual, np.zeros(20), 1e-5)
    assert np.all(np.abs(expected).max(axis=0) > 0.0)
    assert -columns == pytest.approx(expected, rel=1e-3, abs=1e-4)  # of first order in small angles


@pytest.mark.parametrize('degrees', [0.5, 3.0, 20.0])
def test_the_motion_at_the_capture_is_within_its_covariance(degrees: float, unchanged: Unchanged) -> None:
    _, exact = flown(degrees)
    flight = free_flight(noisy(exact, 3), PoseNoise(0.0, 0.0))
    unchanged.values(flight=numbers(flight))
    assert flight.noise.position == pytest.approx(5e-3, rel=0.1)
    assert flight.noise.orientation == pytest.approx(5e-3, rel=0.1)
    assert flight.noise.correlation_times == (0.0, 0.0)
    turn = exp(np.random.default_rng(0).standard_normal(3))
    spin = np.deg2rad(degrees) * AXIS
    # Of the tracked frame's origin, which slow spins determine as well; its velocity has no part in the lever then.
    place = np.array([1.0, -0.5, 2.0]) + turn @ PLACE
    centre = np.array([1.0, -0.5, 2.0]) + turn @ BODY[1:4]
    true = np.concatenate((VELOCITY + np.cross(spin, place - centre), spin))

    def motion(step: Array) -> Array:
        moved = flight.moved(step)
        there = moved.rotation @ moved.spin
        return np.concatenate((moved.velocity + np.cross(there, place - moved.centre), there))

    slope = np.array([(motion(each) - motion(-each)) / 2e-6 for each in 1e-6 * np.eye(20)]).T
    error, covariance = motion(np.zeros(20)) - true, slope @ flight.covariance @ slope.T
    assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(RARE, 6)
    lever = np.sqrt(np.diag(flight.covariance))[LEVER]
    assert np.all(np.abs(flight.lever - (PLACE - BODY[1:4])) < 4.0 * lever)


def test_a_pose_that_jumps_is_left_out(unchanged: Unchanged) -> None:
    _, exact = flown(3.0, seconds=30.0)
    track = noisy(exact, 5)
    track.position[40] += 0.5
    track.rotation[70] = exp(np.array([0.3, 0.0, 0.0])) @ track.rotation[70]
    flight = free_flight(track, PoseNoise(5e-3, 5e-3))
    unchanged.values(flight=numbers(flight))
    assert flight.dropped == 2
    assert flight.misfit == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize(('position', 'orientation', 'misfit'), [(1.0, 1.0, 1.0), (2.0, 1.0, 4.0), (1.0, 3.0, 9.0)])
def test_the_typical_misfit_is_that_of_the_worse_of_positions_and_orientations(
    position: float, orientation: float, misfit: float
) -> None:
    """Of errors so many times as large as their noise."""
    _, exact = flown(3.0, seconds=60.0)
    flight = free_flight(exact, PoseNoise(5e-3, 5e-3))
    declared = PoseNoise(5e-3 / position, 5e-3 / orientation)
    assert _typical_misfit(flight, noisy(exact, 6), declared) == pytest.approx(misfit, rel=0.15)


def test_errors_that_last_widen_the_covariance(unchanged: Unchanged) -> None:
    _, exact = flown(3.0, seconds=30.0)
    rng, count = np.random.default_rng(8), len(exact.time)
    error = rng.standard_normal((2, count, 3))
    for place in range(1, count):
        error[:, place] = 0.8 * error[:, place - 1] + 0.6 * error[:, place]
    track = Track(exact.time, exact.position + 5e-3 * error[0], exp(5e-3 * error[1]) @ exact.rotation)
    white, shared = free_flight(track, PoseNoise(5e-3, 5e-3, (1e-9, 1e-9))), free_flight(track, PoseNoise(0.0, 0.0))
    unchanged.values(white=numbers(white), shared=numbers(shared))
    assert shared.noise.correlation_times[0] == pytest.approx(-0.2 / np.log(0.8), rel=0.5)

    def size(flight: FreeFlight) -> Array:
        return np.sqrt(np.diag(flight.covariance)[6:12])

    assert np.all(size(shared) > 1.5 * size(white))


MOTION = 1.13e-3  # rad/s, of a low orbit
RADIUS = 6.78e6  # m


def about_the_earth(seconds: float) -> tuple[Track, FreeFlight]:
    """Return exact poses of a body beside a point on a circular orbit, by gravity in an inertial frame, and its end."""
    pull, start = MOTION**2 * RADIUS**3, np.array([RADIUS, 0.0, 0.0])
    inertia, lever = unvec(BODY[4:]), np.array([0.3, -0.2, 0.4])

    def rates(_: float, values: Array) -> Array:
        place, speed, point, point_speed, spin = np.split(values[:15], 5)
        turn = values[15:].reshape(3, 3)
        up = turn.T @ place / np.linalg.norm(place)
        strength = pull / np.linalg.norm(place) ** 3
        torque = 3.0 * strength * np.cross(up, inertia @ up) - np.cross(spin, inertia @ spin)
        falls = [-pull * each / np.linalg.norm(each) ** 3 for each in (place, point)]
        turning = turn @ np.array([[0.0, -spin[2], spin[1]], [spin[2], 0.0, -spin[0]], [-spin[1], spin[0], 0.0]])
        return np.concatenate(
            (speed, falls[0], point_speed, falls[1], np.linalg.solve(inertia, torque), turning.ravel())
        )

    forward = np.array([0.0, MOTION * RADIUS, 0.0])
    away, drift, spin = np.array([8.0, -5.0, 6.0]), np.array([0.01, -0.02, 0.015]), np.array([0.01, -0.02, 0.03])
    begin = np.concatenate((start + away, forward + drift, start, forward, spin, exp(generic(9, 3)).ravel()))
    time = np.arange(0.0, seconds + 0.01, 0.5)
    found = solve_ivp(rates, (0.0, seconds), begin, DOP853, time, rtol=1e-13, atol=1e-12).y.T
    turn = found[:, 15:].reshape(-1, 3, 3)
    centre, velocity = found[:, :3] - found[:, 6:9], found[:, 3:6] - found[:, 9:12]
    noise, nothing = PoseNoise(1e-3, 1e-3), np.zeros((20, 21))
    end = FreeFlight(turn[-1], centre[-1], velocity[-1], found[-1, 12:15], lever, np.zeros(5), nothing, noise, 0.0, 0)
    return Track(time - seconds, centre + turn @ lever, turn), end


def test_in_an_orbit_a_body_falls_and_turns_as_gravity_has_it() -> None:
    seconds, noise = 120.0, PoseNoise(1e-3, 1e-3)
    track, end = about_the_earth(seconds)
    # In axes that do not turn, with x up at the begin.
    orbit = Orbit.inertial(MOTION, np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    falling = replace(track, gradient=lambda time: orbit.gradient(time + seconds))
    right, straight = free_flight(falling, noise), free_flight(track, noise)
    assert right.velocity == pytest.approx(end.velocity, abs=1e-7)
    assert right.spin == pytest.approx(end.spin, abs=3e-7)
    assert right.centre + right.rotation @ right.lever == pytest.approx(track.position[-1], abs=1e-6)
    # Without the gradient it is off by far more.
    assert np.abs(straight.velocity - end.velocity).max() > 1e-3
    assert np.abs(straight.spin - end.spin).max() > 1e-5


def test_derivatives_in_an_orbit() -> None:
    track, _ = about_the_earth(60.0)
    orbit = Orbit.inertial(0.05, np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))  # a fast one
    few = replace(track, gradient=lambda time: orbit.gradient(time + 60.0))[::20]
    flight = free_flight(track, PoseNoise(1e-3, 1e-3))

    def residual(step: Array) -> Array:
        return _linearised(flight.moved(step), few)[0].ravel()

    columns, expected = _linearised(flight, few)[1].reshape(-1, 20), central_difference(residual, np.zeros(20), 1e-5)
    assert np.abs(columns[:, 3:9] + expected[:, 3:9]).max() < 1e-6
    assert np.abs(expected[:, 3:6]).max() > 2.0  # the gradient moves it apart


def test_the_fall_is_that_of_an_exponential() -> None:
    gradient = 0.03**2 * np.diag([2.0, -1.0, -1.0])
    time = -np.array([0.0, 0.7, 1.9, 2.0, 33.3, 60.0])
    by_place, by_speed = free_fall(time, lambda each: np.broadcast_to(gradient, (len(each), 3, 3)))
    matrix = np.block([[np.zeros((3, 3)), np.eye(3)], [gradient, np.zeros((3, 3))]])
    for index, each in enumerate(time):
        expected = expm(each * matrix)[:3]
        assert np.hstack((by_place[index], by_speed[index])) == pytest.approx(expected, rel=2e-6, abs=1e-6)


def test_the_torque_of_gravity_is_that_on_all_point_masses() -> None:
    pull = generic(1, 3, 3) + generic(1, 3, 3).T
    rotation, masses, points = exp(generic(2, 3)), np.abs(generic(3, 5)), generic(4, 15).reshape(5, 3)
    inertia = np.einsum('k,kij->ij', masses, -(skew(points) @ skew(points)))
    placed = points @ rotation.T
    torque = np.sum(masses[:, None] * np.cross(placed, placed @ pull), axis=0)
    assert gravity_torque(pull, rotation, inertia) == pytest.approx(rotation.T @ torque)


def test_noise_is_found_by_differences_of_neighbouring_poses() -> None:
    """Of a smooth motion nothing is left."""
    _, exact = flown(3.0, seconds=600.0)
    rng, count = np.random.default_rng(4), len(exact.time)
    away, turn = 0.01 * rng.standard_normal((count, 3)), 0.002 * rng.standard_normal((count, 3))
    found = Track(exact.time, exact.position + away, exp(turn) @ exact.rotation).local_noise
    assert np.array(found) == pytest.approx([0.01, 0.002], rel=0.05)


@pytest.mark.parametrize('time', [0.0, 2.0])
def test_residuals_are_whitened_by_their_noise_and_their_correlation(time: float) -> None:
    """Those of a stationary series come out white, at uneven times too."""
    rng, count = np.random.default_rng(5), 4000
    stamps = np.cumsum(rng.uniform(0.1, 1.0, count))
    shared = np.exp(-np.diff(stamps) / time) if time else np.zeros(count - 1)
    values = rng.standard_normal((2, count, 3))
    for place, kept in enumerate(shared.tolist(), 1):
        values[:, place] = kept * values[:, place - 1] + np.sqrt(1.0 - kept**2) * values[:, place]
    values *= np.array([0.01, 0.3])[:, None, None]
    track = Track(stamps, values[0], np.tile(np.eye(3), (count, 1, 1)))
    white = _whitened(values, track, PoseNoise(0.01, 0.3, (time, time)))
    assert np.std(white, axis=(1, 2)) == pytest.approx(np.ones(2), rel=0.03)
    assert np.mean(white[:, 1:] * white[:, :-1], axis=(1, 2)) == pytest.approx(np.zeros(2), abs=0.03)
    assert white[:, 0] == pytest.approx(values[:, 0] / np.array([[0.01], [0.3]]))


@pytest.mark.parametrize('times', [(2.0, 0.0), (0.0, 1.0)])  # s, 0 for white noise
def test_noise_and_its_correlation_are_those_of_the_residuals_where_none_is_declared(
    times: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of stationary series whose correlation falls to 1 / e in a time."""
    count, step = 4000, 0.2
    values = np.random.default_rng(6).standard_normal((2, count, 3))
    for series, kept in zip(values, (np.exp(-step / time) if time else 0.0 for time in times), strict=True):
        series[1:] *= np.sqrt(1.0 - kept**2)
        series[:] = lfilter([1.0], [1.0, -kept], series, axis=0)
    values *= np.array([0.01, 0.002])[:, None, None]
    monkeypatch.setattr(module, '_linearised', lambda *_: (values, None))
    flight: Any = None
    track = Track(step * np.arange(count), values[0], np.tile(np.eye(3), (count, 1, 1)))
    found = _estimated(flight, track, PoseNoise(0.0, 0.0))
    assert (found.position, found.orientation) == pytest.approx((0.01, 0.002), rel=0.1)
    assert found.correlation_times == pytest.approx(times, rel=0.2)
    declared = PoseNoise(0.3, 0.4, (5.0, 6.0))
    assert _estimated(flight, track, declared) == declared


def test_the_first_guess_is_a_sphere_that_turns_as_the_last_poses_do() -> None:
    _, track = flown(20.0, seconds=20.0)
    guess = _first_guess(track, PoseNoise(1e-3, 1e-3))
    turning = guess.rotation @ exp(track.time[-10:, None] * guess.spin)
    assert np.abs(log(np.swapaxes(turning, 1, 2) @ track.rotation[-10:])).max() < 0.1
    assert turning[-1] == pytest.approx(track.rotation[-1])
    # Of the last poses within one radian: the tracked frame's origin goes round the centre of mass.
    recent = track.time > track.time[-1] - 1.0 / np.deg2rad(20.0)
    line = np.polyfit(track.time[recent], track.position[recent], 1)
    assert guess.velocity == pytest.approx(line[0], abs=2e-3)
    assert guess.centre == pytest.approx(line[1], abs=5e-3)


def test_a_step_is_that_of_damped_least_squares_and_takes_no_shape_far() -> None:
    _, track = flown(20.0, seconds=20.0)
    flight = _first_guess(track, PoseNoise(1e-3, 1e-3))
    rows = generic(3, 60, 21)
    prior = np.diag(np.repeat([0.0, 0.1, 1.0], [12, 3, 5]) ** 2)
    information = rows[:, :-1].T @ rows[:, :-1] + prior
    for damping in (0.0, 2.0):
        step, root = _step(flight, rows, damping)
        damped = information + damping * np.diag(np.diag(information))
        expected = np.linalg.solve(damped, rows[:, :-1].T @ rows[:, -1] - prior @ _held(flight))
        assert step == pytest.approx(expected)
        assert root.T @ root == pytest.approx(information)
    rows[:, -1] *= 1e3
    far, _ = _step(flight, rows, 0.0)
    assert np.max(np.abs(far[15:])) == pytest.approx(0.7)
