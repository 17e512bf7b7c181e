"""A run of the simulator, as both faces see it: parameters go in, messages come out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mbaid_ros import sensor_messages
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.outgoing import Frames, MessageTypes, inertia_message, time_message
from mbaid_ros.sensor_messages import SENSOR_TYPES, SensorMessages
from mbaid_ros.simulated_robot import (
    make_imu,
    make_model_errors,
    make_motion,
    make_simulation,
    make_view,
    make_wheels,
    steered,
)
from mbaid_ros.simulation.changes import CaptureSimulation, Pulse, ThrustSimulation
from mbaid_ros.simulation.sensors import SensedSimulation, Sensors
from mbaid_ros.simulation.simulation import LONGEST_STEP, total_momentum
from mbaid_ros.simulation.steered import Steered
from mbaid_ros.simulation.true_robot import true_robot

Topic = Literal['joint_states', 'odom', 'thrust', 'stored_momentum', 'imu']
_COMMANDS = 0.1  # s, between two of thrust


@dataclass(frozen=True)
class TimedMessage:
    """A message and when it is due."""

    time: float  # s since the start of the run
    topic: Topic  # the one it belongs on
    message: Any  # JointState, Odometry, WrenchStamped, Vector3Stamped or Imu


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
    brought : (6,) the momentum that it had before; zero where nothing is captured
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
        in_joint_states = config.wheels.names if config.wheels.publish == 'joint_states' else ()
        self._messages = SensorMessages(types, self.model, config.odom_frame, in_joint_states, config.flexible.joints)
        self.start = 0
        self._motion = steered(make_motion(config, self.robot))
        simulation = make_simulation(config, self.robot, self._motion)
        self.pulse = simulation.pulse if isinstance(simulation, ThrustSimulation) else None
        self.captured = simulation.target if isinstance(simulation, CaptureSimulation) else None
        self._commands = commands(self.pulse) if self.pulse is not None and config.thrust.publish else []
        if isinstance(simulation, CaptureSimulation):
            self.momentum, self.brought = simulation.momentum, simulation.brought
            self.target = simulation.joined.link(target)
        else:
            self.momentum = total_momentum(self.robot, simulation.advance(np.zeros(1)), self.wheels)[0]
            self.brought = np.zeros(6)
        view = make_view(config)
        sensors = Sensors(SensorNoise(**vars(config.noise)), config.seed, self.errors, config.wheels.speed_noise, view)
        imu = make_imu(config, self.robot)
        self._read = 0.0  # s, until which it has been
        self._sensed = SensedSimulation(simulation, sensors, config.joint_rate, config.odometry_rate, imu)

    @property
    def topics(self) -> dict[str, str]:
        """The topics of its messages, with their types."""
        wanted = {
            'imu': self.config.imu.rate > 0.0,
            'thrust': self.pulse is not None and self.config.thrust.publish,
            'stored_momentum': self.wheels is not None and self.config.wheels.publish == 'stored_momentum',
        }
        return {topic: kind for topic, kind in SENSOR_TYPES.items() if wanted.get(topic, True)}

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

    def follow(self, trajectory: JointTrajectory) -> float:
        """Let the joints follow a trajectory from just after the samples read, and return that time, s.

        Raises DataError: The joints are not driven, or it is of other joints, or begins elsewhere.
        """
        if not isinstance(self._motion, Steered):
            raise DataError("motion.kind is 'passive'; accepted: joints that are driven, as with motion.kind: random")
        begin = self._read + LONGEST_STEP
        self._motion.follow(trajectory, self.model, begin)
        return begin

    def read(self, until: float) -> list[TimedMessage]:
        """Return the messages due up to and including a time (s) that were not returned before, in order of time.

        Raises ModelError: The motion has diverged.
        """
        joints, base, imu = self._sensed.read(until)
        self._read = max(self._read, until)
        due = [command for command in self._commands if command[0] <= until]
        del self._commands[: len(due)]
        frame = (
            self.pulse.link.name if self.pulse is not None and self.pulse.link is not None else self.config.odom_frame
        )
        stamp, types, made = self.stamp, self._types, self._messages
        momenta = self.wheels.stored(joints.wheel_speed) if self.wheels and 'stored_momentum' in self.topics else ()
        messages: list[TimedMessage] = []
        add = messages.append
        for t, wrench in due:
            add(TimedMessage(t, 'thrust', sensor_messages.wrench_message(types, stamp(t), frame, wrench)))
        for t, momentum in zip(joints.time.tolist(), momenta, strict=False):
            message = sensor_messages.vector_message(types, stamp(t), self.model.base_link, momentum)
            add(TimedMessage(t, 'stored_momentum', message))
        for i, t in enumerate(base.time.tolist()):
            add(TimedMessage(t, 'odom', made.odometry(base, i, stamp(t))))
        for i, t in enumerate(joints.time.tolist()):
            add(TimedMessage(t, 'joint_states', made.joint_state(joints, i, stamp(t))))
        if imu is not None:
            for i, t in enumerate(imu.time.tolist()):
                add(TimedMessage(t, 'imu', made.imu(imu, i, stamp(t + self.config.imu.delay))))
        return sorted(messages, key=lambda message: message.time)


def commands(pulse: Pulse) -> list[tuple[float, Array]]:
    """Return the wrenches (6,) that are commanded, and when, s: the thrust again and again, and its end."""
    times = np.arange(pulse.begin, pulse.end - 1e-9, _COMMANDS).tolist()
    return [*((time, pulse.wrench) for time in times), (pulse.end, np.zeros(6))]
