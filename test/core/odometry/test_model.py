"""What mount, delay and gyro do to the readings of a window, against finite differences on exact data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from checked import assert_derivative, central_difference, generic, some
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.clocks import clock_drift, time_offset
from mbaid_ros.core.contracts import Motion, Unknown, deviation_text
from mbaid_ros.core.filter.linearise import WindowModel
from mbaid_ros.core.geometry import Array, crossed, exp, log, rotate, rotate_back
from mbaid_ros.core.gyro import IMU, GyroErrors, angular_momentum, gyro, gyro_sensor
from mbaid_ros.core.joints.model import joint_lags, joint_placements
from mbaid_ros.core.odometry.model import (
    ANGULAR_BIAS,
    LINEAR_BIAS,
    IntegratedTwist,
    MarkerConfig,
    OdometryScale,
    _certain,
    integral_weights,
    integrated_twist,
    marker_frame,
    odometry_mount,
    odometry_scale,
    parabolic_weights,
    poses_beside_others,
    telescoped,
    twist_bias,
    vibration,
)
from mbaid_ros.core.odometry.stream import _blended
from mbaid_ros.core.poses import NamedPoseConfig, PoseCollector, PoseSensor, pose_errors
from mbaid_ros.core.robot.model import Kinematics, express
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import BaseStream, Samples
from mbaid_ros.core.state import BODY, Layout
from mbaid_ros.parameters import build
from mbaid_ros.session.catalogue import unknowns
from mbaid_ros.simulation.simulation import Truth
from observed import MID, observe
from simulated import robot
from windowed import FIRST, JOINT, LAST, residuals, window_model, window_of
from wrong_robots import Wrong

SPACING = 0.05  # s
LINK = 'link4'  # that an IMU sits on


def test_covariances_at_joint_readings_are_between_those_of_the_poses_beside() -> None:
    parts = np.random.default_rng(0).normal(size=(3, 6, 6))
    covariance, (first, second) = parts @ np.swapaxes(parts, 1, 2), ([0, 1], [1, 2])
    found = _blended(covariance, (np.array(first), np.array(second)), np.array([[0.25], [0.6]]), np.array([1.0, 2.0]))
    assert found[0] == pytest.approx(0.75 * covariance[0] + 0.25 * covariance[1])
    assert found[1] == pytest.approx(2.0 * (0.4 * covariance[1] + 0.6 * covariance[2]))


def read(tumbling: Truth, unknown: Unknown, value: Array, joints: int) -> Samples:
    return observe(Wrong.by((unknown,), (value,), joints).read(tumbling), MID)


def state(robot: MomentumKernel, momentum: Array, error: Array, value: Array) -> Array:
    return np.concatenate((error, momentum, robot.target.parameters, value))


def base(exact: Samples, time: float) -> tuple[Array, Array]:
    """Return orientation (3, 3) and twist (angular, linear) of the base midway between two samples."""
    index = int(np.searchsorted(exact.time, time))
    twist = np.concatenate((exact.base_angular_velocity, exact.base_linear_velocity), axis=1)
    # The mean of two rotations that differ by half a milliradian is one, to a part in a million.
    rotation, mean = (0.5 * (values[index - 1] + values[index]) for values in (exact.base_rotation, twist))
    return rotation, mean


def of_mount(exact: Samples, time: float, component: int) -> Array:
    """Return the pose error of odometry that is mounted elsewhere: R mu_R, R mu_p."""
    rotation = base(exact, time)[0]
    error = np.zeros(6)
    block = slice(0, 3) if component < 3 else slice(3, 6)
    error[block] = rotation[:, component % 3]
    return error


def of_delay(exact: Samples, time: float, _component: int) -> Array:
    return -base(exact, time)[1]


def of_drift(exact: Samples, time: float, _component: int) -> Array:
    return -time * base(exact, time)[1]


def of_scale(exact: Samples, time: float, _component: int) -> Array:
    """Return the pose error of lengths that are read too long."""
    index = int(np.searchsorted(exact.time, time))
    position = 0.5 * (exact.base_position[index - 1] + exact.base_position[index])
    return -np.concatenate((np.zeros(3), position))


def of_twist(_exact: Samples, _time: float, _component: int) -> Array:
    return np.zeros(6)


# In their own units.
MOUNT, DELAY, DRIFT = odometry_mount(1.0, 1.0), time_offset(1.0), clock_drift(1.0)
SCALE, BIAS = odometry_scale(1.0), twist_bias(1.0, 1.0)
ERROR = {MOUNT: of_mount, DELAY: of_delay, DRIFT: of_drift, SCALE: of_scale, BIAS: of_twist}


@pytest.mark.parametrize(
    ('unknown', 'component'), [(unknown, each) for unknown in ERROR for each in range(unknown.count)]
)
def test_readings_are_off_as_the_rows_say(
    servicer7: MomentumKernel, tumbling: Truth, exact: Samples, start: Array, unknown: Unknown, component: int
) -> None:
    # Central differences over 10 ms of a motion whose own time is seconds; mounts and biases are all but linear.
    late = unknown in {DELAY, DRIFT}
    size = 5e-3 if unknown is DELAY else 1e-3
    # A window's mean twist stands for that at each of its instants.
    tolerance = 1e-2 if unknown in {DRIFT, SCALE} else 1e-3 if unknown is DELAY else 1e-5
    layout = Layout.from_unknowns(servicer7, (unknown,))
    here = layout.point(state(servicer7, start, np.zeros(6), np.zeros(unknown.count)))
    begin, end = (ERROR[unknown](exact, time, component) for time in (FIRST, LAST))
    parts = []
    for step in (size, -size):
        value = np.zeros(unknown.count)
        value[component] = step
        window = window_of(read(tumbling, unknown, value, servicer7.model.joints), SPACING)
        own = (1.0 - step) * start if unknown is DRIFT else start  # in seconds of the joints' clock
        x = state(servicer7, own, step * begin, value)
        parts.append(np.concatenate(residuals(window_model(layout, window, here), x)))
    pose, twist, after = np.split((parts[0] - parts[1]) / (2.0 * size), 3)
    motion = np.abs(np.concatenate(base(exact, FIRST)[1:])).max()
    scale = motion if late or unknown is SCALE else 1.0
    assert pose == pytest.approx(np.zeros(6), abs=tolerance * scale)
    assert twist == pytest.approx(np.zeros(6), abs=tolerance * scale)
    assert after == pytest.approx(end, abs=tolerance * scale)
    # And the columns are not nothing.
    model = window_model(layout, window_of(exact, SPACING), here)
    rows = model.rates.rows if unknown is BIAS else model.pose.rows
    assert np.abs(rows[:, BODY.stop + component]).max() > 0.3 * scale


ARM, CAMERA = 'gyros.arm', 'poses.camera'
SIZES = np.full(13, 1e-3)  # rad/s; relative, rad, relative; s


@pytest.fixture(scope='module')
def exact(tumbling: Truth) -> Samples:
    return observe(tumbling, MID)


def measured(kernel: MomentumKernel, exact: Samples, value: Array, name: str = 'base_link') -> Samples:
    """Return samples with what a gyro on a link reads that has these errors."""
    link, kinematics = kernel.model.link(name), kernel.kinematics
    bias, scale, turn, shared, delay = value[:3], value[3:6], value[6:9], value[9:12], value[12]
    placed = kinematics.configure(exact.base_rotation, exact.joint_position)
    base = np.concatenate((np.zeros_like(exact.base_angular_velocity), exact.base_angular_velocity), axis=1)
    bodies = kinematics.body_twists(placed, exact.joint_velocity, base)
    rate = CubicSpline(exact.time, rotate_back(placed.link_pose(link)[0], bodies[:, link.body, 3:]))
    late = CubicSpline(exact.time, rate(exact.time - delay) @ exp(turn))  # rows: turned back
    turned = late.antiderivative()(exact.time) @ (np.diag(1.0 + scale) + crossed(shared)) + exact.time[:, None] * bias
    return replace(exact, further=turned)


def gyro_window(
    kernel: MomentumKernel, samples: Samples, start: Array, known: Array, name: str = 'base_link'
) -> tuple[WindowModel, Array]:
    """Return a window's model where some of the errors are known, and the state."""
    link = kernel.model.link(name) if name != 'base_link' else None
    unknown = gyro(GyroErrors(1.0, 1.0, 1.0, 1.0, cross=1.0, link=link))
    layout = replace(Layout.from_unknowns(kernel, (unknown,)), sensors=(gyro_sensor(IMU, 0.0, kernel.model, link),))
    x = state(kernel, start, np.zeros(6), known)
    assert len(x) == BODY.stop + 13
    return window_model(layout, window_of(samples, SPACING), layout.point(x)), x


@pytest.mark.parametrize(('name', 'exactly', 'part'), [('base_link', 1e-8, 5e-3), (LINK, 1e-6, 1e-2)])
def test_gyro_readings_are_off_as_the_columns_say(
    servicer7: MomentumKernel, exact: Samples, start: Array, name: str, exactly: float, part: float
) -> None:
    def left(value: Array, known: Array) -> Array:
        """Return what is left of the readings where some of the errors are known."""
        read = measured(servicer7, exact, value, name)
        return residuals(*gyro_window(servicer7, read, start, known, name))[1][6:]

    nothing = np.zeros(13)
    none = left(nothing, nothing)
    assert np.abs(none).max() < exactly
    for value in np.diag(SIZES):
        off, rest = left(value, nothing), left(value, value)
        assert np.abs(off).max() > 1e-6
        assert np.abs(rest - none).max() < part * np.abs(off).max()


def test_two_gyros_are_off_as_their_columns_say_where_no_error_is_zero(
    servicer7: MomentumKernel, exact: Samples, start: Array
) -> None:
    """One on the base, one on a link, with all errors at once: each reads by its own ones alone."""
    size = SIZES * np.abs(generic(5, 2, len(SIZES)))
    errors = [
        gyro(GyroErrors(1.0, 1.0, 1.0, 1.0, cross=1.0)),
        gyro(GyroErrors(1.0, 1.0, 1.0, 1.0, cross=1.0, name=ARM, link=servicer7.model.link(LINK))),
    ]
    sensors = (
        gyro_sensor(IMU, 0.0, servicer7.model),
        gyro_sensor(ARM, 0.0, servicer7.model, servicer7.model.link(LINK), slice(3, 6)),
    )
    layout = replace(Layout.from_unknowns(servicer7, errors), sensors=sensors)
    read = [measured(servicer7, exact, *each).further for each in zip(size, ('base_link', LINK), strict=True)]
    window = window_of(replace(exact, further=np.concatenate(read, axis=1)), SPACING)

    def left(first: Array, second: Array) -> Array:
        x = np.concatenate((np.zeros(6), start, servicer7.target.parameters, first, second))
        model = window_model(layout, window, layout.point(x))
        assert model.rates.rows.shape == (12, BODY.stop + 26)
        return residuals(model, x)[1][6:]

    nothing = np.zeros(13)
    off, rest = left(nothing, nothing), left(*size)
    assert np.abs(rest).max() < 2e-2 * np.abs(off).min()
    for gyros_own, known in ((slice(0, 3), (size[0], nothing)), (slice(3, 6), (nothing, size[1]))):
        one = left(*known)
        assert one[gyros_own] == pytest.approx(rest[gyros_own], abs=1e-12)
        assert np.delete(one, gyros_own) == pytest.approx(np.delete(off, gyros_own), abs=1e-12)


@pytest.mark.parametrize('component', [6, 7, 8])
def test_an_orientation_of_its_own_is_turned_as_its_axes_are(
    servicer7: MomentumKernel, exact: Samples, start: Array, component: int
) -> None:
    value = np.zeros(13)
    value[component] = SIZES[component]
    layout = Layout.from_unknowns(servicer7, (gyro(GyroErrors(1.0, 1.0, 1.0, 1.0, cross=1.0, with_orientation=True)),))
    layout = replace(layout, sensors=(gyro_sensor(IMU, 0.0, servicer7.model),))
    state = np.concatenate((np.zeros(6), start, servicer7.target.parameters, value))
    read = measured(servicer7, exact, value)
    read = replace(read, base_rotation=read.base_rotation @ exp(value[6:9]))
    point = layout.point(np.concatenate((state[: BODY.stop], np.zeros(13))))
    model = window_model(layout, window_of(read, 0.05), point)
    # The error of the pose is that of the axes, and stays so.
    state[:3] = -read.base_rotation[np.searchsorted(read.time, FIRST - 1e-6)] @ value[6:9]
    pose, rate, after = residuals(model, state)
    turned = read.base_rotation[np.searchsorted(read.time, LAST - 1e-6)] @ value[6:9]
    assert np.abs(pose[:3]).max() < 5e-3 * SIZES[component]
    assert np.abs(rate[6:]).max() < 5e-3 * SIZES[component]
    assert after[:3] == pytest.approx(-turned, abs=5e-3 * SIZES[component])


def test_a_gyro_that_measures_no_orientation_reads_no_pose(exact: Samples) -> None:
    """The other one turns it with its axes, and neither reads what another sensor does."""
    motion = cast('Motion', SimpleNamespace(rotation=exact.base_rotation))
    alone, oriented = (gyro(GyroErrors(1.0, 1.0, 1.0, 1.0, cross=1.0, with_orientation=each)) for each in (False, True))
    assert alone.measured('pose', motion) is None
    columns = some(oriented.measured('pose', motion))
    assert np.array_equal(columns[:, :3, 6:9], exact.base_rotation)
    assert np.count_nonzero(columns) == np.count_nonzero(exact.base_rotation)
    assert oriented.measured('twist', motion) is None


def test_the_joints_noise_is_in_the_readings_as_the_covariance_says(
    servicer7: MomentumKernel, exact: Samples, start: Array
) -> None:
    rng = np.random.default_rng(0)
    read, errors = measured(servicer7, exact, np.zeros(13), LINK), []
    for _ in range(150):
        noisy = read.joint_position + JOINT * rng.normal(size=read.joint_position.shape)
        model, x = gyro_window(servicer7, replace(read, joint_position=noisy), start, np.zeros(13), LINK)
        errors.append(residuals(model, x)[1])
    # Nothing else is noisy: the windows' own is 1e-15, the gyro has none.
    expected, found = model.rates.covariance, np.cov(np.array(errors).T)
    for part in (slice(0, 3), slice(6, 9)):
        assert np.trace(found[part, part]) == pytest.approx(np.trace(expected[part, part]), rel=0.2)
    size = np.sqrt(np.trace(expected[:3, :3]) * np.trace(expected[6:, 6:]))
    assert found[:3, 6:] == pytest.approx(expected[:3, 6:], abs=0.1 * size)
    # That of the joints before it is half as much again.
    assert np.trace(expected[6:, 6:]) > 1.4 * np.trace(expected[:3, :3])


@pytest.mark.parametrize('count', [2, 3, 17])
def test_weights_of_an_integral_and_of_its_mean_over_the_knots(count: int) -> None:
    """Rates that hold from knot to knot lead to the running sum at each knot."""
    rates = np.random.default_rng(count).normal(size=count)
    at_knots = np.concatenate(([0.0], np.cumsum(rates)))[:-1]
    of_all, of_mean = integral_weights(count)
    assert count * of_all @ rates == pytest.approx(np.sum(rates))
    assert 0.5 * (count - 1.0) * of_mean @ rates == pytest.approx(np.mean(at_knots))


@pytest.mark.parametrize('count', [3, 10])
def test_a_windows_twist_is_weighted_by_a_parabola_that_vanishes_at_its_ends(count: int) -> None:
    weights, spacing = parabolic_weights(count), 0.05
    assert np.sum(weights) == pytest.approx(1.0)
    parabola = np.polyfit(np.arange(count), weights, 2)
    assert np.polyval(parabola, [-0.5, count - 0.5]) == pytest.approx([0.0, 0.0], abs=1e-12)
    # White noise of the joints at the knots: in the weighted sum of their differences, over that in their mean.
    noise = np.random.default_rng(count).normal(size=(40_000, count + 1))
    twist, mean = np.diff(noise, axis=1) @ weights / spacing, np.mean(noise[:, :count], axis=1)
    assert np.var(twist) / np.var(mean) == pytest.approx(telescoped(count, spacing), rel=0.05)


def test_a_measurement_is_worth_as_much_as_among_all_windows_of_a_long_run() -> None:
    """Beside a random walk: the middle block of the inverse of the covariance of all, far from the ends."""
    rng, size, windows = np.random.default_rng(1), 2, 81
    noise, by_carried, walk = rng.normal(size=(4, 6)), rng.normal(size=(4, size)), rng.normal(size=(size, size))
    noise = noise @ noise.T
    steps = np.kron(np.tril(np.ones((windows, windows))), walk)  # the walk's values by its steps
    steps[:, :size] *= 1e3  # it begins anywhere
    readings = np.kron(np.eye(windows), by_carried) @ steps
    whole = np.linalg.inv(np.kron(np.eye(windows), noise) + readings @ readings.T)
    middle = slice(4 * (windows // 2), 4 * (windows // 2) + 4)
    assert _certain(noise[None], by_carried, walk[None])[0] == pytest.approx(whole[middle, middle], rel=1e-4)


def test_the_noise_of_an_integrated_twist_is_that_of_its_way_and_of_its_mean_over_the_knots() -> None:
    """Of equal readings in each interval; stored momentum is as noisy in all of them."""
    count, spacing, windows = 6, 0.05, 2
    rng = np.random.default_rng(3)
    own, stored = rng.normal(size=(windows, 6, 8)), 0.3 * rng.normal(size=(windows, 6, 3))
    rotation = exp(rng.normal(size=(count * windows, 3))).reshape(count, windows, 3, 3)
    shapes = {'by_parameters': (6, 9), 'by_pose_error': (6, 6), 'twist': (6,)}
    prediction: Any = SimpleNamespace(
        **{name: rng.normal(size=(count, windows, *shape)) for name, shape in shapes.items()}
    )
    stack: Any = SimpleNamespace(
        windows=(SimpleNamespace(spacing=spacing),) * windows,
        samples=50,
        twist_covariance=own @ np.swapaxes(own, 1, 2),
        whitening=rng.normal(size=(windows, 6)),
    )

    class Middle(SimpleNamespace):
        def __len__(self) -> int:
            return count

    middle: Any = Middle(base_twist=rng.normal(size=(count, windows, 6)), base_rotation=rotation)
    point: Any = SimpleNamespace(parameters=rng.normal(size=9), nuisance=rng.normal(size=2))
    found = integrated_twist(
        stack,
        prediction,
        middle,
        rng.normal(size=(count + 1, windows, 6, 16)),
        point,
        by_readings=[rng.normal(size=(windows, 6, 2))] * 2,
        stored=stored,
    )
    axes = np.zeros((windows, 6, 6))
    axes[:, :3, :3] = axes[:, 3:, 3:] = rotation[count // 2]
    one = axes @ stack.twist_covariance @ np.swapaxes(axes, 1, 2) + stored @ np.swapaxes(stored, 1, 2)
    one *= count / stack.samples  # of an interval's mean
    steps = rng.normal(size=(200_000, count)) * spacing
    way, mean = np.sum(steps, axis=1), np.mean(np.cumsum(steps, axis=1) - steps, axis=1)
    variance, shared = np.var(way), np.mean(way * mean)
    assert found.white == pytest.approx(variance * one, rel=0.02)
    assert found.share == pytest.approx(shared / variance, rel=0.02)
    assert found.left == pytest.approx(np.var(mean) / variance - (shared / variance) ** 2, rel=0.02)
    assert found.replaces_twist.all()
    assert IntegratedTwist.none(windows, 17).white.shape == found.white.shape


def test_the_bias_of_a_twist_is_six_numbers_of_two_kinds() -> None:
    assert BIAS.labels == (*(ANGULAR_BIAS,) * 3, *(LINEAR_BIAS,) * 3)
    sizes = twist_bias(2.0, 3.0).factor.sum(axis=1)
    assert sizes == pytest.approx([2.0] * 3 + [3.0] * 3)
    assert odometry_mount(0.5, 0.02).tilt == pytest.approx(0.02)


def on_the_arm(
    kernel: MomentumKernel, exact: Samples, start: Array, unknown: Unknown, late: float = 0.0
) -> Callable[[Array, Array], Array]:
    """Return the residuals of a gyro's and poses' readings of a link, linearised at values, others in the state.

    Where the poses are `late`, s, those are of one sensor alone.
    """
    link = kernel.model.link(LINK)
    path = Kinematics(kernel.model).ancestors[link.body]
    lever = np.array([0.1, -0.2, 0.3])
    sensors = (
        gyro_sensor(IMU, 0.0, kernel.model, link),
        PoseSensor(CAMERA, 'both', slice(0, 50), link=link, moved_by=path),
        PoseSensor(CAMERA, 'position', slice(50, 100), lever, link=link, moved_by=path),
    )
    layout = replace(Layout.from_unknowns(kernel, (unknown,)), sensors=sensors[1:2] if late else sensors)
    turned, away = kernel.kinematics.configure(exact.base_rotation, exact.joint_position).link_pose(link)
    turn = CubicSpline(exact.time, log(turned[0].T @ turned))

    def before(time: Array) -> Array:
        return turned[0] @ exp(turn(time))

    stamp = np.round(1e9 * exact.time).astype(np.int64)
    parts = []
    for point in (np.zeros(3), lever):
        collector = PoseCollector(10**9, 'both', same_world=True)
        place = CubicSpline(exact.time, exact.base_position + away + rotate(turned, point))(exact.time - late)
        unknown_rates = np.full((len(stamp), 3), np.nan)
        poses = np.tile(1e-8 * np.eye(6), (len(stamp), 1, 1))
        collector.push(BaseStream(stamp, place, before(exact.time - late), unknown_rates, unknown_rates, poses, poses))
        parts.append(collector.columns(exact, stamp))
    read = replace(measured(kernel, exact, np.zeros(13), LINK), readings=np.concatenate(parts, axis=1))
    window = window_of(read, SPACING)

    def left(at: Array, value: Array) -> Array:
        point = layout.point(state(kernel, start, np.zeros(6), at))
        return residuals(window_model(layout, window, point), state(kernel, start, np.zeros(6), value))[1][6:]

    return left


# The speed of a window's middle stands for that of its readings.
@pytest.mark.parametrize(('kind', 'part'), [('placements', 4e-3), ('lags', 5e-2)])
def test_sensors_on_a_link_are_off_by_errors_of_joints_as_the_columns_say(
    servicer7: MomentumKernel, exact: Samples, start: Array, kind: str, part: float
) -> None:
    """To first order it is the same whether errors are in the point of linearisation or in the state."""
    ones = np.ones(servicer7.model.joints).tolist()
    unknown: Unknown = joint_placements(servicer7, ones, ones, ones)
    if kind == 'lags':
        unknown = joint_lags(servicer7.model.joint_names, ones)
    left, nothing = on_the_arm(servicer7, exact, start, unknown), np.zeros(unknown.count)
    assert np.abs(left(nothing, nothing)).max() < 1e-6
    for place in range(0, unknown.count, 2):
        value = np.zeros(unknown.count)
        value[place] = 1e-3
        off = left(nothing, value)
        assert np.abs(off).min() > 1e-9
        assert left(value, value) == pytest.approx(off, abs=part * np.abs(off).max())


def test_poses_of_a_link_that_are_late_are_those_of_where_it_has_been(
    servicer7: MomentumKernel, exact: Samples, start: Array
) -> None:
    """Joints and base have moved it: the delay takes both back."""
    delay, config = (
        0.01,
        NamedPoseConfig(time_offset_std=1.0, mount_orientation_std=0.0, mount_position_std=0.0, scale_std=0.0),
    )
    unknown = pose_errors('camera', config, same_world=True)
    assert unknown.causes == ('pose delay:camera',)
    left = on_the_arm(servicer7, exact, start, unknown, delay)
    off = left(np.zeros(1), np.zeros(1))
    assert left(np.zeros(1), np.array([delay])) == pytest.approx(np.zeros(6), abs=0.05 * float(np.abs(off).max()))


@pytest.mark.parametrize('same', [False, True])
def test_a_scale_beside_poses_of_the_same_world_is_about_its_origin(same: bool) -> None:
    """As those poses are; alone it is about the run's, wherever that begins."""
    config = build(EstimatorConfig, {'poses.names': ['mocap'], 'poses.mocap.same_world': same})
    kernel = MomentumKernel(robot('servicer7'), 'link7')
    (scale,) = (each for each in unknowns(config, kernel) if isinstance(each, OdometryScale))
    place, origin, fast = generic(1, 2, 3), generic(2, 3), generic(3, 2, 6)
    motion = Motion(np.arange(2.0), origin, place, np.stack([np.eye(3)] * 2), fast, fast, fast)
    read = some(scale.measured('pose', motion))[:, 3:, 0]
    assert read == pytest.approx(place + origin if same else place)
    assert some(scale.measured('twist', motion))[:, 3:, 0] == pytest.approx(fast[:, 3:])


@pytest.mark.parametrize(('scale', 'text'), [(0.07, '7 % too long'), (-0.092, '9.2 % too short')])
def test_a_wrong_scale_is_said_as_lengths_that_are_too_long_or_too_short(scale: float, text: str) -> None:
    value, std = np.array([scale]), np.array([0.002])
    assert text in deviation_text(SCALE.labels[0], value)
    found = SCALE.repair('', value, std, cast(MomentumKernel, None))
    size, _, ending = text.partition(' %')
    assert found.cause == f'the odometry reads lengths +{size} ± 0.39 %{ending}'


def test_poses_that_are_late_or_drift_are_those_of_earlier_and_displaced() -> None:
    unknown = poses_beside_others(1e-4, 1e-6)
    motion = cast('Motion', SimpleNamespace(time=np.array([2.0, 5.0]), twist=generic(7, 2, 6)))
    read = some(unknown.measured('pose', motion)) @ np.array([0.05, 1e-3, 0.0, -2e-3])
    moved = np.array([[0.0, 0.0, 0.0, 2e-3, 0.0, -4e-3], [0.0, 0.0, 0.0, 5e-3, 0.0, -1e-2]])
    assert read == pytest.approx(moved - 0.05 * motion.twist)
    assert unknown.measured('twist', motion) is None
    texts = deviation_text('poses late', np.array([0.05])), deviation_text('poses drift', np.array([0.0, 1e-3, 0.0]))
    assert texts[0].startswith('the odometry is stamped +50 ms late')
    assert 'drifts by 60 mm a minute' in texts[1]


def test_a_vibration_of_the_twist_is_the_rate_of_that_of_the_pose() -> None:
    unknown = vibration(0.7)
    for time in (0.3, 47.0):
        at = SimpleNamespace(time=np.array([time]))
        rate = some(unknown.measured('twist', cast('Motion', at)))[0]

        def pose(later: Array, time: float = time) -> Array:
            there = SimpleNamespace(time=time + later)
            return some(unknown.measured('pose', cast('Motion', there)))[0]

        assert rate == pytest.approx(central_difference(pose, np.zeros(1), 1e-4)[..., 0], abs=1e-4)
    once, again = (
        some(unknown.measured('pose', cast('Motion', SimpleNamespace(time=np.array([time])))))[0]
        for time in (0.3, 0.3 + 1.0 / 0.7)
    )
    assert again[:, :12] == pytest.approx(once[:, :12])
    still = some(unknown.measured('pose', cast('Motion', SimpleNamespace(time=np.array([60.0])))))[0]
    assert still[:, 12:] == pytest.approx(still[:, :12])  # grown by as much again in a minute


@pytest.mark.parametrize(
    ('make', 'measured_twist'),
    [(lambda: odometry_scale(1.0), 'scaled'), (lambda: twist_bias(1.0, 1.0), 'biased')],
)
def test_the_momentum_follows_from_a_twist_as_it_is_read(
    servicer7: MomentumKernel, make: Callable[[], Unknown], measured_twist: str
) -> None:
    joints = servicer7.model.joints
    (turn,), twist = exp(generic(1, 1, 3)), generic(2, 6)  # linear first
    rest = turn[None], generic(3, 1, joints), generic(4, 1, joints)

    def momentum(value: Array) -> Array:
        """Return the known bodies' momentum by readings whose twist is off by a value."""
        axes = np.zeros((6, 6))
        axes[:3, 3:] = axes[3:, :3] = turn  # angular numbers first
        off = value[0] * np.append(twist[:3], np.zeros(3)) if measured_twist == 'scaled' else axes @ value
        return servicer7.states_of(*rest, (twist - off)[None]).known_momentum[0]

    unknown = make()
    found = unknown.equation_columns(servicer7, servicer7.states_of(*rest, twist[None]))[0]
    assert_derivative(found, momentum, np.zeros(unknown.count))


def test_a_gyro_alone_shows_the_angular_momentum(servicer7: MomentumKernel, exact: Samples, start: Array) -> None:
    """About the centre of mass; where poses locate the base, nothing is asked of it."""
    window = window_of(measured(servicer7, exact, np.zeros(13)), SPACING)
    alone = replace(window, noise=replace(window.noise, pose=np.full((6, 6), np.nan)))
    target = servicer7.target.parameters
    found = angular_momentum(servicer7, target, [alone, alone])
    middle = int(np.searchsorted(exact.time, 0.5 * (FIRST + LAST)))
    sample = exact[middle : middle + 1]
    placed = servicer7.kinematics.configure(sample.base_rotation, sample.joint_position)
    bodies = express(servicer7.body_parameters(target), placed.rotation, placed.position)[0].sum(axis=0)
    centre = sample.base_position[0] + bodies[1:4] / bodies[0]
    assert found == pytest.approx(start[3:] - np.cross(centre, start[:3]), rel=1e-2, abs=0.05)
    assert not angular_momentum(servicer7, target, [window]).any()
    lost = replace(alone, knots=replace(alone.knots, further=np.full_like(alone.knots.further, np.nan)))
    assert not angular_momentum(servicer7, target, [lost]).any()
    assert angular_momentum(servicer7, target, [lost, alone]) == pytest.approx(found)


def test_windows_with_a_twist_of_its_own_have_no_integral_of_one() -> None:
    nothing = IntegratedTwist.none(3, 20)
    shapes = {item.name: getattr(nothing, item.name).shape for item in fields(nothing)}
    of_each = {'integral_value': (6,), 'mean_value': (6,), 'white': (6, 6)}
    of_each |= {'integral_rows': (6, 20), 'mean_rows': (6, 20)}
    assert shapes == {name: (3, *of_each.get(name, ())) for name in shapes}
    assert not any(getattr(nothing, name).any() for name in shapes)


def test_a_marker_has_the_pose_that_is_given_and_none_without_a_position() -> None:
    """Turned by 90 degrees about z, its x axis is the base's y axis."""
    turned = 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)
    marker = some(marker_frame(MarkerConfig(position=(0.3, -0.2, 0.5), orientation=turned)))
    assert marker.position.tolist() == [0.3, -0.2, 0.5]
    assert marker.rotation @ [1.0, 0.0, 0.0] == pytest.approx(np.array([0.0, 1.0, 0.0]))
    assert marker_frame(MarkerConfig(orientation=turned)) is None
