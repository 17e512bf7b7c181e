"""An orbit, odometry in frames that turn with it, and the momentum change by its gravity gradient: the tide.

The falling frame does not turn, and has the axes of the odometry's frame at the epoch. Up is away from the centre; the
orbit turns about its normal, at the mean motion if it is circular.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mbaid_ros.core.geometry import Array, bracket, cross, exp, rotate, rotate_back, skew
from mbaid_ros.core.robot.kinematics import Configuration, Kinematics
from mbaid_ros.core.robot.model import RobotModel, express
from mbaid_ros.core.samples import BaseStream, Samples

Frame = Literal['inertial', 'lvlh', 'hill']
Turning = Literal['lvlh', 'hill']

# Direction of up, and of the orbit's normal, in the frames that turn. CCSDS 500.0-G: LVLH has z down and y against the
# normal; Hill's frame (RSW, RTN, QSW) has x up and z along the normal.
_TURNING: dict[Turning, tuple[Array, Array]] = {
    'lvlh': (np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0])),
    'hill': (np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])),
}
_NEWTON = 20  # steps, enough for an eccentricity of 0.9


@dataclass(frozen=True, eq=False)
class Orbit:
    """An orbit of one body about another (Kepler)."""

    mean_motion: float  # rad/s
    # up, normal: (3,) unit vectors at the epoch, in the frame that falls along
    zenith: Array
    normal: Array
    is_rotating: bool  # whether the frame of the odometry turns with the orbit
    eccentricity: float = 0.0  # 0 is a circle
    anomaly: float = 0.0  # rad, true anomaly at the epoch: how far past the lowest point

    @staticmethod
    def rotating(mean_motion: float, frame: Turning) -> Orbit:
        """Return the orbit of a frame of the odometry that turns with it."""
        return Orbit(mean_motion, *_TURNING[frame], is_rotating=True)

    @staticmethod
    def inertial(mean_motion: float, nadir: Array, normal: Array) -> Orbit:
        """Return the orbit of a frame that does not turn, with (3,) nadir, projected, and normal at the epoch."""
        across = normal / np.linalg.norm(normal)
        down = nadir - (nadir @ across) * across
        return Orbit(mean_motion, -down / np.linalg.norm(down), across, is_rotating=False)

    def with_eccentricity(self, eccentricity: float, anomaly: float) -> Orbit:
        """Return the same with an eccentricity below 1, at a true anomaly (rad) at the epoch."""
        return replace(self, eccentricity=eccentricity, anomaly=anomaly)

    def swept_angle(self, time: Array) -> Array:
        """Return the (N,) changes of the true anomaly, rad, (N,) s after the epoch."""
        passed, e = self.mean_motion * np.asarray(time), self.eccentricity
        if e == 0.0:
            return passed
        ratio = np.sqrt((1.0 + e) / (1.0 - e))
        begin = 2.0 * np.arctan2(np.sin(0.5 * self.anomaly), ratio * np.cos(0.5 * self.anomaly))
        mean = begin - e * np.sin(begin) + passed
        eccentric = mean + e * np.sin(mean)
        for _ in range(_NEWTON):  # Kepler's equation
            eccentric = eccentric - (eccentric - e * np.sin(eccentric) - mean) / (1.0 - e * np.cos(eccentric))
        true = 2.0 * np.arctan2(ratio * np.sin(0.5 * eccentric), np.cos(0.5 * eccentric))
        return np.asarray(true - self.anomaly)

    def gradient_strength(self, time: Array) -> Array:
        """Return the (N,) mu / r^3, 1/s^2, (N,) s after the epoch."""
        return np.asarray(self.mean_motion**2 * self._axis_over_radius(time) ** 3)

    def rate(self, time: Array) -> Array:
        """Return the (N, 3) angular velocities of the turning frame, rad/s, in the axes of either frame."""
        pace = self.mean_motion * np.sqrt(1.0 - self.eccentricity**2) * self._axis_over_radius(time) ** 2
        return np.asarray(pace[:, None] * self.normal)

    def _axis_over_radius(self, time: Array) -> Array:
        """Return the (N,) ratios of the semi-major axis to the distance from the centre."""
        anomaly = self.anomaly + self.swept_angle(time)
        return np.asarray((1.0 + self.eccentricity * np.cos(anomaly)) / (1.0 - self.eccentricity**2))

    def with_epoch(self, time: float) -> Orbit:
        """Return the orbit with its epoch a time (s) later; for a frame that does not turn."""
        begin = np.array([time])
        return replace(self, zenith=self.zenith_at(begin)[0], anomaly=self.anomaly + float(self.swept_angle(begin)[0]))

    def to_inertial(self, time: Array) -> Array:
        """Return the (N, 3, 3) rotations from the turning frame's axes to inertial ones, (N,) s after the epoch."""
        return exp(self.swept_angle(time)[:, None] * self.normal)

    def zenith_at(self, time: Array) -> Array:
        """Return the (N, 3) unit vectors away from the centre, inertial axes, (N,) s after the epoch."""
        angle = self.swept_angle(time)[:, None]
        return np.asarray(np.cos(angle) * self.zenith + np.sin(angle) * cross(self.normal, self.zenith))

    def gradient(self, time: Array) -> Array:
        """Return the (N, 3, 3) gradients G of gravity, 1/s^2: at x from the origin a body falls by G x faster."""
        up, strength = self.zenith_at(time), self.gradient_strength(time)[:, None, None]
        return np.asarray(strength * (3.0 * up[:, :, None] * up[:, None, :] - np.eye(3)))


def orbit_fixed_frame(rate: float) -> str:
    """Return the cause in words: the odometry's frame turns at a rate, rad/s, as those of an orbit do."""
    return f'looks like gravity gradient or an orbit-fixed frame at about {rate:.2g} rad/s: set orbit.mean_motion'


def momentum_rates(orbit: Orbit, time: Array, configuration: Configuration, base_position: Array) -> Array:
    """Return the rate of (P, L) about the frame's origin by each body's standard parameters, (N, n + 1, 6, 10).

    `time` (N,) s after the epoch, `configuration` and `base_position` (N, 3) m at these instants.
    """
    rotation, place = configuration.rotation, base_position[:, None] + configuration.position
    gradient, up = orbit.gradient(time)[:, None], orbit.zenith_at(time)[:, None]
    pull = (gradient @ place[..., None])[..., 0]
    first = gradient @ rotation
    seen = rotate_back(rotation, np.broadcast_to(up, place.shape))
    rates = np.zeros((*place.shape[:2], 6, 10))
    rates[..., :3, 0], rates[..., :3, 1:4] = pull, first
    rates[..., 3:, 0] = cross(place, pull)
    rates[..., 3:, 1:4] = skew(place) @ first - skew(pull) @ rotation
    strength = orbit.gradient_strength(time)[:, None, None, None]
    rates[..., 3:, 4:] = 3.0 * strength * (rotation @ (skew(seen) @ bracket(seen)))
    return rates


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
        self, orbit: Orbit, model: RobotModel, *, relative_twist: bool, epoch: int | None = None, located: bool = True
    ) -> None:
        self._orbit = orbit
        self._located = located
        self._bodies = model.body_parameters()
        self._kinematics = Kinematics(model)
        self._relative = relative_twist
        self.epoch = epoch
        self._before: tuple[float, Array] | None = None  # time of the last sample, and its rates
        self._total: Array = np.zeros(0)

    def to_falling_frame(self, measured: BaseStream) -> BaseStream:
        """Return measurements in the frame of the odometry as seen from the falling one."""
        if not self._orbit.is_rotating:
            return measured
        if self.epoch is None:
            self.epoch = int(measured.stamp[0])
        passed = (measured.stamp - self.epoch) * 1e-9
        turn, rate = self._orbit.to_inertial(passed), self._orbit.rate(passed)
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

    def with_momentum(self, window: Samples, origin: int) -> Samples:
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
