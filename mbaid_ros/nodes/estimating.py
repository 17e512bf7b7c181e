"""The node `estimator` at work: joint states and odometry in, the inertia of the captured body out."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import scipy.optimize  # noqa: F401 - a window that needed it first would wait for it
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, Vector3Stamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from mbaid_ros.config.capture import DebrisConfig
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import read_robot_description
from mbaid_ros.config.model_errors import KnownLinksConfig
from mbaid_ros.core.errors import DataError, MbaidError
from mbaid_ros.nodes.diagnostics import Diagnostics, NodeClock
from mbaid_ros.nodes.planning import AdviceTask, Planning
from mbaid_ros.nodes.publishers import EstimatePublication
from mbaid_ros.nodes.reports import RunLog, RunState, remarks
from mbaid_ros.nodes.subscriptions import DescriptionSubscription, Subscriptions, qos, quiet_publisher, tf_message
from mbaid_ros.session.reading import TIME_JUMP
from mbaid_ros.session.session import Session

PERIOD = 1.0  # s, of /diagnostics
_SLICE_PERIOD = 1e-3  # s, between two time slices of the background task, at least

# A robot that fits any method: finds parameters that no robot description can be used with.
_ANY_ROBOT = """\
<robot name="any"><link name="base_link"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"""


class LiveEstimator:
    """Converts, calls the session, publishes; uses messages from the beginning if `active`, else from `activate` on.

    Raises ParameterError, ModelError: A parameter, or the robot description file it names, cannot be used.
    """

    def __init__(self, node: Node, config: EstimatorConfig, *, active: bool = True) -> None:
        self._node = node
        self._config = config
        self._log = RunLog(node.get_logger())  # type: ignore[no-untyped-call]
        self._state = RunState(active=active)
        self._report_due = False  # a report waits for the estimate of a window
        self._awaited: int | None = None  # end of the window that one waited for
        # Refusals come first: nothing is on the graph then.
        self._read_robot()
        self._subscriptions = {
            'joint_states': Subscriptions(node, JointState, 'joint_states', self._on_joint_state),
            **self._base_subscriptions(),
        }
        self._thrust = Subscriptions(node, WrenchStamped, 'thrust', self._on_thrust)
        self._imu = self._subscriptions.get('imu') or Subscriptions(node, Imu, 'imu', self._on_imu)
        self._stored_momentum = Subscriptions(node, Vector3Stamped, 'stored_momentum', self._on_stored_momentum)
        self._description = None if self._state.session else DescriptionSubscription(node, self._on_description)
        topic = self._description.topic if self._description else ''
        self._diagnostics = Diagnostics(self._subscriptions, self._thrust, topic)
        self._diagnostics_publisher = quiet_publisher(node, DiagnosticArray, '/diagnostics', qos(10))
        self._clock = NodeClock(node, TIME_JUMP)
        self._planning = Planning(node, self._state, self._log.event)
        self._advice = AdviceTask(self._state, self._log.advice)
        self._publication = EstimatePublication(
            node, config, self._state, self._log, self._planning, lambda: self._diagnostics.missing(self._state)
        )
        self._services = [
            node.create_service(Trigger, '~/reset', self._on_reset),
            node.create_service(SetBool, '~/pause', self._on_pause),
            node.create_service(Trigger, '~/capture', self._on_capture),
        ]
        # A steady clock: with use_sim_time and no /clock, the missing clock has to be reported.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD, self._on_timer, clock=clock)
        # Runs the background task between messages, a few milliseconds at a time, before the next window.
        self._idle_timer: Any = node.create_timer(_SLICE_PERIOD, self._on_idle, clock=clock, autostart=False)
        self._publication.publish_waiting()

    def _base_subscriptions(self) -> dict[str, Subscriptions]:
        """Return the subscriptions that may locate the base, or replace that."""
        node, config = self._node, self._config
        if config.imu.alone:
            return {'imu': Subscriptions(node, Imu, 'imu', self._on_imu)}
        if config.pose.tf_child_frame:
            return {'tf': Subscriptions(node, tf_message(), '/tf', self._on_odometry)}
        others = (PoseWithCovarianceStamped, TransformStamped)
        return {
            'odom': Subscriptions(node, Odometry, 'odom', self._on_odometry),
            'pose': Subscriptions(node, PoseStamped, 'pose', self._on_odometry, others),
        }

    def _all_subscriptions(self) -> set[Subscriptions]:
        return {*self._subscriptions.values(), self._thrust, self._stored_momentum, self._imu}

    # Robot description

    def _read_robot(self) -> None:
        """Read the robot description file; without one, check the parameters that need none."""
        path = self._config.robot_description_file
        if path:
            self._state.session = Session(self._config, read_robot_description(path))
            self._log.robot(self._state.session.model_summary(), self._config.method)
            return
        # Names of links, and files of a robot, can only be checked with the robot.
        config = replace(self._config, base_link='', target_link='', debris=DebrisConfig())
        Session(replace(config, known_links=KnownLinksConfig(), continue_from=''), _ANY_ROBOT)

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
            self._log.warn_once(state.problem)
            self._publication.publish_waiting()
            return
        replaced = state.session is not None
        state.session, state.problem = session, ''
        self._log.robot(session.model_summary(), self._config.method)
        if replaced:
            self._start_again()

    # Messages

    def _on_joint_state(self, message: Any) -> None:
        session = self._open_session()
        if session is not None:
            self._add(session.add_joint_state, message)

    def _on_odometry(self, message: Any) -> None:
        session = self._open_session()
        if session is not None:
            self._add(session.add_odometry, message)

    def _on_imu(self, message: Imu) -> None:
        session = self._open_session()
        if session is not None:
            self._add(session.add_imu, message)

    def _on_stored_momentum(self, message: Vector3Stamped) -> None:
        session = self._open_session()
        if session is not None:
            session.add_stored_momentum(message)

    def _on_thrust(self, message: WrenchStamped) -> None:
        # Also while paused: it changes the momentum of the next samples.
        if self._state.session is not None:
            self._state.session.add_thrust(message)

    def _open_session(self) -> Session | None:
        """Return the session if it takes messages now; count the message otherwise."""
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

    def _add(self, add: Callable[[Any], bool], message: Any) -> None:
        if add(message):
            self._process()

    def _process(self) -> None:
        """Process the queued messages and publish their estimates."""
        session = self._state.session
        if session is None:
            return
        estimates = session.process()
        self._publication.publish(session, estimates)
        if estimates:
            self._idle_timer.reset()  # the background task comes after the estimates
            if self._report_due:
                self._report()

    def _on_idle(self) -> None:
        if self._state.session is None or not self._state.session.run_slice():
            self._idle_timer.cancel()
            self._advice.run_if_due()

    # Services and parameters

    def activate(self, *, active: bool) -> None:
        """Begin or end to use messages; the run stays."""
        if self._state.active and not active:
            self._process()
        self._state.active = active
        self._publication.publish_waiting()

    def adjust(self, config: EstimatorConfig) -> None:
        """Change the parameters that may change at run time: convergence.* and plan.*."""
        self._config = replace(self._config, convergence=config.convergence, plan=config.plan)
        if self._state.session is not None:
            self._state.session.judge_by(config.convergence, config.plan)

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._start_again()
        response.success, response.message = True, 'everything forgotten, started again'
        self._log.event(response.message)
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
        self._log.event(response.message)
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        state = self._state
        self._count_lost()
        if request.data and not state.halted:
            self._process()  # so that the last estimate holds everything that has come
        state.paused = bool(request.data)
        response.success = True
        response.message = f'paused: no samples are taken; {state.account}' if request.data else 'taking samples'
        self._log.event(response.message)
        self._publication.publish_waiting()
        return response

    def _start_again(self) -> None:
        if self._state.session is not None:
            self._state.session.reset()
        self._state.ignored = Counter()
        for each in self._all_subscriptions():
            each.lost = 0
        self._publication.withdraw()

    # Reports

    def _on_timer(self) -> None:
        session = self._state.session
        if session is not None:
            if session.closing not in (None, self._awaited):
                # The estimate due in a moment goes first; if it does not come, the next report does not wait.
                self._awaited, self._report_due = session.closing, True
                return
            self._process()  # also messages that complete no window: one stream without the other must not pile up
        self._report()

    def _count_lost(self) -> None:
        self._state.lost = {each.topic: each.lost for each in self._all_subscriptions()}

    def _report(self) -> None:
        """Publish /diagnostics, log problems, and mark the estimate stale if nothing follows it."""
        self._report_due = False
        for each in self._all_subscriptions():
            each.refresh()
        state = self._state
        self._count_lost()
        if state.session is not None:
            for remark in remarks(state.session, stuck=self._diagnostics.stuck):
                self._log.warn_once(remark)
            if state.session.used:
                self._log.joints(state.session.model_summary())
        self._log.waiting(self._diagnostics.awaited(state))
        self._publication.publish_waiting()
        clocks = self._clock.problems(self._subscriptions)
        for problem in clocks:
            self._log.warn_once(problem)
        statuses = self._diagnostics.statuses(state, self._node.get_fully_qualified_name().lstrip('/'), clocks)
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics_publisher.publish(array)
        self._publication.publish_stale(self._diagnostics.silence(state))
        gc.collect()  # delays no estimate here: one has just been published, or none is due in a moment

    def close(self) -> None:
        """Leave the graph."""
        for each in self._all_subscriptions():
            each.close()
        if self._description is not None:
            self._description.close()
        for service in self._services:
            self._node.destroy_service(service)
        self._planning.close()
        self._node.destroy_timer(self._timer)
        self._node.destroy_timer(self._idle_timer)
        self._node.destroy_publisher(self._diagnostics_publisher)
        self._publication.close()
        self._clock.close()
