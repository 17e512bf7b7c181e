"""The node `estimator`: joint states and odometry in, the inertia of the captured body out."""

from __future__ import annotations

import argparse
import gc
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import monotonic
from typing import Any

import scipy.optimize  # noqa: F401 - a window that needed it first would wait for it
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, Vector3Stamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import read_robot_description
from mbaid_ros.core.links import KnownLinksConfig
from mbaid_ros.core.samples import IMU_TYPE, Input
from mbaid_ros.core.target import DebrisConfig
from mbaid_ros.errors import DataError, MbaidError
from mbaid_ros.nodes.diagnostics import Diagnostics, RunState
from mbaid_ros.nodes.publishers import EstimatePublication, RunLog
from mbaid_ros.nodes.runner import Interrupt, declare_parameters, spin
from mbaid_ros.nodes.subscriptions import (
    DescriptionSubscription,
    Subscriptions,
    message_class,
    qos,
    quiet_publisher,
    tf_message,
)
from mbaid_ros.session.catalogue import inputs
from mbaid_ros.session.explanation import remarks
from mbaid_ros.session.planning import advice  # at the start: an import in a run would delay estimates
from mbaid_ros.session.session import Session

NAME = 'estimator'
PERIOD = 1.0  # s, of /diagnostics
_ADVICE_PERIOD = 5.0  # s, between two searches for the most informative motion, at least
_ADVICE_SHARE = 0.01  # of the time that these searches may take

# A robot that fits any method: finds parameters that no robot description can be used with.
_ANY_ROBOT = """\
<robot name="any"><link name="base_link"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"""


class EstimatorNode(Node):
    """Hands messages to the session, and publishes its estimates; between messages, it is its own background work.

    Raises ParameterError, ModelError: A parameter, or the robot description file it names, cannot be used.
    """

    def __init__(self) -> None:
        super().__init__(NAME)
        self._config = declare_parameters(self, EstimatorConfig)
        self._log = RunLog(self.get_logger())  # type: ignore[no-untyped-call]
        self._state = RunState()
        self._advice_due = 0.0  # monotonic time
        self._report_due = False  # a report waits for the estimate of a window
        self._awaited: int | None = None  # end of the window that one waited for
        self._background_due = False
        # Refusals come first: nothing is on the graph then.
        self._read_robot()
        self._inputs = {
            'joint_states': Subscriptions(
                self, JointState, 'joint_states', partial(self._add, Session.add_joint_state)
            ),
            **self._base_subscriptions(),
        }
        self._thrust = Subscriptions(self, WrenchStamped, 'thrust', self._on_thrust)
        named = inputs(self._config)
        named.pop('imu', None)
        self._named = {name: self._named_subscription(name, each) for name, each in named.items()}
        self._named['imu'] = self._inputs.get('imu') or self._named_subscription('imu', Input('imu', (IMU_TYPE,)))
        self._stored_momentum = Subscriptions(
            self, Vector3Stamped, 'stored_momentum', partial(self._add, Session.add_stored_momentum)
        )
        more = (PoseWithCovarianceStamped, Odometry)
        add_pose = partial(self._add, Session.add_target_pose)
        self._target_pose = Subscriptions(self, PoseStamped, 'target_pose', add_pose, more)
        description = None if self._state.session else DescriptionSubscription(self, self._on_description)
        self._diagnostics = Diagnostics(self._inputs, self._thrust, description.topic if description else '')
        self._diagnostics_publisher = quiet_publisher(self, DiagnosticArray, '/diagnostics', qos(10))
        self._publication = EstimatePublication(
            self, self._config, self._state, self._log, lambda: self._diagnostics.missing(self._state)
        )
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SetBool, '~/pause', self._on_pause)
        self.create_service(Trigger, '~/capture', self._on_capture)
        # A steady clock: reports come with use_sim_time and no /clock, too.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(PERIOD, self._on_timer, clock=clock)
        self._publication.publish_waiting()

    def _base_subscriptions(self) -> dict[str, Subscriptions]:
        """Return the subscriptions that may locate the base, or replace that."""
        if self._config.imu.alone:
            return {'imu': self._named_subscription('imu', Input('imu', (IMU_TYPE,)))}
        if self._config.poses.alone:
            return {}
        if self._config.pose.tf_child_frame:
            return {'tf': Subscriptions(self, tf_message(), '/tf', partial(self._add, Session.add_odometry))}
        others = (PoseWithCovarianceStamped, TransformStamped)
        return {
            'odom': Subscriptions(self, Odometry, 'odom', partial(self._add, Session.add_odometry)),
            'pose': Subscriptions(self, PoseStamped, 'pose', partial(self._add, Session.add_odometry), others),
        }

    def _named_subscription(self, name: str, given: Input) -> Subscriptions:
        """Return the subscription of a sensor by the name of its parameters."""
        first, *others = map(message_class, given.types)
        return Subscriptions(
            self, first, given.topic, partial(self._add, partial(Session.add_named, name=name)), others
        )

    def _all_subscriptions(self) -> set[Subscriptions]:
        others = self._thrust, self._stored_momentum, self._target_pose
        return {*self._inputs.values(), *others, *self._named.values()}

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
        config = config.without_frames
        Session(replace(config, known_links=KnownLinksConfig(), continue_from=''), _ANY_ROBOT)

    def _on_description(self, message: String) -> None:
        state = self._state
        if state.session is not None and state.session.is_described_by(message.data):
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

    def _add(self, add: Callable[[Session, Any], bool | None], message: Any) -> None:
        """Add a message to the session if that takes messages now, and process if it is time to."""
        session = self._open_session()
        if session is not None and add(session, message):
            self._process()

    def _on_thrust(self, message: WrenchStamped) -> None:
        # Also while paused: it changes the momentum of the next samples.
        if self._state.session is not None:
            self._state.session.add_thrust(message)

    def _open_session(self) -> Session | None:
        """Return the session if it takes messages now; count the message otherwise."""
        state = self._state
        if state.session is None:
            state.ignored['no robot description'] += 1
        elif state.paused:
            state.ignored['paused'] += 1
        else:
            return state.session
        return None

    def _process(self) -> None:
        """Process the queued messages and publish their estimates."""
        session = self._state.session
        if session is None:
            return
        estimates = session.process(at_once=False)
        self._publication.publish(session, estimates)
        if estimates or session.catching_up:
            self._background_due = True  # after the estimates
        if estimates and self._report_due:
            self._report()

    @property
    def is_due(self) -> bool:
        """Whether a slice of background work may run: not while the estimate of a window is due in a moment."""
        session = self._state.session
        return self._background_due and (session is None or session.closing is None)

    def run_slice(self) -> None:
        """Run a slice of the session's background work, and look for a motion to advise after the last one."""
        session = self._state.session
        self._background_due = session is not None and session.run_slice()
        if not self._background_due:
            self._advise()

    def _advise(self) -> None:
        """Look for the most informative motion, if it is time to; it takes one or two tenths of a second."""
        begin, session, estimate = monotonic(), self._state.session, self._state.estimate
        if begin < self._advice_due or session is None:
            return
        posterior = None if estimate is None or estimate.contradicted else session.posterior()
        self._state.advice = '' if posterior is None else advice(self._config, posterior)
        self._log.advice(self._state.advice)
        end = monotonic()
        self._advice_due = end + max(_ADVICE_PERIOD, (end - begin) / _ADVICE_SHARE)

    # Services

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
        if request.data and not state.paused:
            self._process()  # so that the last estimate holds everything that has come
        state.paused = bool(request.data)
        response.success = True
        response.message = f'paused: no samples are taken; {state.sample_counts}' if request.data else 'taking samples'
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
        self._log.waiting(self._diagnostics.missing_messages(state))
        self._publication.publish_waiting()
        statuses = self._diagnostics.statuses(state, self.get_fully_qualified_name().lstrip('/'))
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_publisher.publish(array)
        self._publication.publish_stale(self._diagnostics.silence(state))
        gc.collect()  # delays no estimate here: one has just been published, or none is due in a moment


def main(_arguments: argparse.Namespace, interrupt: Interrupt) -> int:
    """Run the node until it is interrupted, and return the exit code; `mbaid_ros.nodes.start` calls it within ROS."""
    node = EstimatorNode()
    spin(node, lambda: interrupt.requested, node)
    return 0
