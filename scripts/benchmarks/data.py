"""Robots of config/ in motion, and the readings of sensors of three qualities."""

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.honesty.readings import Defect, Readings, correlated, outliers, read_by, thinned, wandering
from mbaid_ros.bags import BAG_TYPES, BagWriter
from mbaid_ros.config.parameter_files import load_parameter_file, read_robot_description
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.geometry import Array, rotate, rotation_from_quaternion
from mbaid_ros.core.pipeline import Synchroniser
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, SensorNoise
from mbaid_ros.parameters import build
from mbaid_ros.sensor_messages import Joints, Poses, Thrust, in_order, joints_of, poses_of
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from mbaid_ros.simulation.true_robot import ErrorStds, ModelErrors, draw, generator, true_robot

CONFIG = Path(__file__).resolve().parents[2] / 'config'
ROBOTS = {
    'table1': 'Table 1 of the paper (planar, 4 joints)',
    'servicer7': 'servicer7 (7 joints)',
    'ets7': 'ets7 (6 joints)',
}
RATE = 100.0  # Hz
DURATION = 60.0  # s
MAXIMUM_GAP = 0.1  # s
START = 1_700_000_000_000_000_000  # ns, stamp at time 0
JOINTS, ODOMETRY = '/joint_states', '/odom'
_MESSAGES_AT_ONCE = 2_000  # as in `replay`


# Quality of the encoders; that of the navigation is the same throughout.
LEVELS = {
    level: SensorNoise(encoder, 10.0 * encoder, 1e-3, 1e-4, 1e-3, 1e-4)
    for level, encoder in {'low': 1e-5, 'mid': 1e-4, 'high': 1e-3}.items()
}
NOISE = LEVELS['mid']


@dataclass(frozen=True)
class Case:
    """A robot, and the quality of its sensors."""

    robot: str  # name of a URDF of config/
    level: str  # of encoder noise
    sensors: Literal['all', 'poses'] = 'all'  # 'poses': joint positions and base poses, no velocities
    wander: float = 0.0  # m / sqrt(s), random walk of the odometry's position
    correlated: float = 0.0  # s, time constant of the pose errors; 0: white
    outliers: float = 0.0  # share of the poses
    every: int = 1  # joint states for each Odometry

    @property
    def noise(self) -> SensorNoise:
        """Standard deviations of the sensors."""
        return LEVELS[self.level]

    @property
    def name(self) -> str:
        """Short, for tables and files."""
        parts = {
            f'wander {1e3 * self.wander:g} mm': self.wander,
            f'correlated over {self.correlated:g} s': self.correlated,
            f'{100.0 * self.outliers:g} % outliers': self.outliers,
            f'odometry at {RATE / self.every:g} Hz': self.every > 1,
            'poses alone': self.sensors == 'poses',
        }
        return ' '.join([self.robot, self.level, *(text for text, given in parts.items() if given)])

    @property
    def plain(self) -> bool:
        """Whether all sensors work."""
        return self == Case(self.robot, self.level)

    @property
    def defects(self) -> list[Defect]:
        """Those of its odometry."""
        sizes: dict[Any, float] = {wandering: self.wander, correlated: self.correlated, outliers: self.outliers}
        found: list[Defect] = [partial(defect, size) for defect, size in sizes.items() if size]
        return [*found, partial(thinned, self.every)]


@cache
def model(robot: str) -> RobotModel:
    """Return a robot of config/."""
    return load_model(read_robot_description(CONFIG / f'{robot}.urdf'))


@cache
def kernel(robot: str) -> MomentumKernel:
    """Return the momentum kernel of a robot whose last link is unknown."""
    return MomentumKernel(model(robot), model(robot).last_link)


@cache
def target(robot: str) -> Array:
    """Return the true (10,) physical parameters of a robot's last link."""
    return physical(kernel(robot).target.parameters)


def drawn(robot: str, sizes: ErrorStds, seed: int) -> ModelErrors:
    """Return the errors of a robot's URDF, drawn as the simulator draws them."""
    return draw(model(robot), model(robot).last_link, sizes, generator(seed))


def true_model(robot: str, model_errors: ModelErrors) -> RobotModel:
    """Return the robot that has these errors."""
    return true_robot(model(robot), model_errors, (model(robot).last_link,))


def simulator_config(robot: str, changes: Mapping[str, object] | None = None) -> SimulatorConfig:
    """Return the parameters of config/<robot>_simulator.yaml with changes."""
    values = load_parameter_file(CONFIG / f'{robot}_simulator.yaml', 'simulator')
    return build(SimulatorConfig, {**values, **(changes or {})})


@cache
def motion(robot: str, rate: float = RATE) -> Truth:
    """Return the true motion of a robot, as config/<robot>_simulator.yaml has it, at 0 ... 60 s."""
    return motion_of(robot, model(robot), rate)


def motion_of(robot: str, moving: RobotModel, rate: float = RATE) -> Truth:
    """Return the same motion of a robot that deviates from its URDF."""
    return make_simulation(simulator_config(robot), moving).advance(np.arange(round(DURATION * rate) + 1) / rate)


def endless_motion(robot: str, rate: float = RATE, seconds: float = DURATION) -> Truth:
    """Return one period (60 s), or its beginning, of a motion that repeats exactly, from rest and without momentum.

    All joints follow cosines with whole numbers of periods a minute: in the second half minute they reverse the first.
    Without momentum the base's pose depends on their path alone, so it returns as well.
    """
    joints = model(robot).joints
    order = np.arange(joints)
    cycles = np.column_stack((1 + order % 3, 4 + order % 4)) * 1.0
    amplitude = np.column_stack((0.35 - 0.02 * order, 0.1 + 0.01 * order))
    driven = Sinusoids(0.3 * np.cos(order), amplitude, cycles / DURATION, np.full(cycles.shape, 0.5 * np.pi))
    rest = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), driven.start, np.zeros(6 + joints))
    return Simulation(model(robot), driven, rest).advance(np.arange(round(seconds * rate)) / rate)


def last_state(truth: Truth) -> State:
    """Return the state that a motion ends in."""
    last = truth[-1:]
    velocity = (last.base_linear_velocity[0], last.base_angular_velocity[0], last.joint_velocity[0])
    return State(last.base_position[0], last.base_orientation[0], last.joint_position[0], np.concatenate(velocity))


def momentum_of(robot: str, truth: Truth) -> Array:
    """Return the true (6,) total momentum, about the odometry origin."""
    return total_momentum(model(robot), truth[:1])[0]


def readings(
    truth: Truth, noise: SensorNoise, seed: int | None, model_errors: ModelErrors | None = None
) -> tuple[JointStream, BaseStream]:
    """Return the readings of a motion with the covariances of a noise; without a seed they are exact."""
    silent = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return _streams(read_by(Sensors(silent if seed is None else noise, seed or 0, model_errors), truth), noise)


def observed(
    truth: Truth, case: Case, seed: int, model_errors: ModelErrors | None = None
) -> tuple[JointStream, BaseStream]:
    """Return the readings of a motion by the case's sensors."""
    own = zlib.crc32(f'{case.robot} {case.level}'.encode()) << 32 | seed  # robots and levels draw apart
    read, rng = read_by(Sensors(case.noise, own, model_errors), truth), np.random.default_rng([seed, 1])
    for defect in case.defects:
        read = defect(read, rng)
    joints, base = _streams(read, case.noise)
    if case.sensors == 'poses':
        nothing = np.full_like(base.linear_velocity, np.nan)
        joints = replace(joints, velocity=np.full_like(joints.velocity, np.nan))
        base = replace(base, linear_velocity=nothing, angular_velocity=nothing)
    return joints, base


def _streams(read: Readings, noise: SensorNoise) -> tuple[JointStream, BaseStream]:
    joints, base = read.joints, read.base
    rotation, shape = rotation_from_quaternion(base.orientation), (len(base.time), 6, 6)
    stamps = [np.round(each.time * 1e9).astype(np.int64) for each in (joints, base)]
    return JointStream(stamps[0], joints.position, joints.velocity), BaseStream(
        stamp=stamps[1],
        position=base.position,
        rotation=rotation,
        linear_velocity=rotate(rotation, base.linear_velocity),
        angular_velocity=rotate(rotation, base.angular_velocity),
        pose_covariance=np.broadcast_to(noise.pose_covariance(), shape),
        twist_covariance=np.broadcast_to(noise.twist_covariance(), shape),
    )


def exact_samples(truth: Truth, noise: SensorNoise, model_errors: ModelErrors | None = None) -> Samples:
    """Return noise-free samples with the covariances of noisy ones."""
    samples = Synchroniser(MAXIMUM_GAP).push(*readings(truth, noise, None, model_errors))
    assert samples is not None, 'a motion has samples'
    return samples


def sampled(truth: Truth, sensors: Sensors, declared: SensorNoise) -> Samples:
    """Return the samples that sensors take of a motion, all at the same instants, with a declared noise of the base."""
    joints, base = sensors.joints(truth), sensors.base(truth)
    count = len(truth)
    return Samples(
        time=truth.time - truth.time[0],
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        base_position=base.position,
        base_rotation=rotation_from_quaternion(base.orientation),
        base_linear_velocity=quaternions.rotate(base.orientation, base.linear_velocity),
        base_angular_velocity=quaternions.rotate(base.orientation, base.angular_velocity),
        pose_covariance=np.tile(declared.pose_covariance(), (count, 1, 1)),
        twist_covariance=np.tile(declared.twist_covariance(), (count, 1, 1)),
    )


def history(session: Session, parts: Sequence[Joints | Poses | Thrust], late: float = 0.0) -> list[Estimate]:
    """Return all estimates of a session that takes readings in the order of time; stamps of joints are late (s)."""
    take = {'joint_states': session.add_joint_state, 'odom': session.add_odometry, 'thrust': session.add_thrust}

    def stamp(part: object, time: float) -> int:
        return START + round(time * 1e9) + (round(late * 1e9) if isinstance(part, Joints) else 0)

    found: list[Estimate] = []
    for count, (_, topic, message) in enumerate(in_order(parts, BAG_TYPES, stamp), start=1):
        take[topic](message)
        if count % _MESSAGES_AT_ONCE == 0:
            found += session.process()
    return found + session.process()


def write_bag(path: Path, robot: RobotModel, sensors: Sensors, parts: Iterable[tuple[float, Truth]]) -> None:
    """Write a bag, a JointState and an Odometry a sample; parts of the motion with the times (s) when they begin."""
    with BagWriter(path) as bag:
        bag.add_topic(JOINTS, 'sensor_msgs/msg/JointState')
        bag.add_topic(ODOMETRY, 'nav_msgs/msg/Odometry')
        for begin, truth in parts:
            joints = joints_of(sensors.joints(truth), robot.joint_names)
            base = poses_of(sensors.base(truth), robot.base_link)
            for index, time in enumerate(truth.time.tolist()):
                stamp = START + round((begin + time) * 1e9)
                bag.write(ODOMETRY, base.message(BAG_TYPES, index, stamp), stamp)
                bag.write(JOINTS, joints.message(BAG_TYPES, index, stamp), stamp)


def make_bag(path: Path, robot: str, minutes: float, rate: float = RATE) -> None:
    """Write a bag of the endless motion of a robot."""
    truth = endless_motion(robot, rate, min(60.0 * minutes, DURATION))
    samples = round(minutes * 60.0 * rate)
    parts = ((begin / rate, truth[: samples - begin]) for begin in range(0, samples, len(truth)))
    write_bag(path, model(robot), Sensors(NOISE, seed=0), parts)
