"""Whether the base's twist is given in the frame it is declared in, decided by how the poses change.

In each window the poses say how fast the base moved. The twist, read as declared, should agree; read in the other
frame it differs from that by d. The share of d that is found in the disagreement is 0 where the declaration holds and 1
where the other does. It is estimated by weighted least squares over all windows, with its standard deviation, which is
as much larger as the noise has turned out to be: noise that is declared too small speaks for neither.
What a window says counts from the next one on, so that looking at it can wait until its estimate is out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.core.geometry import Array, log, rotate, rotate_back
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.rates import base_slopes, fits

_SIGNIFICANT = 6.0  # standard deviations, from which one reading of the twist is the right one: one in a billion
# Standard deviations of the twist's noise: a smaller difference of the readings correlates with it, and says nothing.
_DISTINCT = 5.0
_FEWEST_SAMPLES = 6  # samples in a window, for a rate of its poses that is better than theirs
_ENOUGH = 12.0  # numbers that tell: of fewer it does not show how noisy they are
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
        self._squares, self._count = 0.0, 0.0  # of the disagreements, weighted
        self._waiting: list[Samples] = []  # the last window, while nothing has looked at it

    def update(self, windows: Sequence[Samples]) -> list[tuple[str, float]]:
        """Take windows; return `contradiction` and `gain` before each. One without a measured twist says nothing."""
        if not windows:
            return []
        told = self._look([*self._waiting, *windows[:-1]])
        self._waiting = [windows[-1]]
        return told[-len(windows) :]

    def work_off(self) -> None:
        """Look at the last window now, not when the next one comes."""
        if self._waiting:
            self._look(self._waiting)
            self._waiting = []

    def _look(self, windows: Sequence[Samples]) -> list[tuple[str, float]]:
        """Look at windows, and return `contradiction` and `gain` before the first and after each."""
        said = np.zeros((len(windows), 4))
        for places in _alike(windows):
            said[places] = _said([windows[place] for place in places], self._declared)
        told = [(self.contradiction, self.gain)]
        for information, weighted, squares, count in said.tolist():
            self._information += information
            self._weighted += weighted
            self._squares += squares
            self._count += count
            told.append((self.contradiction, self.gain))
        return told

    @property
    def share(self) -> tuple[float, float]:
        """How much the poses follow the other reading (0: not at all, 1: entirely), and its standard deviation."""
        if self._information <= 0.0:
            return 0.0, np.inf
        share = self._weighted / self._information
        left = (self._squares - share * self._weighted) / max(self._count - 1.0, 1.0)
        return share, (max(left, 1.0) / self._information) ** 0.5

    @property
    def gain(self) -> float:
        """Log-likelihood by which the other reading is better."""
        return self._weighted - 0.5 * self._information

    @property
    def contradiction(self) -> str:
        """A sentence if the declared frame contradicts the data with at least six standard deviations, else empty."""
        share, deviation = self.share
        if self._count < _ENOUGH or share < 0.5 or share < _SIGNIFICANT * deviation or not np.isfinite(share):
            return ''
        return (
            f'the twist in the Odometry is not in {_NAMES[self._declared]} as declared: the poses say it is in '
            f'{_NAMES[self._other]}; if so, set twist_frame: {self._other}'
        )


def _alike(windows: Sequence[Samples]) -> list[list[int]]:
    """Return which windows have enough samples with a twist, those of one length together."""
    groups: dict[int, list[int]] = {}
    for place, window in enumerate(windows):
        if len(window) >= _FEWEST_SAMPLES and not window.missing_rates[1]:
            groups.setdefault(len(window), []).append(place)
    return list(groups.values())


def _said(windows: Sequence[Samples], declared: str) -> Array:
    """Return what W windows of N samples say, (W, 4).

    It is the information, the share they find times that, the weighted sum of squared disagreements, and their number.
    """
    twist = np.stack(
        [np.concatenate((window.base_linear_velocity, window.base_angular_velocity), axis=1) for window in windows]
    )
    rotation = np.stack([window.base_rotation for window in windows])
    difference = np.mean(_other_reading(rotation, twist, declared) - twist, axis=1)
    # The twist's noise, of whichever axes: its larger variance of the three.
    spread = _variances([window.twist_covariance for window in windows]).reshape(-1, 2, 3)
    own = np.repeat(np.max(spread, axis=2), 3, axis=1) / twist.shape[1]
    distinct = difference**2 > _DISTINCT**2 * 2.0 * own
    said = np.zeros((len(windows), 4))
    told = np.flatnonzero(np.any(distinct, axis=1))
    if not len(told):
        return said
    seen, slope = _seen([windows[place] for place in told])
    weight = np.where(distinct[told], 1.0 / (slope + own[told]), 0.0)
    disagreement = seen - np.mean(twist[told], axis=1)
    said[told, 0] = np.sum(weight * difference[told] ** 2, axis=1)
    said[told, 1] = np.sum(weight * difference[told] * disagreement, axis=1)
    said[told, 2] = np.sum(weight * disagreement**2, axis=1)
    said[told, 3] = np.sum(distinct[told], axis=1)
    return said


def _seen(windows: Sequence[Samples]) -> tuple[Array, Array]:
    """Return the mean twist that the poses of W windows of N samples imply, (W, 6), and the variances of its parts."""
    seen, gain = np.empty((len(windows), 6)), np.empty((len(windows), 1))
    position = np.stack([window.base_position for window in windows])
    rotation = np.stack([window.base_rotation for window in windows])
    for places, local in fits(np.stack([window.time for window in windows])):
        slopes = base_slopes(position[places], rotation[places], local)
        seen[places] = np.mean(np.concatenate(slopes, axis=-1), axis=1)
        gain[places, 0] = local.mean_gain
    return seen, np.maximum(gain * _variances([window.pose_covariance for window in windows]), 1e-30)


def _variances(covariances: Sequence[Array]) -> Array:
    """Return the (W, k) mean variances of W times (N, k, k) covariances."""
    return np.mean([np.diagonal(covariance, axis1=-2, axis2=-1) for covariance in covariances], axis=1)


def _other_reading(rotation: Array, twist: Array, declared: str) -> Array:
    """Return the (..., 6) twist in odometry axes if its numbers were meant in the frame that is not declared."""
    turn = rotate_back if declared == 'child' else rotate
    return np.concatenate((turn(rotation, twist[..., :3]), turn(rotation, twist[..., 3:])), axis=-1)


_FEWEST_WINDOWS = 6  # windows, of three numbers each: enough for a turn and a judgement of it
_TURNED = 0.2  # rad, from which the axes are others: no declared mount is as far off
# Part of the squared disagreement that another reading of the gyro may leave: right axes leave next to nothing.
_BETTER = 0.1
_SURE = 50.0  # log-likelihood by which another reading of the gyro has to be better: no accident in any number of runs
_OFF = 0.02  # part of the motion that a declared error of the gyro's scale or mount may make


class GyroFrame:
    """Watches whether the gyro turns as the poses do.

    Attributes
    ----------
    gain : log-likelihood by which the reading that `contradiction` names is better
    """

    def __init__(self) -> None:
        self._count = 0
        self._sums: Array = np.zeros((6,))
        self._squares: Array = np.zeros((6, 6))
        self._variance = 0.0
        self.gain = 0.0
        self.contradiction = ''

    def update(self, window: Samples) -> str:
        """Take a window, and return what is wrong by then: a sentence, empty if nothing."""
        if len(window) > 1 and window.gyro.shape[1] and not self.contradiction:
            length = float(window.time[-1] - window.time[0])
            turned = log(window.base_rotation[0].T @ window.base_rotation[-1])
            both = np.concatenate((turned, window.gyro[-1] - window.gyro[0])) / length
            ends = window.pose_covariance[[0, -1], 3:, 3:]
            if np.all(np.isfinite(both)) and np.all(np.isfinite(ends)):
                self._count += 1
                self._sums = self._sums + both
                self._squares = self._squares + np.outer(both, both)
                self._variance += float(np.trace(np.sum(ends, axis=0))) / 3.0 / length**2
                self.contradiction = self._judged()
        return self.contradiction

    def _judged(self) -> str:
        """Return what all windows so far say."""
        if self._count < _FEWEST_WINDOWS:
            return ''
        about_mean = self._squares - np.outer(self._sums, self._sums) / self._count
        of_poses, cross, of_gyro = about_mean[:3, :3], about_mean[3:, :3], about_mean[3:, 3:]
        # Noise of the poses, and what of the motion an error of scale or mount as declared may make.
        noise = self._variance / self._count + _OFF**2 * float(np.trace(of_poses)) / self._count

        def misfit(matrix: Array) -> float:
            left = of_gyro - matrix @ cross.T - cross @ matrix.T + matrix @ of_poses @ matrix.T
            return max(float(np.trace(left)), 0.0)

        left, _, right = np.linalg.svd(cross)
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        degrees = 180.0 / np.pi
        found = {
            '': misfit(np.eye(3)),
            'degrees': misfit(degrees * np.eye(3)) / degrees**2,
            'turned': misfit(turn),
        }
        best = min(found, key=lambda name: found[name])
        self.gain = 0.5 * (found[''] - found[best]) / noise
        if found[best] > _BETTER * found[''] or self.gain < _SURE:
            return ''
        if best == 'degrees':
            return (
                'the angular velocity of the IMU is 57.3 times that of the poses: it is in degrees; accepted: rad/s, '
                'as REP 103 says'
            )
        vector = log(turn.T)  # of the IMU, where its readings are turned back
        angle = float(np.linalg.norm(vector))
        if best != 'turned' or angle < _TURNED:
            return ''
        axis = ', '.join(f'{number:.2f}' for number in np.round(vector / angle, 2) + 0.0)
        return (
            f'the IMU is turned by {np.degrees(angle):.0f} degrees about ({axis}) against the axes that its frame has: '
            'check how it is mounted in the robot description, or set imu.frame'
        )
