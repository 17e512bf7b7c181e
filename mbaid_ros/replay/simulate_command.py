"""What the executable `simulate` does with its arguments."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from tqdm import tqdm

from mbaid_ros import cli
from mbaid_ros.bags import BagWriter
from mbaid_ros.config.files import load_parameter_file, parse_assignment
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.config.trajectory import read_trajectory
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.replay.truth import TRUTH_FILE
from mbaid_ros.replay.truth_output import write_truth
from mbaid_ros.simulated_run import SimulatedRun

NODE = 'simulator'
JOINT_STATES, ODOMETRY, THRUST, STORED_MOMENTUM, IMU = '/joint_states', '/odom', '/thrust', '/stored_momentum', '/imu'
DESCRIPTION, TRUTH = '/robot_description', f'/{NODE}/truth'

_REST = 0.5  # s after a trajectory, where nothing is said of how long the run is
_CHUNK = 1.0  # s of the run between two looks at the progress bar


def simulate(arguments: argparse.Namespace) -> int:
    """Simulate a run as the arguments say, and return the exit code."""
    config = _config(arguments)
    run = SimulatedRun(config, read_robot_description(config.robot_description_file), BAG_TYPES)
    begin = time.monotonic()
    if arguments.truth is not None:
        write_truth(arguments.truth, run)
    with BagWriter(arguments.output) as bag:
        if arguments.truth is None:
            write_truth(arguments.output / TRUTH_FILE, run)
        _record(run, bag)
    print(
        f'{bag.messages} messages, {config.duration:g} s of {run.model.name} in {time.monotonic() - begin:.1f} s: '
        f'{cli.one_line(str(arguments.output))}'
    )
    return 0


def _config(arguments: argparse.Namespace) -> SimulatorConfig:
    """Return the parameters: the file's, then those of -p, then those with an argument of their own."""
    values = load_parameter_file(arguments.params, NODE) if arguments.params is not None else {}
    values |= dict(map(parse_assignment, arguments.assignments))
    own = {'robot_description_file': arguments.model, 'duration': arguments.duration, 'seed': arguments.seed}
    if arguments.trajectory is not None:
        own |= {'motion.kind': 'trajectory', 'motion.trajectory_file': arguments.trajectory}
    values |= {name: value for name, value in own.items() if value is not None}
    config = build(SimulatorConfig, values)
    if config.duration == 0.0 and arguments.trajectory is not None:
        end = config.motion.trajectory_begin + read_trajectory(arguments.trajectory).duration
        config = replace(config, duration=end + _REST)
    if not config.robot_description_file:
        raise ParameterError("no robot is given; accepted: --model URDF, or the parameter 'robot_description_file'")
    if config.duration == 0.0:
        raise ParameterError(
            "parameter 'duration' is 0 s, which never ends; accepted: a number > 0 s (or --duration S)"
        )
    return config


def _record(run: SimulatedRun, bag: BagWriter) -> None:
    bag.add_topic(DESCRIPTION, 'std_msgs/msg/String', latched=True)
    bag.add_topic(TRUTH, 'geometry_msgs/msg/InertiaStamped', latched=True)
    bag.add_topic(JOINT_STATES, 'sensor_msgs/msg/JointState')
    bag.add_topic(ODOMETRY, 'nav_msgs/msg/Odometry')
    topics = {'joint_states': JOINT_STATES, 'odom': ODOMETRY, 'thrust': THRUST}
    topics |= {'stored_momentum': STORED_MOMENTUM, 'imu': IMU}
    if run.config.imu.rate > 0.0:
        bag.add_topic(IMU, 'sensor_msgs/msg/Imu')
    if run.pulse is not None and run.config.thrust.publish:
        bag.add_topic(THRUST, 'geometry_msgs/msg/WrenchStamped')
    if run.publishes_momentum:
        bag.add_topic(STORED_MOMENTUM, 'geometry_msgs/msg/Vector3Stamped')
    bag.write(DESCRIPTION, run.description(), run.stamp(0.0))
    bag.write(TRUTH, run.truth(), run.stamp(0.0))
    duration = run.config.duration
    with tqdm(
        total=duration, unit='s', disable=None, leave=False, bar_format='{l_bar}{bar}| {n:.0f}/{total:.0f} s'
    ) as bar:
        for chunk in range(int(np.ceil(duration / _CHUNK))):
            until = min((chunk + 1) * _CHUNK, duration)
            for timed in run.read(until):
                bag.write(topics[timed.topic], timed.message, run.stamp(timed.time))
            bar.update(until - bar.n)
