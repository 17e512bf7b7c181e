"""What the node `estimator` publishes and logs: estimates, what it waits for, how it is."""

from __future__ import annotations

import gc
from collections.abc import Mapping
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.publication import DebrisPublication
from mbaid_ros.nodes.clocks import SimulatedClock, clock_problems
from mbaid_ros.nodes.diagnostics import Diagnostics
from mbaid_ros.nodes.log import RunLog
from mbaid_ros.nodes.markers import Display
from mbaid_ros.nodes.planning import Planning
from mbaid_ros.nodes.publishers import TYPES, Publishers, last_of_each_window
from mbaid_ros.nodes.qos import qos, quiet_publisher
from mbaid_ros.nodes.reports import remarks
from mbaid_ros.nodes.state import State
from mbaid_ros.nodes.subscriptions import Subscriptions
from mbaid_ros.outgoing import Frames, debris_message
from mbaid_ros.session import Session

_TIDY_EVERY = 1.0  # s, at least, from one look for garbage after an estimate to the next


class EstimatePublication:
    """Tells of the runs of a node.

    Parameters
    ----------
    node : whose topics these are
    config : EstimatorConfig
    state : what the node knows; the estimate in it is the last one told
    narrator : says in the log what changes
    planning : whose motion is withdrawn with the run that it was planned from

    Attributes
    ----------
    display : markers and transforms
    """

    def __init__(self, node: Node, config: EstimatorConfig, state: State, narrator: RunLog, planning: Planning) -> None:
        self._node = node
        self._config = config
        self._state = state
        self._narrator = narrator
        self._planning = planning
        self._log: Any = node.get_logger()  # type: ignore[no-untyped-call]
        self.display = Display(node, with_frames=config.publish_tf, prefix=config.frame_prefix)
        self._clock = SimulatedClock(node, config.time_jump_threshold)
        self._outlets = Publishers(node, with_debris=config.debris.report)
        self._diagnostics_publisher = quiet_publisher(node, DiagnosticArray, '/diagnostics', qos(10))
        self._diagnostics: Diagnostics | None = None
        self._restarted = 0  # how often the session had started again when that was last told
        self._calibrated = ''  # what was last told of the robot's own bodies
        self._debris = DebrisPublication()
        self._tidied = 0.0  # s of the monotonic clock, when Python last looked for garbage
        self._waiting: tuple[str, ...] | None = None  # what the last estimate of status 'waiting' said

    def watch(self, diagnostics: Diagnostics) -> None:
        """Take what knows what arrives, and say what is missing."""
        self._diagnostics = diagnostics
        self.missing()

    def estimates(self, session: Session, found: list[Estimate]) -> None:
        """Publish new estimates, and withdraw what was published before stamps jumped back."""
        for estimate in last_of_each_window(found, self._config.window):
            if session.restarted != self._restarted and session.restarts[-1] in estimate.warnings:
                self._follow_restart(session)
            self._state.estimate, self._state.stale = estimate, ''
            self._narrator.estimate(estimate)
            frames = _frames(session)
            self._outlets.publish(estimate, frames, session.robot.urdf)
            self._tell_of_calibration(session)
            self._tell_of_debris(session, estimate, frames)
            self.display.show(estimate, f'{frames.prefix}{frames.target_link}')
        if found and monotonic() > self._tidied + _TIDY_EVERY:
            gc.collect()
            self._tidied = monotonic()
        if session.restarted != self._restarted:
            self._follow_restart(session)

    def withdraw(self, *, warned: bool = False) -> None:
        """Take back what has been published: it is of a run that is over.

        Parameters
        ----------
        warned : whether the log has said so
        """
        self._state.estimate, self._state.stale, self._state.advice, self._waiting = None, '', '', None
        self._narrator.begin(warned=warned)
        self._debris = DebrisPublication()
        self._planning.forget()
        self._outlets.clear()
        self.display.clear()
        self.missing()

    def anew(self) -> None:
        """Withdraw everything, of a session that has been reset or replaced."""
        self._restarted = 0
        self.withdraw()

    def missing(self) -> None:
        """Publish, while there is no estimate, what it waits for, whenever that changes."""
        state = self._state
        if self._diagnostics is None or state.estimate is not None:
            return
        missing = self._diagnostics.missing(state)
        if missing == self._waiting:
            return
        self._waiting = missing
        session = state.session
        frames = _frames(session) if session else Frames(target_link=self._config.target_link, odometry='')
        estimate = Estimate(
            method=self._config.method,
            status='waiting',
            stamp=self._node.get_clock().now().nanoseconds,
            warnings=missing,
        )
        self._outlets.publish(estimate, frames, '')

    def report(self, inlets: Mapping[str, Subscriptions]) -> None:
        """Publish /diagnostics, and log what is wrong with what arrives.

        Parameters
        ----------
        inlets : whose stamps have to fit the node's clock
        """
        assert self._diagnostics is not None, 'the inlets are watched before the first report'
        state = self._state
        if state.session is not None:
            for remark in remarks(state.session):
                self._narrator.warn_once(remark)
            if state.session.used:
                self._narrator.joints(state.session.survey())
        self._narrator.waiting(self._diagnostics.awaited(state))
        self.missing()
        clocks = self._clock_problems(inlets)
        for problem in clocks:
            self._narrator.warn_once(problem)
        statuses = self._diagnostics.statuses(state, self._node.get_fully_qualified_name().lstrip('/'), clocks)
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics_publisher.publish(array)
        self._tell_if_stale(self._diagnostics.silence(state))

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_publisher(self._diagnostics_publisher)
        self._outlets.close()
        self.display.close()
        self._clock.close()

    def _follow_restart(self, session: Session) -> None:
        self._restarted = session.restarted
        for restart in session.restarts:
            self._narrator.warn_once(restart)
        self.withdraw(warned=True)

    def _tell_of_debris(self, session: Session, estimate: Estimate, frames: Frames) -> None:
        """Publish the captured body alone; once without numbers where it is not determined any more."""
        found = self._debris.follow(session.robot.debris(estimate))
        if found is not None:
            capture = session.robot.captured(estimate)
            self._outlets.publish_debris(debris_message(found, estimate, TYPES, frames, capture))

    def _tell_of_calibration(self, session: Session) -> None:
        if session.robot.calibrated and session.robot.calibrated != self._calibrated:
            self._calibrated = session.robot.calibrated
            self._log.info(session.robot.calibrated)

    def _tell_if_stale(self, reason: str) -> None:
        """Publish the last estimate once more, as one that nothing follows, when data stop or it is paused."""
        state = self._state
        if state.session is None or state.estimate is None or not reason or state.stale:
            return
        state.stale = reason
        self._narrator.event(f'the estimate is stale: {reason}')
        self._outlets.tell_stale(state.estimate, _frames(state.session), [state.account, reason])

    def _clock_problems(self, inlets: Mapping[str, Subscriptions]) -> list[str]:
        readings = {inlet.topic: inlet.timed for inlet in inlets.values() if inlet.timed is not None}
        use_sim_time = bool(self._node.get_parameter('use_sim_time').value)
        found = clock_problems(self._node.get_clock().now().nanoseconds, readings, use_sim_time=use_sim_time)
        return [*found, *self._clock.problems()]


def _frames(session: Session) -> Frames:
    robot, prefix = session.robot, session.config.frame_prefix
    return Frames(target_link=robot.target_link, odometry=session.intake.odometry_reader.frame, prefix=prefix)
