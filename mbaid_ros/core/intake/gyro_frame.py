"""Whether an IMU measures in the axes and units that it is said to, decided by how the poses turn.

Over each window the mean angular velocity that a gyro measures is compared with that by which the pose has turned. A
bias does not matter, an error of scale or mount as is declared does not either; a gyro that is upside down, whose axes
are others, or that measures in degrees is told from one that is not by how much better it then agrees.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, log
from mbaid_ros.core.samples import Samples

_FEWEST = 6  # windows, of three numbers each: enough for a turn and a judgement of it
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
        if self._count < _FEWEST:
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
