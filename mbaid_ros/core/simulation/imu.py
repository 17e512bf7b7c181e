"""An IMU: its gyro reads the true angular velocity with noise, a bias that walks, and scales of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, quaternion_from_rotation, rotate_back
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.simulation import quaternions
from mbaid_ros.core.simulation.run import Truth


@dataclass(frozen=True)
class ImuErrors:
    """What an IMU reads wrong.

    Attributes
    ----------
    noise_density : rad/s/sqrt(Hz)
    bias : (3,) rad/s at the begin
    bias_walk : rad/s/sqrt(s)
    scale : (3,) by what part each axis reads too much
    orientation : rad, white noise of the orientation that it tells, about fixed axes; 0 is that it tells none
    """

    noise_density: float = 0.0
    bias: tuple[float, ...] = (0.0, 0.0, 0.0)
    bias_walk: float = 0.0
    scale: tuple[float, ...] = (0.0, 0.0, 0.0)
    orientation: float = 0.0


@dataclass(frozen=True)
class ImuReadings:
    """N readings, in the axes of the link that it is on.

    Attributes
    ----------
    time : (N,) s since the start of the run
    angular_velocity : (N, 3) rad/s
    orientation : (N, 4) quaternions (x, y, z, w) from those axes to the odometry's; (N, 0) where it tells none
    orientation_std : rad, of its noise
    link : name of that link; empty is the base link
    """

    time: Array
    angular_velocity: Array
    orientation: Array
    orientation_std: float = 0.0
    link: str = ''


class Imu:
    """A gyro with seeded errors; they do not depend on how the readings are cut into batches.

    Parameters
    ----------
    rate : Hz
    errors : ImuErrors
    seed : the same seed gives the same noise
    robot : the one that moves, where it is on a link that is not the base link
    link : that one
    """

    def __init__(
        self, rate: float, errors: ImuErrors, seed: int, robot: RobotModel | None = None, link: Link | None = None
    ) -> None:
        self.rate = rate
        self._errors = errors
        self._kinematics = None if robot is None else Kinematics(robot)
        self._link = link
        streams = np.random.SeedSequence(seed).spawn(3)
        self._noise, self._walk, self._attitude = (np.random.default_rng(stream) for stream in streams)
        self._bias: Array = np.array(errors.bias, dtype=float)

    def readings(self, truth: Truth) -> ImuReadings:
        """Return what it reads of the true motion at the next N of its instants."""
        errors = self._errors
        orientation, angular_velocity = self._of_link(truth)
        shape = angular_velocity.shape
        steps = errors.bias_walk / np.sqrt(self.rate) * self._walk.standard_normal(shape)
        bias = np.cumsum(np.concatenate((self._bias[None], steps)), axis=0)
        self._bias = bias[-1]
        noise = errors.noise_density * np.sqrt(self.rate) * self._noise.standard_normal(shape)
        turn = errors.orientation * self._attitude.standard_normal(shape)
        told = quaternions.product(quaternions.exp(turn), orientation)
        return ImuReadings(
            truth.time,
            (1.0 + np.array(errors.scale)) * angular_velocity + bias[:-1] + noise,
            told if errors.orientation > 0.0 else told[:, :0],
            errors.orientation,
            '' if self._link is None else self._link.name,
        )

    def _of_link(self, truth: Truth) -> tuple[Array, Array]:
        """Return the orientation (N, 4) and the angular velocity (N, 3), in its own axes, of the link that it is on."""
        orientation, rate = truth.base_orientation, truth.base_angular_velocity
        if self._kinematics is None or self._link is None:
            return orientation, rate
        placed = self._kinematics.configure(np.tile(np.eye(3), (len(rate), 1, 1)), truth.joint_position)
        twist = np.concatenate((np.zeros_like(rate), rate), axis=1)
        bodies = self._kinematics.body_twists(placed, truth.joint_velocity, twist)
        turned, _ = placed.link(self._link)  # to base axes
        own = quaternion_from_rotation(turned)
        return quaternions.product(orientation, own), rotate_back(turned, bodies[:, self._link.body, 3:])
