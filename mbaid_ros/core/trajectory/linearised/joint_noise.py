"""What the noise of the joint encoders does to a window.

An error dq of the joints moves the predicted pose by A dq, A = dV/dq', at that instant only: noise of what is measured,
and hardly any of what accumulates. As A depends on bodies and joints, the same dq is in the window's rows, by dA/dphi
dq: that makes least squares prefer bodies of small A (errors in variables), and is why the filter has to know of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.linearised.prediction import Bodies, Prediction, gains_by_unknowns, joint_gains
from mbaid_ros.core.trajectory.state import ANGULAR_FIRST, Layout
from mbaid_ros.core.trajectory.windows.window import Stack


@dataclass(frozen=True)
class JointNoise(ArrayRecord):
    """The joints' noise in B windows, (angular, linear).

    Attributes
    ----------
    pose : (B, 6, n) factor of the covariance of the mean pose
    by_unknowns : (B, 6, 10 + e, n) its derivative by the target body and the unknowns that the prediction depends on
    process : (B, 6, n + c) factor of the covariance of what accumulates on the way to the next window, by the noise of
        joints and of the c readings of what stores momentum
    stored : (B, 6, c) factor of the covariance of the twist, by the noise of one reading of each of these, and by what
        wanders within a window
    stepped : (B, 6, f) how far the base goes with each of the unknowns' numbers that wander, when that grows by one
    """

    pose: Array
    by_unknowns: Array
    process: Array
    stored: Array
    stepped: Array


def joint_noise(
    layout: Layout,
    kernel: MomentumKernel,
    stacks: Sequence[Stack],
    inside: Sequence[slice],
    predictions: Sequence[Prediction],
    bodies: Bodies,
) -> list[JointNoise]:
    """Return the noise of stacks of windows, followed at their first, middle and last intervals.

    Parameters
    ----------
    layout : of the state
    kernel : of the robot where it is linearised
    stacks : Sequence of Stack
    inside : the windows' own intervals among those of each stack
    predictions : of each stack and the intervals beside, (m, B, ...)
    bodies : of all these intervals, one after the other
    """
    places = [_places(each) for each in inside]
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
    # What is left behind at position level: the turn of A itself, and what F~ makes of A dq.
    remainder = by_position[1] + slope @ middle - (last - first) / apart
    by_unknowns = gains_by_unknowns(layout, kernel, bodies[index[1]], middle[:, ANGULAR_FIRST])[:, ANGULAR_FIRST]
    process, stored = deviation * length * remainder, np.zeros((*middle.shape[:-1], 0))
    if kernel.storage.count:
        stored = _by_readings(bodies[index[1]])
        samples = np.concatenate([stack.samples for stack in stacks])
        process = np.concatenate((process, length / np.sqrt(samples) * stored), axis=-1)
    stepped = np.zeros((*last.shape[:-1], 0))
    if layout.times.size:
        samples = np.concatenate([stack.samples for stack in stacks])
        stepped = last @ layout.joint_steps
        # The rate of what wanders is white, its density twice the variance over the time constant.
        times = layout.times[np.isfinite(layout.times)]
        within = np.sqrt(2.0 / times * samples / length) * (middle @ layout.joint_steps)
        stored = np.concatenate((stored, within), axis=-1)
    whole = JointNoise(deviation * middle, deviation[..., None, :] * by_unknowns, process, stored, stepped)
    ends = np.cumsum([0, *(len(stack.windows) for stack in stacks)])
    return [whole[begin:end] for begin, end in pairwise(ends)]


def _by_readings(bodies: Bodies) -> Array:
    """Return what the noise of one reading of each that stores momentum makes of the twist, (N, 6, c)."""
    storage, placed = bodies.states.storage, bodies.states.configuration
    columns = bodies.mobility @ storage.columns(placed.rotation)
    return np.asarray(columns[:, ANGULAR_FIRST] * storage.noises)


def _places(inside: slice) -> Integers:
    """Return a window's first, middle and last intervals."""
    count = inside.stop - inside.start
    return inside.start + np.array([0, count // 2, count - 1])
