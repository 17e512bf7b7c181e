"""The command lines of the nodes, which show their help without rclpy."""

from __future__ import annotations

from mbaid_ros.cli import ArgumentParser, number


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
