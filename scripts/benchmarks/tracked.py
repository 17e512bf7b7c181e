"""A free body that was tracked, caught by a robot at rest whose arm moves some seconds later."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from benchmarks.data import MAXIMUM_GAP, NOISE, START, model
from benchmarks.precapture import POSTURE, free_model
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical, standard
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.parameters import build
from mbaid_ros.sensor_messages import Readings, TargetPoses, in_order, joints_of, poses_of
from mbaid_ros.session.session import Session
from mbaid_ros.simulation.changes import CaptureSimulation, Target
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Driven, Sinusoids
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.tumbling import FreeMotion, GraspedMotion, TargetCamera, TrackedMotion, Tracking

CAPTURE = 60.0  # s, of poses before it
REST = 3.0  # s after it, in which the arm rests
RATE = 20.0  # Hz, of encoders and odometry
SPIN = np.deg2rad(3.0)  # rad/s
POSES = Tracking(np.array([0.1, 0.0, 0.2]), 5.0, 5e-3, 5e-3)
# The captured body in the last link's frame: mass, CoM, inertia about it.
BODY = np.array([155.0, 0.34, -0.22, 0.78, 24.0, -2.5, 2.0, 33.0, -0.5, 29.0])
PLANAR_BODY = np.array([155.0, 0.84, 0.32, 0.0, 24.0, 0.0, 0.0, 33.0, 0.0, 29.0])
_EMPTY_LINK4 = np.array([12.0, 0.25, 0.05, 0.0, 0.5, 0.0, 0.0, 1.0, 0.0, 1.2])
_LINKS = {'servicer7': 'link7', 'table1': 'link4'}
_EARLY = 0.5  # s before the capture that are simulated: the robot rests until then


@dataclass(frozen=True)
class Rested(Driven):
    """Joints that rest until a time, and then move."""

    begin: float
    motion: Sinusoids

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration of the joints at a time, (n,) each."""
        if time >= self.begin:
            return self.motion.reference(time - self.begin)
        still = np.zeros_like(self.motion.start)
        return self.motion.start, still, still

    def from_time(self, time: float) -> Rested:
        """Return the motion with time 0 at a time (s) of this one."""
        return replace(self, begin=self.begin - time)


@cache
def robot(name: str) -> RobotModel:
    """Return a robot with an empty hand."""
    if name == 'servicer7':
        return free_model()
    return load_model(replace_inertial(model('table1').urdf, 'link4', _EMPTY_LINK4))


@dataclass(frozen=True)
class Caught:
    """A capture as it was."""

    robot: str
    seed: int
    truth: Truth  # of the robot, from 0 on
    poses: TargetPoses
    target: Target

    @property
    def together(self) -> Array:
        """The target link with the body, (10,) mass, CoM, inertia about it."""
        return physical(robot(self.robot).link(self.target.link).parameters + standard(self.target.body))


def caught(
    name: str,
    seed: int,
    approach: float,
    *,
    after: float,
    tracking: Tracking = POSES,
    settling: float = 0.0,
    later: float = 0.0,
) -> Caught:
    """Return a capture at a speed, m/s; directions, posture and motion of the arm are drawn by the seed.

    Parameters
    ----------
    after : s of the run after the capture
    settling : s, in which the body slips in the grasp
    later : s after the capture, for which poses go on
    """
    rng, planar, free = np.random.default_rng([seed, 65]), name == 'table1', robot(name)
    joints = free.joints
    velocity, turn = rng.standard_normal(3), rng.standard_normal(3)
    if planar:
        velocity[2], turn[:2] = 0.0, 0.0
    velocity, turn = (each * size / np.linalg.norm(each) for each, size in ((velocity, approach), (turn, SPIN)))
    start = np.array(POSTURE[:joints] if not planar else [0.3, 0.5, -0.4, 0.6][:joints]) + 0.3 * rng.standard_normal(
        joints
    )
    amplitude = rng.uniform(0.15, 0.3, (joints, 2))
    motion = Sinusoids(start, amplitude, 1.0 / rng.uniform(12.0, 30.0, (joints, 2)), np.full((joints, 2), np.pi / 2.0))
    target = Target(_EARLY, _LINKS[name], PLANAR_BODY if planar else BODY, velocity, turn, settling)
    initial = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), start, np.zeros(6 + joints))
    arm = Rested(_EARLY + REST, motion)
    simulation, again = (CaptureSimulation(free, arm, initial, target) for _ in range(2))
    time = np.arange(round((_EARLY + after) * RATE)) / RATE
    moved = simulation.advance(time)
    early = round((CAPTURE - _EARLY) * RATE)
    still = moved[np.zeros(early, dtype=int)]
    times = np.arange(early + len(time)) / RATE
    truth = replace(Truth.concatenate([still, moved]), time=times)
    flight = FreeMotion(replace(target, time=CAPTURE), *simulation.link_pose)
    tracked = TrackedMotion(flight, GraspedMotion(again, free, CAPTURE - _EARLY))
    camera = TargetCamera(tracked, CAPTURE, tracking, seed, CAPTURE + later)
    return Caught(name, seed, truth, TargetPoses(*camera.readings(CAPTURE + later)), replace(target, time=CAPTURE))


def estimates(run: Caught, *, tracked: bool, **options: object) -> list[Estimate]:
    """Return the estimates of a capture with the poses of the target, or without."""
    return session_of(run, tracked=tracked, **options)[0]


def session_of(run: Caught, *, tracked: bool, **options: object) -> tuple[list[Estimate], Session]:
    """Return these, and the session that made them."""
    session = Session(build(EstimatorConfig, parameters(options)), robot(run.robot).urdf)
    add: dict[str, Callable[[Any], object]] = {
        'joint_states': session.add_joint_state,
        'odom': session.add_odometry,
        'target_pose': session.add_target_pose,
    }
    for topic, message in messages(run, tracked=tracked):
        add[topic](message)
    return [*session.process(), *session.finish()], session


def parameters(options: Mapping[str, object]) -> dict[str, object]:
    """Return the estimator's parameters, with some more."""
    noise = {f'noise.{name}': value for name, value in vars(NOISE).items() if name != 'base_correlation_time'}
    return {**EXACT, **noise, 'capture.time': CAPTURE, 'maximum_gap': max(MAXIMUM_GAP, 3.0 / RATE), **options}


def messages(run: Caught, *, tracked: bool) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of all sensors in order."""
    sensors, free = Sensors(NOISE, run.seed), robot(run.robot)
    joints = joints_of(sensors.joints(run.truth), free.joint_names)
    parts: list[Readings] = [joints, poses_of(sensors.base(run.truth), free.base_link)]
    parts += [run.poses] if tracked else []
    for _, topic, message in in_order(parts, BAG_TYPES, lambda _, time: START + round(time * 1e9)):
        yield topic, message
