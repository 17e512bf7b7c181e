"""Windows of the error chain: how the true pose drifts from the measured one, and what a window measures of it.

The error xi = (theta, rho) is that of the measured pose: R_true = Exp(theta) R, p_true = p + rho. From knot to knot it
changes by the predicted motion less the measured one. A window's pose measurement says that xi vanishes on average; its
twist measurement compares predicted and measured velocities. Both are linear in the state at the window's first knot.

The state is that of `state`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from mbaid_ros.core.geometry import Array, cross, exp, rotate, rotate_back, skew
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.trajectory.interpolation import Midpoints, gradient
from mbaid_ros.core.trajectory.joint_loads import by_deflections
from mbaid_ros.core.trajectory.joint_noise import JointNoise, joint_noise
from mbaid_ros.core.trajectory.knots import Integers
from mbaid_ros.core.trajectory.prediction import ANGULAR_FIRST, Bodies, Prediction, predict
from mbaid_ros.core.trajectory.state import Layout, Point
from mbaid_ros.core.trajectory.windows import Stack
from mbaid_ros.core.unknowns.declaration import Reading

_IDENTITY = np.eye(6)


@dataclass(frozen=True)
class WindowModel:
    """A window, linear in the state x at its first knot: measurements, and the way to the next window.

    Models of several windows share one, with the windows along a first axis that the shapes below leave out.

    Attributes
    ----------
    pose_value, pose_rows, pose_covariance : (6,), (6, s), (6, 6): value = rows x + noise, x the s numbers of the state
    twist_value, twist_rows, twist_covariance : the same of the twist, and where there is an IMU of its angular velocity
        after it, (9,), (9, s), (9, 9); NaN value of what is not measured
    transition, drift : (6, s), (6,): pose error at the next window's first knot = transition x + drift
    process : (6, n) factor of the covariance of the joint noise that accumulates on the way
    joints, joints_by_unknowns : (6, n), (6, 10 + e, n) the part of the pose's noise that the joints' makes
        (`JointNoise`)
    joints_in_twist : () how many times as large as in the pose that is in the twist, as a variance
    length : () s
    rotation, position : (3, 3), (3,) m, of the base at the window's end
    brought : (6, s) what the unknowns make of (P, L) on the way to the next window
    """

    pose_value: Array
    pose_rows: Array
    pose_covariance: Array
    twist_value: Array
    twist_rows: Array
    twist_covariance: Array
    transition: Array
    drift: Array
    process: Array
    joints: Array
    joints_by_unknowns: Array
    joints_in_twist: Array
    length: Array
    rotation: Array
    position: Array
    brought: Array

    def __getitem__(self, index: int | Integers) -> WindowModel:
        """Return the model of one of several windows, or of some."""
        return WindowModel(*(part[index] for part in vars(self).values()))

    @staticmethod
    def concatenate(parts: Sequence[WindowModel]) -> WindowModel:
        """Return the models of several windows, joined in order."""
        return WindowModel(*map(np.concatenate, zip(*(vars(part).values() for part in parts), strict=True)))


def window_models(layout: Layout, stacks: Sequence[Stack], point: Point) -> WindowModel:
    """Return the models of windows, linearised at the same point, in their order before they were stacked.

    Below, arrays have a window's m intervals (or m + 1 knots) first, and the B windows of a stack second.

    Parameters
    ----------
    layout : of the state
    stacks : of windows of one shape each; their motion is predicted in one call
    point : windows that follow each other share its readings: the chain is that of the motion as they correct it
    """
    motions = [stack.motion(point.side) for stack in stacks]
    flat = Midpoints.concatenate([motion.flat for motion, _ in motions])
    whole, bodies = predict(layout, flat, point)
    for unknown, place in layout.of_joints:
        spacings = [stack.windows[0].spacing for stack in stacks]
        each = [motion for motion, _ in motions]
        whole.by_parameters[..., place] += by_deflections(unknown, point.side.kernel, each, spacings, bodies)
    predictions = whole.divided([motion.turn.shape[:2] for motion, _ in motions])
    noises = joint_noise(layout, point.side.kernel, stacks, [inside for _, inside in motions], predictions, bodies)
    models, begin = [], 0
    for stack, motion, prediction, noise in zip(stacks, motions, predictions, noises, strict=True):
        around, inside = motion
        rows, windows = around.turn.shape[:2]
        last = begin + (inside.stop - 1) * windows + np.arange(windows)
        begin += rows * windows
        brought = _brought(layout, stack, bodies[last], around.base_position[inside.stop - 1])
        models.append(_models(layout, stack, motion, prediction, point, (noise, brought)))
    if len(stacks) == 1:
        return models[0]
    return WindowModel.concatenate(models)[np.argsort(np.concatenate([stack.places for stack in stacks]))]


def _models(
    layout: Layout,
    stack: Stack,
    motion: tuple[Midpoints, slice],
    predicted: Prediction,
    point: Point,
    effects: tuple[JointNoise, Array],
) -> WindowModel:
    """Return a stack's models from its motion, the prediction, what the joints' noise does and what is brought."""
    noise, brought = effects
    around, inside = motion
    parameters, spacing = point.parameters, stack.windows[0].spacing
    around_slope = gradient(predicted.twist) / spacing
    integral = _integral(predicted.twist, around_slope, spacing)[inside]
    middle, prediction, slope = around[inside], predicted[inside], around_slope[inside]
    errors = _compose(*_chain_steps(prediction, integral, middle, spacing))
    # Absolute parameters: what the chain has as deviations from `parameters` moves to its constant part.
    errors[..., -1] -= errors[..., 6:-1] @ parameters
    of_joints = noise.pose @ np.swapaxes(noise.pose, -1, -2)
    change = stack.whitening
    # The joints' errors, independent from knot to knot, are in the change by those of two knots.
    ends = (1.0 - 2.0 * change + 2.0 * len(middle) * change**2)[..., None]
    pose, twist = _readings(layout, stack, predicted, motion, slope)
    return WindowModel(
        *_pose_measurement(errors, change, pose, point.readings),
        stack.pose_covariance / stack.samples + ends * of_joints,
        *_twist_measurement(errors, prediction, middle, point, twist),
        _twist_covariance(stack, middle, of_joints, noise.stored),
        transition=_state_rows(errors[-1], np.zeros_like(pose)),
        drift=errors[-1][..., -1],
        process=noise.process,
        joints=np.sqrt(ends) * noise.pose,
        joints_by_unknowns=np.sqrt(ends)[..., None] * noise.by_unknowns,
        joints_in_twist=_telescoped(len(middle), spacing) / ends[:, 0, 0],
        length=np.full(len(stack.windows), len(middle) * spacing),
        rotation=exp(0.5 * middle.turn[-1]) @ middle.base_rotation[-1],
        position=middle.base_position[-1] + 0.5 * middle.step[-1],
        brought=brought,
    )


def _brought(layout: Layout, stack: Stack, bodies: Bodies, position: Array) -> Array:
    """Return what the unknowns make of the momentum from a stack's windows to the next, (B, 6, s).

    Parameters
    ----------
    layout, stack : of the state, of B windows
    bodies : near the end of each
    position : (B, 3) m, of the base then
    """
    brought = np.zeros((len(position), 6, layout.size))
    pushing = [pair for pair in zip(layout.unknowns, layout.places, strict=True) if pair[0].pushes]
    if pushing:
        placed = bodies.configuration
        whole = np.sum(express(bodies.parameters, placed.rotation, position[:, None] + placed.position), axis=1)
        length = stack.windows[0].length
        for unknown, place in pushing:
            rates = unknown.momentum_rates(whole, stack.windows[0].origin, stack.middles + 0.5 * length)
            brought[..., place] = length * rates @ unknown.factor
    return brought


def _readings(
    layout: Layout, stack: Stack, predicted: Prediction, motion: tuple[Midpoints, slice], slope: Array
) -> tuple[Array, Array]:
    """Return how a stack's mean poses (B, 6, r) and rates (B, 6 or 9, r) depend on the unknowns that are only read."""
    around, inside = motion
    windows, weight = predicted.twist.shape[1], _weights(inside.stop - inside.start)[:, None, None]
    twist = _at_knots(predicted.twist, inside)
    change = stack.whitening
    own = predicted.twist[inside]
    # A chain that is tau late has xi = -tau (w, v) in it: what F makes of that and of the joints' own delay is left.
    linear = slope[..., :3] - cross(own[..., 3:], own[..., :3])
    rotation, axes = _at_knots(around.base_rotation, inside), around.base_rotation[inside]
    seen = Reading(
        twist=_mean(twist, change)[..., ANGULAR_FIRST],
        slope=_total(weight * np.concatenate((slope[..., 3:], linear), axis=-1)),
        rotation=_mean(rotation, change[..., None]),
        turning=_total(weight[..., None] * (skew(own[..., 3:]) @ axes)),
        sliding=_total(weight[..., None] * (skew(own[..., :3]) @ axes)),
        time=stack.middles,
        position=_mean(_at_knots(around.base_position, inside), change),
        axes=_total(weight[..., None] * axes),
        origin=stack.windows[0].origin,
    )
    gyro = around.gyro.shape[-1] > 0
    if gyro:
        stretching = axes * rotate_back(axes, own[..., 3:])[..., None, :]
        seen = replace(seen, stretching=_total(weight[..., None] * stretching))
    poses: list[Array] = [np.zeros((windows, 6, 0))]
    rates: list[Array] = [np.zeros((windows, 9 if gyro else 6, 0))]
    for unknown in layout.read:
        nothing = np.zeros((windows, 6, len(unknown.factor)))
        pose, turned = unknown.reading(seen) or (nothing, nothing)
        if gyro:
            own_part = unknown.gyro_reading(seen)
            turned = np.concatenate((turned, nothing[:, :3] if own_part is None else own_part), axis=1)
        poses.append(pose @ unknown.factor)
        rates.append(turned @ unknown.factor)
    return np.concatenate(poses, axis=-1), np.concatenate(rates, axis=-1)


def _integral(twist: Array, slope: Array, spacing: float) -> Array:
    """Return the (m, B, 6) integrals of (v, w) over each interval, fourth order, the rotation's commutator included."""
    change = twist[1:] - twist[:-1]
    bend = np.zeros_like(twist)
    bend[1:-1] = change[1:] - change[:-1]
    bend[0], bend[-1] = bend[1], bend[-2]
    integral = spacing * (twist + bend / 24.0)
    integral[..., 3:] += spacing**3 / 12.0 * cross(slope[..., 3:], twist[..., 3:])
    return integral


def _chain_steps(prediction: Prediction, integral: Array, middle: Midpoints, spacing: float) -> tuple[Array, Array]:
    """Return, for each interval, the (6, 6) transition of xi and the (6, u + 1) gain of parameters and of 1."""
    gain = np.empty((*middle.turn.shape[:-1], 6, prediction.by_parameters.shape[-1] + 1))
    gain[..., :-1] = spacing * prediction.by_parameters[..., ANGULAR_FIRST, :]
    gain[..., :3, -1] = integral[..., 3:] - middle.turn
    gain[..., 3:, -1] = integral[..., :3] - middle.step
    # xi acts at mid-interval, the mean of both ends: (1 - D F / 2) xi' = (1 + D F / 2) xi + gain
    back = np.linalg.inv(_IDENTITY - 0.5 * spacing * prediction.error_slope)
    return 2.0 * back - _IDENTITY, back @ gain


def _compose(transition: Array, gain: Array) -> Array:
    """Return xi at every knot, (m + 1, B, 6, 6 + u + 1): linear in (xi at the first knot, parameters, 1)."""
    count, windows = transition.shape[:2]
    errors = np.zeros((count + 1, windows, 6, 6 + gain.shape[-1]))
    errors[0, ..., :6] = np.eye(6)
    for index in range(count):
        np.matmul(transition[index], errors[index], out=errors[index + 1])
        errors[index + 1, ..., 6:] += gain[index]
    return errors


def _state_rows(errors: Array, readings: Array) -> Array:
    """Return the rows of the state of a composition: the column of the constant goes, the readings come."""
    return np.concatenate((errors[..., :-1], readings), axis=-1)


def _at_knots(values: Array, inside: slice) -> Array:
    """Return what is known midway, at the knots of the intervals inside; without one before or after, that midway."""
    around = np.concatenate(
        (values[max(inside.start - 1, 0) : inside.start or 1], values[inside.start : inside.stop + 1])
    )
    around = around if len(values) > inside.stop else np.concatenate((around, values[-1:]))
    return 0.5 * (around[:-1] + around[1:])


def _mean(knots: Array, change: Array) -> Array:
    """Return the mean of values (m + 1, B, ...) at a window's knots and the next, with some of their change."""
    mean = _total(knots[:-1]) / (len(knots) - 1)
    return mean + change * (knots[-1] - knots[0]) if change.any() else mean


def _pose_measurement(errors: Array, change: Array, readings: Array, point: Array) -> tuple[Array, Array]:
    """0 = mean of xi over the knots + what the readings depend on + noise (trajectory.md, eq. 3), linearised at (r,).

    With some of what xi changes by, where its errors are correlated: the noise is then independent of other windows'.

    The twist in the readings is that at the knots themselves. Its noise is the joints', as that of xi is, and cancels
    in the product of both where it comes alike from before and after; half an interval later it would tell of a delay
    by that half.
    """
    mean = _mean(errors, change[..., None])
    return readings @ point - mean[..., -1], _state_rows(mean, readings)


def _twist_measurement(
    errors: Array, prediction: Prediction, middle: Midpoints, point: Point, readings: Array
) -> tuple[Array, Array]:
    """V_measured - V_predicted = F xi + G (parameters - linearisation) + readings + noise, weighted.

    What a gyro measures in base axes is turned by the measured pose, as the twist is.
    """
    weight = _weights(len(middle))[:, None, None]
    gain = prediction.by_parameters[..., ANGULAR_FIRST, :]
    model: Array = prediction.by_pose_error[..., ANGULAR_FIRST, :] @ (0.5 * (errors[1:] + errors[:-1]))
    model[..., 6:-1] += gain
    model[..., -1] += prediction.twist[..., ANGULAR_FIRST] - gain @ point.parameters
    mean = _total(weight[..., None] * model)
    measured = _total(weight * middle.base_twist[..., ANGULAR_FIRST])
    if middle.gyro.shape[-1]:
        mean = np.concatenate((mean, mean[:, :3]), axis=1)
        turned = _total(weight * rotate(middle.base_rotation, middle.gyro))
        measured = np.concatenate((measured, turned), axis=1)
    return measured - mean[..., -1] + readings @ point.readings, _state_rows(mean, readings)


def _twist_covariance(stack: Stack, middle: Midpoints, of_joints: Array, stored: Array) -> Array:
    """Return the (B, 6, 6) covariance: white noise of the twist, and `of_joints` (of a mean), which telescopes.

    That of what is read of stored momentum, with a factor (B, 6, c), is white in the predicted twist. A gyro's angular
    velocity, (B, 9, 9) then, has noise of its own and the other two in common with the twist.
    """
    count, weight = len(middle), _weights(len(middle))
    axes = np.zeros_like(of_joints)
    axes[..., :3, :3] = axes[..., 3:, 3:] = middle.base_rotation[count // 2]
    white = count * np.sum(weight**2) / stack.samples
    telescoped = _telescoped(count, stack.windows[0].spacing)
    covariance = white * (axes @ stack.twist_covariance @ np.swapaxes(axes, -1, -2)) + telescoped * of_joints
    common = telescoped * of_joints
    if stored.shape[-1]:
        by_readings = white * (stored @ np.swapaxes(stored, -1, -2))
        covariance, common = covariance + by_readings, common + by_readings
    if not middle.gyro.shape[-1]:
        return covariance
    whole = np.zeros((len(common), 9, 9))
    whole[:, :6, :6], whole[:, :6, 6:], whole[:, 6:, :6] = covariance, common[:, :, :3], common[:, :3]
    of_gyro = _preintegrated(count, stack.windows[0].spacing) * stack.gyro_variance * np.eye(3)
    whole[:, 6:, 6:] = common[:, :3, :3] + of_gyro
    return whole


@cache
def _telescoped(count: int, spacing: float) -> float:
    """Return how many times as large joint noise is in a window's twist as in its mean pose, as a variance."""
    return float(count * np.sum(np.diff(np.pad(_weights(count), 1)) ** 2) / spacing**2)


@cache
def _preintegrated(count: int, spacing: float) -> float:
    """Return the variance of a window's weighted angular velocity by white noise of unit density, 1/s.

    The integral at a knot is a mean over the knot's time, so that the rate from one knot to the next is one over two of
    them, sharpened by the neighbours': the weights of the gyro's readings are a convolution of all that.
    """
    fine = 20  # pieces of a knot
    between = np.zeros(count + 4)  # of the steps from knot to knot, those of two neighbours on either side among them
    between[2:-2] = _weights(count) / spacing
    between[1:-1] -= np.diff(between, 2) / 24.0
    steps = np.repeat(np.diff(np.pad(between, 1)), fine)  # of the knots' means
    readings = np.cumsum(-steps) / fine
    return float(np.sum(readings**2) * spacing / fine)


def _total(values: Array) -> Array:
    """Return the sum along the intervals, one after the other: numpy chooses another order for other layouts."""
    return np.asarray(np.add.reduce(np.ascontiguousarray(values), axis=0))


@cache
def _weights(count: int) -> Array:
    """Return the (m,) weights of a window's twists: a parabola that vanishes at its ends."""
    place = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    parabola = 1.0 - place**2
    return np.asarray(parabola / np.sum(parabola))
