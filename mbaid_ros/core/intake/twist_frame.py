"""Whether the base's twist is given in the frame it is declared in, decided by how the poses change.

In each window the poses say how fast the base moved. The twist, read as declared, should agree; read in the other
frame it differs from that by d. The share of d that is found in the disagreement is 0 where the declaration holds and 1
where the other does. It is estimated by weighted least squares over all windows, with its standard deviation.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, rotate, rotate_back
from mbaid_ros.core.intake.rates import base_slopes, fit
from mbaid_ros.core.samples import Samples

_SIGNIFICANT = 6.0  # standard deviations
# A difference between the readings within the twist's own noise would correlate with it: such windows say nothing.
_DISTINCT = 5.0
_FEWEST = 6  # samples in a window
_NAMES = {'child': 'the child frame', 'inertial': 'the inertial frame'}


class TwistFrame:
    """Watches whether windows contradict the declared frame of the twist.

    Parameters
    ----------
    declared : 'child' or 'inertial': how the twists in the samples were read
    """

    def __init__(self, declared: str) -> None:
        self._declared = declared
        self._other = 'inertial' if declared == 'child' else 'child'
        self._information = 0.0
        self._weighted = 0.0

    def update(self, window: Samples) -> None:
        """Take a window; one whose twist is not measured says nothing."""
        twist = np.concatenate((window.base_linear_velocity, window.base_angular_velocity), axis=1)
        if len(window) < _FEWEST or not np.all(np.isfinite(twist)):
            return
        other = _other_reading(window.base_rotation, twist, self._declared)
        read, difference = np.mean(twist, axis=0), np.mean(other - twist, axis=0)
        local = fit(window.time)
        seen = np.mean(np.concatenate(base_slopes(window, local), axis=1), axis=0)
        slope = np.maximum(local.mean_gain * np.diagonal(np.mean(window.pose_covariance, axis=0)), 1e-30)
        # The twist's noise, of whichever axes: its larger variance of the three.
        spread = np.diagonal(np.mean(window.twist_covariance, axis=0)).reshape(2, 3)
        own = np.repeat(np.max(spread, axis=1), 3) / len(window)
        distinct = difference**2 > _DISTINCT**2 * 2.0 * own
        weight = np.where(distinct, 1.0 / (slope + own), 0.0)
        self._information += float(np.sum(weight * difference**2))
        self._weighted += float(np.sum(weight * difference * (seen - read)))

    @property
    def share(self) -> tuple[float, float]:
        """How much the poses follow the other reading (0: not at all, 1: entirely), and its standard deviation."""
        if self._information <= 0.0:
            return 0.0, np.inf
        return self._weighted / self._information, self._information**-0.5

    @property
    def contradiction(self) -> str:
        """A sentence if the declared frame contradicts the data with at least six standard deviations, else empty."""
        share, deviation = self.share
        if share < 0.5 or share < _SIGNIFICANT * deviation or not np.isfinite(share):
            return ''
        return (
            f'the twist in the Odometry is not in {_NAMES[self._declared]} as declared: the poses say it is in '
            f'{_NAMES[self._other]}; if so, set twist_frame: {self._other}'
        )


def _other_reading(rotation: Array, twist: Array, declared: str) -> Array:
    """Return the (N, 6) twist in odometry axes if its numbers were meant in the frame that is not the declared one."""
    turn = rotate_back if declared == 'child' else rotate
    return np.concatenate((turn(rotation, twist[:, :3]), turn(rotation, twist[:, 3:])), axis=1)
