"""The robots of config/ in motion, and what sensors of three qualities say of it."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.spoilt import correlated, outliers
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.geometry import Array, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, SensorNoise
from mbaid_ros.core.sensors.synchroniser import Synchroniser
from mbaid_ros.simulated_robot import make_initial_state, make_motion
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from mbaid_ros.simulation.true_robot import ErrorSizes, draw, generator, true_robot

CONFIG = Path(__file__).resolve().parents[2] / 'config'
ROBOTS = {
    'table1': 'Table 1 of the paper (planar, 4 joints)',
    'servicer7': 'servicer7 (7 joints)',
    'ets7': 'ets7 (6 joints)',
}
RATE = 100.0  # Hz
DURATION = 60.0  # s
MAXIMUM_GAP = 0.1  # s
_DIRECTION = np.array([2.0, 1.0, 2.0]) / 3.0  # of drift and offset


def _noise(encoder: float) -> SensorNoise:
    return SensorNoise(
        joint_position=encoder,
        joint_velocity=10.0 * encoder,
        base_position=1e-3,
        base_orientation=1e-4,
        base_linear_velocity=1e-3,
        base_angular_velocity=1e-4,
    )


# Quality of the encoders; that of the navigation is the same throughout.
LEVELS = {'low': _noise(1e-5), 'mid': _noise(1e-4), 'high': _noise(1e-3)}
_SILENT = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Case:
    """One situation that the methods are compared in.

    Attributes
    ----------
    robot : name of a URDF of config/
    level : quality of the encoders
    drift : m/s, velocity of the whole system's centre of mass in the odometry frame
    offset : m, distance of the base from the odometry origin
    sensors : 'all', or 'poses': joint positions and poses alone, no velocities
    wander : m / sqrt(s), random walk of the odometry's position
    correlated : s, time constant of the errors of the poses, which are white without
    outliers : share of the poses that are far off
    every : so many joint states come for each Odometry
    """

    robot: str
    level: str
    drift: float = 0.0
    offset: float = 0.0
    sensors: Literal['all', 'poses'] = 'all'
    wander: float = 0.0
    correlated: float = 0.0
    outliers: float = 0.0
    every: int = 1

    @property
    def noise(self) -> SensorNoise:
        """What the sensors add."""
        return LEVELS[self.level]

    @property
    def name(self) -> str:
        """Short, for people and files."""
        drift = f' drift {1e3 * self.drift:g} mm/s' if self.drift else ''
        away = f' {self.offset:.0e} m away' if self.offset else ''
        wander = f' wander {1e3 * self.wander:g} mm' if self.wander else ''
        alike = f' correlated over {self.correlated:g} s' if self.correlated else ''
        far = f' {100.0 * self.outliers:g} % outliers' if self.outliers else ''
        slow = f' odometry at {RATE / self.every:g} Hz' if self.every > 1 else ''
        alone = ' poses alone' if self.sensors == 'poses' else ''
        return f'{self.robot} {self.level}{drift}{away}{wander}{alike}{far}{slow}{alone}'

    @property
    def plain(self) -> bool:
        """Whether nothing is special but robot and noise."""
        return self == Case(self.robot, self.level)

    def draw(self, seed: int) -> int:
        """Return the seed of the sensors' noise.

        Robots and noise levels draw apart, so that the tables' rows do not share their luck; one robot in several
        frames draws the same, so that those rows can be compared closely.
        """
        return zlib.crc32(f'{self.robot} {self.level}'.encode()) << 32 | seed


@cache
def model(robot: str) -> RobotModel:
    """Return a robot of config/."""
    return load_model(read_robot_description(CONFIG / f'{robot}.urdf'))


@cache
def kernel(robot: str) -> MomentumKernel:
    """Return the momentum kernel of a robot whose last link is unknown."""
    return MomentumKernel(model(robot), model(robot).last_link)


def drawn(robot: str, sizes: ErrorSizes, seed: int) -> ModelErrors:
    """Return what a robot has more than its URDF says, as the simulator draws it for a seed."""
    return draw(model(robot), model(robot).last_link, sizes, generator(seed))


def true_model(robot: str, model_errors: ModelErrors | None = None) -> RobotModel:
    """Return the robot that has these errors."""
    nominal = model(robot)
    return nominal if model_errors is None else true_robot(nominal, model_errors, (nominal.last_link,))


def motion(robot: str, rate: float = RATE, model_errors: ModelErrors | None = None) -> Truth:
    """Return the true motion of a robot, as config/<robot>_simulator.yaml has it, at 0 ... 60 s.

    That of the robot that is exactly its URDF is made once.
    """
    return _exact_motion(robot, rate) if model_errors is None else _motion(robot, rate, model_errors)


@cache
def _exact_motion(robot: str, rate: float) -> Truth:
    return _motion(robot, rate, None)


def _motion(robot: str, rate: float, model_errors: ModelErrors | None) -> Truth:
    config = build(SimulatorConfig, load_parameter_file(CONFIG / f'{robot}_simulator.yaml', 'simulator'))
    moving = true_model(robot, model_errors)
    driven = make_motion(config, moving)
    simulation = Simulation(moving, driven, make_initial_state(config, moving, driven), config.step)
    return simulation.advance(np.arange(round(DURATION * rate) + 1) / rate)


def endless_motion(robot: str, rate: float = RATE, seconds: float = DURATION) -> Truth:
    """Return one period (60 s), or its beginning, of a motion that repeats exactly, from rest and without momentum.

    All joints follow cosines with whole numbers of periods a minute: in the second half minute they go back the way
    they came. Without momentum the base's pose depends on their path alone, so it comes back too.
    """
    joints = model(robot).joints
    order = np.arange(joints)
    cycles = np.column_stack((1 + order % 3, 4 + order % 4)) * 1.0
    driven = Sinusoids(
        start=0.3 * np.cos(order),
        amplitude=np.column_stack((0.35 - 0.02 * order, 0.1 + 0.01 * order)),
        frequency=cycles / DURATION,
        phase=np.full(cycles.shape, 0.5 * np.pi),
    )
    rest = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), driven.start, np.zeros(6 + joints))
    return Simulation(model(robot), driven, rest, 0.02).advance(np.arange(round(seconds * rate)) / rate)


def moved(truth: Truth, case: Case) -> Truth:
    """Return a motion seen from another frame: drifting, or far from its origin."""
    drift = case.drift * _DIRECTION
    velocity = np.broadcast_to(drift, truth.base_position.shape)
    rotation = rotation_from_quaternion(truth.base_orientation)
    return replace(
        truth,
        base_position=truth.base_position + truth.time[:, None] * drift + case.offset * _DIRECTION,
        base_linear_velocity=truth.base_linear_velocity + rotate_back(rotation, velocity),
    )


def momentum_of(robot: str, truth: Truth, model_errors: ModelErrors | None = None) -> Array:
    """Return the true (6,) total momentum, about the odometry origin."""
    return total_momentum(true_model(robot, model_errors), truth[:1])[0]


def readings(
    truth: Truth, noise: SensorNoise, seed: int | None, model_errors: ModelErrors | None = None
) -> tuple[JointStream, BaseStream]:
    """Return what sensors say of a motion; without a seed they are right, but do not know it.

    Parameters
    ----------
    truth : the motion
    noise : one standard deviation of each channel
    seed : of the noise
    model_errors : of the robot, whose zeros and mount the sensors do not know
    """
    sensors = Sensors(_SILENT, 0, model_errors) if seed is None else Sensors(noise, seed, model_errors)
    return sensed(truth, sensors, noise)


def observed(
    truth: Truth, case: Case, seed: int, model_errors: ModelErrors | None = None
) -> tuple[JointStream, BaseStream]:
    """Return what a case's sensors say of a motion.

    Parameters
    ----------
    truth : the motion, as `moved` has it
    case : Case
    seed : of the noise, before `Case.draw`
    model_errors : of the robot
    """
    joints, base = readings(truth, case.noise, case.draw(seed), model_errors)
    if case.wander:
        step = case.wander * np.sqrt(np.diff(truth.time, prepend=truth.time[0]))
        walk = step[:, None] * np.random.default_rng([seed, 1]).normal(size=base.position.shape)
        base = replace(base, position=base.position + np.cumsum(walk, axis=0))
    if case.sensors == 'poses':
        joints = replace(joints, velocity=np.full_like(joints.velocity, np.nan))
        nothing = np.full_like(base.linear_velocity, np.nan)
        base = replace(base, linear_velocity=nothing, angular_velocity=nothing)
    if case.correlated:
        base = correlated(base, truth, case.correlated)
    if case.outliers:
        base = outliers(base, case.outliers, seed)
    return joints, base[:: case.every]


def sensed(truth: Truth, sensors: Sensors, noise: SensorNoise) -> tuple[JointStream, BaseStream]:
    """Return what given sensors say of a motion, with the covariances of a given noise."""
    joints, base = sensors.joints(truth), sensors.base(truth)
    stamp = np.round(truth.time * 1e9).astype(np.int64)
    rotation = rotation_from_quaternion(base.orientation)
    shape = (len(truth), 6, 6)
    return JointStream(stamp, joints.position, joints.velocity), BaseStream(
        stamp=stamp,
        position=base.position,
        rotation=rotation,
        linear_velocity=rotate(rotation, base.linear_velocity),
        angular_velocity=rotate(rotation, base.angular_velocity),
        pose_covariance=np.broadcast_to(noise.pose_covariance(), shape),
        twist_covariance=np.broadcast_to(noise.twist_covariance(), shape),
    )


def exact_samples(truth: Truth, noise: SensorNoise, model_errors: ModelErrors | None = None) -> Samples:
    """Return noise-free samples that carry the covariances of noisy ones."""
    samples = Synchroniser(MAXIMUM_GAP).push(*readings(truth, noise, None, model_errors))
    if samples is None:
        raise ValueError('no samples')
    return samples
