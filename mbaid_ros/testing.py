"""For tests with hardware in the loop: run executables, wait for an estimate, compare it with known values.

This module is a public interface: docs/tutorials/hil-test.md shows its use.
"""

from __future__ import annotations

import math
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import rclpy
from ament_index_python.packages import get_package_prefix
from mbaid_msgs.msg import InertiaEstimate
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.estimate_messages import parameters_of
from mbaid_ros.nodes.subscriptions import LOST

Until = Literal['estimating', 'converged', 'stale']
_LAST_WORDS = 10.0  # s, for a process to end after it has been interrupted


@contextmanager
def running(executable: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run an executable of this package during a block, and interrupt it at the end if it has not ended by itself.

    Parameters
    ----------
    executable : its name: 'estimator', 'player', ...
    arguments : as on the command line
    """
    path = Path(get_package_prefix('mbaid_ros')) / 'lib' / 'mbaid_ros' / executable
    process = subprocess.Popen([str(path), *arguments])
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(_LAST_WORDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def wait_for_estimate(
    until: Until = 'converged',
    timeout: float = 60.0,
    topic: str = '/estimator/estimate',
    *,
    allow_lost: bool = False,
) -> InertiaEstimate:
    """Return the first estimate with the wanted state.

    Raises TimeoutError: There is none in time; the text has the last status and its warnings.
    Raises AssertionError: The last estimate lacks messages that the publishers sent, and `allow_lost` is false.

    Parameters
    ----------
    until : 'estimating' accepts any estimate with a parameter, 'converged' one of that status, 'stale' the last one
        after the data have stopped, which covers all complete windows
    timeout : s
    topic : of the estimator
    """
    context = Context()
    rclpy.init(context=context)
    heard: list[InertiaEstimate] = []
    try:
        node = Node('wait_for_estimate', context=context, start_parameter_services=False)
        profile = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # type: ignore[no-untyped-call]
        node.create_subscription(InertiaEstimate, topic, heard.append, profile)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
            found = next((estimate for estimate in heard if _has_come(estimate, until)), None)
            if found is not None:
                lost = [warning for warning in found.warnings if LOST in warning]
                assert allow_lost or not lost, '; '.join(lost)
                return found
            del heard[:-1]
    finally:
        rclpy.shutdown(context=context)
    raise TimeoutError(f'no {until} estimate on {topic} within {timeout:g} s: {_last(heard)}')


def deviations(estimate: InertiaEstimate, expected: Mapping[str, float]) -> dict[str, float]:
    """Return how far parameters are from the expected values, in their standard deviations; infinite if not determined.

    Raises ParameterError: A name is not that of a parameter.

    Parameters
    ----------
    expected : values by name: mass, com_x, com_y, com_z (kg, m, target link's frame), ixx, ..., izz (kg m^2, about the
        centre of mass, the link's axes)
    """
    values, found = parameters_of(estimate), {}
    for name, wanted in expected.items():
        if name not in PARAMETERS:
            raise ParameterError(f"parameter '{name}' is not known; accepted: {listing(PARAMETERS)}")
        place = PARAMETERS.index(name)
        known, std = math.isfinite(values[place]), float(estimate.standard_deviation[place])
        found[name] = float(values[place] - wanted) / std if known else math.inf
    return found


def assert_within(estimate: InertiaEstimate, expected: Mapping[str, float], sigmas: float = 4.0) -> None:
    """Assert that parameters have the expected values within a number of their standard deviations.

    Raises AssertionError: One deviates, or the data do not determine it, or contradict the model.

    Parameters
    ----------
    estimate, expected : as for `deviations`
    sigmas : four are exceeded by chance once in 16,000
    """
    found = deviations(estimate, expected)
    off = [f'{name} by {number:+.1f}' for name, number in found.items() if not abs(number) <= sigmas]
    if estimate.status == estimate.INCONSISTENT:
        off.append('the data contradict the model')
    if off:
        text = f'off by more than {sigmas:g} standard deviations: {", ".join(off)}; {_last([estimate])}'
        raise AssertionError(text)


def _has_come(estimate: InertiaEstimate, until: Until) -> bool:
    if until == 'stale':
        return bool(estimate.stale)
    if until == 'converged':
        return bool(estimate.status == estimate.CONVERGED)
    return estimate.status in {estimate.ESTIMATING, estimate.CONVERGED} and any(estimate.identifiable)


def _last(heard: list[InertiaEstimate]) -> str:
    """Return the last estimate heard, in words."""
    if not heard:
        return 'nothing has been heard of an estimator'
    last = heard[-1]
    return '; '.join([f'status {last.status}, {last.samples} samples', *last.warnings])
