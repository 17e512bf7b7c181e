"""The noise of the joint encoders in a window, and the errors-in-variables bias that it makes.

An error dq of the joints moves the predicted pose by A dq, A = dV/dq', at that instant only: mostly measurement noise.
As A depends on the bodies, the same dq is in the rows, by dA/dphi dq: least squares prefers bodies of small A.

Integrated over windows (`IntegratedTwist`), dq in the predicted twist telescopes (trajectory.md, eqs. 9 and 10):
neighbours share only its effect c on the pose at the border, which is carried from window to window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag
from scipy.linalg.lapack import dtrtrs

from mbaid_ros.core.filter.measured_window import IntegratedTwist, Measurement
from mbaid_ros.core.filter.state import ANGULAR_FIRST, BODY, LINEAR, Layout
from mbaid_ros.core.filter.twist_prediction import Bodies, Prediction, gains_by_unknowns, joint_gains
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.window import Stack
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.passive import passive_momenta, spring_constants
from mbaid_ros.core.robot.sensitivity import sensitivity_to_joints
from mbaid_ros.core.samples import ArrayRecord


@dataclass(frozen=True)
class JointNoise(ArrayRecord):
    """The joints' noise in B windows, (angular, linear)."""

    pose: Array  # (B, 6, n) factor of the covariance of the mean pose
    by_unknowns: Array  # (B, 6, 10 + e, n) its derivative by the target body and the prediction's unknowns
    # (B, 6, n + c) factor of the pose error that accumulates until the next window, by joints and the c readings of
    # stored momentum
    process: Array
    stored: Array  # (B, 6, c) factor of the noise in the twist, by these readings and by Gauss-Markov processes
    by_process_steps: Array  # (B, 6, f) motion of the base with each Gauss-Markov process, when that grows by one
    process_variance: Array  # (B, f) variance that each gains in the window by the joints' noise, beside its own


def joint_noise(
    layout: Layout,
    kernel: MomentumKernel,
    stacks: Sequence[Stack],
    inside: Sequence[slice],
    predictions: Sequence[Prediction],
    bodies: Bodies,
    *,
    swing: Array | None = None,
) -> list[JointNoise]:
    """Return the noise of stacks of windows, from their first, middle and last intervals.

    Parameters
    ----------
    layout, kernel : of the state; of the robot where it is linearised
    stacks, inside : windows, and their own intervals among those of each stack
    predictions, bodies : of each stack and the intervals beside, (m, B, ...); of all these, one after the other
    swing : (B, f, u) derivative of passive joints' deflections at the ends of all windows; None without any
    """
    # Of each stack its windows' first, middle and last intervals.
    places = [np.array([own.start, (own.start + own.stop) // 2, own.stop - 1]) for own in inside]
    begins = np.cumsum([0, *(each.twist[..., 0].size for each in predictions)])
    index = np.concatenate(  # (3, all windows)
        [
            begin + len(stack.windows) * place[:, None] + np.arange(len(stack.windows))
            for begin, place, stack in zip(begins, places, stacks, strict=False)
        ],
        axis=1,
    )
    gains = (gain[:, ANGULAR_FIRST] for gain in joint_gains(kernel, bodies[index.ravel()]))
    by_rate, by_position = (gain.reshape(*index.shape, *gain.shape[1:]) for gain in gains)
    first, middle, last = by_rate
    slope = np.concatenate([each[place[1]].error_slope for each, place in zip(predictions, places, strict=True)])
    size = [np.full((len(each.windows), 1, 1), each.windows[0].spacing) for each in stacks]
    apart = np.concatenate([each * (place[2] - place[0]) for each, place in zip(size, places, strict=True)])
    length = apart + np.concatenate(size)
    deviation = np.concatenate([np.sqrt(stack.joint_variance / stack.samples) for stack in stacks])
    if kernel.springs.count:  # nothing reads passive joints: their errors are those of the parameters
        deviation = np.repeat(deviation, kernel.model.joints // deviation.shape[-1], axis=-1)
        deviation[..., list(kernel.springs.joints)] = 0.0
    # At position level the turn of A itself remains, and F~ A dq.
    remainder = by_position[1] + slope @ middle - (last - first) / apart
    by_unknowns = gains_by_unknowns(layout, kernel, bodies[index[1]], middle[:, ANGULAR_FIRST])[:, ANGULAR_FIRST]
    process, stored = deviation * length * remainder, np.zeros((*middle.shape[:-1], 0))
    if kernel.storage.count:
        stored = _by_readings(bodies[index[1]])
        samples = np.concatenate([stack.samples for stack in stacks])
        process = np.concatenate((process, length / np.sqrt(samples) * stored), axis=-1)
    steps = np.zeros((*last.shape[:-1], 0))
    if layout.time_constants.size:
        samples = np.concatenate([stack.samples for stack in stacks])
        steps = last @ layout.joint_columns
        # The rate of a Gauss-Markov process is white, its density twice the variance over the time constant.
        times = layout.time_constants[np.isfinite(layout.time_constants)]
        within = np.sqrt(2.0 / times * samples / length) * (middle @ layout.joint_columns)
        stored = np.concatenate((stored, within), axis=-1)
    added = np.zeros((len(steps), steps.shape[-1]))
    if swing is not None and layout.time_constants.size:
        more, added, jolts = _of_swing(layout, kernel, bodies[index[1]], swing, (deviation, length))
        steps, stored = steps + more, np.concatenate((stored, np.sqrt(samples) / length * jolts), axis=-1)
    noise = JointNoise(deviation * middle, deviation[..., None, :] * by_unknowns, process, stored, steps, added)
    ends = np.cumsum([0, *(len(stack.windows) for stack in stacks)])
    return [noise[begin:end] for begin, end in pairwise(ends)]


def _of_swing(
    layout: Layout, kernel: MomentumKernel, bodies: Bodies, swing: Array, noise: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Return (B, 6, f) motions of the base with each Gauss-Markov process, and (B, f) variances by the joints' noise.

    Third, how that moves the base by the end of the window, (B, 6, f).

    An error of a joint's reading is one of a passive joint's predicted deflection, and its spring pulls accordingly:
    white noise that drives the swing. Each of its two amplitudes takes half.
    """
    deviation, length = noise
    states, springs = bodies.states, kernel.springs
    assert bodies.passive is not None, 'there are passive joints'
    inertias, gamma = bodies.passive.inertias, sensitivity_to_joints(kernel, states)[1]
    # Deflections by constant errors of the joints, and their accelerations, (B, f, n); the base's twist by their rates.
    _, errors = inertias.solve(-gamma, -passive_momenta(kernel, states.configuration.joint_twist, gamma))
    by_joints = inertias.mobility_of_joints @ (spring_constants(kernel, bodies.parameters)[0][:, None] * errors)
    turned = -inertias.mobility @ np.swapaxes(inertias.gamma, 1, 2)
    processes = np.flatnonzero(np.isfinite(layout.time_constants))
    own = processes < swing.shape[-1] - (BODY.stop - LINEAR.start)
    columns = processes[own] + BODY.stop - LINEAR.start
    steps, variance = np.zeros((len(swing), 6, len(processes))), np.zeros((len(swing), len(processes)))
    growth = np.exp(length / layout.time_constants[processes[own]])
    steps[..., own] = turned[:, ANGULAR_FIRST] @ swing[..., columns] * growth
    rates = np.sqrt(np.sum((length * by_joints * deviation) ** 2, axis=-1))  # (B, f) that a window adds
    begin = 0
    for unknown in layout.unknowns:
        count = int(np.sum(np.isfinite(unknown.time_constants)))
        if unknown.noise_driven:
            variance[:, begin : begin + count] = unknown.process_variances(rates)
        begin += count
    ends = np.minimum(1.0 / (np.sqrt(2.0) * springs.frequency), length[:, 0] / np.sqrt(3.0)) * rates
    return steps, variance, turned[:, ANGULAR_FIRST] * ends[:, None]


def _by_readings(bodies: Bodies) -> Array:
    """Return the effect of the noise of each reading of stored momentum on the twist, (N, 6, c)."""
    storage, placed = bodies.states.storage, bodies.states.configuration
    columns = bodies.mobility @ storage.jacobian(placed.rotation)
    return np.asarray(columns[:, ANGULAR_FIRST] * storage.noises)


_MOST = 0.99  # part of the information that the noise may make: intervals are then a hundred times as wide


def errors_in_variables_bias(precision: Array, slope: Array, body: Array, variables: Variables) -> Array:
    """Return the information M of the body by the joints' noise in the rows, and M times the body, (B, b, b + 1).

    Parameters
    ----------
    precision : (B, 6, 6) S^-1 of the measurements, the joints' noise in pose and twist together
    slope : (B, 6, 10 + e, n) that noise in the rows
    body : (B, 10) standard parameters at the linearisation point
    variables : of the filter
    """
    of_body = slope[:, :, :10].transpose(0, 3, 1, 2) @ variables.to_state[BODY, variables.body]
    weighed = precision[:, None] @ of_body  # (B, n, 6, b)
    windows, joints, numbers, count = of_body.shape
    flat = of_body.reshape(windows, joints * numbers, count)
    information = np.swapaxes(flat, 1, 2) @ weighed.reshape(flat.shape)  # M of trajectory.md, eq. 13
    at = variables.from_state[variables.body, BODY] @ body[..., None]
    return np.concatenate((information, information @ at), axis=-1)


@dataclass(frozen=True)
class InformationCorrection:
    """Correction of the body's b variables for M (trajectory.md, eqs. 13 and 14), P their covariance without it."""

    gain: Array  # (b, b) N: errors are larger by (1 - P M)^-1 = 1 + P N
    score: Array  # (b, b) K: their covariance gains (1 - P M)^-1 P M P (1 - M P)^-1 = P K K^T P
    shift: Array  # (b,) s: the estimate moves by P s

    @staticmethod
    def from_information(covariance: Array, bias_information: Array, mean: Array) -> InformationCorrection:
        """Return it for covariance (b, b), (M, M body) (b, b + 1) and mean (b,)."""
        root, information, at = np.linalg.cholesky(covariance), bias_information[:, :-1], bias_information[:, -1]
        # With P = F F^T and F^T M F = V diag(mu) V^T:  N = F^-T V diag(mu / (1 - mu)) V^T F^-1.
        part, along = np.linalg.eigh(root.T @ information @ root)
        part = np.clip(part, 0.0, _MOST)
        back = dtrtrs(root.T, along)[0]
        gain = (back * (part / (1.0 - part))) @ back.T
        score = information @ mean - at
        return InformationCorrection(gain, back * (np.sqrt(part) / (1.0 - part)), score + gain @ covariance @ score)


@dataclass(frozen=True)
class TwistLink:
    """How a window's measurements depend on c (k,), and c on the next window's; q (k,) are of unit variance."""

    # by_noise, by_carried: (w, k) derivatives of a window's w whitened measurements by q and c
    by_noise: Array
    by_carried: Array
    # value, rows, inverse factor: (k,), (k, v), (k, k): q = back (c' - c - process noise + value - rows variables)
    integral_value: Array
    integral_rows: Array
    inverse_factor: Array
    process: Array  # (k, n) of that noise, as in `WhitenedWindow`


def integrated_twist_rows(
    twist: IntegratedTwist, pose: Measurement, noise_of_joints: JointNoise, variables: Variables
) -> tuple[list[tuple[Array, Array, Array, TwistLink]], Array]:
    """Return value, rows, log_noise and link of B windows by pose and integrated twist, as in `WhitenedWindow`.

    Second, (B, 6, 6) S^-1 of these measurements as the joints' noise is in them. The measured way, free of that noise,
    takes the place of the change of xi that whitens the mean pose.
    """
    select, of_joints = variables.measured, noise_of_joints.pose
    size, change = len(select), twist.change[:, None]
    values = np.concatenate(
        ((pose.value - change * twist.integral_value) @ select.T, twist.mean_value @ select.T),
        axis=1,
    )
    by_state = np.concatenate(
        (select @ (pose.rows - change[..., None] * twist.integral_rows), select @ twist.mean_rows),
        axis=1,
    )
    common = of_joints @ np.swapaxes(of_joints, -1, -2)
    factor = np.linalg.cholesky(select @ twist.white @ select.T)
    noise = np.zeros((len(pose), 2 * size, 2 * size))
    noise[:, :size, :size] = select @ pose.covariance @ select.T
    noise[:, :size, size:] = noise[:, size:, :size] = select @ common @ select.T
    noise[:, size:, size:] = select @ (common + twist.left[:, None, None] * twist.white) @ select.T
    by_noise = np.concatenate((-change[..., None] * factor, twist.share[:, None, None] * factor), axis=1)
    by_carried = np.concatenate((np.zeros((size, size)), np.eye(size)))
    triangle = np.linalg.cholesky(noise)
    whiten = np.linalg.inv(triangle)
    links = map(
        TwistLink,
        whiten @ by_noise,
        whiten @ by_carried,
        twist.integral_value @ select.T,
        select @ variables.rows(twist.integral_rows),
        np.linalg.inv(factor),
        select @ noise_of_joints.process,
    )
    both = block_diag(select, select).reshape(2, size, 2, 6).sum(axis=2).reshape(2 * size, 6)
    certain = _certain(noise + by_noise @ np.swapaxes(by_noise, -1, -2), by_carried, factor)
    log_noise = 2.0 * np.add.reduce(np.log(np.diagonal(triangle, axis1=1, axis2=2).T.copy()), axis=0)
    white = (whiten @ values[..., None])[..., 0], whiten @ variables.rows(by_state), log_noise
    return list(zip(*white, links, strict=True)), both.T @ certain @ both


def _certain(noise: Array, by_carried: Array, walk: Array) -> Array:
    """Return the (B, w, w) inverse of the covariance of the measurements, with c as certain as all windows make it.

    c is a random walk. Measured with a variance r times that of its step, it keeps 1 / sqrt(1 + 4 r) of r: the smoothed
    variance far from the ends of a run.

    Parameters
    ----------
    noise, by_carried : (B, w, w) covariance of the measurements given c, and (w, k) their derivative by c
    walk : (B, k, k) factor of the covariance of a step of c
    """
    inverse = np.linalg.inv(noise)
    seen = inverse @ by_carried @ walk
    size, along = np.linalg.eigh(np.swapaxes(by_carried @ walk, -1, -2) @ seen)
    size = np.maximum(size, 1e-12)
    left = (seen @ along) / np.sqrt(np.sqrt(size * (size + 4.0)))[:, None]
    return np.asarray(inverse - left @ np.swapaxes(left, -1, -2))
