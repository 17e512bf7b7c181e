"""How every node starts and stops: arguments, signals, and errors that are one line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.node import Node
from rclpy.utilities import ok, remove_ros_args, try_shutdown

from mbaid_ros.core.errors import ParameterError

RCLError = rclpy_implementation.RCLError
InvalidROSArgsError = rclpy_implementation.RCLInvalidROSArgsError
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError

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


@contextmanager
def ros(argv: Sequence[str]) -> Iterator[None]:
    """Initialise ROS for the duration of a block; an interrupt (SIGINT, SIGTERM) ends the block and is no error.

    Raises
    ------
    ParameterError
        ROS does not accept the arguments.
    """
    with _refusals():
        rclpy.init(args=['', *argv])
    try:
        with suppress(KeyboardInterrupt, ExternalShutdownException):
            yield
    except (RCLError, InvalidHandle):
        # A signal shuts ROS down at once: what was about to be published then cannot be.
        if ok():
            raise
    finally:
        _shut_down()


def spin(node: Node) -> None:
    """Run a node's callbacks, one at a time, until ROS is shut down."""
    # Of rclpy's executors the one that keeps up with two topics at 1 kHz.
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.spin()


def _shut_down() -> None:
    try:
        try_shutdown()
    except RCLError:
        # The thread that handles signals may have shut ROS down in between.
        if ok():
            raise


def run_node(make: Callable[[], Node], argv: Sequence[str]) -> int:
    """Run a node until it is interrupted, and return the exit code 0."""
    with ros(argv):
        spin(make())
    return 0


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
    for prefix in ('failed to initialize rcl: ', 'Failed to parse ROS arguments: '):
        reason = reason.removeprefix(prefix)
    if 'same type' in reason:
        reason += ' (in a list of numbers, write all with a decimal point)'
    return reason
