"""Joints that are not where they are read to be, by an error that wanders: those that are told as commanded, say.

Of each joint, true less read position is a stationary first-order Gauss-Markov process. A window has its mean in it;
where that is another one in the next window, the joint has moved by the difference, which no reading tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.unknowns.declaration import Linear
from mbaid_ros.core.unknowns.joint_placements import momentum_displaced

TRACKING = 'tracking'


@dataclass(frozen=True, eq=False)
class JointTracking(Linear):
    """Of each joint: true less read position (rad or m), in every motion another one.

    Attributes
    ----------
    correlation : (e,) s, time constant of each independent number
    """

    correlation: Array

    read = False
    in_equations = True
    of_a_motion = True

    @property
    def times(self) -> Array:
        """Time constants of the errors."""
        return self.correlation

    @property
    def joint_steps(self) -> Array:
        """Each joint is further on by its own number."""
        return self.factor

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum changes where what a joint carries has gone on along with it."""
        return momentum_displaced(kernel, states, states.configuration.joint_twist[:, :, None])

    def in_plane(self, detector: PlaneDetector) -> JointTracking:
        """Return it as it is: whatever joints do is in the plane."""
        del detector
        return self


def joint_tracking(names: Sequence[str], deviations: Sequence[float], times: Sequence[float]) -> JointTracking:
    """Return it as an unknown, for joints of these names.

    Parameters
    ----------
    names : n of them
    deviations : (n,) rad (m for a prismatic joint), stationary standard deviations; 0 is none, empty none of all
    times : (n,) s, time constants
    """
    each = np.asarray(deviations if len(deviations) else np.zeros(len(names)), dtype=float)
    wandering = each > 0.0
    correlation = np.asarray(times if len(times) else np.ones(len(names)), dtype=float)[wandering]
    return JointTracking(np.diag(each)[:, wandering], tuple(f'{TRACKING}:{name}' for name in names), correlation)
