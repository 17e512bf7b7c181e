"""Orbits: frames that fall and turn, the gravity gradient, undeclared orbits, orbits that are no circles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from scipy.optimize import least_squares

from mbaid_ros.core.contracts import Disturbance, Motion, Words, diagonal
from mbaid_ros.core.geometry import Array, bracket, chi_square_limit, cross, exp, rotate, rotate_back, skew, unvec
from mbaid_ros.core.repair import Repair, widened
from mbaid_ros.core.results.verdict import Reason
from mbaid_ros.core.robot.model import Configuration, Kinematics, RobotModel, express
from mbaid_ros.core.samples import BaseStream, Samples
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import parameter

Frame = Literal['inertial', 'lvlh', 'hill']
Turning = Literal['lvlh', 'hill']
# Direction of up, and of the orbit's normal, in the frames that turn. CCSDS 500.0-G: LVLH has z down and y against the
# normal; Hill's frame (RSW, RTN, QSW) has x up and z along the normal.
_TURNING: dict[Turning, tuple[Array, Array]] = {
    'lvlh': (np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0])),
    'hill': (np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])),
}
TURNING_FRAMES = {frame: normal for frame, (_, normal) in _TURNING.items()}  # and the axes that they turn about
_NEWTON = 20  # steps, enough for an eccentricity of 0.9
FRAMES = ('inertial', 'lvlh', 'hill')
TWISTS = ('relative', 'inertial')
_ACROSS = 0.02  # rad, by how much nadir and normal may miss a right angle
GRAVITY, SHAPE = 'gravity gradient', 'orbit shape'
# Orthonormal symmetric matrices without trace, (5, 3, 3).
_TRACELESS = np.array(
    [
        np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / np.sqrt(2.0),
        np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) / np.sqrt(2.0),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]) / np.sqrt(2.0),
        np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0),
        np.diag([1.0, 1.0, -2.0]) / np.sqrt(6.0),
    ]
)
_NO_ORBIT = 1e-3  # chance that an orbit's gradient looks as little like one
_FALSE_ALARM = 1e-9  # chance that noise looks like a gradient as large: each window asks once, for days
_NEAR = 200.0  # m from its origin, beyond which a frame does not count as one that falls with the robot


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
    """Transforms odometry from a frame that turns with an orbit to one that falls; adds momentum by gravity.

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

    def turned(self, stamp: Array) -> Array:
        """Return the rotations (N, 3, 3) from the odometry's axes to those of the falling frame, at stamps (N,) ns."""
        if not self._orbit.is_rotating:
            return np.broadcast_to(np.eye(3), (len(stamp), 3, 3))
        return self._orbit.to_inertial((stamp - (self.epoch or 0)) * 1e-9)

    def gradient(self, stamp: Array) -> Array:
        """Return the gradients of gravity (N, 3, 3), 1/s^2, in the falling frame at stamps (N,) ns."""
        return self._orbit.gradient((stamp - (self.epoch or 0)) * 1e-9)

    def with_momentum(self, window: Samples, origin: int) -> Samples:
        """Return the next window with momentum by gravity until each sample; `origin` is the stamp at time 0, ns."""
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
        return replace(window, gravity_columns=total)


@dataclass(frozen=True)
class SimulatedOrbitConfig:
    """An orbit, and how the frame of the odometry stands to it."""

    mean_motion: float = parameter(0.0, 'rad/s', minimum=0.0, maximum=0.1)
    """Mean motion: 0.00113 at 400 km above the Earth; 0 is no orbit."""
    frame: str = parameter('inertial', choices=FRAMES)
    """Frame of the odometry, with its origin on the orbit (CCSDS 500.0-G): inertial axes, or axes that rotate with the
    orbit (lvlh, hill)."""
    nadir: tuple[float, ...] = parameter((), lengths=(0, 3))
    """Direction to the centre at the epoch in an inertial frame of the odometry."""
    normal: tuple[float, ...] = parameter((), lengths=(0, 3))
    """Direction of the orbit's angular momentum in an inertial frame of the odometry."""
    eccentricity: float = parameter(0.0, minimum=0.0, maximum=0.9)
    """Eccentricity of the orbit; 0 is a circle."""
    true_anomaly: float = parameter(0.0, 'rad')
    """True anomaly at the epoch, from the lowest point; without effect on a circle."""
    twist: str = parameter('relative', choices=TWISTS)
    """Twist in a rotating orbit.frame: relative to that frame (the ROS convention), or inertial, as a gyro measures
    it."""


@dataclass(frozen=True)
class OrbitConfig(SimulatedOrbitConfig):
    """The same with the time at which the directions are as given."""

    epoch: float = parameter(0.0, 's', minimum=0.0)
    """Stamp at which nadir has the given direction, and a rotating frame has the axes of the reported momentum; 0: the
    first sample."""
    undeclared_rate: float = parameter(1.2e-3, 'rad/s', minimum=0.0, maximum=0.1)
    """Without orbit.mean_motion: largest rate of an unknown orbit, whose gravity gradient is estimated; 0: none."""
    gradient_relative_std: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """With orbit.mean_motion: relative standard deviation of the gravity gradient of that orbit, as where it was only
    estimated from a motion; 0: exact."""
    undeclared_eccentricity: float = parameter(0.002, minimum=0.0, maximum=0.02)
    """With orbit.mean_motion but no orbit.eccentricity: largest eccentricity, which is estimated; 0: a
    circle."""


def make_orbit(config: SimulatedOrbitConfig) -> Orbit | None:
    """Return the orbit that the parameters describe, None where there is none.

    Raises ParameterError: Directions are missing, not at right angles, or given for a frame that has its own.
    """
    if config.mean_motion == 0.0:
        return None
    frame: Frame = 'lvlh' if config.frame == 'lvlh' else 'hill' if config.frame == 'hill' else 'inertial'
    given = [name for name in ('nadir', 'normal') if getattr(config, name)]
    if frame != 'inertial':
        if given:
            raise ParameterError(
                f"parameter 'orbit.{given[0]}' is given with orbit.frame: {frame}, which has its own; accepted: none"
            )
        return Orbit.rotating(config.mean_motion, frame).with_eccentricity(config.eccentricity, config.true_anomaly)
    if len(given) < 2:
        missing = 'normal' if 'nadir' in given else 'nadir'
        raise ParameterError(
            f"parameter 'orbit.{missing}' is empty with an orbit.frame that is inertial; accepted: three numbers, in "
            'the axes of the odometry'
        )
    nadir, normal = np.array(config.nadir), np.array(config.normal)
    size = float(np.linalg.norm(nadir) * np.linalg.norm(normal))
    if size == 0.0 or abs(float(nadir @ normal)) > _ACROSS * size:
        raise ParameterError(
            f"parameters 'orbit.nadir' {list(config.nadir)} and 'orbit.normal' {list(config.normal)} are not at right "
            'angles; accepted: directions that are'
        )
    return Orbit.inertial(config.mean_motion, nadir, normal).with_eccentricity(config.eccentricity, config.true_anomaly)


@dataclass(frozen=True, eq=False)
class Gravity(Disturbance):
    """The five numbers of a gradient G at the begin, 1/s^2, and of its change a second; beside a declared orbit's."""

    declared: bool = False  # whether there is such an orbit, so that a gradient contradicts nothing

    words: ClassVar = {
        GRAVITY: Words(
            remedy='an orbit: set orbit.mean_motion, or orbit.undeclared_rate to 0',
            deviation=lambda _, value: (
                f'a gravity gradient acts as at {orbit_rate(value):.2g} rad/s: set orbit.mean_motion'
            ),
        )
    }

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the change of (P, L) a second by each of them."""
        del rotation
        rates = gravity_gradient_rates(_TRACELESS, whole, origin if np.linalg.norm(origin) < _NEAR else np.zeros(3))
        return np.concatenate((rates, time[:, None, None] * rates), axis=2)

    def finding(self, mean: Array, covariance: Array) -> Reason | None:
        """Return that there is an undeclared orbit, if the data show one.

        The model is not adequate then: the gradient is estimated to first order, beside a body that it acts on and that
        is not known either. That suffices to detect it, but not for valid intervals.
        """
        if self.declared or not self.count:
            return None
        now = slice(5)  # the others are its rate
        square = float(mean[now] @ np.linalg.solve(covariance[now, now], mean[now]))
        if square <= chi_square_limit(_FALSE_ALARM, 5):
            return None
        rate, around = orbit_rate(self.factor @ mean), likeliest_orbit(self.factor, mean, covariance)
        if around is not None:
            directions = {'orbit.nadir': -around.zenith, 'orbit.normal': around.normal}
            repair = Repair(
                f'the robot is in an orbit of {1e3 * around.mean_motion:.3g} mrad/s, in axes that do not turn',
                {
                    'orbit.mean_motion': float(f'{around.mean_motion:.6g}'),
                    'orbit.gradient_relative_std': 1.0,
                    **{name: tuple(np.round(value, 6).tolist()) for name, value in directions.items()},
                },
                value=around.mean_motion,
                unit='rad/s',
            )
            return Reason(orbit_fixed_frame(around.mean_motion), 'contradiction', 0.5 * square, repair)
        repair = Repair(
            f'the frame of the odometry may turn with an orbit that is not set, at {1e3 * rate:.2g} mrad/s',
            {'odometry.turning_std': widened(rate)},
            value=rate,
            unit='rad/s',
        )
        return Reason(orbit_fixed_frame(rate), 'contradiction', 0.5 * square, repair)


def gradient_numbers(around: Orbit) -> Array:
    """Return the (10,) numbers of an orbit's gradient at its epoch, 1/s^2, and of its change a second, 1/s^3."""
    early, now, late = around.gradient(np.array([-1.0, 0.0, 1.0]))
    return np.concatenate([np.einsum('kij,ij->k', _TRACELESS, each) for each in (now, 0.5 * (late - early))])


def likeliest_orbit(factor: Array, mean: Array, covariance: Array) -> Orbit | None:
    """Return the circular orbit whose gradient the data suggest, in axes that do not turn; None if they suggest none.

    Any other disturbance makes a gradient of five free numbers, of which two have to agree with each other in an orbit.

    Parameters
    ----------
    factor : (10, 10) of the gradient's numbers, by numbers of unit variance a priori
    mean, covariance : (10,), (10, 10) of these, after the data
    """
    variance, directions = np.linalg.eigh(covariance)
    variance = np.clip(variance, 1e-9, 1.0 - 1e-9)
    weight = np.sqrt(1.0 / variance - 1.0)  # of the data without the prior, along each direction
    wanted = weight * (directions.T @ mean) / (1.0 - variance)
    back = weight[:, None] * directions.T @ np.linalg.inv(factor)
    gradient, change = np.tensordot((factor @ mean).reshape(2, 5), _TRACELESS, 1)
    up = np.linalg.eigh(gradient)[1][:, -1]
    ahead = change @ up - (up @ change @ up) * up
    if not ahead.any():
        ahead = cross(up, np.eye(3)[np.argmin(np.abs(up))])
    across = cross(up, ahead / np.linalg.norm(ahead))
    rate = orbit_rate(factor @ mean)

    def orbit(numbers: Array) -> Orbit:
        turn = exp(numbers[1:])
        return Orbit(rate * float(np.exp(numbers[0])), turn @ up, turn @ across, is_rotating=False)

    fit = least_squares(lambda numbers: back @ gradient_numbers(orbit(numbers)) - wanted, np.zeros(4), method='lm')
    return orbit(fit.x) if 2.0 * fit.cost <= chi_square_limit(_NO_ORBIT, 6) else None


def gravity_gradient_rates(gradients: Array, whole: Array, origin: Array) -> Array:
    """Return the changes of (P, L) a second, (B, 6, k), by (k, 3, 3) or (B, k, 3, 3) gradients; as `momentum_rates`."""
    mass, first, inertia = whole[:, 0], whole[:, 1:4], unvec(whole[:, 4:])
    second = 0.5 * np.trace(inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) - inertia
    weighed = (second + first[:, :, None] * origin)[:, None] @ gradients  # (B, k, 3, 3)
    rates = np.zeros((len(whole), 6, gradients.shape[-3]))
    rates[:, :3] = np.swapaxes((gradients @ (first + mass[:, None] * origin)[:, None, :, None])[..., 0], 1, 2)
    for axis, (one, other) in enumerate(((1, 2), (2, 0), (0, 1))):
        rates[:, 3 + axis] = weighed[..., one, other] - weighed[..., other, one]
    return rates


def gravity(rate: float) -> Gravity:
    """Return the gradient as an unknown, that of a circular orbit at a rate (rad/s) in a plane of any direction."""
    size = np.sqrt(6.0 / 5.0) * rate**2
    deviations = np.repeat((size, np.sqrt(3.0) * rate * size), len(_TRACELESS))
    return Gravity(diagonal(deviations), (GRAVITY,) * len(deviations))


def orbit_rate(value: Array) -> float:
    """Return the mean motion, rad/s, of an orbit with a gradient of (10,) numbers at the begin."""
    return float((value[:5] @ value[:5] / 6.0) ** 0.25)


@dataclass(frozen=True, eq=False)
class NominalOrbit:
    """A circular orbit that may be none."""

    orbit: Orbit  # the circle, the epoch at the begin of the run
    eccentricity: float  # up to which it may be none
    relative_twist: bool = True  # whether the twist is read relative to a frame that turns


@dataclass(frozen=True, eq=False)
class OrbitShape(Disturbance):
    """The numbers k, h and d of an orbit beside its circle (orbit.md)."""

    circle: NominalOrbit

    words: ClassVar = {
        SHAPE: Words(
            'eccentricity and mean motion of the orbit',
            'orbit.undeclared_eccentricity, or set orbit.eccentricity and orbit.true_anomaly',
            'the shape of the orbit: set orbit.eccentricity, or orbit.undeclared_eccentricity to 0',
            lambda _, __: (
                'the orbit is no circle, or orbit.mean_motion is wrong: set orbit.eccentricity and orbit.true_anomaly'
            ),
        )
    }

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the momentum by gravity beside that of the circle."""
        del rotation
        orbit = self.circle.orbit
        gradient, normal = orbit.gradient(time), skew(orbit.normal)
        brought = gravity_gradient_rates(gradient[:, None], whole, origin)
        if orbit.is_rotating:
            # The run's origin is read turned, too.
            turned: Array = np.concatenate((normal @ brought[:, :3], normal @ brought[:, 3:]), axis=1)
            turned[:, 3:] += skew(np.cross(orbit.normal, origin)) @ brought[:, :3]
        else:
            turned = gravity_gradient_rates((normal @ gradient - gradient @ normal)[:, None], whole, origin)
        ahead, stronger = self._orbit_sensitivity(time)[::2]
        return np.asarray(brought * stronger[:, None] + turned * ahead[:, None])

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return the rotation of a co-rotating frame back, about its own origin."""
        relative = sensor == 'pose' or (sensor == 'twist' and self.circle.relative_twist)
        if not (relative and self.circle.orbit.is_rotating):
            return None
        normal = np.broadcast_to(self.circle.orbit.normal, motion.position.shape)
        turn = np.concatenate((normal, cross(normal, motion.origin + motion.position)), axis=1)[..., None]
        ahead, faster, _ = self._orbit_sensitivity(motion.time)
        return np.asarray(-turn * (ahead if sensor == 'pose' else faster)[:, None])

    def _orbit_sensitivity(self, time: Array) -> tuple[Array, Array, Array]:
        """Return how D, its rate and s depend on the numbers, (N, 3) each."""
        n = self.circle.orbit.mean_motion
        angle, one = n * time, np.ones(len(time))
        sine, cosine = np.sin(angle), np.cos(angle)
        ahead = np.column_stack((2.0 * sine, 2.0 * cosine - 2.0, angle))
        faster = n * np.column_stack((2.0 * cosine, -2.0 * sine, one))
        return ahead, faster, np.column_stack((3.0 * cosine, -3.0 * sine, 2.0 * one))


def orbit_shape(circle: NominalOrbit) -> OrbitShape:
    """Return an orbit's deviation from a circle as an unknown: each number is the eccentricity in one direction."""
    return OrbitShape(np.sqrt(0.5) * circle.eccentricity * np.eye(3), (SHAPE,) * 3, circle)


def falling_frame(config: OrbitConfig, model: RobotModel, *, located: bool = True) -> FallingFrame | None:
    """Return the transformation of odometry to the frame in free fall, None without an orbit.

    Raises ParameterError: The directions do not make an orbit.
    """
    orbit = make_orbit(config)
    if orbit is None:
        return None
    epoch = round(config.epoch * 1e9) if config.epoch > 0.0 else None
    return FallingFrame(orbit, model, relative_twist=config.twist == 'relative', epoch=epoch, located=located)


def declared_gravity(config: OrbitConfig, *, located: bool) -> Gravity:
    """Return the gravity gradient of an orbit that may be there undeclared, or the error of that of a declared one."""
    if not located or config.mean_motion == 0.0:
        return gravity(config.undeclared_rate if located else 0.0)
    if config.gradient_relative_std == 0.0:
        return gravity(0.0)
    beside = gravity(config.mean_motion)
    return replace(beside, factor=config.gradient_relative_std * beside.factor, declared=True)


def declared_orbit_shape(config: OrbitConfig) -> tuple[OrbitShape, ...]:
    """Return the shape of the orbit; none where its eccentricity is declared, or there is no orbit."""
    circle = _uncertain_circle(config)
    return () if circle is None else (orbit_shape(circle),)


def _uncertain_circle(config: OrbitConfig) -> NominalOrbit | None:
    """Return the orbit whose eccentricity is estimated; None where it is declared, or there is no orbit."""
    orbit = make_orbit(config)
    if orbit is None or config.eccentricity > 0.0 or config.epoch > 0.0 or config.undeclared_eccentricity == 0.0:
        return None
    return NominalOrbit(orbit, config.undeclared_eccentricity, config.twist == 'relative')
