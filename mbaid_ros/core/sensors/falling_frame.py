"""The frame that falls along an orbit: odometry of a frame that turns, and the tide that changes the momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross, rotate
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel, express
from mbaid_ros.core.robot.orbit import Orbit, momentum_rates
from mbaid_ros.core.samples import BaseStream, Samples


def bodies_of(model: RobotModel) -> Array:
    """Return the (n + 1, 10) standard parameters of the URDF's bodies, each in its own frame."""
    bodies = np.zeros((model.joints + 1, 10))
    for link in model.links:
        bodies[link.body] += express(link.parameters, link.rotation, link.position)
    return bodies


class FallingFrame:
    """Transforms odometry from a frame that turns with an orbit to one that falls and does not turn; adds the tide.

    Parameters
    ----------
    relative_twist : whether a measured twist is relative to the frame of the odometry
    epoch : ns, stamp at which the axes of odometry and falling frame agree; None for the first stamp
    located : whether anything locates the base; else its frame moves with the common centre of mass, about which the
        URDF's robot is then placed, and gravity only turns it

    Attributes
    ----------
    epoch : as given, or found
    """

    def __init__(
        self,
        orbit: Orbit,
        model: RobotModel,
        *,
        relative_twist: bool,
        epoch: int | None = None,
        located: bool = True,
    ) -> None:
        self._orbit = orbit
        self._located = located
        self._bodies = bodies_of(model)
        self._kinematics = Kinematics(model)
        self._relative = relative_twist
        self.epoch = epoch
        self._before: tuple[float, Array] | None = None  # time of the last sample, and its rates
        self._total: Array = np.zeros(0)

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
        covariance = measured.pose_covariance
        if self._located:
            axes = np.zeros((len(turn), 6, 6))
            axes[:, :3, :3] = axes[:, 3:, 3:] = turn
            covariance = axes @ covariance @ np.swapaxes(axes, -1, -2)
        else:
            covariance = covariance.copy()
            covariance[:, 3:, 3:] = turn @ covariance[:, 3:, 3:] @ np.swapaxes(turn, -1, -2)
        return replace(
            measured,
            position=rotate(turn, measured.position),
            rotation=turn @ measured.rotation,
            linear_velocity=rotate(turn, linear),
            angular_velocity=rotate(turn, angular),
            pose_covariance=covariance,
        )

    def applied(self, window: Samples, origin: int) -> Samples:
        """Return the next window with the tide until each of its samples; `origin` is the stamp at time 0, ns."""
        if self.epoch is None:
            self.epoch = origin
        placed = self._kinematics.configure(window.base_rotation, window.joint_position)
        after_epoch = window.time + (origin - self.epoch) * 1e-9
        position = window.base_position
        if not self._located:
            whole = np.sum(express(self._bodies, placed.rotation, placed.position), axis=1)
            position = -whole[:, 1:4] / whole[:, :1]
        rates = momentum_rates(self._orbit, after_epoch, placed, position)
        if not self._located:
            rates[..., :3, :] = 0.0
        rates = rates.reshape(len(rates), -1)
        if self._before is None:
            self._before, self._total = (float(window.time[0]), rates[0]), np.zeros(rates.shape[1])
        time, rate = self._before
        steps = np.diff(window.time, prepend=time)[:, None]
        pulses = 0.5 * steps * (rates + np.concatenate((rate[None], rates[:-1])))
        total = self._total + np.cumsum(pulses, axis=0)
        self._before, self._total = (float(window.time[-1]), rates[-1]), total[-1]
        return replace(window, tide=total)
