"""The publications of the node `estimator`: estimates as they come, stale or withdrawn."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import groupby
from time import monotonic
from typing import Any

from geometry_msgs.msg import InertiaStamped
from mbaid_msgs.msg import InertiaEstimate
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String

from mbaid_ros.cli import one_line
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.capture import Capture
from mbaid_ros.core.results.estimate import PARAMETERS, UNITS, Estimate, is_complete, rounded
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.core.target import Debris
from mbaid_ros.errors import listing
from mbaid_ros.estimate_messages import Frames, Publications, estimate_message
from mbaid_ros.nodes.diagnostics import RunState
from mbaid_ros.nodes.subscriptions import LATCHED, TYPES, quiet_publisher
from mbaid_ros.nodes.watch import NEXT
from mbaid_ros.session.model_summary import ModelSummary
from mbaid_ros.session.session import Session

PATIENCE = 5.0  # s without the awaited messages, or of a motion that determines too little, before a log line
_NUMBER = re.compile(r'\b\d+(\.\d+)?\b')
_ALARMING = {'inconsistent', 'not_identifiable'}


class RunLog:
    """The terminal output of the estimator: each thing once."""

    def __init__(self, log: Any) -> None:
        self._log = log
        self._warned: set[str] = set()
        self.begin()

    def begin(self, *, warned: bool = False) -> None:
        """Begin a run: lines about data may come again, warnings only if not `warned`."""
        if not warned:
            self._warned.clear()
        self._since = monotonic()
        self._status = ''
        self._logged_joints = False
        self._advised: set[str] = {''}

    def robot(self, summary: ModelSummary, method: str) -> None:
        """Log the summary of the robot description."""
        for line in (*summary.lines, f'method {method}'):
            self.event(line)
        for warning in summary.warnings:
            self._log.warning(one_line(warning))

    def joints(self, summary: ModelSummary) -> None:
        """Log, once messages have come, the joints that the robot description lacks."""
        if not self._logged_joints and summary.foreign:
            self.event(f'joints of the messages that the robot description lacks: {listing(summary.foreign)}')
        self._logged_joints = True

    def waiting(self, awaited: Sequence[str]) -> None:
        """Log awaited messages after a while, once for each likely reason; call it regularly."""
        if monotonic() - self._since > PATIENCE:
            for each in awaited:
                self.warn_once(f'waiting for {each}')

    def estimate(self, estimate: Estimate) -> None:
        """Log the first estimate, and each whose status differs from the last one's."""
        self._log.debug(
            f'window to {estimate.time:.3f} s: {estimate.status}, {estimate.samples} samples, residual '
            f'{estimate.residual:.3g}, {_method(estimate)}'
        )
        # Hardly any motion determines anything in its first seconds: no reason for alarm yet.
        early = estimate.status == 'not_identifiable' and estimate.time < PATIENCE and not estimate.contradicted
        if early or estimate.status in {'waiting', self._status}:
            return
        first, self._status = not self._status, estimate.status
        lead = 'first estimate, ' if first else ''
        text = one_line(f'{lead}{estimate.status.replace("_", " ")} after {estimate.time:.1f} s: {headline(estimate)}')
        # One call a level: rclpy ties a line of code to the level of its first call.
        if estimate.status in _ALARMING:
            self._log.warning(text)
        else:
            self._log.info(text)

    def warn_once(self, text: str) -> None:
        """Log a warning, unless it differs from an earlier one only in its numbers."""
        if _is_new(text, self._warned):
            self._log.warning(one_line(text))

    def advice(self, text: str) -> None:
        """Log the most informative motion, once for each joint and parameter."""
        if _is_new(text, self._advised):
            self.event(f'{NEXT}: {text}')

    def event(self, text: str) -> None:
        """Log an event: a reset, a pause, a capture."""
        self._log.info(one_line(text))


def _is_new(text: str, known: set[str]) -> bool:
    """Return whether a text differs from the known ones in more than numbers, and remember it."""
    key, before = _NUMBER.sub('#', text), len(known)
    known.add(key)
    return len(known) > before


def headline(estimate: Estimate) -> str:
    """Return mass and centre of mass with their 95 % bands, the residual, and the likely cause, in a line."""
    parts = []
    for index in range(4):
        value, band = rounded(float(estimate.parameters[index]), float(estimate.std[index]))
        if value:
            parts.append(f'{PARAMETERS[index]} {value}{f" ± {band}" if band else ""} {UNITS[index]}')
    if any('±' in part for part in parts):
        parts.append('± 95 %')
    parts += [f'residual {estimate.residual:.2g}', _method(estimate), *map(str, estimate.repairs)]
    if estimate.likely_causes:
        parts.append(f'likely cause: {estimate.likely_causes[0][0]}')
    elif estimate.status in _ALARMING and estimate.warnings:
        parts.append(estimate.warnings[0])
    return ', '.join(parts)


def _method(estimate: Estimate) -> str:
    return estimate.method if estimate.stage in {'', estimate.method} else f'stage {estimate.stage}'


_PATIENCE = Duration(nanoseconds=50_000_000)  # with a subscriber that has died, or has no time


class Publishers:
    """The latched topics: ~/estimate, ~/inertia, ~/robot_description and, if asked for, ~/debris."""

    def __init__(self, node: Node, *, with_debris: bool = False) -> None:
        self._node = node
        self._topics: dict[str, type] = {
            '~/estimate': InertiaEstimate,
            '~/inertia': InertiaStamped,
            '~/robot_description': String,
        }
        if with_debris:
            self._topics['~/debris'] = InertiaEstimate
        self._publishers: dict[str, Publisher] = {}
        self._publications = Publications(TYPES)
        self._last: tuple[Estimate, Frames] | None = None  # what was published last, of this run
        self.clear()

    def clear(self) -> None:
        """Withdraw everything: later subscribers get nothing of it, those that have numbers get NaN."""
        if self._last is not None:
            estimate, frames = self._last
            ended = Estimate(method=estimate.method, status='waiting', stamp=estimate.stamp)
            for name, message in self._publications.messages_of(ended, frames):
                if name != 'estimate':
                    self.send(f'~/{name}', message)
                    self._publishers[f'~/{name}'].wait_for_all_acked(_PATIENCE)
        self._last = None
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        for topic in self._topics:
            self._open(topic)
        self._publications = Publications(TYPES)
        self._described = False  # whether ~/robot_description holds a robot

    def publish(
        self,
        estimate: Estimate,
        frames: Frames,
        urdf: str,
        alone: Debris | None = None,
        capture: Capture | None = None,
    ) -> None:
        """Publish an estimate in all the forms that it determines, and withdraw the last one from the others."""
        self._last = estimate, frames
        for name, message in self._publications.messages_of(estimate, frames, alone, capture):
            self.send(f'~/{name}', message)
        described, self._described = self._described, is_complete(estimate)
        if self._described:
            text = replace_inertial(urdf, frames.target_link, estimate.parameters)
            self.send('~/robot_description', String(data=text))
        elif described:
            # A robot without numbers is none, and only a publisher's end makes a latched topic forget.
            self._node.destroy_publisher(self._publishers['~/robot_description'])
            self._open('~/robot_description')

    def send(self, topic: str, message: Any) -> None:
        """Publish a message on a topic, once its subscribers have the last one."""
        # A latched topic keeps one message, and would lose it to the next when several windows close at once.
        self._publishers[topic].wait_for_all_acked(_PATIENCE)
        self._publishers[topic].publish(message)

    def _open(self, topic: str) -> None:
        self._publishers[topic] = quiet_publisher(self._node, self._topics[topic], topic, LATCHED)


class EstimatePublication:
    """The estimates of the runs of a node, on its topics and in its log.

    Parameters
    ----------
    node, config, log : of the node
    state : of the node; its estimate is the last one published
    missing : returns the obstacles to an estimate
    """

    def __init__(
        self,
        node: Node,
        config: EstimatorConfig,
        state: RunState,
        log: RunLog,
        missing: Callable[[], tuple[str, ...]],
    ) -> None:
        self._node = node
        self._config = config
        self._state = state
        self._log = log
        self._missing = missing
        self._publishers = Publishers(node, with_debris=config.debris.report)
        self._restarted = 0  # restarts of the session that have been reported
        self._waiting: tuple[str, ...] | None = None  # warnings of the last estimate of status 'waiting'

    def publish(self, session: Session, estimates: list[Estimate]) -> None:
        """Publish new estimates, and withdraw those from before a restart."""
        for estimate in last_of_each_window(estimates, self._config.window):
            if session.restarted != self._restarted and session.restarts[-1] in estimate.warnings:
                self._report_restart(session)
            self._state.estimate, self._state.stale = estimate, ''
            robot = session.robot_of(estimate)
            alone, capture = robot.debris(estimate), robot.captured(estimate)
            self._publishers.publish(estimate, session.frames_of(estimate), robot.urdf, alone, capture)
            self._log.estimate(estimate)
        if session.restarted != self._restarted:
            self._report_restart(session)

    def publish_waiting(self) -> None:
        """Publish, while there is no estimate, the obstacles to one, whenever these change."""
        if self._state.estimate is not None:
            return
        missing = self._missing()
        if missing == self._waiting:
            return
        self._waiting = missing
        session = self._state.session
        frames = session.frames if session else Frames(target_link=self._config.target_link, odometry='')
        stamp = self._node.get_clock().now().nanoseconds
        waiting = Estimate(method=self._config.method, status='waiting', stamp=stamp, warnings=missing)
        self._publishers.publish(waiting, frames, '')

    def publish_stale(self, reason: str) -> None:
        """Publish the last estimate again, marked stale, with the reason; once."""
        state = self._state
        if state.session is None or state.estimate is None or not reason or state.stale:
            return
        state.stale = reason
        self._log.event(f'the estimate is stale: {reason}')
        warnings = [state.sample_counts, reason]
        frames = state.session.frames_of(state.estimate)
        message = estimate_message(state.estimate, TYPES, frames, warnings, stale=True)
        self._publishers.send('~/estimate', message)

    def withdraw(self, *, warned: bool = False) -> None:
        """Withdraw everything of a run that has ended; `warned` is whether the log has reported that."""
        self._state.estimate, self._state.stale, self._state.advice, self._waiting = None, '', '', None
        if not warned:  # a session that has been reset or replaced
            self._restarted = 0
        self._log.begin(warned=warned)
        self._publishers.clear()
        self.publish_waiting()

    def _report_restart(self, session: Session) -> None:
        self._restarted = session.restarted
        for restart in session.restarts:
            self._log.warn_once(restart)
        self.withdraw(warned=True)


def last_of_each_window(estimates: Sequence[Estimate], window: float) -> list[Estimate]:
    """Return the last estimate of each window (s): the methods of the paper give one a sample, too many to publish.

    The stamps of the samples alone separate windows, so how many come at once makes no difference.
    """
    windows = groupby(estimates, key=lambda estimate: int((estimate.time + 1e-9) / window))
    return [list(several)[-1] for _, several in windows]
