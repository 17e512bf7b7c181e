"""The nodes' entry points and command lines, which show their help without rclpy.

They end at once on a signal while a node is being imported, which takes seconds: nothing has begun by then that would
need completion. This is why everything slow is imported in a function.
"""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from importlib import import_module
from types import FrameType

from mbaid_ros.cli import ArgumentParser, number, run


def estimator_arguments() -> ArgumentParser:
    """Return the parser of the node `estimator`."""
    return ArgumentParser(
        'estimator',
        'Identify the inertia of a captured body from joint_states and odom; publish it on ~/estimate and ~/inertia.\n'
        'Parameters are ROS parameters (config/estimator.yaml has them all); a running node describes them:\n'
        '  ros2 param list /estimator; ros2 param describe /estimator window',
        'ros2 run mbaid_ros estimator --ros-args -p robot_description_file:=robot.urdf -p noise.joint_position:=1e-4\n'
        '  ros2 run mbaid_ros estimator --ros-args --params-file estimator.yaml -r __ns:=/servicer -r odom:=/base/odom',
    )


def simulator_arguments() -> ArgumentParser:
    """Return the parser of the node `simulator`."""
    return ArgumentParser(
        'simulator',
        'Simulate a free-floating robot: publish joint_states, odom and robot_description, and the truth on ~/truth.\n'
        'Parameters are ROS parameters; a running node describes them:\n'
        '  ros2 param list /simulator; ros2 param describe /simulator motion.kind',
        'ros2 run mbaid_ros simulator --ros-args -p robot_description_file:=robot.urdf -p motion.kind:=random\n'
        '  ros2 run mbaid_ros simulator --ros-args -p robot_description_file:=config/table1.urdf '
        '--params-file config/table1_simulator.yaml',
    )


def recorder_arguments() -> ArgumentParser:
    """Return the parser of the node `recorder`."""
    return ArgumentParser(
        'recorder',
        'Write topics to an MCAP bag as they arrive; SIGINT (Ctrl-C) completes it.\n'
        'Parameters are ROS parameters: output (folder), topics (list), duration (s).',
        'ros2 run mbaid_ros recorder --ros-args -p output:=run1 -p duration:=60.0',
    )


def player_arguments() -> ArgumentParser:
    """Return the parser of the node `player`."""
    parser = ArgumentParser(
        'player',
        "Publish a bag's messages at their times; latched topics as latched.",
        'ros2 run mbaid_ros player run1 --rate 2 --topics /joint_states /odom --wait-for-subscribers 10',
    )
    add = parser.add_argument
    add('bag', metavar='BAG', help='rosbag2 folder (MCAP or sqlite3), or a bare .mcap or .db3 file')
    add('--rate', type=number(0.0, exclusive=True), default=1.0, metavar='R', help='speed (default: 1)')
    add('--clock', action='store_true', help='publish the time of the recording on /clock')
    add('--loop', action='store_true', help='start again at the end, until interrupted')
    add('--topics', nargs='+', default=[], metavar='TOPIC', help='topics to play (default: all)')
    add(
        '--wait-for-subscribers',
        type=number(0.0, unit='s'),
        default=0.0,
        metavar='S',
        help='wait up to S seconds until every topic has a subscriber',
    )
    return parser


def watch_arguments() -> ArgumentParser:
    """Return the parser of `watch`."""
    parser = ArgumentParser(
        'watch',
        'Show the estimate of a running estimator in the terminal: values with 95 % intervals, bars that are full at\n'
        'a standard deviation of 0.1 %, and the most informative motion (next). Into a file or pipe it writes one\n'
        'line an update.',
        'ros2 run mbaid_ros watch /servicer/estimator\n  ros2 run mbaid_ros watch --once | tee now.txt',
    )
    parser.add_argument('estimator', nargs='?', default='', metavar='NAME', help='node or topic (default: any)')
    parser.add_argument('--once', action='store_true', help='show one update and end')
    return parser


PARSERS = {
    'estimator': estimator_arguments,
    'simulator': simulator_arguments,
    'recorder': recorder_arguments,
    'player': player_arguments,
    'watch': watch_arguments,
}


def _leave(number: int, _frame: FrameType | None) -> None:
    os._exit(128 + number)


def _start(name: str) -> int:
    """Import a node, run it and return the exit code; `runner.ros` handles signals from its call on."""
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, _leave)
    if not {'-h', '--help'}.isdisjoint(sys.argv):
        return run(lambda argv: bool(PARSERS[name]().parse(argv)), name=name)
    return run(partial(run_node, name), name=name)


def run_node(name: str, argv: list[str]) -> int:
    """Run `main` of a node's module on the arguments that are not ROS's, within ROS, and return its exit code."""
    runner = import_module('mbaid_ros.nodes.runner')
    main = import_module(f'mbaid_ros.nodes.{name}').main
    arguments = PARSERS[name]().parse(runner.own_arguments(argv))
    with runner.ros(argv) as interrupt:
        code: int = main(arguments, interrupt)
    return code


estimator, player, recorder, simulator, watch = (
    partial(_start, name) for name in ('estimator', 'player', 'recorder', 'simulator', 'watch')
)
