"""The executable `simulate`: the simulator without a graph, straight to a bag, with the truth beside it."""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from mbaid_ros.bags import BAG_TYPES, BagWriter
from mbaid_ros.cli import one_line
from mbaid_ros.config.motion_files import read_trajectory
from mbaid_ros.config.parameter_files import given_parameters, read_robot_description
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.robot.body import physical
from mbaid_ros.errors import ParameterError
from mbaid_ros.files import write_text
from mbaid_ros.parameters import build, values_of
from mbaid_ros.replay.json_output import shaped
from mbaid_ros.replay.read_back import TRUTH_FILE
from mbaid_ros.simulated_run import SimulatedRun

NODE = 'simulator'
DESCRIPTION, TRUTH = '/robot_description', f'/{NODE}/truth'

_REST = 0.5  # s after a trajectory, where no duration is given
_CHUNK = 1.0  # s of the run between two looks at the progress bar


def simulate(arguments: argparse.Namespace) -> int:
    """Simulate a run by the arguments, and return the exit code."""
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
        f'{one_line(str(arguments.output))}'
    )
    return 0


def _config(arguments: argparse.Namespace) -> SimulatorConfig:
    """Return the parameters: the file's, then those of -p, then those with an argument of their own."""
    values = given_parameters(arguments, NODE)
    given = {'robot_description_file': arguments.model, 'duration': arguments.duration, 'seed': arguments.seed}
    if arguments.trajectory is not None:
        given |= {'motion.kind': 'trajectory', 'motion.trajectory_file': arguments.trajectory}
    config = build(SimulatorConfig, values | {name: value for name, value in given.items() if value is not None})
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
    for topic, kind in run.topics.items():
        bag.add_topic(f'/{topic}', kind)
    bag.write(DESCRIPTION, run.description(), run.stamp(0.0))
    bag.write(TRUTH, run.truth(), run.stamp(0.0))
    duration = run.config.duration
    form = '{l_bar}{bar}| {n:.0f}/{total:.0f} s'
    with tqdm(total=duration, unit='s', disable=None, leave=False, bar_format=form) as bar:
        for chunk in range(int(np.ceil(duration / _CHUNK))):
            until = min((chunk + 1) * _CHUNK, duration)
            for timed in run.read(until):
                bag.write(f'/{timed.topic}', timed.message, run.stamp(timed.time))
            bar.update(until - bar.n)


def write_truth(path: Path, run: SimulatedRun) -> None:
    """Write the target's true values, the robot's deviations from its URDF, and the parameters of the run as JSON."""
    one_momentum = run.pulse is None and run.config.orbit.mean_motion == 0.0  # thrust and orbits change it
    truth = {
        'robot': run.model.name,
        'target_link': run.target.name,
        **shaped(run.target_inertia),
        'momentum': {'linear': run.momentum[:3].tolist(), 'angular': run.momentum[3:].tolist()}
        if one_momentum
        else None,
        'capture': _capture(run),
        'model_errors': _model_errors(run),
        'seed': run.config.seed,
        'parameters': values_of(run.config),
    }
    write_text(path, json.dumps(truth, indent=2) + '\n')


def _capture(run: SimulatedRun) -> dict[str, object] | None:
    """Return the captured body, its momentum before, and when it is captured; None where nothing is."""
    target = run.captured
    if target is None:
        return None
    return {
        't': target.time,
        **shaped(target.body),
        'target_linear_momentum': run.target_momentum[:3].tolist(),
        'target_angular_momentum': run.target_momentum[3:].tolist(),
        'target_linear_velocity': target.velocity.tolist(),
        'target_angular_velocity': target.spin.tolist(),
    }


def _model_errors(run: SimulatedRun) -> dict[str, object] | None:
    """Return how the robot deviates from its URDF, link by link and joint by joint; None where it does not."""
    errors = run.errors
    if errors.is_zero:
        return None
    links = zip(run.robot.links, run.model.links, strict=True)
    joints = zip(run.model.joint_names, errors.zeros, errors.origins, errors.tilts, strict=True)
    return {
        'links': {
            link.name: shaped(physical(link.parameters) - physical(before.parameters))
            for link, before in links
            if not np.array_equal(link.parameters, before.parameters)
        },
        'joints': {
            name: {'zero': float(zero), 'origin': origin.tolist(), 'axis': tilt.tolist()}
            for name, zero, origin, tilt in joints
        },
        'mount': {'position': errors.mount[3:].tolist(), 'orientation': errors.mount[:3].tolist()},
    }
