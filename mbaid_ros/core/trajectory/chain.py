"""Windows of the error chain: how the true pose drifts from the measured one, and what a window measures of it.

The error xi = (theta, rho) is that of the measured pose: R_true = Exp(theta) R, p_true = p + rho. From node to node it
changes by the predicted motion less the measured one. A window's pose measurement says that xi vanishes on average; its
twist measurement compares predicted and measured velocities. Both are linear in the state at the window's first node.

State: xi (6), P (3), L (3), phi (10), errors of uncertain known bodies (10 each), a constant force and torque
(6), tau (1): the joints' stamps are tau late.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, cross, exp, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.nodes import Midpoints, Window, WindowNoise
from mbaid_ros.core.trajectory.prediction import Prediction, joint_gains, predict, with_errors

LINEAR, ANGULAR, BODY = slice(6, 9), slice(9, 12), slice(12, 22)
PARAMETERS = slice(6, -7)  # all that enters the prediction
FORCE = slice(-7, -1)
DELAY = -1
# Rows of a twist (v, w) in the order (angular, linear) of the pose error.
_ANGULAR_FIRST = np.array([3, 4, 5, 0, 1, 2])


@dataclass(frozen=True)
class Point:
    """Where windows are linearised.

    Attributes
    ----------
    parameters : (u,) (P, L, phi, errors of the uncertain bodies)
    delay : s, of the joints' stamps
    """

    parameters: Array
    delay: float = 0.0

    @staticmethod
    def of(state: Array) -> Point:
        """Return the point of a state (s,)."""
        return Point(state[PARAMETERS], float(state[DELAY]))


@dataclass(frozen=True)
class WindowModel:
    """A window, linear in the state x at its first node: measurements, and the way to the next window.

    Attributes
    ----------
    pose_value, pose_rows, pose_covariance : (6,), (6, s), (6, 6): value = rows x + noise, x the s numbers of the state
    twist_value, twist_rows, twist_covariance : the same; NaN value where the twist is not measured
    transition, drift : (6, s), (6,): pose error at the next window's first node = transition x + drift
    process : (6, n) factor of the covariance of the joint noise that accumulates on the way
    length : s
    rotation, position : (3, 3), (3,) m, of the base at the window's end
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
    length: float
    rotation: Array
    position: Array


def window_model(kernel: MomentumKernel, window: Window, point: Point, uncertain: Sequence[int] = ()) -> WindowModel:
    """Return one window's model (see `window_models`)."""
    return window_models(kernel, [window], point, uncertain)[0]


def window_models(
    kernel: MomentumKernel, windows: Sequence[Window], point: Point, uncertain: Sequence[int] = ()
) -> list[WindowModel]:
    """Return the models of some windows, linearised at the same point.

    Parameters
    ----------
    kernel : MomentumKernel
    windows : their motion is predicted in one call
    point : windows that follow each other share its delay: a chain is as late as its joints
    uncertain : indices of the uncertain bodies
    """
    parameters = point.parameters
    motions = [window.motion(point.delay) for window in windows]
    middle = Midpoints.concatenate(motions)
    prediction = predict(kernel, middle, parameters, uncertain)
    ends = np.cumsum([len(motion) for motion in motions])
    parts = [slice(int(end) - len(motion), int(end)) for motion, end in zip(motions, ends, strict=True)]
    # The joints' noise is followed at a window's first, middle and last interval.
    places = [part.start + window.places for window, part in zip(windows, parts, strict=True)]
    chosen = np.concatenate(places)
    exact = with_errors(kernel, parameters[16:], uncertain)
    by_joints = joint_gains(exact, middle[chosen], prediction.twist[chosen], parameters[6:16])
    by_rate, by_position = (gain[:, _ANGULAR_FIRST].reshape(len(windows), 3, 6, -1) for gain in by_joints)
    return [
        _model(window, motions[k][window.inside], prediction[part], (by_rate[k], by_position[k]), point)
        for k, (window, part) in enumerate(zip(windows, parts, strict=True))
    ]


def _model(
    window: Window, middle: Midpoints, predicted: Prediction, gains: tuple[Array, Array], point: Point
) -> WindowModel:
    """Return one window's model from its motion, prediction and gains (3, 6, n) of joint rates and positions."""
    parameters = point.parameters
    slope = np.gradient(predicted.twist, window.spacing, axis=0)
    integral = _integral(predicted.twist, slope, window.spacing)[window.inside]
    slope = slope[window.inside]
    prediction = predicted[window.inside]
    errors = _compose(*_chain_steps(prediction, integral, middle, window.spacing))
    # Absolute parameters: what the chain has as deviations from `parameters` moves to its constant part.
    errors[..., -1] -= errors[..., 6:-1] @ parameters
    by_rate, by_position = gains
    # What joint noise leaves behind at position level: the turn of its own gain A, and what F makes of A dq.
    length, centre = len(middle) * window.spacing, len(middle) // 2
    turning = (by_rate[2] - by_rate[0]) / (length - window.spacing)
    remainder = by_position[1] + _error_slope(prediction)[centre] @ by_rate[1] - turning
    deviation = window.noise.joint_position * length / np.sqrt(window.noise.samples)
    return WindowModel(
        *_from_delay(point.delay, *_pose_measurement(errors, prediction.twist, by_rate[1], window.noise)),
        *_from_delay(
            point.delay, *_twist_measurement(errors, prediction, middle, by_rate[1], window, (parameters, slope))
        ),
        transition=_state_rows(errors[-1]),
        drift=errors[-1][:, -1],
        process=deviation * remainder,
        length=length,
        rotation=exp(0.5 * middle.turn[-1]) @ middle.base_rotation[-1],
        position=middle.base_position[-1] + 0.5 * middle.step[-1],
    )


def _integral(twist: Array, slope: Array, spacing: float) -> Array:
    """Return (J, 6) integrals of (v, w) over each interval, fourth order, the rotation's commutator included."""
    bend = np.concatenate((np.zeros((1, 6)), np.diff(twist, n=2, axis=0), np.zeros((1, 6))))
    bend[0], bend[-1] = bend[1], bend[-2]
    integral = spacing * (twist + bend / 24.0)
    integral[:, 3:] += spacing**3 / 12.0 * cross(slope[:, 3:], twist[:, 3:])
    return integral


def _chain_steps(prediction: Prediction, integral: Array, middle: Midpoints, spacing: float) -> tuple[Array, Array]:
    """Return, for each interval, the (6, 6) transition of xi and the (6, u + 1) gain of parameters and of 1."""
    gain = np.empty((len(middle), 6, prediction.by_parameters.shape[-1] + 1))
    gain[..., :-1] = spacing * prediction.by_parameters[:, _ANGULAR_FIRST]
    surplus = integral[:, 3:] - middle.turn
    gain[:, :3, -1] = surplus
    gain[:, 3:, -1] = integral[:, :3] - middle.step
    # xi acts at mid-interval, the mean of both ends: (1 - D F / 2) xi' = (1 + D F / 2) xi + gain
    half = 0.5 * spacing * _error_slope(prediction)
    solved = np.linalg.solve(np.eye(6) - half, np.concatenate((np.eye(6) + half, gain), axis=-1))
    return solved[..., :6], solved[..., 6:]


def _error_slope(prediction: Prediction) -> Array:
    """Return F, the (J, 6, 6) rate of change of xi by xi."""
    slope = prediction.by_pose_error[:, _ANGULAR_FIRST]
    slope[:, 3:, :3] -= skew(prediction.twist[:, :3])  # the predicted velocity turns with the true base
    return slope


def _compose(transition: Array, gain: Array) -> Array:
    """Return xi at every node, (m + 1, 6, 6 + u + 1): linear in (xi at the first node, parameters, 1)."""
    count = len(transition)
    errors = np.zeros((count + 1, 6, 6 + gain.shape[-1]))
    errors[0, :, :6] = np.eye(6)
    for index in range(count):
        errors[index + 1] = transition[index] @ errors[index]
        errors[index + 1, :, 6:] += gain[index]
    return errors


def _state_rows(errors: Array) -> Array:
    """Return the rows of the state of a composition: the column of the constant goes, force and delay come."""
    rows = np.zeros((6, errors.shape[-1] + 6))
    rows[:, : PARAMETERS.stop] = errors[:, :-1]
    return rows


def _from_delay(delay: float, value: Array, rows: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Return a measurement, linear in how much later than `delay` the joints are, in absolute terms."""
    return value + rows[:, DELAY] * delay, rows, covariance


def _pose_measurement(errors: Array, twist: Array, by_rate: Array, noise: WindowNoise) -> tuple[Array, Array, Array]:
    """0 = mean of xi over the nodes + tau V + noise: joints that are tau late make a chain that is tau late."""
    mean = np.mean(errors[:-1], axis=0)
    rows = _state_rows(mean)
    rows[:, DELAY] = np.mean(twist, axis=0)[_ANGULAR_FIRST]
    # An error dq of the joints moves the predicted pose by A dq; it does not accumulate.
    covariance = noise.pose / noise.samples + noise.joint_position**2 / noise.samples * by_rate @ by_rate.T
    return -mean[:, -1], rows, covariance


def _twist_measurement(
    errors: Array,
    prediction: Prediction,
    middle: Midpoints,
    by_rate: Array,
    window: Window,
    point: tuple[Array, Array],
) -> tuple[Array, Array, Array]:
    """V_measured - V_predicted = F xi + G (parameters - linearisation) + tau (V' - w x V) + noise, weighted.

    `point` holds the parameters of the linearisation and the slope V' there.
    """
    count, noise = len(middle), window.noise
    parameters, slope = point
    place = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    weight = (1.0 - place**2) / np.sum(1.0 - place**2)
    gain = prediction.by_parameters[:, _ANGULAR_FIRST]
    model: Array = prediction.by_pose_error[:, _ANGULAR_FIRST] @ (0.5 * (errors[1:] + errors[:-1]))
    model[..., 6:-1] += gain
    model[..., -1] += prediction.twist[:, _ANGULAR_FIRST] - gain @ parameters
    model = np.tensordot(weight, model, axes=1)
    value = weight @ middle.base_twist[:, _ANGULAR_FIRST] - model[:, -1]
    axes = np.zeros((6, 6))
    axes[:3, :3] = axes[3:, 3:] = middle.base_rotation[count // 2]
    white = float(np.sum(weight**2)) * count / noise.samples
    telescoped = float(np.sum(np.diff(np.pad(weight, 1)) ** 2)) * count / noise.samples / window.spacing**2
    covariance = white * axes @ noise.twist @ axes.T + noise.joint_position**2 * telescoped * by_rate @ by_rate.T
    rows = _state_rows(model)
    # A chain that is tau late has xi = -tau (w, v) in it: what F makes of that and of the joints' own delay is left.
    turning = np.concatenate((slope[:, 3:], slope[:, :3] - cross(prediction.twist[:, 3:], prediction.twist[:, :3])), 1)
    rows[:, DELAY] = weight @ turning
    return value, rows, covariance
