"""A run of the simulator, as both faces see it: parameters go in, messages come out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbaid_ros.config.simulator_parameters import SimulatedImuConfig, SimulatedPoseConfig, SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.errors import DataError
from mbaid_ros.estimate_messages import Frames, MessageTypes, inertia_message, time_message
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.sensor_messages import (
    SENSOR_TYPES,
    Joints,
    Readings,
    StoredMomentum,
    TargetPoses,
    Thrust,
    further_of,
    in_order,
    pose_type,
    poses_of,
)
from mbaid_ros.simulated_robot import (
    make_further,
    make_model_errors,
    make_motion,
    make_simulation,
    make_target_camera,
    make_view,
    make_wheels,
    steerable,
)
from mbaid_ros.simulation.changes import CaptureSimulation, Pulse, ThrustSimulation
from mbaid_ros.simulation.sensors import JointReadings, SensedSimulation, Sensors
from mbaid_ros.simulation.simulation import LONGEST_STEP, total_momentum
from mbaid_ros.simulation.steered import SteeredMotion
from mbaid_ros.simulation.true_robot import true_robot

_COMMANDS = 0.1  # s, between two of thrust


@dataclass(frozen=True)
class TimedMessage:
    """A message and when it is due."""

    time: float  # s since the start of the run
    topic: str  # the one it belongs on
    message: Any  # JointState, Odometry, WrenchStamped, Vector3Stamped, PoseStamped or Imu


class SimulatedRun:
    """A robot in motion and the messages of its sensors.

    Raises ModelError, ParameterError: The robot, or a combination of parameters, cannot be used.

    Parameters
    ----------
    config : SimulatorConfig
    urdf : str
        Text of the robot description.
    types : MessageTypes

    Attributes
    ----------
    start : stamp at time 0, ns; to be set before the first message is asked for
    model : RobotModel, of the URDF
    errors : deviations of the moving robot from it
    robot : the one that moves, before a capture
    target : the target link, as it is
    momentum : (6,) total momentum (P, L) in the odometry frame, L about its origin: kg m/s, kg m^2/s; after a capture
    pulse : of thrust, None where there is none; the momentum is then that before it
    wheels : inside the base, None where there are none; their momentum is in the total
    captured : the captured body, None if there is none
    target_momentum : (6,) the momentum that it had before; zero where nothing is captured
    """

    def __init__(self, config: SimulatorConfig, urdf: str, types: MessageTypes) -> None:
        self.config = config
        self.model = load_model(urdf, config.base_link)
        target = self.model.link(config.target_link or self.model.last_link).name
        self.errors = make_model_errors(config, self.model)
        self.robot = true_robot(self.model, self.errors, fixed=(target,))
        self.target = self.robot.link(target)
        self._types = types
        self.wheels = make_wheels(config, self.model)
        self.start = 0
        self._motion = steerable(make_motion(config, self.robot))
        simulation = make_simulation(config, self.robot, self._motion)
        self.pulse = simulation.pulse if isinstance(simulation, ThrustSimulation) else None
        self.captured = simulation.target if isinstance(simulation, CaptureSimulation) else None
        self._commands = commands(self.pulse) if self.pulse is not None and config.thrust.publish else []
        if isinstance(simulation, CaptureSimulation):
            self.momentum, self.target_momentum = simulation.total_momentum, simulation.target_momentum
            self.target = simulation.joined_model.link(target)
        else:
            self.momentum = total_momentum(self.robot, simulation.advance(np.zeros(1)), self.wheels)[0]
            self.target_momentum = np.zeros(6)
        view = make_view(config)
        sensors = Sensors(SensorNoise(**vars(config.noise)), config.seed, self.errors, config.wheels.speed_noise, view)
        further = make_further(config, self.robot)
        named: dict[str, SimulatedImuConfig | SimulatedPoseConfig] = {**config.further_gyros, **config.further_poses}
        self._named = named
        self._camera = make_target_camera(config, self.robot, simulation)
        self._read = 0.0  # s, until which it has been
        # s: the state at the capture, and a tracked body's motion after it, follow from the first motion of the joints.
        self._steerable_from = 0.0
        if self.captured is not None:
            self._steerable_from = config.capture.time + (0.0 if self._camera is None else config.target_pose.after)
        self._sensed = SensedSimulation(simulation, sensors, config.joint_rate, config.odometry_rate, further)

    @property
    def topics(self) -> dict[str, str]:
        """The topics of its messages, with their types."""
        wanted = {
            'odom': not self.config.pose_only,
            'pose': self.config.pose_only,
            'imu': 'imu' in self._named,
            'thrust': self.pulse is not None and self.config.thrust.publish,
            'target_pose': self._camera is not None,
            'stored_momentum': self.wheels is not None and self.config.wheels.publish == 'stored_momentum',
        }
        known = {topic: kind for topic, kind in SENSOR_TYPES.items() if wanted.get(topic, True)}
        gyros = dict.fromkeys(self.config.further_gyros, SENSOR_TYPES['imu'])
        poses = {name: pose_type(each.measures) for name, each in self.config.further_poses.items()}
        return known | gyros | poses

    @property
    def target_inertia(self) -> Array:
        """The target link's true (m, r_c, I_c), (10,): kg; m, link frame; kg m^2, link axes."""
        return physical(self.target.parameters)

    def description(self) -> Any:
        """Return the robot description as a std_msgs/String."""
        return self._types.find('std_msgs/msg/String')(data=self.model.urdf)

    def truth(self) -> Any:
        """Return the target link's true mass properties as a geometry_msgs/InertiaStamped."""
        known = Estimate('truth', 'converged', stamp=self.start, parameters=self.target_inertia)
        return inertia_message(known, self._types, Frames(self.target.name, self.config.odom_frame))

    def clock(self, time: float) -> Any:
        """Return a rosgraph_msgs/Clock of a time (s) since the start of the run."""
        return self._types.find('rosgraph_msgs/msg/Clock')(clock=time_message(self.stamp(time), self._types))

    def stamp(self, time: float) -> int:
        """Return the stamp in ns of a time (s) since the start of the run."""
        return self.start + round(time * 1e9)

    def add_trajectory(self, trajectory: JointTrajectory) -> float:
        """Let the joints follow a trajectory from just after the samples read, and return that time, s.

        Raises DataError: The joints are not driven, a capture or tracked poses after it are still to come, or the
            trajectory is of other joints, or begins elsewhere.
        """
        if not isinstance(self._motion, SteeredMotion):
            raise DataError("motion.kind is 'passive'; accepted: joints that are driven, as with motion.kind: random")
        begin = self._read + LONGEST_STEP
        if begin < self._steerable_from:
            raise DataError(
                f'it would begin at {begin:.6g} s, and the motion until {self._steerable_from:.6g} s is fixed by '
                'capture.time and target_pose.after; accepted: a trajectory sent later'
            )
        self._motion.add_trajectory(trajectory, self.model, begin)
        return begin

    def read(self, until: float) -> list[TimedMessage]:
        """Return the messages due up to and including a time (s) that were not returned before, in order of time.

        Raises ModelError: The motion has diverged.
        """
        joints, base, further = self._sensed.read(until)
        self._read = max(self._read, until)
        due = [command for command in self._commands if command[0] <= until]
        del self._commands[: len(due)]
        parts: list[Readings] = []
        if due and self.pulse is not None:
            frame = self.config.odom_frame if self.pulse.link is None else self.pulse.link.name
            times, wrenches = zip(*due, strict=True)
            parts.append(Thrust(np.array(times), np.array(wrenches), frame))
        if self.wheels is not None and 'stored_momentum' in self.topics:
            stored = self.wheels.momentum(joints.wheel_speed)
            parts.append(StoredMomentum(joints.time, stored, self.model.base_link))
        bare, frames = self.config.pose_only, (self.model.base_link, self.config.odom_frame)
        parts += [poses_of(base, *frames, pose_only=bare), self._reported(joints)]
        parts += [further_of(each, name, self.model.base_link) for name, each in further.items()]
        if self._camera is not None:
            delay = self.config.target_pose.delay
            time, position, orientation = self._camera.readings(until - delay)
            parts.append(TargetPoses(time + delay, position, orientation, self.config.odom_frame))
        return [TimedMessage(*each) for each in in_order(parts, self._types, self._stamp)]

    def _stamp(self, part: Readings, time: float) -> int:
        if isinstance(part, TargetPoses):
            return self.stamp(time - self.config.target_pose.delay)
        own = self._named.get(part.topic)
        return self.stamp(time if own is None else time + own.delay)

    def _reported(self, readings: JointReadings) -> Joints:
        """Return the joints that JointState has: all but passive ones, and wheels with their speeds alone."""
        every, passive = self.model.joint_names, self.config.flexible.joints
        kept = [place for place, name in enumerate(every) if name not in passive]
        position, velocity, effort = (part[:, kept] for part in (readings.position, readings.velocity, readings.effort))
        wheels = self.config.wheels.names if self.config.wheels.publish == 'joint_states' else ()
        still = np.zeros((len(readings.time), len(wheels)))
        names = (*(every[place] for place in kept), *wheels)
        turning = readings.wheel_speed if wheels else still
        columns = ((position, still), (velocity, turning), (effort, still))
        return Joints(names, readings.time, *(np.concatenate(both, axis=1) for both in columns))


def commands(pulse: Pulse) -> list[tuple[float, Array]]:
    """Return the wrenches (6,) that are commanded, and when, s: the thrust again and again, and its end."""
    times = np.arange(pulse.begin, pulse.end - 1e-9, _COMMANDS).tolist()
    return [*((time, pulse.wrench) for time in times), (pulse.end, np.zeros(6))]
