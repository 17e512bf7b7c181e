"""What the node `estimator` does: joint states and odometry in, the inertia of the captured body out."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, Vector3Stamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.core.errors import DataError, MbaidError
from mbaid_ros.nodes.description import DescriptionSubscription, check_without_robot, tf_message
from mbaid_ros.nodes.diagnostics import Diagnostics
from mbaid_ros.nodes.estimate_publication import EstimatePublication
from mbaid_ros.nodes.log import RunLog
from mbaid_ros.nodes.planning import AdviceTask, Planning
from mbaid_ros.nodes.state import State
from mbaid_ros.nodes.subscriptions import Subscriptions
from mbaid_ros.session import Session

PERIOD = 1.0  # s, of /diagnostics
_AT_ONCE = 1e-3  # s, from one slice of what can wait to the next, at least


class Estimating:
    """Converts, calls the session, publishes.

    Parameters
    ----------
    node : whose topics and services these are
    config : EstimatorConfig
    active : whether data are taken from the beginning; where not, from `activate` on

    Raises
    ------
    ParameterError, ModelError
        A parameter, or the robot description file it names, cannot be used.
    """

    def __init__(self, node: Node, config: EstimatorConfig, *, active: bool = True) -> None:
        self._node = node
        self._narrator = RunLog(node.get_logger())  # type: ignore[no-untyped-call]
        self._config = config
        self._state = State(active=active)
        self._report_due = False  # a report waits for the estimate of a window
        self._awaited: int | None = None  # end of the window that one waited for
        # What can be refused comes first: nothing of this is on the graph then.
        self._read_robot()
        self._planning = Planning(node, self._state, self._narrator.event)
        self._telling = EstimatePublication(node, config, self._state, self._narrator, self._planning)
        self._description = None if self._state.session else DescriptionSubscription(node, self._on_description)
        self._inlets = {
            'joint_states': Subscriptions(node, JointState, 'joint_states', self._on_joint_state),
            **self._base_inlets(node),
        }
        self._thrust = Subscriptions(node, WrenchStamped, 'thrust', self._on_thrust)
        self._imu = self._inlets.get('imu') or Subscriptions(node, Imu, 'imu', self._on_imu)
        topic = self._description.topic if self._description else ''
        self._stored_momentum = Subscriptions(node, Vector3Stamped, 'stored_momentum', self._on_stored_momentum)
        diagnostics = Diagnostics(self._inlets, self._thrust, topic)
        self._services = [
            node.create_service(Trigger, '~/reset', self._on_reset),
            node.create_service(SetBool, '~/pause', self._on_pause),
            node.create_service(Trigger, '~/capture', self._on_capture),
        ]
        self._advising = AdviceTask(self._state, self._narrator.advice)
        # Its own clock: with use_sim_time and no /clock, that there is none is what a user has to be told.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD, self._on_timer, clock=clock)
        # While something is left to do before the next window: between messages, a few milliseconds at a time.
        self._leisure: Any = node.create_timer(_AT_ONCE, self._on_leisure, clock=clock, autostart=False)
        self._telling.watch(diagnostics)

    def _base_inlets(self, node: Node) -> dict[str, Subscriptions]:
        """Return the subscriptions that may locate the base, or what is needed in their place."""
        if self._config.imu.alone:
            return {'imu': Subscriptions(node, Imu, 'imu', self._on_imu)}
        if self._config.pose.tf_child_frame:
            message = tf_message("parameter 'pose.tf_child_frame' is set", 'empty')
            return {'tf': Subscriptions(node, message, '/tf', self._on_odometry)}
        others = (PoseWithCovarianceStamped, TransformStamped)
        return {
            'odom': Subscriptions(node, Odometry, 'odom', self._on_odometry),
            'pose': Subscriptions(node, PoseStamped, 'pose', self._on_odometry, others),
        }

    def _every_inlet(self) -> set[Subscriptions]:
        return {*self._inlets.values(), self._thrust, self._stored_momentum, self._imu}

    # Robot description

    def _read_robot(self) -> None:
        """Read the robot description file, if there is one; else check what can be without it."""
        path = self._config.robot_description_file
        if path:
            self._state.session = Session(self._config, read_robot_description(path))
            self._narrator.robot(self._state.session.survey(), self._config.method)
        else:
            check_without_robot(self._config)

    def _on_description(self, message: String) -> None:
        state = self._state
        if state.session is not None and state.session.robot.model.urdf == message.data:
            state.problem = ''
            return
        try:
            session = Session(self._config, message.data)
        except MbaidError as error:
            kept = '; the one before stays in use' if state.session is not None else ''
            state.problem = f'robot description refused: {error}{kept}'
            self._narrator.warn_once(state.problem)
            self._telling.missing()
            return
        restarted = state.session is not None
        state.session, state.problem = session, ''
        self._narrator.robot(session.survey(), self._config.method)
        if restarted:
            self._start_again()

    # Data

    def _on_joint_state(self, message: Any) -> None:
        session = self._open_session()
        if session is None:
            return
        self._telling.display.follow(session.robot.model, message)
        if session.add_joint_state(message):
            self._process(session)

    def _on_odometry(self, message: Any) -> None:
        session = self._open_session()
        if session is not None and session.add_odometry(message):
            self._process(session)

    def _on_thrust(self, message: WrenchStamped) -> None:
        # Also while paused: it changes the momentum that the next samples have.
        if self._state.session is not None:
            self._state.session.add_thrust(message)

    def _on_stored_momentum(self, message: Vector3Stamped) -> None:
        session = self._open_session()
        if session is not None:
            session.add_stored_momentum(message)

    def _on_imu(self, message: Imu) -> None:
        session = self._open_session()
        if session is not None and session.add_imu(message):
            self._process(session)

    def _open_session(self) -> Session | None:
        """Return the session if it takes messages now."""
        state = self._state
        if state.session is None:
            state.ignored['no robot description'] += 1
        elif not state.active:
            state.ignored['not active'] += 1
        elif state.paused:
            state.ignored['paused'] += 1
        else:
            return state.session
        return None

    def _process(self, session: Session) -> None:
        try:
            estimates = session.process()
        except DataError as error:
            self._narrator.warn_once(str(error))
            return
        self._telling.estimates(session, estimates)
        if estimates:
            self._leisure.reset()  # what can wait comes after the estimates
        if estimates and self._report_due:
            self._report()

    def _on_leisure(self) -> None:
        if self._state.session is None or not self._state.session.work_off():
            self._leisure.cancel()
            self._advising.look()

    def activate(self, *, active: bool) -> None:
        """Begin or end to take data; what has been learnt stays."""
        if self._state.active and not active:
            self._close_books()
        self._state.active = active
        self._telling.missing()

    def adjust(self, config: EstimatorConfig) -> None:
        """Take on what may change while it runs: convergence.*, plan.* and publish_tf.

        Raises
        ------
        ParameterError
            Frames are asked for, but the message package for them is not installed.
        """
        self._telling.display.send_frames(wanted=config.publish_tf)
        self._config = replace(
            self._config, convergence=config.convergence, publish_tf=config.publish_tf, plan=config.plan
        )
        if self._state.session is not None:
            self._state.session.judge_by(config.convergence, config.plan)

    def close(self) -> None:
        """Leave the graph."""
        for inlet in self._every_inlet():
            inlet.close()
        if self._description is not None:
            self._description.close()
        for service in self._services:
            self._node.destroy_service(service)
        self._planning.close()
        self._node.destroy_timer(self._timer)
        self._node.destroy_timer(self._leisure)
        self._telling.close()

    # Services

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._start_again()
        response.success, response.message = True, 'everything forgotten, started again'
        self._narrator.event(response.message)
        return response

    def _on_capture(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        session = self._state.session
        try:
            if session is None:
                raise DataError('there is no robot description yet; accepted: a capture after the first sample')
            response.message = session.capture()
        except DataError as error:
            response.message = str(error)
            return response
        response.success = True
        self._narrator.event(response.message)
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        state = self._state
        if request.data and not state.halted:
            self._close_books()
        state.paused = bool(request.data)
        response.success = True
        response.message = f'paused: no samples are taken; {state.account}' if request.data else 'taking samples'
        self._narrator.event(response.message)
        self._telling.missing()
        return response

    def _close_books(self) -> None:
        """Work through what has come, so that it is in the estimate that is told as the last one."""
        if self._state.session is not None:
            self._process(self._state.session)

    def _start_again(self) -> None:
        state = self._state
        if state.session is not None:
            state.session.reset()
        state.ignored = Counter()
        self._telling.anew()

    # Reports

    def _on_timer(self) -> None:
        session = self._state.session
        if session is not None:
            if session.closing not in (None, self._awaited):
                # The estimate that comes in a moment goes first; if it does not come, the next report waits no more.
                self._awaited, self._report_due = session.closing, True
                return
            # Also what no window waits for: a stream without the other one must not pile up unread.
            self._process(session)
        self._report()

    def _report(self) -> None:
        self._report_due = False
        for inlet in self._every_inlet():
            inlet.refresh()
        self._telling.report(self._inlets)
