"""Planned motions: the next informative motion in words, now and then, and a whole trajectory on request."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from time import monotonic
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.nodes.reports import RunState
from mbaid_ros.nodes.subscriptions import LATCHED, TYPES, quiet_publisher
from mbaid_ros.outgoing import trajectory_message
from mbaid_ros.session.planning import advice, make_planner  # at the start: an import in a run would delay estimates

_ADVICE_PERIOD = 5.0  # s, between two searches, at least
_SHARE = 0.01  # of the time that these searches may take
_POLL_PERIOD = 0.1  # s, between two looks for the planned motion


class AdviceTask:
    """Updates the advice in the node's state and logs it; a search takes one or two tenths of a second."""

    def __init__(self, state: RunState, log: Callable[[str], None]) -> None:
        self._state = state
        self._log = log
        self._due = 0.0

    def run_if_due(self) -> None:
        """Search, if it is time to; call it when the estimates of a window are published and nothing waits."""
        begin = monotonic()
        if begin < self._due:
            return
        self._state.advice = self._advice()
        self._log(self._state.advice)
        end = monotonic()
        self._due = end + max(_ADVICE_PERIOD, (end - begin) / _SHARE)

    def _advice(self) -> str:
        session, estimate = self._state.session, self._state.estimate
        posterior = None if session is None else session.posterior()
        if session is None or posterior is None or estimate is None or estimate.contradicted:
            return ''
        return advice(session.config, posterior)


class Planning:
    """The service ~/plan, which searches in a process of its own, and the motion it publishes on ~/motion."""

    def __init__(self, node: Node, state: RunState, log: Callable[[str], None]) -> None:
        self._node = node
        self._state = state
        self._log = log
        self._publisher = self._open()
        self._service = node.create_service(Trigger, '~/plan', self._on_plan)
        self._timer = node.create_timer(_POLL_PERIOD, self._poll, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()  # type: ignore[no-untyped-call]
        self._process: Any = None
        self._answer: Connection | None = None

    def close(self) -> None:
        """End a search, and leave the graph."""
        self._end_search()
        self._node.destroy_service(self._service)
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def withdraw(self) -> None:
        """End a search, and withdraw the motion, also from late subscribers."""
        self._end_search()
        if self._state.plan is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = self._open()
        self._state.plan = None

    def _open(self) -> Publisher:
        return quiet_publisher(self._node, JointTrajectory, '~/motion', LATCHED)

    def _on_plan(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        session = self._state.session
        posterior = None if session is None else session.posterior()
        if self._process is not None:
            response.message = 'a motion is being planned already; it comes on ~/motion'
        elif session is None or posterior is None:
            response.message = 'there is no solution to plan from yet; accepted: a call once method trajectory has one'
        else:
            self._begin_search(session.config, posterior)
            response.success = True
            response.message = (
                f'planning from the state at {posterior.end.time:.1f} s; the motion comes on ~/motion, the verdict in '
                '/diagnostics and in the log'
            )
            self._log(response.message)
        return response

    def _begin_search(self, config: EstimatorConfig, posterior: Posterior) -> None:
        context = multiprocessing.get_context('spawn')  # a forked process would lack the middleware's threads
        self._answer, other = context.Pipe(duplex=False)
        self._process = context.Process(target=_search, args=(other, config, posterior), daemon=True)
        self._process.start()
        other.close()
        self._timer.reset()  # type: ignore[no-untyped-call]

    def _end_search(self) -> None:
        self._timer.cancel()  # type: ignore[no-untyped-call]
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._answer is not None:
            self._answer.close()
        self._process = self._answer = None

    def _poll(self) -> None:
        """Publish the motion, if it has been found."""
        assert self._answer is not None, 'the timer runs while an answer is awaited'
        if not self._answer.poll():
            return
        try:
            trajectory, reached, lines = self._answer.recv()
        except EOFError:
            trajectory, reached, lines = None, False, ('no motion: the process that looked for it has ended',)
        self._end_search()
        self._state.plan = reached, lines[0]
        if trajectory is not None:
            self._publisher.publish(trajectory_message(trajectory, TYPES))
        for line in lines:
            self._log(line)


def _search(answer: Connection, config: EstimatorConfig, posterior: Posterior) -> None:
    """Send back the motion, None if there is none, whether it reaches the wanted precision, and lines for the log."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process ends this one
    try:
        plan = make_planner(config, posterior).plan()
    except MbaidError as error:
        answer.send((None, False, (f'no motion: {error}',)))
    else:
        answer.send((plan.trajectory, plan.reached, (plan.verdict, *plan.excursions, *plan.notes)))
