"""Odometry in a frame that turns with an orbit, seen from one that falls along and does not turn; and the tide."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross, rotate
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.orbit import Orbit, momentum_rates
from mbaid_ros.core.samples import BaseStream, JointStream, Samples


class FallingFrame:
    """Takes odometry to the falling frame, and adds up what the orbit brings to the momentum.

    Parameters
    ----------
    orbit : Orbit
    model : RobotModel
    relative_twist : whether a measured twist is that relative to the frame of the odometry
    epoch : ns, stamp at which the axes of odometry and falling frame are the same; None is that of the first one

    Attributes
    ----------
    epoch : as given, or found
    """

    def __init__(self, orbit: Orbit, model: RobotModel, *, relative_twist: bool, epoch: int | None = None) -> None:
        self._orbit = orbit
        self._kinematics = Kinematics(model)
        self._relative = relative_twist
        self.epoch = epoch
        self._before: tuple[float, Array] | None = None  # time of the last sample, and its rates
        self._brought: Array = np.zeros(0)

    def falling(self, measured: BaseStream) -> BaseStream:
        """Return measurements in the frame of the odometry as seen from the falling one."""
        if not self._orbit.turning:
            return measured
        if self.epoch is None:
            self.epoch = int(measured.stamp[0])
        passed = (measured.stamp - self.epoch) * 1e-9
        turn, rate = self._orbit.turned(passed), self._orbit.rate(passed)
        linear, angular = measured.linear_velocity, measured.angular_velocity
        if self._relative:
            linear = linear + cross(rate, measured.position)
            angular = angular + rate
        axes = np.zeros((len(turn), 6, 6))
        axes[:, :3, :3] = axes[:, 3:, 3:] = turn
        return replace(
            measured,
            position=rotate(turn, measured.position),
            rotation=turn @ measured.rotation,
            linear_velocity=rotate(turn, linear),
            angular_velocity=rotate(turn, angular),
            pose_covariance=axes @ measured.pose_covariance @ np.swapaxes(axes, -1, -2),
        )

    def applied(self, window: Samples, origin: int) -> Samples:
        """Return a window with what the orbit has brought until each of its samples.

        Parameters
        ----------
        window : Samples, after those before
        origin : ns, stamp at time 0
        """
        if self.epoch is None:
            self.epoch = origin
        placed = self._kinematics.configure(window.base_rotation, window.joint_position)
        after_epoch = window.time + (origin - self.epoch) * 1e-9
        rates = momentum_rates(self._orbit, after_epoch, placed, window.base_position)
        rates = rates.reshape(len(rates), -1)
        if self._before is None:
            self._before, self._brought = (float(window.time[0]), rates[0]), np.zeros(rates.shape[1])
        time, rate = self._before
        steps = np.diff(window.time, prepend=time)[:, None]
        pulses = 0.5 * steps * (rates + np.concatenate((rate[None], rates[:-1])))
        total = self._brought + np.cumsum(pulses, axis=0)
        self._before, self._brought = (float(window.time[-1]), rates[-1]), total[-1]
        return replace(window, tide=total)


NOT_FINITE_MOMENTUM = 'stored momentum with a NaN or infinite value'
OTHER_MOMENTUM_FRAME = 'stored momentum in another frame'
NOT_ASKED_FOR = 'stored momentum is told, and nobody asks for it: set wheels.momentum_frame'


class StoredMomentum:
    """Collects what is told until it is asked for.

    Parameters
    ----------
    model : RobotModel
    frame : name of the link in whose axes it is wanted; links fixed to it are accepted as well. Empty takes nothing

    Attributes
    ----------
    taken : number of messages
    dropped : those not used, by cause
    other_frame : frame of the last one in another
    """

    def __init__(self, model: RobotModel, frame: str) -> None:
        self._turns: dict[str, Array] = {}
        if frame:
            wanted = model.link(frame)
            same = (link for link in model.links if link.body == wanted.body)
            self._turns = {link.name: wanted.rotation.T @ link.rotation for link in same}
        self._stamps: list[int] = []
        self._vectors: list[Array] = []
        self.taken = 0
        self.dropped: Counter[str] = Counter()
        self.other_frame = ''

    def take(self, frame: str, stamp: int, momentum: Array) -> None:
        """Take a (3,) momentum, N m s, in a frame's axes at a stamp, ns."""
        if not self._turns:
            self.dropped[NOT_ASKED_FOR] += 1
        elif frame not in self._turns:
            self.other_frame = frame
            self.dropped[OTHER_MOMENTUM_FRAME] += 1
        elif not np.all(np.isfinite(momentum)):
            self.dropped[NOT_FINITE_MOMENTUM] += 1
        else:
            self.taken += 1
            self._stamps.append(stamp)
            self._vectors.append(self._turns[frame] @ momentum)

    def stream(self) -> JointStream | None:
        """Return what has come since the last call, as rates of three joints without positions; None for nothing."""
        if not self._stamps:
            return None
        stamps, vectors = np.array(self._stamps, dtype=np.int64), np.array(self._vectors)
        self._stamps, self._vectors = [], []
        return JointStream(stamps, np.zeros_like(vectors), vectors)
