"""The error chain of a window, linear in the state at its first knot (trajectory.md, eq. 2).

The error xi = (theta, rho) is that of the measured pose: R_true = Exp(theta) R, p_true = p + rho. From knot to knot it
changes by the predicted motion less the measured one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.filter.joint_noise import JointNoise, joint_noise
from mbaid_ros.core.filter.knots import Midpoints, gradient
from mbaid_ros.core.filter.measured_window import (
    IntegratedTwist,
    Measurement,
    gyro_covariance,
    integral_weights,
    integrated_twist,
    pose_measurement,
    readings,
    state_rows,
    telescoped,
    twist_covariance,
    twist_measurement,
)
from mbaid_ros.core.filter.state import ANGULAR_FIRST, Layout, Point
from mbaid_ros.core.filter.swing import BESIDE, Motions, SwingCourse
from mbaid_ros.core.filter.twist_prediction import Bodies, Prediction, by_deflections, predict
from mbaid_ros.core.filter.window import Stack
from mbaid_ros.core.geometry import Array, cross, exp
from mbaid_ros.core.linear_algebra import composed
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.samples import ArrayRecord

_IDENTITY = np.eye(6)


@dataclass(frozen=True)
class WindowModel(ArrayRecord):
    """Windows, linear in the state x at their first knots: measurements, and the transition to the next window.

    All arrays have a first axis of the windows, which the shapes below leave out.
    """

    pose: Measurement  # (6,), mean over the knots
    twist: Measurement  # (6,); with an IMU its angular velocity after it, (9,)
    # transition, drift: (6, s), (6,): pose error at the next window's first knot = transition x + drift
    transition: Array
    drift: Array
    noise: JointNoise  # of the joints; the part in the pose as it is measured
    joints_of_gyro: Array  # (3, n) that a gyro on a link has beside it
    joints_in_twist: Array  # () its variance in the twist over that in the pose
    length: Array  # () s
    # rotation, position: (3, 3), (3,) m, of the base at the window's end
    rotation: Array
    position: Array
    centre: Array  # (3,) m, the common centre of mass there
    momentum_change: Array  # (6, s) change of (P, L) until the next window by the unknowns
    body: Array  # (10,) standard parameters of the target at the linearisation point
    integrated: IntegratedTwist  # it takes the place of the twist where it counts


def window_models(
    layout: Layout, stacks: Sequence[Stack], point: Point, course: SwingCourse | None = None
) -> WindowModel:
    """Return windows linearised at one point, in their order before they were stacked.

    Below, arrays have a window's m intervals (or m + 1 knots) first, and the B windows of a stack second.

    Parameters
    ----------
    layout, stacks : of the state; of windows of one shape each
    point : windows of one chain share its readings, which correct the motion
    course : of passive joints in the windows before; None where there are none of either
    """
    swinging = point.side.kernel.springs.count > 0
    motions: Motions = [stack.motion(point.side, layout.imu, BESIDE if swinging else 1) for stack in stacks]
    swing: Array | None = None
    if swinging:
        course = course or SwingCourse(layout, predict)
        motions, prediction, bodies, swing = course.predict(stacks, motions, point)
    else:
        prediction, bodies = predict(layout, Midpoints.concatenate([motion.flat for motion, _ in motions]), point)
    for unknown, place in layout.of_joints:
        every = Midpoints.concatenate([motion.flat for motion, _ in motions])
        prediction.by_parameters[..., place] += by_deflections(unknown, point.side.kernel, every, bodies)
    predictions = prediction.divided([motion.turn.shape[:2] for motion, _ in motions])
    noises = joint_noise(
        layout, point.side.kernel, stacks, [inside for _, inside in motions], predictions, bodies, swing=swing
    )
    models, begin = [], 0
    for stack, motion, prediction, noise in zip(stacks, motions, predictions, noises, strict=True):
        around, inside = motion
        rows, windows = around.turn.shape[:2]
        last = begin + (inside.stop - 1) * windows + np.arange(windows)
        begin += rows * windows
        impulses = _momentum_change(layout, stack, bodies[last], around.base_position[inside.stop - 1])
        models.append(_models(layout, stack, motion, prediction, point, (noise, impulses)))
    if len(stacks) == 1:
        return models[0]
    return WindowModel.concatenate(models)[np.argsort(np.concatenate([stack.places for stack in stacks]))]


def _models(
    layout: Layout,
    stack: Stack,
    motion: tuple[Midpoints, slice],
    predicted: Prediction,
    point: Point,
    effects: tuple[JointNoise, tuple[Array, Array]],
) -> WindowModel:
    """Return a stack's windows from its motion, the prediction, the joints' noise and the impulses."""
    noise, (impulses, centre) = effects
    around, inside = motion
    parameters, spacing = point.parameters, stack.windows[0].spacing
    around_slope = gradient(predicted.twist) / spacing
    integral = _integral(predicted.twist, around_slope, spacing)[inside]
    middle, prediction, slope = around[inside], predicted[inside], around_slope[inside]
    errors = composed(*_chain_steps(prediction, integral, middle, spacing))
    # Absolute parameters instead of deviations from the point: their part moves to the constant.
    errors[..., -1] -= errors[..., 6:-1] @ parameters
    of_joints = noise.pose @ np.swapaxes(noise.pose, -1, -2)
    change = stack.whitening
    # The integrated twist has no Gauss-Markov joint errors.
    integrated = stack.integrates_twist & (layout.time_constants.size == 0)
    # The change of the pose has the joints' errors of two knots, independent of the others.
    ends = np.where(integrated[:, None], 1.0, 1.0 - 2.0 * change + 2.0 * len(middle) * change**2)[..., None]
    in_gyro = np.zeros((len(of_joints), 3, noise.pose.shape[-1]))
    if middle.gyro_gain.shape[-1]:
        in_gyro = np.sqrt(stack.joint_variance / stack.samples) * middle.gyro_gain[len(middle) // 2]
    pose, twist = readings(layout, stack, predicted, motion, slope)
    whole = IntegratedTwist.none(len(stack.windows), layout.size)
    if integrated.any():
        each = integral_weights(len(middle))
        rates = [readings(layout, stack, predicted, motion, slope, weights)[1] for weights in each]
        whole = integrated_twist(stack, prediction, middle, errors, point, by_readings=rates, stored=noise.stored)
        whole = replace(whole, replaces_twist=integrated)
    of_gyro = gyro_covariance(stack, len(middle)) if middle.gyro.shape[-1] else None
    return WindowModel(
        Measurement(
            *pose_measurement(errors, change, pose, point.readings),
            stack.pose_covariance / stack.samples + ends * of_joints,
        ),
        Measurement(
            *twist_measurement(errors, prediction, middle, point, twist),
            twist_covariance(stack, middle, (noise.pose, in_gyro), noise.stored, of_gyro),
        ),
        transition=state_rows(errors[-1], np.zeros_like(pose)),
        drift=errors[-1][..., -1],
        noise=replace(noise, pose=np.sqrt(ends) * noise.pose, by_unknowns=np.sqrt(ends)[..., None] * noise.by_unknowns),
        joints_of_gyro=np.sqrt(ends) * in_gyro,
        joints_in_twist=telescoped(len(middle), spacing) / ends[:, 0, 0],
        length=np.full(len(stack.windows), len(middle) * spacing),
        rotation=exp(0.5 * middle.turn[-1]) @ middle.base_rotation[-1],
        position=middle.base_position[-1] + 0.5 * middle.step[-1],
        centre=centre,
        momentum_change=impulses,
        body=np.tile(point.body, (len(stack.windows), 1)),
        integrated=whole,
    )


def _momentum_change(layout: Layout, stack: Stack, bodies: Bodies, position: Array) -> tuple[Array, Array]:
    """Return the (B, 6, s) change of the momentum until the next window by the unknowns, and the centre of mass, m.

    Parameters
    ----------
    layout, stack : of the state, of B windows
    bodies, position : near the end of each; (B, 3) m, of the base then
    """
    impulses = np.zeros((len(position), 6, layout.size))
    placed, length = bodies.states.configuration, stack.windows[0].length
    system = np.sum(express(bodies.parameters, placed.rotation, position[:, None] + placed.position), axis=1)
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if unknown.changes_momentum:
            ends = stack.middles + 0.5 * length
            rates = unknown.momentum_rates(system, stack.windows[0].origin, ends, placed.rotation[:, 0])
            impulses[..., place] = length * rates @ unknown.factor
    return impulses, system[:, 1:4] / system[:, :1]


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
    # xi acts at mid-interval, the mean of both ends: (1 - D F~ / 2) xi' = (1 + D F~ / 2) xi + gain
    back = np.linalg.inv(_IDENTITY - 0.5 * spacing * prediction.error_slope)
    return 2.0 * back - _IDENTITY, back @ gain
