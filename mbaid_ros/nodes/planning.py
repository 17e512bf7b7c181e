"""What motion would help most, looked at now and then while the node runs."""

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
from mbaid_ros.nodes.publishers import TYPES
from mbaid_ros.nodes.qos import LATCHED, quiet_publisher
from mbaid_ros.nodes.state import State
from mbaid_ros.outgoing import trajectory_message

_ADVICE_PERIOD = 5.0  # s, from one look to the next, at least
_SHARE = 0.01  # of the time that looks may take


class AdviceTask:
    """Keeps what motion would help most in what the node knows.

    A look takes some hundredths of a second, and leaves the estimates as they are.

    Parameters
    ----------
    state : what the node knows
    tell : what is told of each advice, in a line
    """

    def __init__(self, state: State, tell: Callable[[str], None]) -> None:
        self._state = state
        self._tell = tell
        self._due = 0.0

    def look(self) -> None:
        """Look, if it is time to; call it when the estimates of a window have been told and nothing waits."""
        begin = monotonic()
        if begin < self._due:
            return
        self._state.advice = self._found()
        self._tell(self._state.advice)
        end = monotonic()
        self._due = end + max(_ADVICE_PERIOD, (end - begin) / _SHARE)

    def _found(self) -> str:
        session, estimate = self._state.session, self._state.estimate
        knowledge = None if session is None else session.knowledge()
        if session is None or knowledge is None or estimate is None or estimate.contradicted:
            return ''
        from mbaid_ros.session.planning import advice  # noqa: PLC0415 - takes a while, and is not needed to begin

        return advice(session.config, knowledge)


_POLL_PERIOD = 0.1  # s, between two looks at whether the motion is there


class Planning:
    """Plans when it is asked to.

    Parameters
    ----------
    node : whose service and topic these are
    state : what the node knows, and is told of the motion
    tell : what is told of what happens, in a line
    """

    def __init__(self, node: Node, state: State, tell: Callable[[str], None]) -> None:
        self._node = node
        self._state = state
        self._tell = tell
        self._publisher = self._open()
        self._service = node.create_service(Trigger, '~/plan', self._on_plan)
        self._timer = node.create_timer(_POLL_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()  # type: ignore[no-untyped-call]
        self._process: Any = None
        self._answer: Connection | None = None

    def close(self) -> None:
        """Give up what is under way, and leave the graph."""
        self.give_up()
        self._node.destroy_service(self._service)
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def give_up(self) -> None:
        """End a search that is under way."""
        self._timer.cancel()  # type: ignore[no-untyped-call]
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._answer is not None:
            self._answer.close()
        self._process = self._answer = None

    def forget(self) -> None:
        """Give up what is under way, and tell no more of the motion there is, not to late subscribers either."""
        self.give_up()
        if self._state.plan is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = self._open()
        self._state.plan = None

    def _open(self) -> Publisher:
        return quiet_publisher(self._node, JointTrajectory, '~/motion', LATCHED)

    def _on_plan(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        session = self._state.session
        knowledge = None if session is None else session.knowledge()
        if self._process is not None:
            response.message = 'a motion is being planned already; it comes on ~/motion'
        elif session is None or knowledge is None:
            response.message = (
                'there is no solution to plan from yet; accepted: a call once method trajectory has come to one'
            )
        else:
            self._begin(session.config, knowledge)
            response.success = True
            response.message = (
                f'planning from the state at {knowledge.end.time:.1f} s; the motion comes on ~/motion, the verdict in '
                '/diagnostics and in the log'
            )
            self._tell(response.message)
        return response

    def _begin(self, config: EstimatorConfig, knowledge: Posterior) -> None:
        # Of a process that is forked, threads of the middleware would be missing.
        context = multiprocessing.get_context('spawn')
        self._answer, other = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(other, config, knowledge), daemon=True)
        self._process.start()
        other.close()
        self._timer.reset()  # type: ignore[no-untyped-call]

    def _look(self) -> None:
        """Publish the motion, if it has been found."""
        assert self._answer is not None, 'the timer runs while an answer is awaited'
        if not self._answer.poll():
            return
        try:
            found, reached, lines = self._answer.recv()
        except EOFError:
            found, reached, lines = None, False, ('no motion: the process that looked for it has ended',)
        self.give_up()
        self._state.plan = reached, lines[0]
        if found is not None:
            self._publisher.publish(trajectory_message(found, TYPES))
        for line in lines:
            self._tell(line)


def _work(answer: Connection, config: EstimatorConfig, knowledge: Posterior) -> None:
    """Send back the motion, None where there is none, and what is to be told."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who has started this ends it
    from mbaid_ros.session.planning import make_planner  # noqa: PLC0415 - takes a while, and the node needs none of it

    try:
        plan = make_planner(config, knowledge).plan()
    except MbaidError as error:
        answer.send((None, False, (f'no motion: {error}',)))
    else:
        answer.send((plan.trajectory, plan.reached, (plan.verdict, *plan.excursions, *plan.notes)))
