"""The arguments of the nodes' executables, and their help, for which nothing of ROS is needed."""

from __future__ import annotations

import gc
import re
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from mbaid_ros.cli import ArgumentParser, number
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.nodes.clocks import refuse_negative_times


def estimator_arguments() -> ArgumentParser:
    """Return the parser of the node `estimator`."""
    parser = ArgumentParser(
        'estimator',
        'Identify the inertia of a captured body from joint_states and odom; publish it on ~/estimate and ~/inertia.\n'
        'Parameters are ROS parameters (config/estimator.yaml has them all); a running node describes them:\n'
        '  ros2 param list /estimator; ros2 param describe /estimator window',
        'ros2 run mbaid_ros estimator --ros-args -p robot_description_file:=robot.urdf -p noise.joint_position:=1e-4\n'
        '  ros2 run mbaid_ros estimator --ros-args --params-file estimator.yaml -r __ns:=/servicer -r odom:=/base/odom',
    )
    parser.add_argument('--lifecycle', action='store_true', help='be a managed node, which waits to be configured')
    return parser


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
    add('--topics', nargs='+', default=[], metavar='TOPIC', help='what to play (default: everything)')
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
        'Show the estimate of a running estimator in the terminal as it converges: intervals of 95 %, and bars that\n'
        'are full at a standard deviation of 0.1 %; and what motion would help most (next), where one is needed.\n'
        'Written to a file or pipe, one line an update.',
        'watch /servicer/estimator\n  watch --once | tee now.txt',
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


RCLError = rclpy_implementation.RCLError
InvalidROSArgsError = rclpy_implementation.RCLInvalidROSArgsError
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError

LATENCY = 0.1  # s, after which an interrupt is noticed at the latest
_LITTER = 20_000  # objects more than before, at which Python looks for garbage by itself

_NO_NODE = 'error creating node: '
_SOURCE_PLACE = re.compile(r',? at \S+:\d+')


def own_arguments(argv: Sequence[str]) -> list[str]:
    """Return the arguments that are not ROS's (``--ros-args ...``).

    Raises
    ------
    ParameterError
        ROS does not accept its own.
    """
    with _refusals():
        return list(remove_ros_args(['', *argv])[1:])


class Interrupt:
    """SIGINT (Ctrl-C) and SIGTERM, noticed between two callbacks.

    ROS's own handlers shut it down at once, whatever a callback is about to publish, and Python's raise in the middle
    of it, where the conversion of a message may turn that into another error.

    Attributes
    ----------
    requested : whether one has come
    """

    def __init__(self) -> None:
        self.requested = False
        # For good: another one, while what is left is being done, must not cut that short.
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True


@contextmanager
def ros(argv: Sequence[str]) -> Iterator[Interrupt]:
    """Initialise ROS for the duration of a block, and give it what an interrupt sets.

    Raises
    ------
    ParameterError
        ROS does not accept the arguments, or what the environment asks for: security without what it takes.
    """
    with _refusals():
        rclpy.init(args=['', *argv], signal_handler_options=SignalHandlerOptions.NO)
    refuse_negative_times()
    # What rcl does not take apart of a node that it could not make says nothing that the error does not.
    warnings.filterwarnings('ignore', message='Failed to fini rosout publisher', category=RuntimeWarning)
    try:
        yield Interrupt()
    except RCLError as error:
        if not str(error).startswith(_NO_NODE):
            raise
        raise ParameterError(f'the middleware makes no node: {_reason(str(error))}') from error
    finally:
        rclpy.shutdown()


def spin(node: Node, over: Callable[[], object]) -> None:
    """Run a node's callbacks, one at a time, until something is over."""
    # Of rclpy's executors the one that keeps up with two topics at 1 kHz.
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.create_timer(LATENCY, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME))  # a reason to look again
    # What there is by now stays: to look through all of it for garbage would hold messages up, 40 ms each time. A node
    # that has to be quick at times looks through the rest when there is time, before Python does it when there is none.
    gc.freeze()
    gc.set_threshold(_LITTER)
    while not over():
        executor.spin_once()


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn what rcl raises about arguments into ParameterErrors, and keep it from logging a line of its own."""
    set_logger_level('rcl', LoggingSeverity.FATAL)
    try:
        yield
    except UnknownROSArgsError as error:
        raise ParameterError(f'unknown ROS arguments {error}; accepted are -p, --params-file, -r, ...') from error
    except (RCLError, InvalidROSArgsError) as error:
        raise ParameterError(_reason(str(error))) from error
    finally:
        set_logger_level('rcl', LoggingSeverity.UNSET)


def _reason(text: str) -> str:
    """Return what rcl says about an argument, without its source files, and with a hint where it is cryptic."""
    reason = _SOURCE_PLACE.sub('', text)
    for prefix in ('failed to initialize rcl: ', 'Failed to parse ROS arguments: ', _NO_NODE):
        reason = reason.removeprefix(prefix)
    if 'same type' in reason:
        reason += ' (in a list of numbers, write all with a decimal point)'
    return reason
