"""The process of a node: command line, ROS parameters, signals, spinning."""

from __future__ import annotations

import gc
import math
import re
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from types import FrameType
from typing import Any, Protocol, TypeVar

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import get_logger, set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.time_source import TimeSource
from rclpy.utilities import remove_ros_args

from mbaid_ros.config.parameter_files import load_parameter_file, parse_assignment
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import ParameterSpec, build, specification, specifications, values_of

T = TypeVar('T')

RCLError = rclpy_implementation.RCLError
InvalidROSArgsError = rclpy_implementation.RCLInvalidROSArgsError
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError

LATENCY = 0.1  # s, after which an interrupt is noticed at the latest
_LITTER = 20_000  # objects more than before, at which Python collects garbage by itself
_INTEGERS = -(2**63), 2**63 - 1
_NO_NODE = 'error creating node: '
_SOURCE_PLACE = re.compile(r',? at \S+:\d+')
_words: list[tuple[str, str]] = []  # the process's parameters with their flags, as given: rclpy keeps them to itself


@dataclass(frozen=True)
class NoParameters:
    """Those of an executable with arguments instead: one that is given is an error."""


def own_arguments(argv: Sequence[str]) -> list[str]:
    """Return the arguments that are not ROS's (``--ros-args ...``).

    Raises ParameterError: ROS does not accept its own.
    """
    with _refusals():
        return list(remove_ros_args(['', *argv])[1:])


# Parameters


def declare_parameters(node: Node, cls: type[T]) -> T:
    """Declare every parameter of a dataclass on a node and return an instance with the values given to the node.

    Unlike rclpy alone, it refuses unknown names and accepts a whole number for a double, as `replay` and `simulate` do.

    Raises ParameterError: An override has an unknown name, or a value that is not accepted.
    """
    known = specifications(cls)  # type: ignore[arg-type]
    given = _given(node)
    # An empty list comes without a type, hence without a value.
    empty = {name for name, value in given.items() if value is None and name in known and 'array' in known[name].type}
    config = build(cls, given | dict.fromkeys(empty, ()))
    for name, value in values_of(config).items():
        spec = specification(name, cls)
        if value == ():
            _declare_empty_list(node, spec)
        else:
            plain = list(value) if isinstance(value, tuple) else value
            node.declare_parameter(spec.name, plain, _descriptor(spec), ignore_override=True)
    return config


def _given(node: Node) -> dict[str, Any]:
    """Return the parameters given to a node: of its files, where a later one wins, then of -p.

    rclpy alone ignores a file without a section '/**' or of the node's full name, and -p beside such a section.

    Raises ParameterError: A file has no section for the node.
    """
    values: dict[str, Any] = {}
    for flag, text in _words:
        if flag == '--params-file':
            values |= load_parameter_file(text, node.get_fully_qualified_name())
    # rclpy has no public way to the overrides of undeclared parameters, and a misspelt name stays undeclared.
    values |= {name: override.value for name, override in node._parameter_overrides.items()}  # noqa: SLF001
    assigned = dict(parse_assignment(text) for flag, text in _words if flag != '--params-file')
    values |= {name: value for name, value in assigned.items() if ':' not in name}
    if 'use_sim_time' in values:  # which rclpy has read by itself
        node.set_parameters([Parameter('use_sim_time', value=values['use_sim_time'])])  # type: ignore[no-untyped-call]
    return values


def _declare_empty_list(node: Node, spec: ParameterSpec) -> None:
    """Declare a list by its type: rclpy takes an empty one for a list of bytes."""
    kind = Parameter.Type[spec.type.upper()]
    # Declared by type, a parameter has no value; it can be given one before it becomes read-only.
    node.declare_parameter(spec.name, kind, ignore_override=True)
    node.set_parameters([Parameter(spec.name, kind, [])])  # type: ignore[no-untyped-call]
    descriptor = _descriptor(spec)
    descriptor.name, descriptor.type = spec.name, kind.value
    node.set_descriptor(spec.name, descriptor)


def _descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=spec.description,
        additional_constraints=f'{spec.accepted}; read when the node starts',
        read_only=True,
    )
    if spec.minimum is None and spec.maximum is None:
        return descriptor
    # An exclusive minimum, or the range of each number of a list, is described in words only.
    low, high = spec.minimum, spec.maximum
    if spec.type == 'double':
        ends = -math.inf if low is None else float(low), math.inf if high is None else float(high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=ends[0], to_value=ends[1])]
    elif spec.type == 'integer':
        whole = _INTEGERS[0] if low is None else int(low), _INTEGERS[1] if high is None else int(high)
        descriptor.integer_range = [IntegerRange(from_value=whole[0], to_value=whole[1], step=0)]
    return descriptor


# ROS and its signals


class Interrupt:
    """SIGINT (Ctrl-C) and SIGTERM, noticed between two callbacks: `requested` is whether one has come.

    ROS's own handlers shut it down at once, before a callback has published, and Python's raise in the middle of one.
    """

    def __init__(self) -> None:
        self.requested = False
        # For good: a second signal must not cut the completion short.
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True


@contextmanager
def ros(argv: Sequence[str]) -> Iterator[Interrupt]:
    """Initialise ROS for the duration of a block, and yield the interrupt.

    Raises ParameterError: ROS does not accept the arguments, or the environment: security without its files.
    """
    with _refusals():
        rclpy.init(args=['', *argv], signal_handler_options=SignalHandlerOptions.NO)
    inside = False
    for word, following in pairwise((*argv, '')):
        inside = word == '--ros-args' or (inside and word != '--')
        if inside and word in {'-p', '--param', '--params-file'}:
            _words.append((word, following))
    _refuse_negative_times()
    # A node that rcl could not make raises an error that this warning adds nothing to.
    warnings.filterwarnings('ignore', message='Failed to fini rosout publisher', category=RuntimeWarning)
    try:
        yield Interrupt()
    except RCLError as error:
        if not str(error).startswith(_NO_NODE):
            raise
        raise ParameterError(f'the middleware makes no node: {_reason(str(error))}') from error
    finally:
        _words.clear()
        rclpy.shutdown()


class Background(Protocol):
    """Work in slices of some milliseconds that may wait."""

    @property
    def is_due(self) -> bool:
        """Whether a slice may run now."""

    def run_slice(self) -> None:
        """Run a slice."""


def spin(node: Node, over: Callable[[], object], background: Background | None = None) -> None:
    """Run a node's callbacks, one at a time, until `over()`, and background work while no callback is ready."""
    executor = SingleThreadedExecutor()  # the one of rclpy's that keeps up with two topics at 1 kHz
    executor.add_node(node)
    node.create_timer(LATENCY, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME))  # a reason to look again
    # Collecting all objects there are by now would delay messages by 40 ms each time. The estimator collects the others
    # after its estimates, before Python does at a worse time.
    gc.freeze()
    gc.set_threshold(_LITTER)
    ready = False  # whether a callback was, when last looked
    while not over():
        if background is None or not background.is_due:
            executor.spin_once()
            continue
        try:
            handler, *_ = executor.wait_for_ready_callbacks(timeout_sec=0.0)
        except TimeoutException:  # comes after the callbacks that were ready, too
            if not ready:
                background.run_slice()
            ready = False
        else:
            ready = True
            handler()
            handler.result()  # type: ignore[no-untyped-call] # raises what the callback has


def _refuse_negative_times() -> None:
    """Ignore negative times on /clock, for which rclpy ends a node."""
    take = TimeSource.clock_callback
    log: Any = get_logger('clock')

    def take_unless_negative(source: TimeSource, message: Any) -> None:
        if message.clock.sec < 0:
            text = f'a time on /clock is negative, {message.clock.sec} s: it is not taken'
            log.warning(text, once=True)
        else:
            take(source, message)

    TimeSource.clock_callback = take_unless_negative  # type: ignore[method-assign, assignment]


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn rcl's errors about arguments into ParameterErrors, and suppress its own log lines of them."""
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
    """Return an error of rcl without its source files, and with a hint if it is cryptic."""
    reason = _SOURCE_PLACE.sub('', text)
    for prefix in ('failed to initialize rcl: ', 'Failed to parse ROS arguments: ', _NO_NODE):
        reason = reason.removeprefix(prefix)
    if 'same type' in reason:
        reason += ' (in a list of numbers, write all with a decimal point)'
    return reason
