"""Whether measured rates are those of joint positions and poses, without a model of the robot: joints, twist, gyro.

In each window the integral of a joint velocity is compared with the positions. Where the two contradict each other the
velocities are left out; they are taken from the positions then, where a method needs them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array, Flags, log, rotate, rotate_back
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.noise import median
from mbaid_ros.core.sensors.rates import base_slopes, fits

_SIGNIFICANT = 6.0  # standard deviations, from which one reading of the twist is the right one: one in a billion
# Standard deviations of the twist's noise: a smaller difference of the readings correlates with it, and decides
# nothing.
_DISTINCT = 5.0
_FEWEST_SAMPLES = 6  # samples in a window, for a rate of its poses that is better than theirs
_ENOUGH = 12.0  # numbers that suffice: fewer do not show their noise
_NAMES = {'child': 'the child frame', 'inertial': 'the inertial frame'}
_FEWEST_WINDOWS = 6  # windows, of three numbers each: enough for a turn and a judgement of it
_TURNED = 0.2  # rad, from which the axes are others: no declared mount is as far off
# Part of the squared disagreement that another reading of the gyro may leave: right axes leave next to nothing.
_BETTER = 0.1
_SURE = 50.0  # log-likelihood by which another reading of the gyro has to be better: no accident in any number of runs
_OFF = 0.02  # part of the motion that a declared error of the gyro's scale or mount may make


class TwistFrame:
    """Tests whether the base's twist is given in the declared frame, 'child' or 'inertial'.

    In each window the poses yield a mean twist. The twist, read as declared, should agree; read in the other frame it
    differs by d. The share of d in the disagreement is 0 if the declaration holds and 1 if the other one does.
    Weighted least squares over all windows estimates it. Its standard deviation scales with the actual disagreement:
    noise that is declared too small supports neither. A window counts from the next one on, so that its evaluation can
    wait until its estimate is published.
    """

    def __init__(self, declared: str) -> None:
        self._declared = declared
        self._other = 'inertial' if declared == 'child' else 'child'
        self._sums = np.zeros(4).tolist()  # information, weighted share, squared disagreements, their number
        self._waiting: list[Samples] = []  # the last window, until it is evaluated

    def update(self, windows: Sequence[Samples]) -> list[tuple[str, float]]:
        """Add windows, with or without a twist; return `contradiction` and `gain` before each."""
        if not windows:
            return []
        results = self._evaluate([*self._waiting, *windows[:-1]])
        self._waiting = [windows[-1]]
        return results[-len(windows) :]

    def run_slice(self) -> None:
        """Evaluate the last window now, not when the next one comes."""
        if self._waiting:
            self._evaluate(self._waiting)
            self._waiting = []

    def _evaluate(self, windows: Sequence[Samples]) -> list[tuple[str, float]]:
        """Evaluate windows, those of one length together; return `contradiction` and `gain` before and after each."""
        terms = np.zeros((len(windows), 4))
        groups: dict[int, list[int]] = {}
        for place, window in enumerate(windows):
            if len(window) >= _FEWEST_SAMPLES and not window.missing_rates[1]:
                groups.setdefault(len(window), []).append(place)
        for places in groups.values():
            terms[places] = _disagreement([windows[place] for place in places], self._declared)
        results = [(self.contradiction, self.gain)]
        for row in terms.tolist():
            self._sums = [total + term for total, term in zip(self._sums, row, strict=True)]
            results.append((self.contradiction, self.gain))
        return results

    @property
    def share(self) -> tuple[float, float]:
        """Share of the other reading in the poses (0: none, 1: all), and its standard deviation."""
        information, weighted, squares, count = self._sums
        if information <= 0.0:
            return 0.0, np.inf
        share = weighted / information
        left = (squares - share * weighted) / max(count - 1.0, 1.0)
        return share, (max(left, 1.0) / information) ** 0.5

    @property
    def gain(self) -> float:
        """Log-likelihood by which the other reading is better."""
        return float(self._sums[1] - 0.5 * self._sums[0])

    @property
    def contradiction(self) -> str:
        """A sentence if the declared frame contradicts the data with at least six standard deviations, else empty."""
        share, deviation = self.share
        if self._sums[3] < _ENOUGH or share < 0.5 or share < _SIGNIFICANT * deviation or not np.isfinite(share):
            return ''
        return (
            f'the twist in the Odometry is not in {_NAMES[self._declared]} as declared: by the poses, it is in '
            f'{_NAMES[self._other]}; if so, set twist_frame: {self._other}'
        )


def _disagreement(windows: Sequence[Samples], declared: str) -> Array:
    """Return information, weighted share, weighted squared disagreements and their number of W windows, (W, 4)."""
    twist = np.stack(
        [np.concatenate((window.base_linear_velocity, window.base_angular_velocity), axis=1) for window in windows]
    )
    rotation, position = (
        np.stack([getattr(one, f'base_{name}') for one in windows]) for name in ('rotation', 'position')
    )
    turn = rotate_back if declared == 'child' else rotate  # the numbers, meant in the other frame, to odometry axes
    other = np.concatenate((turn(rotation, twist[..., :3]), turn(rotation, twist[..., 3:])), axis=-1)
    difference = np.mean(other - twist, axis=1)
    # The twist's noise, in any axes: its larger variance of the three.
    spread = _variances([window.twist_covariance for window in windows]).reshape(-1, 2, 3)
    own = np.repeat(np.max(spread, axis=2), 3, axis=1) / twist.shape[1]
    distinct = difference**2 > _DISTINCT**2 * 2.0 * own
    terms = np.zeros((len(windows), 4))
    used = np.flatnonzero(np.any(distinct, axis=1))
    if not len(used):
        return terms
    seen, gain = np.empty((len(used), 6)), np.empty((len(used), 1))
    for places, local in fits(np.stack([windows[place].time for place in used])):
        slopes = base_slopes(position[used[places]], rotation[used[places]], local)
        seen[places] = np.mean(np.concatenate(slopes, axis=-1), axis=1)
        gain[places, 0] = local.mean_gain
    slope = np.maximum(gain * _variances([windows[place].pose_covariance for place in used]), 1e-30)
    weight = np.where(distinct[used], 1.0 / (slope + own[used]), 0.0)
    disagreement, difference = seen - np.mean(twist[used], axis=1), difference[used]
    products = weight * difference**2, weight * difference * disagreement, weight * disagreement**2, distinct[used]
    terms[used] = np.stack([np.sum(each, axis=1) for each in products], axis=1)
    return terms


def _variances(covariances: Sequence[Array]) -> Array:
    """Return the (W, k) mean variances of W times (N, k, k) covariances."""
    return np.mean([np.diagonal(covariance, axis1=-2, axis2=-1) for covariance in covariances], axis=1)


class GyroFrame:
    """Tests whether the gyro turns as the poses do: in other units, or in other axes.

    Attributes
    ----------
    gain : log-likelihood by which the reading in `contradiction` is better
    """

    def __init__(self) -> None:
        self._count = 0
        self._sums: Array = np.zeros((6,))
        self._squares: Array = np.zeros((6, 6))
        self._variance = 0.0
        self.gain = 0.0
        self.contradiction = ''

    def update(self, window: Samples) -> str:
        """Add a window; return the contradiction so far as a sentence, empty if there is none."""
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
                self.contradiction = self._judged() if self._count >= _FEWEST_WINDOWS else ''
        return self.contradiction

    def _judged(self) -> str:
        about_mean = self._squares - np.outer(self._sums, self._sums) / self._count
        of_poses, both, of_gyro = about_mean[:3, :3], about_mean[3:, :3], about_mean[3:, 3:]
        # Noise of the poses, and the part of the motion that a declared error of scale or mount may make.
        noise = self._variance / self._count + _OFF**2 * float(np.trace(of_poses)) / self._count

        def misfit(matrix: Array) -> float:
            left = of_gyro - matrix @ both.T - both @ matrix.T + matrix @ of_poses @ matrix.T
            return max(float(np.trace(left)), 0.0)

        left, _, right = np.linalg.svd(both)  # Wahba's problem
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        degrees = 180.0 / np.pi
        found = {'': misfit(np.eye(3)), 'degrees': misfit(degrees * np.eye(3)) / degrees**2, 'turned': misfit(turn)}
        best = min(found, key=lambda name: found[name])
        self.gain = 0.5 * (found[''] - found[best]) / noise
        if found[best] > _BETTER * found[''] or self.gain < _SURE:
            return ''
        if best == 'degrees':
            return (
                'the angular velocity of the IMU is 57.3 times that of the poses: it is in degrees; accepted: rad/s, '
                'as in REP 103'
            )
        vector = log(turn.T)  # of the IMU, where its readings are turned back
        angle = float(np.linalg.norm(vector))
        if best != 'turned' or angle < _TURNED:
            return ''
        axis = ', '.join(f'{number:.2f}' for number in np.round(vector / angle, 2) + 0.0)
        return (
            f'the IMU is turned by {np.degrees(angle):.0f} degrees about ({axis}) relative to its frame: correct the '
            'frame in the robot description, or set imu.frame'
        )


_FEWEST = 6  # samples of a window
_PART = 0.5  # of the motion, by positions or velocities, from which a difference is no filter's or stamp's
_MOVES = 5e-4  # rad or m, from which the motion in a window counts: less are steps of an encoder, or a filter's tail
_FAR = 7.0  # standard deviations of the difference, from which it is no noise
_SURE_OF_JOINTS = 3  # windows, from which the velocities are wrong all along
_MOST = 0.25  # share of the windows with motion, that contradict at least then
_OF_SECOND = 0.6745 * np.sqrt(6.0)  # median size of a second difference of white noise, in standard deviations


class JointRates:
    """Leaves out joint velocities that contradict the positions.

    Parameters
    ----------
    names : of the joints
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._wrong = np.zeros(len(self._names), dtype=np.int64)  # windows that contradict, by joint
        self._moved = np.zeros(len(self._names), dtype=np.int64)  # windows in which a joint moves
        self._left_out: Flags = np.zeros(len(self._names), dtype=bool)
        self._zero: Flags = np.ones(len(self._names), dtype=bool)  # whether the velocity was zero all along

    def applied(self, window: Samples) -> Samples:
        """Return the next window, without velocities that are no rates."""
        velocity, time = window.joint_velocity, window.time
        if len(window) < _FEWEST or not velocity.shape[1] or window.missing_rates[0]:
            return window
        step = np.diff(time)[:, None]
        turned = np.cumsum(0.5 * step * (velocity[1:] + velocity[:-1]), axis=0)
        turned = np.concatenate((np.zeros((1, velocity.shape[1])), turned))
        position = window.joint_position
        size = np.maximum(np.std(position, axis=0), np.std(turned, axis=0))
        noise = np.hypot(_noise(position), np.mean(step) * np.sqrt(len(window)) * _noise(velocity))
        moves = size > np.maximum(_FAR * noise, _MOVES)
        wrong = moves & (np.std(position - turned, axis=0) > np.maximum(_FAR * noise, _PART * size))
        self._wrong += wrong
        self._moved += moves
        self._zero &= ~np.any(velocity, axis=0)
        self._left_out |= (self._wrong >= _SURE_OF_JOINTS) & (self._wrong > _MOST * self._moved)
        if np.any(wrong | self._left_out):
            return replace(window, joint_velocity=np.full_like(velocity, np.nan))
        return window

    @property
    def contradiction(self) -> str:
        """Which velocities are no rates of the positions, in a sentence; empty where none is known to be."""
        wrong = self._left_out
        if not np.any(wrong):
            return ''
        zero = bool(np.all(self._zero[wrong]))
        names = listing(name for name, each in zip(self._names, wrong, strict=True) if each)
        how = 'zero while the positions change' if zero else 'no rates of the positions'
        return f'the velocities of {names} are {how}: velocities are taken from the positions; correct the driver'


def _noise(values: Array) -> Array:
    """Return the standard deviation of white noise in the columns of (N, n), by second differences."""
    return np.asarray(median(np.abs(np.diff(values, 2, axis=0))) / _OF_SECOND)
