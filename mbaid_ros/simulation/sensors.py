"""Encoders, navigation and IMU: their readings of the true motion, and when each is read."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.core.robot.model import Kinematics, Link, RobotModel
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.simulation import PiecewiseSimulation, Simulation, Truth
from mbaid_ros.simulation.true_robot import ModelErrors, as_measured


@dataclass(frozen=True)
class ImuErrors:
    """The errors of an IMU."""

    noise_density: float = 0.0  # rad/s/sqrt(Hz)
    bias: tuple[float, ...] = (0.0, 0.0, 0.0)  # (3,) rad/s at the begin
    bias_walk: float = 0.0  # rad/s/sqrt(s)
    scale: tuple[float, ...] = (0.0, 0.0, 0.0)  # (3,) relative error of each axis
    # rad, white noise of the orientation, about fixed axes; 0 is an IMU without orientation
    orientation: float = 0.0
    turn: tuple[float, ...] = (0.0, 0.0, 0.0)  # rad, of its axes on its link, a rotation vector


@dataclass(frozen=True)
class ImuReadings:
    """N readings, in the axes of the link that it is on."""

    time: Array  # (N,) s since the start of the run
    angular_velocity: Array  # (N, 3) rad/s
    orientation: Array  # (N, 4) quaternions (x, y, z, w) from those axes to the odometry's; (N, 0) if there are none
    orientation_std: float = 0.0  # rad, of its noise
    link: str = ''  # name of that link; empty is the base link


@dataclass(frozen=True)
class PoseErrors:
    """What a sensor of poses locates, and its errors."""

    measures: str = 'both'  # 'position', 'orientation' or 'both'
    place: tuple[float, ...] = (0.0, 0.0, 0.0)  # m, of the point that it locates, in the frame of its link
    turn: tuple[float, ...] = (0.0, 0.0, 0.0)  # rad, of its axes there, a rotation vector
    position: float = 0.0  # m, noise of each coordinate
    orientation: float = 0.0  # rad, noise about each axis
    correlation_time: float = 0.0  # s, of both; 0: white
    world_turn: tuple[float, ...] = (0.0, 0.0, 0.0)  # rad, from the odometry's frame to its own
    world_position: tuple[float, ...] = (0.0, 0.0, 0.0)  # m, of the odometry's frame in its own


@dataclass(frozen=True)
class PoseReadings:
    """N readings of a sensor of poses, in its own frame."""

    time: Array  # (N,) s since the start of the run
    position: Array  # (N, 3) m
    orientation: Array  # (N, 4) quaternions (x, y, z, w) from the axes of its link
    measures: str


class PoseTracker:
    """A star tracker, a camera or motion capture with seeded errors, however its readings are cut into batches.

    Parameters
    ----------
    seed : the same one gives the same noise
    robot, link : the one that moves, and the link that is located
    view : converts a motion into the frame of the odometry, if that is not the falling one
    """

    def __init__(
        self,
        rate: float,
        errors: PoseErrors,
        seed: Sequence[int],
        robot: RobotModel,
        link: Link,
        view: Callable[[Truth], Truth] | None = None,
    ) -> None:
        self.rate = rate
        self._errors, self._link, self._view = errors, link, view
        self._kinematics = Kinematics(robot)
        self._noise = np.random.default_rng(np.random.SeedSequence(seed))
        self._last: Array = np.full(6, np.nan)

    def readings(self, truth: Truth) -> PoseReadings:
        """Return its readings of the true motion at the next N of its instants."""
        errors, seen = self._errors, truth if self._view is None else self._view(truth)
        placed = self._kinematics.configure(rotation_from_quaternion(seen.base_orientation), seen.joint_position)
        turned, away = placed.link_pose(self._link)
        noise = self._errors_of(len(truth.time))
        rotation = exp(errors.orientation * noise[:, :3]) @ turned @ exp(np.array(errors.turn))
        position = seen.base_position + away + rotate(turned, np.array(errors.place)) + errors.position * noise[:, 3:]
        world = exp(np.array(errors.world_turn))
        return PoseReadings(
            truth.time,
            position @ world.T + np.array(errors.world_position),
            quaternion_from_rotation(world @ rotation),
            errors.measures,
        )

    def _errors_of(self, count: int) -> Array:
        """Return the next errors of unit size (N, 6): a first-order Gauss-Markov process, or white."""
        white = self._noise.standard_normal((count, 6))
        time = self._errors.correlation_time
        if time == 0.0:
            return white
        kept = math.exp(-1.0 / (self.rate * time))
        for each in white:
            each[:] = each if np.isnan(self._last).any() else kept * self._last + math.sqrt(1.0 - kept**2) * each
            self._last = each.copy()
        return white


class Imu:
    """A gyro with seeded errors; they do not depend on how the readings are cut into batches.

    Parameters
    ----------
    seed : the same seed gives the same noise
    robot : the one that moves, where it is on a link that is not the base link
    link : that one
    """

    def __init__(
        self,
        rate: float,
        errors: ImuErrors,
        seed: int | Sequence[int],
        robot: RobotModel | None = None,
        link: Link | None = None,
    ) -> None:
        self.rate = rate
        self._errors = errors
        self._kinematics = None if robot is None else Kinematics(robot)
        self._link = link
        streams = np.random.SeedSequence(seed).spawn(3)
        self._noise, self._walk, self._attitude = (np.random.default_rng(stream) for stream in streams)
        self._bias: Array = np.array(errors.bias, dtype=float)

    def readings(self, truth: Truth) -> ImuReadings:
        """Return its readings of the true motion at the next N of its instants."""
        errors = self._errors
        orientation, angular_velocity = self._of_link(truth)
        if any(errors.turn):
            axes = exp(np.array(errors.turn))
            angular_velocity = angular_velocity @ axes
            orientation = quaternions.product(orientation, quaternion_from_rotation(axes))
        shape = angular_velocity.shape
        steps = errors.bias_walk / np.sqrt(self.rate) * self._walk.standard_normal(shape)
        bias = np.cumsum(np.concatenate((self._bias[None], steps)), axis=0)
        self._bias = bias[-1]
        noise = errors.noise_density * np.sqrt(self.rate) * self._noise.standard_normal(shape)
        turn = errors.orientation * self._attitude.standard_normal(shape)
        measured = quaternions.product(quaternions.exp(turn), orientation)
        return ImuReadings(
            truth.time,
            (1.0 + np.array(errors.scale)) * angular_velocity + bias[:-1] + noise,
            measured if errors.orientation > 0.0 else measured[:, :0],
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
        turned, _ = placed.link_pose(self._link)  # to base axes
        own = quaternion_from_rotation(turned)
        return quaternions.product(orientation, own), rotate_back(turned, bodies[:, self._link.body, 3:])


# A reading due within this of a limit (in periods) is due at it: k / rate is rounded.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class JointReadings:
    """N readings of the joints."""

    time: Array  # (N,) s since the start of the run
    # position, velocity, effort: (N, n) rad, rad/s, N m (m, m/s, N for a prismatic joint)
    position: Array
    velocity: Array
    effort: Array
    wheel_speed: Array  # (N, w) rad/s


@dataclass(frozen=True)
class BaseReadings:
    """N readings of the base link's pose and twist."""

    time: Array  # (N,) s since the start of the run
    position: Array  # (N, 3) m, in the odometry frame
    orientation: Array  # (N, 4) unit quaternion (x, y, z, w), base link to odometry frame
    linear_velocity: Array  # (N, 3) m/s, in base axes
    angular_velocity: Array  # (N, 3) rad/s, in base axes
    pose_covariance: Array  # (6, 6) of position and orientation, odometry axes
    twist_covariance: Array  # (6, 6) of linear and angular velocity, base axes


class Sensors:
    """Encoders and navigation with seeded noise.

    Every channel draws from a stream of its own: the noise of one depends neither on how many readings another gave,
    nor on how the readings are cut into batches.

    Parameters
    ----------
    noise : one standard deviation of each channel; 0 is none
    seed : the same seed gives the same noise
    errors : deviations of the robot from its URDF; the sensors ignore zeros and mount
    wheel_noise : rad/s, of the speed of wheels inside the base
    view : converts a motion into the frame of the odometry, if that is not the falling one
    """

    def __init__(
        self,
        noise: SensorNoise,
        seed: int,
        errors: ModelErrors | None = None,
        wheel_noise: float = 0.0,
        view: Callable[[Truth], Truth] | None = None,
    ) -> None:
        self.noise = noise
        self._errors = errors
        self._wheel_noise = wheel_noise
        self._view = view
        streams = np.random.SeedSequence(seed).spawn(7)
        self._encoder, self._rate, self._place, self._attitude, self._speed, self._gyroscope, self._tachometer = (
            np.random.default_rng(stream) for stream in streams
        )

    def joints(self, truth: Truth) -> JointReadings:
        """Return the encoders' readings of the true motion."""
        noise, truth = self.noise, self._without_noise(truth)
        return JointReadings(
            time=truth.time,
            position=truth.joint_position + _white(self._encoder, noise.joint_position, truth.joint_position),
            velocity=truth.joint_velocity + _white(self._rate, noise.joint_velocity, truth.joint_velocity),
            effort=truth.joint_effort,
            wheel_speed=truth.wheel_speed + _white(self._tachometer, self._wheel_noise, truth.wheel_speed),
        )

    def base(self, truth: Truth) -> BaseReadings:
        """Return the navigation's readings of the true motion.

        The orientation's error is a small rotation about the fixed axes of the odometry frame, as the covariance of a
        ROS pose has it.
        """
        noise, truth = self.noise, self._without_noise(truth)
        error = _white(self._attitude, noise.base_orientation, truth.base_position)
        linear = truth.base_linear_velocity
        angular = truth.base_angular_velocity
        return BaseReadings(
            time=truth.time,
            position=truth.base_position + _white(self._place, noise.base_position, truth.base_position),
            orientation=quaternions.product(quaternions.exp(error), truth.base_orientation),
            linear_velocity=linear + _white(self._speed, noise.base_linear_velocity, linear),
            angular_velocity=angular + _white(self._gyroscope, noise.base_angular_velocity, angular),
            pose_covariance=noise.pose_covariance(),
            twist_covariance=noise.twist_covariance(),
        )

    def _without_noise(self, truth: Truth) -> Truth:
        seen = truth if self._view is None else self._view(truth)
        return seen if self._errors is None else as_measured(seen, self._errors)


class SensedSimulation:
    """A simulated run as its sensors report it.

    Parameters
    ----------
    simulation : the true motion
    joint_rate, odometry_rate : readings a second, from time 0 on
    further : gyros and sensors of poses by their topics
    """

    def __init__(
        self,
        simulation: Simulation | PiecewiseSimulation,
        sensors: Sensors,
        joint_rate: float,
        odometry_rate: float,
        further: Mapping[str, Imu | PoseTracker] | None = None,
    ) -> None:
        self._simulation = simulation
        self._sensors = sensors
        self._further = further or {}
        self._rates = (joint_rate, odometry_rate, *(each.rate for each in self._further.values()))
        self._given = [0] * len(self._rates)

    def read(self, until: float) -> tuple[JointReadings, BaseReadings, dict[str, ImuReadings | PoseReadings]]:
        """Return the readings that are due up to and including a time (s) and have not been returned before.

        Raises ModelError: The motion has diverged.
        """
        times = [self._due(sensor, until) for sensor in range(len(self._rates))]
        instants = reduce(np.union1d, times)
        truth = self._simulation.advance(instants)
        joints, base, *others = (truth[np.searchsorted(instants, time)] for time in times)
        further = {name: each.readings(seen) for (name, each), seen in zip(self._further.items(), others, strict=True)}
        return self._sensors.joints(joints), self._sensors.base(base), further

    def _due(self, sensor: int, until: float) -> Array:
        rate = self._rates[sensor]
        count = math.floor(until * rate + _ROUNDING) + 1
        indices = np.arange(self._given[sensor], max(count, self._given[sensor]))
        self._given[sensor] += len(indices)
        # Dividing, not adding periods: readings of two sensors that are due together get the very same time.
        return indices / rate


def _white(generator: np.random.Generator, deviation: float, like: Array) -> Array:
    return deviation * generator.standard_normal(like.shape)
