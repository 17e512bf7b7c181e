"""The measurements of a window: its mean pose, its twist and angular velocity, with their covariances.

Arrays have a window's m intervals (or m + 1 knots) first, and the B windows of a stack second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from mbaid_ros.core.filter.knots import Midpoints, gradient
from mbaid_ros.core.filter.state import ANGULAR_FIRST, Layout, Point
from mbaid_ros.core.filter.twist_prediction import Prediction
from mbaid_ros.core.filter.window import Stack
from mbaid_ros.core.geometry import Array, Flags, cross, crossed, rotate, rotate_back, skew
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.unknowns.declaration import ImuMotion, Reading


@dataclass(frozen=True)
class Measurement(ArrayRecord):
    """What windows measure of the state x: value = rows x + noise, NaN where it is not measured."""

    value: Array  # (k,)
    rows: Array  # (k, s)
    covariance: Array  # (k, k) of the noise


def readings(
    layout: Layout,
    stack: Stack,
    predicted: Prediction,
    motion: tuple[Midpoints, slice],
    slope: Array,
    weights: Array | None = None,
) -> tuple[Array, Array]:
    """Return the derivatives of mean poses (B, 6, r) and rates (B, 6 or 9, r) by the unknowns of the readings.

    Weights (m,) of the twists are those of `twist_measurement`.
    """
    around, inside = motion
    weights = _weights(inside.stop - inside.start) if weights is None else weights
    windows, weight = predicted.twist.shape[1], weights[:, None, None]
    twist = _at_knots(predicted.twist, inside)
    change = stack.whitening
    inner = predicted.twist[inside]
    # A chain that is tau late has xi = -tau (w, v): F times that remains, and the joints' own delay.
    linear = slope[..., :3] - cross(inner[..., 3:], inner[..., :3])
    rotation, axes = _at_knots(around.base_rotation, inside), around.base_rotation[inside]
    reading = Reading(
        twist=_mean(twist, change)[..., ANGULAR_FIRST],
        slope=_total(weight * np.concatenate((slope[..., 3:], linear), axis=-1)),
        rotation=_mean(rotation, change[..., None]),
        turning=_total(weight[..., None] * (skew(inner[..., 3:]) @ axes)),
        sliding=_total(weight[..., None] * (skew(inner[..., :3]) @ axes)),
        time=stack.middles,
        position=_mean(_at_knots(around.base_position, inside), change),
        axes=_total(weight[..., None] * axes),
        origin=stack.windows[0].origin,
    )
    gyro = around.gyro.shape[-1] > 0
    if gyro:
        reading = replace(reading, imu=_turning_imu(motion, inner, reading, slope, stack.windows[0].spacing))
    poses: list[Array] = [np.zeros((windows, 6, 0))]
    rates: list[Array] = [np.zeros((windows, 9 if gyro else 6, 0))]
    for unknown in layout.read:
        nothing = np.zeros((windows, 6, len(unknown.factor)))
        pose, turned = unknown.reading(reading) or (nothing, nothing)
        if gyro:
            of_gyro = unknown.gyro_reading(reading)
            turned = np.concatenate((turned, nothing[:, :3] if of_gyro is None else of_gyro), axis=1)
        poses.append(pose @ unknown.factor)
        rates.append(turned @ unknown.factor)
    return np.concatenate(poses, axis=-1), np.concatenate(rates, axis=-1)


def _turning_imu(
    motion: tuple[Midpoints, slice], twist: Array, reading: Reading, slope: Array, spacing: float
) -> ImuMotion:
    """Return the turn of a stack's IMU, for the base's predicted twist (m, B, 6) and its slope."""
    around, inside = motion
    weight = _weights(inside.stop - inside.start)[:, None, None]
    relative = around.imu_rate
    rate, axes = twist[..., 3:] + relative[inside], around.imu_axes[inside]
    changing = slope[..., 3:] + gradient(relative)[inside] / spacing
    within = rotate_back(axes, rate)
    return ImuMotion(
        rate=reading.twist[..., :3] + _total(weight * relative[inside]),
        slope=_total(weight * changing),
        axes=_total(weight[..., None] * axes),
        stretching=_total(weight[..., None] * axes * within[..., None, :]),
        turning=_total(weight[..., None] * (skew(rate) @ axes)),
        crossing=_total(weight[..., None] * (axes @ crossed(within))),
    )


def state_rows(errors: Array, readings: Array) -> Array:
    """Return rows (..., r, s) of the state: a composition (..., r, p + 1) without its constant, and the readings."""
    return np.concatenate((errors[..., :-1], readings), axis=-1)


def _at_knots(values: Array, inside: slice) -> Array:
    """Return values midway between knots at the knots of the intervals inside; at an open end the value midway."""
    around = np.concatenate(
        (values[max(inside.start - 1, 0) : inside.start or 1], values[inside.start : inside.stop + 1])
    )
    around = around if len(values) > inside.stop else np.concatenate((around, values[-1:]))
    return 0.5 * (around[:-1] + around[1:])


def _mean(knots: Array, change: Array) -> Array:
    """Return the mean of values (m + 1, B, ...) at a window's knots and the next, with some of their change."""
    mean = _total(knots[:-1]) / (len(knots) - 1)
    return mean + change * (knots[-1] - knots[0]) if change.any() else mean


def pose_measurement(errors: Array, change: Array, readings: Array, point: Array) -> tuple[Array, Array]:
    """0 = mean of xi over the knots + readings + noise (trajectory.md, eq. 3), linearised at (r,).

    A share `change` of the change of xi whitens correlated errors. The twist in the readings is that at the knots
    themselves: half an interval later its noise, the joints' as that of xi, would look like a delay by that half.
    """
    mean = _mean(errors, change[..., None])
    return readings @ point - mean[..., -1], state_rows(mean, readings)


def twist_measurement(
    errors: Array,
    prediction: Prediction,
    middle: Midpoints,
    point: Point,
    readings: Array,
    weights: Array | None = None,
) -> tuple[Array, Array]:
    """V_measured - V_predicted = F xi + G (parameters - linearisation) + readings + noise, weighted.

    A gyro's angular velocity is turned by the measured pose, as the twist is; on a link, less the turn by the joints.
    Weights (m,) are a parabola's, where none are given.
    """
    weight = (_weights(len(middle)) if weights is None else weights)[:, None, None]
    gain = prediction.by_parameters[..., ANGULAR_FIRST, :]
    model: Array = prediction.by_pose_error[..., ANGULAR_FIRST, :] @ (0.5 * (errors[1:] + errors[:-1]))
    model[..., 6:-1] += gain
    model[..., -1] += prediction.twist[..., ANGULAR_FIRST] - gain @ point.parameters
    mean = _total(weight[..., None] * model)
    measured = _total(weight * middle.base_twist[..., ANGULAR_FIRST])
    if middle.gyro.shape[-1]:
        mean = np.concatenate((mean, mean[:, :3]), axis=1)
        turned = _total(weight * (rotate(middle.imu_axes, middle.gyro) - middle.imu_rate))
        measured = np.concatenate((measured, turned), axis=1)
    return measured - mean[..., -1] + readings @ point.readings, state_rows(mean, readings)


@dataclass(frozen=True)
class IntegratedTwist(ArrayRecord):
    """Integral of a window's twist from its first knot on; of several windows with these along a first axis."""

    replaces_twist: Flags  # () whether it takes the place of the twist; all else is zero where not
    # first two: (6,), (6, s): value - rows x = c - c' + noise, to the next window's first knot, with its c'
    integral_value: Array
    integral_rows: Array
    # mean_value, mean_rows: (6,), (6, s): value - rows x = c - joint noise in the mean pose + noise, mean over the
    # knots
    mean_value: Array
    mean_rows: Array
    white: Array  # (6, 6) covariance of the noise in the way
    # share, left: () share of that noise in the mean, and variance of the rest of the mean's noise, over `white`
    share: Array
    left: Array
    change: Array  # () as `Stack.whitening`

    @staticmethod
    def none(count: int, size: int) -> IntegratedTwist:
        """Return those of windows, a count, whose twist is measured by itself; for a state of this size."""
        value, rows, nothing = np.zeros((count, 6)), np.zeros((count, 6, size)), np.zeros(count)
        counts = np.zeros(count, dtype=bool)
        return IntegratedTwist(counts, value, rows, value, rows, rows[..., :6], nothing, nothing, nothing)


def integral_weights(count: int) -> tuple[Array, Array]:
    """Return the weights (m,) of a window's twists in its integral, and in the mean of the integrals to its knots."""
    remaining = count - 1.0 - np.arange(count)
    return np.full(count, 1.0 / count), remaining / np.sum(remaining)


def integrated_twist(
    stack: Stack,
    prediction: Prediction,
    middle: Midpoints,
    errors: Array,
    point: Point,
    *,
    by_readings: Sequence[Array],
    stored: Array,
) -> IntegratedTwist:
    """Return the integrated twist of a stack's windows; other arguments as of `twist_measurement`.

    Parameters
    ----------
    by_readings : rates by the unknowns of the readings, as of `readings`, with each of `integral_weights`
    stored : (B, 6, c) noise in the twist by stored momentum
    """
    count, spacing = len(middle), stack.windows[0].spacing
    share, of_mean = 0.5 * (count - 1.0) / count, integral_weights(count)[1]
    parts: list[tuple[Array, Array]] = []
    sizes = count * spacing, share * count * spacing
    for weights, rates, size in zip(integral_weights(count), by_readings, sizes, strict=True):
        value, rows = twist_measurement(errors, prediction, middle, point, rates, weights)
        parts.append((size * value, size * rows))
    way, mean = parts
    white = (count * spacing) ** 2 / stack.samples * _white(stack, middle.base_rotation[count // 2], stored)
    nothing = np.ones(len(stack.windows))
    left = count * np.sum((share * of_mean) ** 2) - share**2
    return IntegratedTwist(nothing > 0.0, *way, *mean, white, share * nothing, left * nothing, stack.whitening[:, 0])


def _white(stack: Stack, rotation: Array, stored: Array) -> Array:
    """Return the (B, 6, 6) covariance of the white noise of one twist, and of the readings of stored momentum."""
    axes = np.zeros((len(rotation), 6, 6))
    axes[..., :3, :3] = axes[..., 3:, 3:] = rotation
    return np.asarray(axes @ stack.twist_covariance @ np.swapaxes(axes, -1, -2) + stored @ np.swapaxes(stored, -1, -2))


def twist_covariance(
    stack: Stack, middle: Midpoints, joints: tuple[Array, Array], stored: Array, of_gyro: Array | None = None
) -> Array:
    """Return the (B, 6, 6) covariance: white noise of the twist and of stored momentum, and the joints', telescoped.

    `joints` are its factors in the mean pose, (B, 6, n), and (B, 3, n) that a gyro on a link has beside; `stored`
    (B, 6, c). With a gyro (B, 9, 9): that has noise of its own, `of_gyro` (B, 3, 3), and the latter two in common with
    the twist.
    """
    count, weight = len(middle), _weights(len(middle))
    by_joints, in_gyro = joints
    of_joints = by_joints @ np.swapaxes(by_joints, -1, -2)
    axes = np.zeros_like(of_joints)
    axes[..., :3, :3] = axes[..., 3:, 3:] = middle.base_rotation[count // 2]
    white = count * np.sum(weight**2) / stack.samples
    growth = telescoped(count, stack.windows[0].spacing)
    of_mean = growth * of_joints
    covariance = white * (axes @ stack.twist_covariance @ np.swapaxes(axes, -1, -2)) + of_mean
    common = of_mean
    if stored.shape[-1]:
        by_readings = white * (stored @ np.swapaxes(stored, -1, -2))
        covariance, common = covariance + by_readings, common + by_readings
    if of_gyro is None:
        return covariance
    cross_covariance, of_rate = common[:, :, :3], common[:, :3, :3] + of_gyro
    if in_gyro.any():
        more = growth * by_joints @ np.swapaxes(in_gyro, -1, -2)
        cross_covariance = cross_covariance + more
        of_rate = of_rate + more[:, :3] + np.swapaxes(more[:, :3], 1, 2)
        of_rate = of_rate + growth * in_gyro @ np.swapaxes(in_gyro, -1, -2)
    joined = np.zeros((len(common), 9, 9))
    joined[:, :6, :6], joined[:, 6:, 6:] = covariance, of_rate
    joined[:, :6, 6:], joined[:, 6:, :6] = cross_covariance, np.swapaxes(cross_covariance, 1, 2)
    return joined


@cache
def telescoped(count: int, spacing: float) -> float:
    """Return the variance of joint noise in a window's twist over that in its mean pose, 1/s^2."""
    return float(count * np.sum(np.diff(np.pad(_weights(count), 1)) ** 2) / spacing**2)


def gyro_covariance(stack: Stack, count: int) -> Array:
    """Return the (B, 3, 3) covariance of windows' weighted angular velocity by the gyro's own noise; of m intervals."""
    return np.asarray(_preintegrated(count, stack.windows[0].spacing) * stack.gyro_variance * np.eye(3))


@cache
def _preintegrated(count: int, spacing: float) -> float:
    """Return the variance of a window's weighted angular velocity by white noise of unit density, 1/s.

    The integral at a knot is a mean over the knot's time, and a rate a difference of two, sharpened by the neighbours':
    the weights of the gyro's readings are the convolution of these.
    """
    fine = 20  # pieces of a knot
    between = np.zeros(count + 4)  # of the steps from knot to knot, those of two neighbours on either side among them
    between[2:-2] = _weights(count) / spacing
    between[1:-1] -= np.diff(between, 2) / 24.0
    steps = np.repeat(np.diff(np.pad(between, 1)), fine)  # of the knots' means
    readings = np.cumsum(-steps) / fine
    return float(np.sum(readings**2) * spacing / fine)


def _total(values: Array) -> Array:
    """Return the sum along the intervals in order: numpy chooses another order for other memory layouts."""
    return np.asarray(np.add.reduce(np.ascontiguousarray(values), axis=0))


@cache
def _weights(count: int) -> Array:
    """Return the (m,) weights of a window's twists: a parabola that vanishes at its ends."""
    place = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    parabola = 1.0 - place**2
    return np.asarray(parabola / np.sum(parabola))
