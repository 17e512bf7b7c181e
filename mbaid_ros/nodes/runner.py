"""How every node starts and stops: arguments, signals, and errors that are one line."""

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

from mbaid_ros.core.errors import ParameterError
from mbaid_ros.nodes.simulated_clock import refuse_negative_times

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
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

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
