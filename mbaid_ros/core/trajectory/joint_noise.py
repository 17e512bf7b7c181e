"""What the noise of the joint encoders does to a window.

An error dq of the joints moves the predicted pose by A dq, A = dV/dq', at that instant only: noise of what is measured,
and hardly any of what accumulates. As A depends on the bodies, the same dq is in the window's rows, by dA/dphi dq: that
makes least squares prefer bodies of small A (errors in variables), and is why the filter has to know of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.stacked import Stacked
from mbaid_ros.core.trajectory.midpoints import Midpoints
from mbaid_ros.core.trajectory.nodes import Integers
from mbaid_ros.core.trajectory.prediction import ANGULAR_FIRST, Prediction, joint_gains, unit_rates, with_errors
from mbaid_ros.core.trajectory.windows import Stack


@dataclass(frozen=True)
class JointNoise(Stacked):
    """The joints' noise in B windows, (angular, linear).

    Attributes
    ----------
    pose : (B, 6, n) factor of the covariance of the mean pose
    by_parameters : (B, 6, u - 6, n) its derivative by the parameters but the momentum
    process : (B, 6, n) factor of the covariance of what accumulates on the way to the next window
    """

    pose: Array
    by_parameters: Array
    process: Array


def joint_noise(
    kernel: MomentumKernel,
    stacks: Sequence[Stack],
    motions: Sequence[tuple[Midpoints, slice]],
    predictions: Sequence[Prediction],
    parameters: Array,
    uncertain: Sequence[int],
) -> list[JointNoise]:
    """Return the noise of stacks of windows, followed at their first, middle and last intervals.

    Parameters
    ----------
    kernel : MomentumKernel
    stacks : Sequence of Stack
    motions, predictions : of each and the intervals beside, (m, B, ...); which are the windows' own
    parameters, uncertain : as of `predict`
    """
    places = [_places(inside) for _, inside in motions]
    around = [motion[place] for (motion, _), place in zip(motions, places, strict=True)]
    twist = [prediction.twist[place].reshape(-1, 6) for prediction, place in zip(predictions, places, strict=True)]
    gains = joint_gains(
        with_errors(kernel, parameters[16:], uncertain),
        Midpoints.concatenate([each.flat for each in around]),
        np.concatenate(twist),
        parameters[6:16],
    )
    slopes = unit_rates(kernel, Midpoints.concatenate([each[1:2].flat for each in around]), parameters, uncertain)
    ends = np.cumsum([len(stack.windows) for stack in stacks])[:-1]
    by_rate, by_position = (np.split(gain[:, ANGULAR_FIRST], 3 * ends) for gain in gains)
    by_parameters = np.split(slopes[:, ANGULAR_FIRST], ends)
    found = []
    for index, (stack, place) in enumerate(zip(stacks, places, strict=True)):
        first, middle, last = by_rate[index].reshape(3, len(stack.windows), 6, -1)
        moved = by_position[index].reshape(3, len(stack.windows), 6, -1)[1]
        spacing = stack.windows[0].spacing
        # What is left behind at position level: the turn of A itself, and what F makes of A dq.
        turning = (last - first) / (spacing * (place[2] - place[0]))
        remainder = moved + predictions[index].error_slope[place[1]] @ middle - turning
        deviation = np.sqrt(stack.joint_variance / stack.samples)
        length = spacing * (place[2] - place[0] + 1)
        found.append(
            JointNoise(deviation * middle, deviation[..., None] * by_parameters[index], deviation * length * remainder)
        )
    return found


def _places(inside: slice) -> Integers:
    """Return a window's first, middle and last intervals."""
    count = inside.stop - inside.start
    return inside.start + np.array([0, count // 2, count - 1])
