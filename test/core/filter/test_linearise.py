"""A window of the error chain: exact on exact data, linear in the state, and as noisy as it claims."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from checked import central_difference, generic
from floating import true_momentum
from mbaid_ros.core.clocks import time_offset
from mbaid_ros.core.contracts import Stack, stacked
from mbaid_ros.core.filter.linearise import _by_tracking, predict
from mbaid_ros.core.geometry import Array, exp, log, rotate, unvec
from mbaid_ros.core.joints.model import joint_gains, joint_placements
from mbaid_ros.core.links import independent_errors, known_bodies
from mbaid_ros.core.odometry.model import odometry_scale
from mbaid_ros.core.poses import NamedPoseConfig, PoseSensor, pose_errors
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import BODY, LINEAR, POSE, Layout, MomentumDrift, Point
from mbaid_ros.core.windows import BEFORE, Knots, midpoints
from mbaid_ros.simulation.simulation import Truth
from observed import MID, drifting, kernel, observe
from windowed import JOINT, LENGTH, START, residuals, window_model, window_of

SWAP = np.array([3, 4, 5, 0, 1, 2])
PARAMETERS, DELAY = slice(6, 22), 22  # of a state whose only unknown is the delay, in seconds


@pytest.fixture(scope='module')
def robot() -> Layout:
    return Layout.from_unknowns(kernel('servicer7'), (time_offset(1.0),))


@pytest.fixture(scope='module')
def exact(servicer: Truth) -> Samples:
    """Return exact samples of a servicer that tumbles and drifts."""
    return observe(drifting(servicer, np.array([0.02, -0.01, 0.03])), MID)


@pytest.fixture(scope='module')
def point(robot: Layout, exact: Samples) -> Array:
    """Return the true parameters, (P, L) about the odometry origin."""
    return np.concatenate((true_momentum(robot.kernel, exact)[0], robot.kernel.target.parameters))


def state(point: Array, error: Array | None = None, delay: float = 0.0) -> Array:
    x = np.zeros(len(point) + 7)
    x[POSE] = 0.0 if error is None else error
    x[PARAMETERS], x[DELAY] = point, delay
    return x


def at(robot: Layout, point: Array, delay: float = 0.0) -> Point:
    return robot.point(state(point, delay=delay))


def test_what_forces_bring_follows_the_state_at_given_accelerations(exact: Samples, point: Array) -> None:
    """The change of (P, L) is the momentum of the robot, its joints at rest, at one velocity and rate about c."""
    model = kernel('servicer7')
    links = known_bodies(model.model, independent_errors(model.known, 0.01))
    layout = Layout.from_unknowns(model, (links, joint_placements(model, *[[1e-2] * 7] * 3)))
    state = layout.state(point[6:], point[:6])
    window, faster, turning = window_of(exact, 0.05), np.array([0.3, -0.2, 0.1]), np.array([0.02, 0.05, -0.03])
    (stack,) = stacked([window])

    def whole(x: Array) -> Array:
        """Return the standard parameters of all bodies together near the end of the window, about the origin."""
        at = layout.point(x)
        middle, inside = stack.motion(at.nominal, 1)
        _, bodies = predict(layout, middle.flat, at)
        last, place = bodies[inside.stop - 1].states.configuration, middle.base_position[inside.stop - 1, 0]
        own = at.nominal.kernel.body_parameters(x[BODY])
        return np.sum(express(own, last.rotation, place + last.position), axis=0)

    centre = whole(state)[1:4] / whole(state)[0]

    def brought(x: Array) -> Array:
        mass, first, inertia = whole(x)[0], whole(x)[1:4], unvec(whole(x)[4:])
        velocity = faster - np.cross(turning, centre)  # of the point of all bodies that is at the origin
        linear = mass * velocity + np.cross(turning, first)
        return np.concatenate((linear, np.cross(first, velocity) + inertia @ turning))

    change = brought(state)
    drift = MomentumDrift(np.array([window.start]), -change[None], window.start + window.length, change, 1.0)
    drifting = replace(layout.point(state), drift=drift)
    leverage = window_model(layout, window, drifting).leverage
    expected = central_difference(brought, state, 1e-4 * np.maximum(np.abs(state), 1.0))
    assert leverage[:, LINEAR.start : -1] == pytest.approx(expected[:, LINEAR.start :], abs=1e-5)
    assert leverage @ np.append(state, 1.0) == pytest.approx(np.zeros(6), abs=1e-9)


def test_a_drift_changes_from_window_to_window_and_goes_on_after_them() -> None:
    rng = np.random.default_rng(2)
    offsets, rate = rng.normal(size=(3, 6)), rng.normal(size=6)
    drift = MomentumDrift(np.array([0.1, 0.6, 1.1]), offsets, 1.6, rate, 20.0)
    # Windows begin where the ones before end, to rounding.
    begins = [0.1, 0.6 + 1e-15, 1.1, 1.6, 2.1]
    assert drift.at(begins) == pytest.approx(np.vstack((offsets, np.zeros(6), 0.5 * rate)))
    changes = (offsets[1] - offsets[0], offsets[2] - offsets[1], -offsets[2], 0.5 * rate, 0.5 * rate)
    assert drift.until_next(begins, 0.5) == pytest.approx(np.array(changes))
    heavier = drift.of_mass(50.0)
    assert heavier.at(begins) == pytest.approx(2.5 * drift.at(begins))
    assert heavier.since(2.1).at([2.6]) == pytest.approx(1.25 * rate[None])


@pytest.mark.parametrize('correlation_time', [0.0, 0.3])
def test_exact_data_leave_nothing(robot: Layout, exact: Samples, point: Array, correlation_time: float) -> None:
    windows = [window_of(exact, spacing, correlation_time) for spacing in (0.1, 0.05)]
    found = [residuals(window_model(robot, window, at(robot, point)), state(point)) for window in windows]
    sizes = np.array([[np.abs(part).max() for part in parts] for parts in found])
    # A hundredth of the standard deviation that any of them has at the lowest noise, 1e-6.
    assert np.all(sizes[1] < 1e-8)
    assert np.all(sizes[1] < sizes[0] / 3.0)


@pytest.mark.parametrize('correlation_time', [0.0, 0.3])
def test_parameters_act_as_the_rows_say(robot: Layout, exact: Samples, point: Array, correlation_time: float) -> None:
    window = window_of(exact, 0.05, correlation_time)
    model = window_model(robot, window, at(robot, point))

    def constants(change: Array) -> Array:
        """Return what is left with the state at the linearisation point."""
        shifted = point + change
        pose, twist, drift = residuals(window_model(robot, window, at(robot, shifted)), state(shifted))
        return np.concatenate((pose, twist, drift))

    expected = central_difference(constants, np.zeros(16), 1e-4 * np.maximum(np.abs(point), 1.0))
    rows = np.concatenate((-model.pose.rows, -model.rates.rows, model.transition))[:, PARAMETERS]
    # The rows leave out the fourth-order corrections: a part in a thousand of the motion within an interval.
    for group in (slice(0, 6), slice(6, 12), slice(12, 18)):
        assert rows[group] == pytest.approx(expected[group], abs=2e-4 * np.abs(expected[group]).max())


def test_a_window_ends_with_the_base_and_the_centre_of_mass_where_they_are_then(
    robot: Layout, exact: Samples, point: Array
) -> None:
    window = window_of(exact, 0.05)
    model = window_model(robot, window, at(robot, point))
    # At the first knot of the next window, between two samples; the centre of mass half an interval before.
    end = window.start + window.length
    then = exact[np.searchsorted(exact.time, np.array([end + 0.02, end + 0.03, end]) - 1e-6)]
    states = robot.kernel.states(then)
    bodies = robot.kernel.body_parameters(robot.kernel.target.parameters)
    placed = states.configuration
    whole = np.sum(express(bodies, placed.rotation, then.base_position[:, None] + placed.position), axis=1)
    assert np.mean(log(then.base_rotation[:2] @ model.rotation.T), axis=0) == pytest.approx(np.zeros(3), abs=1e-5)
    assert model.position == pytest.approx(np.mean(then.base_position[:2], axis=0), abs=1e-5)
    assert model.centre == pytest.approx(whole[2, 1:4] / whole[2, 0], abs=1e-5)


@pytest.mark.parametrize('axis', range(6))
def test_a_measured_pose_that_is_off(robot: Layout, exact: Samples, point: Array, axis: int) -> None:
    error = np.zeros(6)
    error[axis] = 1e-3
    back = exp(-error[:3])
    # The twist is measured in base axes, and turned by the measured orientation.
    off = replace(
        exact,
        base_rotation=back @ exact.base_rotation,
        base_position=exact.base_position - error[3:],
        base_linear_velocity=rotate(back, exact.base_linear_velocity),
        base_angular_velocity=rotate(back, exact.base_angular_velocity),
    )
    model = window_model(robot, window_of(off, 0.05), at(robot, point))
    pose, twist, after = residuals(model, state(point, error))
    # What is left is of second order in the error; without F it would be 1e-3 times the speed, 1e-5.
    assert after == pytest.approx(error, abs=2e-7)
    assert pose == pytest.approx(-error, abs=2e-7)
    assert twist == pytest.approx(np.zeros(6), abs=2e-7)


def late(samples: Samples, delay: float) -> Samples:
    """Return samples whose joints are those of a moment before."""
    curve = CubicSpline(samples.time, samples.joint_position)
    return replace(samples, joint_position=curve(samples.time - delay))


def test_correlated_errors_of_poses_are_independent_from_window_to_window(exact: Samples) -> None:
    window = window_of(exact, 0.05, 0.3)
    keep = np.exp(-0.05 / 0.3)
    change = float(Stack((window,), (0,)).whitening[0, 0])
    knots = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], np.random.default_rng(0).normal(size=100_000))
    means = knots.reshape(-1, 10)[:-1].mean(axis=1) + change * np.diff(knots[::10])
    assert np.var(means) == pytest.approx((1.0 + keep) / (1.0 - keep) / 10.0, rel=0.05)
    assert np.mean(means[1:] * means[:-1]) / np.var(means) == pytest.approx(0.0, abs=0.04)


@pytest.mark.parametrize(
    ('time', 'pose', 'twist', 'measured', 'integrated'),
    [
        (0.3, 1e-3, 1e-4, True, True),
        (0.0, 1e-3, 1e-4, True, False),  # independent errors of poses
        (0.3, 1e-3, 1e-1, True, False),  # a twist that is far noisier
        (0.3, 1e-3, 1e-4, False, False),
    ],
)
def test_a_twist_counts_by_its_integral_where_poses_are_correlated_and_it_is_better(
    exact: Samples, time: float, pose: float, twist: float, measured: bool, integrated: bool
) -> None:
    window = window_of(exact, 0.05)
    noise = replace(window.noise, pose=pose**2 * np.eye(6), twist=twist**2 * np.eye(6), correlation_time=time)
    knots = window.knots
    if not measured:
        knots = replace(knots, base_twist=np.full_like(knots.base_twist, np.nan))
    assert Stack((replace(window, noise=noise, knots=knots),), (0,)).integrates_twist.tolist() == [integrated]


def _second(values: Array) -> Array:
    inner = np.diff(values, n=2, axis=0)
    return np.concatenate((inner[:1], inner, inner[-1:]))


def test_late_joints_leave_nothing_where_the_delay_is_known(robot: Layout, exact: Samples, point: Array) -> None:
    delay = 0.03
    parts = []
    for known in (0.0, delay):
        model = window_model(robot, window_of(late(exact, delay), 0.05), at(robot, point, known))
        first = -(delay - known) * np.concatenate((exact.base_angular_velocity, exact.base_linear_velocity), axis=1)[0]
        parts.append(np.abs(np.concatenate(residuals(model, state(point, first, delay))[:2])).max())
    # Not to first order alone: what is left is that of exact joints.
    assert parts[1] < 2e-7
    assert parts[0] > 20.0 * parts[1]


TRACKER = 'poses.tracker'
OF_TRACKER = slice(12, 15)  # of all numbers that a window with a tracker has: pose, twist, orientation


@pytest.fixture(scope='module')
def tracked(robot: Layout) -> Layout:
    """Return the state with a star tracker, whose only error is a delay in seconds."""
    config = NamedPoseConfig('orientation', mount_orientation_std=0.0, time_offset_std=1.0)
    errors = pose_errors('tracker', config, same_world=True)
    layout = Layout.from_unknowns(robot.kernel, (errors,))
    return replace(layout, sensors=(PoseSensor(TRACKER, 'orientation', slice(0, 50)),))


def with_a_reading(exact: Samples, behind: int) -> Samples:
    """Return samples with one reading of a star tracker at the window's end, stamped so many samples late."""
    readings = np.zeros((len(exact), 50))
    place = int(np.searchsorted(exact.time, START + LENGTH - 1e-6))
    readings[place, :2] = 1.0, exact.time[place]
    readings[place, 2:11] = exact.base_rotation[place - behind].ravel()
    readings[place, 14:] = (4e-10 * np.eye(6)).ravel()
    return replace(exact, readings=readings)


@pytest.mark.parametrize('behind', [0, 1])
def test_a_late_reading_is_of_the_motion_at_its_own_time(
    tracked: Layout, exact: Samples, point: Array, behind: int
) -> None:
    left = residuals(
        window_model(tracked, window_of(with_a_reading(exact, behind), 0.05), at(tracked, point)),
        state(point, delay=0.01 * behind),
    )[1]
    # A second order in the delay is left; with the mean motion of the window it would be five times as much.
    assert left[-3:] == pytest.approx(np.zeros(3), abs=3e-6)


class JointNoise:
    """How an error of every joint at every knot moves what a window says: exact, for it is linear."""

    def __init__(self, robot: Layout, exact: Samples, point: Array) -> None:
        self.window = window_of(exact, 0.05)
        self.model = window_model(robot, self.window, at(robot, point))
        middle = midpoints(self.window.knots, self.window.spacing)
        gain = joint_gains(robot.kernel, predict(robot, middle, at(robot, point))[1])[0][:, SWAP]
        # The gain at the window's first knot.
        begin = self.window.inside.start
        gain = 0.5 * (gain[begin - 1] + gain[begin])
        columns = []
        for knot, joint in np.ndindex(self.window.knots.joint_position.shape):
            changed = []
            for size in (JOINT, -JOINT):
                error = np.zeros_like(self.window.knots.joint_position)
                error[knot, joint] = size
                # What of it the differences integrate to.
                centre = error - 0.5 * self.window.knots.spread[:, None] * _second(error)
                changed.append(self._left(robot, point, error, gain @ centre[begin]))
            columns.append((changed[0] - changed[1]) / (2.0 * JOINT))
        samples_a_node = self.window.noise.samples * self.window.spacing / LENGTH
        rows = np.stack(columns, axis=1) * JOINT / np.sqrt(samples_a_node)
        self.covariance = rows @ rows.T

    def _left(self, robot: Layout, point: Array, error: Array, first: Array) -> Array:
        knots = replace(self.window.knots, joint_position=self.window.knots.joint_position + error)
        assert isinstance(knots, Knots)
        model = window_model(robot, replace(self.window, knots=knots), at(robot, point))
        # The chain begins displaced by what the first knot's error makes of the pose.
        pose, rates, _ = residuals(model, state(point, first))
        return np.concatenate((pose, rates))


def test_covariances_are_those_of_the_joints_noise(robot: Layout, exact: Samples, point: Array) -> None:
    noise = JointNoise(robot, exact, point)
    for place, claimed in enumerate((noise.model.pose.covariance, noise.model.rates.covariance)):
        part = slice(6 * place, 6 * place + 6)
        ratio = np.diag(noise.covariance[part, part]) / np.diag(claimed)
        # One gain stands for the window's, and the fourth-order formulas stir the noise a little.
        assert np.all((ratio > 0.8) & (ratio < 1.35))


def test_a_single_reading_has_the_joints_noise_of_the_knots_beside_it(
    tracked: Layout, exact: Samples, point: Array
) -> None:
    noise = JointNoise(tracked, with_a_reading(exact, 0), point)
    still = replace(noise.window, noise=replace(noise.window.noise, joint_position=0.0))
    own = window_model(tracked, still, at(tracked, point)).rates.covariance[-3:, -3:]
    claimed = noise.model.rates.covariance[-3:, -3:] - own
    ratio = np.linalg.eigvals(np.linalg.solve(claimed, noise.covariance[OF_TRACKER, OF_TRACKER])).real
    # Means sharpened to the knots' centres have a fifth more of it. One gain stands for the window's.
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.06)


def test_poses_share_their_noise_with_the_column_of_a_scale(exact: Samples, point: Array) -> None:
    size, layout = 1e-3, Layout.from_unknowns(kernel('servicer7'), (odometry_scale(1.0),))
    window = window_of(exact, 0.05)
    window = replace(window, noise=replace(window.noise, pose=size**2 * np.eye(6)))
    inside, shared = window.inside, np.zeros((6, 6))
    of_knot = size / np.sqrt(window.noise.samples * window.spacing / LENGTH)

    def read(error: Array) -> tuple[Array, Array]:
        """Return the pose's value and the scale's column; the chain begins displaced by the first knot's error."""
        knots = replace(window.knots, base_position=window.knots.base_position + error)
        model = window_model(layout, replace(window, knots=knots), layout.point(state(point)))
        displaced = np.concatenate((np.zeros(3), -error[inside.start]))
        return residuals(model, state(point, displaced))[0], model.pose.rows[:, -1]

    before = read(np.zeros_like(window.knots.base_position))
    for knot in range(len(window.knots.base_position)):
        error = np.zeros_like(window.knots.base_position)
        error[knot] = of_knot * np.array([1.0, -1.0, 1.0])
        by_value, by_column = (after - value for after, value in zip(read(error), before, strict=True))
        shared += np.outer(by_value, by_column)
    claimed = window_model(layout, window, layout.point(state(point))).position_noise[..., 0]
    assert claimed[3:, 3:] == pytest.approx(size**2 / window.noise.samples * np.eye(3), rel=1e-12)
    # The column is read midway between knots.
    assert np.diagonal(shared) == pytest.approx(np.diagonal(claimed), abs=0.1 * claimed.max())


def test_what_accumulates_of_the_joints_noise(robot: Layout, exact: Samples, point: Array) -> None:
    window = window_of(exact, 0.05)
    columns = []
    for joint in range(robot.kernel.model.joints):
        # An error of a few knots within the window, none at its ends: what is left of it at the next window's knot.
        error = np.zeros_like(window.knots.joint_position)
        error[BEFORE + 3 : BEFORE + 8, joint] = 1.0
        after = []
        for size in (JOINT, -JOINT):
            knots = replace(window.knots, joint_position=window.knots.joint_position + size * error)
            after.append(
                residuals(window_model(robot, replace(window, knots=knots), at(robot, point)), state(point))[2]
            )
        columns.append((after[0] - after[1]) / (2.0 * JOINT * 5 * window.spacing))
    remainder = np.stack(columns, axis=1)
    claimed = window_model(robot, window, at(robot, point)).noise.process
    expected = JOINT * LENGTH / np.sqrt(window.noise.samples) * remainder
    assert claimed == pytest.approx(expected, abs=0.1 * np.abs(expected).max())


def test_tracking_errors_of_joints_are_white_noise_of_the_rates_of_a_sensor_beside_the_base() -> None:
    """In the time dt of a sample an error of unit variance and time constant T changes by sqrt(2 dt / T)."""
    gain, columns, counts, length = generic(1, 2, 3, 4), generic(2, 4, 2), np.array([20.0, 30.0]), 0.5
    times = np.array([0.2, 3.0])
    layout: Any = SimpleNamespace(time_constants=np.array([np.inf, *times]), joint_columns=columns)
    stack: Any = SimpleNamespace(samples=counts[:, None, None], windows=[SimpleNamespace(length=length)])
    kinds = (None, None), (gain, np.ones((2, 4))), (gain, None)  # on the base, of the pose, of the rates
    seen: Any = [SimpleNamespace(value=np.zeros((2, 3)), joint_gain=by, weights=at) for by, at in kinds]
    found = _by_tracking(layout, stack, seen, (2, 9, 5))
    steps = length / counts[:, None]
    rates = np.sqrt(2.0 * steps / times) / steps
    assert found[:, 6:, 3:] == pytest.approx(np.einsum('brn,nc,bc->brc', gain, columns, rates))
    assert not found[:, :6].any()
    assert not found[:, :, :3].any()
    layout.time_constants = np.zeros(0)
    assert not _by_tracking(layout, stack, seen, (2, 9, 5)).any()
