"""What a live run of hours shows: memory and processor time of its processes, windows and messages that are lost."""

from __future__ import annotations

import os
import subprocess
import time
from dataclasses import dataclass, field

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from benchmarks.endurance import processor_time, resident
from benchmarks.speed_live import DOMAIN, ENVIRONMENT
from mbaid_ros.core.geometry import Array
from mbaid_ros.nodes.subscriptions import qos

RATE = 100.0  # Hz
WINDOW = 0.5  # s
_EVERY = 5.0  # s, from one mark to the next
_LAST = 3.0  # s, in which /diagnostics tells of what came last
_PATIENCE = 20.0  # s, until the first estimate
_INPUTS = (': joint_states', ': odom')
Process = subprocess.Popen[bytes]


@dataclass(frozen=True)
class Mark:
    """Where a run was.

    Attributes
    ----------
    hours : of stamps
    estimator, simulator : processor time, s; resident memory, MB
    """

    hours: float
    estimator: tuple[float, float]
    simulator: tuple[float, float]


@dataclass
class Hours:
    """What a run has come to.

    Attributes
    ----------
    marks : in order
    windows, lost_windows : from the first estimate to the last one
    messages, lost : on both topics, by the stamp at which the node told of them
    seconds : that it took
    speed : seconds of stamps in a second
    status, parameters, deviations : of the last estimate
    """

    marks: list[Mark] = field(default_factory=list)
    windows: int = 0
    lost_windows: int = 0
    messages: int = 0
    lost: int = 0
    seconds: float = 0.0
    speed: float = 0.0
    status: str = ''
    parameters: Array = field(default_factory=lambda: np.full(10, np.nan))
    deviations: Array = field(default_factory=lambda: np.full(10, np.nan))


class _Listener(Node):
    """Notes the estimates, and how many messages the node has received."""

    def __init__(self, context: Context) -> None:
        super().__init__('listener', context=context, start_parameter_services=False)
        self.estimates = 0
        self.first = self.last = 0.0  # s, stamps of the first estimate and the last one
        self.estimate = InertiaEstimate()
        self.received: dict[str, int] = {}
        self.create_subscription(InertiaEstimate, '/estimator/estimate', self._on_estimate, qos(1000))
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos(10))

    def _on_estimate(self, message: InertiaEstimate) -> None:
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        if message.samples and message.status != 'waiting' and stamp > self.last:
            self.first = self.first or stamp
            self.estimates, self.last, self.estimate = self.estimates + 1, stamp, message

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for item in status.values if status.name.endswith(_INPUTS) else ():
                if item.key == 'received':
                    self.received[status.name] = int(item.value)


def watched(estimator: Process, simulator: Process, seconds: float, stamps: float) -> Hours:
    """Return what two processes show in some s on the wall, or of stamps; the simulator is stopped at its end.

    Raises
    ------
    RuntimeError
        One has ended, or there is no estimate.
    """
    os.environ.update(ENVIRONMENT)  # read by the middleware of this process, too
    context, hours = Context(), Hours()
    rclpy.init(context=context, domain_id=DOMAIN)
    listener, executor = _Listener(context), SingleThreadedExecutor(context=context)
    executor.add_node(listener)

    def spin(until: float) -> None:
        while time.monotonic() < until:
            executor.spin_once(timeout_sec=0.1)

    try:
        patience = time.monotonic() + _PATIENCE
        while not listener.estimates and time.monotonic() < patience:
            executor.spin_once(timeout_sec=0.1)
        if not listener.estimates:
            raise RuntimeError('no estimate')
        begin, at = time.monotonic(), listener.last
        while (now := time.monotonic()) < begin + seconds and listener.last < stamps:
            if estimator.poll() is not None or simulator.poll() is not None:
                raise RuntimeError('estimator or simulator has ended')
            told = [(processor_time(each.pid), resident(each.pid)) for each in (estimator, simulator)]
            hours.marks.append(Mark(listener.last / 3600.0, *told))
            spin(now + min(_EVERY, seconds))
        hours.seconds = time.monotonic() - begin
        hours.speed = (listener.last - at) / hours.seconds
        simulator.terminate()
        spin(time.monotonic() + _LAST)
        _end(hours, listener)
    finally:
        executor.shutdown()
        listener.destroy_node()  # type: ignore[no-untyped-call]
        rclpy.shutdown(context=context)
    return hours


def _end(hours: Hours, listener: _Listener) -> None:
    """Note what there was in all; the stamps begin at 0, with a message each."""
    hours.windows = round((listener.last - listener.first) / WINDOW) + 1
    hours.lost_windows = hours.windows - listener.estimates
    least = int(listener.last * RATE) + 1  # messages on each topic up to the last window's end
    hours.messages = sum(max(count, least) for count in listener.received.values())
    hours.lost = sum(max(0, least - count) for count in listener.received.values())
    last = listener.estimate
    hours.status = last.status
    hours.parameters, hours.deviations = _told(last)


def _told(estimate: InertiaEstimate) -> tuple[Array, Array]:
    """Return the ten parameters and their standard deviations."""
    inertia = estimate.inertia
    com = inertia.com
    elements = (inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz)
    covariance = np.array(estimate.covariance, dtype=float).reshape(10, 10)
    return np.array([inertia.m, com.x, com.y, com.z, *elements]), np.sqrt(np.diag(covariance))
