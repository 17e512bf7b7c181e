"""The node `simulator`: a free-floating robot in motion; joint states and odometry out, and the truth."""

from __future__ import annotations

import argparse
import math
import time
from collections import deque
from collections.abc import Callable

from geometry_msgs.msg import InertiaStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from mbaid_ros.config.parameter_files import read_robot_description
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.errors import DataError, ParameterError
from mbaid_ros.joint_trajectory import trajectory_of
from mbaid_ros.nodes.runner import Interrupt, declare_parameters, spin
from mbaid_ros.nodes.subscriptions import LATCHED, TYPES, message_class, qos
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage


class Pace:
    """The time of a run that goes a number of times as fast as this machine's clock.

    If the machine does not keep up, or stands still for a while, the run is late from then on: to catch up it would
    publish more at once than its subscribers' queues hold.

    Parameters
    ----------
    factor, most : simulated seconds in a second, and between two calls of `now` at most
    clock : monotonic, s
    """

    def __init__(self, factor: float, most: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._factor, self._most, self._clock = factor, most, clock
        self._begin = math.nan  # s of the machine at time 0 of the run
        self._reached = 0.0
        self.late = 0.0  # s of the machine, by which the run is later than it would be

    @property
    def begun(self) -> bool:
        """Whether the run has begun."""
        return not math.isnan(self._begin)

    def begin(self) -> None:
        """Begin the run now."""
        self._begin = self._clock()

    def now(self) -> float:
        """Return the time of the run, s."""
        now = (self._clock() - self._begin) * self._factor
        missed = (now - self._reached - self._most) / self._factor
        if missed > 0.0:
            self._begin, self.late = self._begin + missed, self.late + missed
            now = self._reached + self._most
        self._reached = now
        return now


NAME = 'simulator'

_AHEAD = 0.1  # s of this machine's time that is simulated at once: a batch costs little more than a single sample
_SHORTEST_PERIOD = 0.001  # s, of the timer; at higher rates it publishes several messages at a time
_LONGEST_PERIOD = 0.1  # s: however slow it is, subscribers that it waits for and its end are noticed
_PATIENCE = 2.0  # s, with subscribers that have not got everything when the run is over
_DEPTH = 5000  # messages kept for a slow subscriber: no fewer than the estimator keeps
_AT_ONCE = 200  # messages of each kind that are published at once
_LATE = 1.0  # s, by which a run is late when that is logged


class SimulatorNode(Node):
    """Publishes the messages of a simulated run when they are due.

    Raises ParameterError, ModelError: A parameter, or the robot description file it names, cannot be used.
    """

    def __init__(self) -> None:
        super().__init__(NAME)
        self._config = declare_parameters(self, SimulatorConfig)
        if not self._config.robot_description_file:
            raise ParameterError("parameter 'robot_description_file' is empty; accepted: the path of a URDF file")
        urdf = read_robot_description(self._config.robot_description_file)
        self._run = SimulatedRun(self._config, urdf, TYPES)
        self._topics = {
            topic: self.create_publisher(message_class(kind), topic, qos(_DEPTH))
            for topic, kind in self._run.topics.items()
        }
        clock = self._config.publish_clock
        self._clock_topic = self.create_publisher(ClockMessage, '/clock', qos(10)) if clock else None
        self._description = self.create_publisher(String, 'robot_description', LATCHED)
        self._truth = self.create_publisher(InertiaStamped, '~/truth', LATCHED)
        self.create_subscription(JointTrajectory, 'joint_trajectory', self._on_trajectory, qos(1))
        self._waiting: deque[TimedMessage] = deque()
        self._computed = -math.inf  # s of the run that the messages computed so far reach
        rate = max(self._config.joint_rate, self._config.odometry_rate)
        of_gyros = [each.rate for each in self._config.further_gyros.values()]
        of_poses = [each.rate for each in self._config.further_poses.values()]
        most = max(rate, *of_gyros, *of_poses, 0.0)
        self._pace = Pace(self._config.real_time_factor, _AT_ONCE / most)
        self._clock_published = -math.inf  # s of the run on /clock
        self.over = False  # whether everything has been published
        self._description.publish(self._run.description())
        self._log_run()
        if not self._config.wait_for_subscribers:
            self._start()
        # A clock that nothing stops: this node may be the source of simulated time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        period = 1.0 / (rate * self._config.real_time_factor)
        self.create_timer(max(_SHORTEST_PERIOD, min(period, _LONGEST_PERIOD)), self._on_timer, clock=steady)

    def _start(self) -> None:
        """Let the run begin now."""
        if not self._config.publish_clock:  # otherwise simulated time begins at 0
            self._run.start = time.time_ns()
        self._truth.publish(self._run.truth())
        self._pace.begin()

    def _on_timer(self) -> None:
        """Publish the messages that are due."""
        if not self._pace.begun:
            wanted, base = self._config.wait_for_subscribers, 'pose' if self._config.pose_only else 'odom'
            if any(self._topics[topic].get_subscription_count() < wanted for topic in ('joint_states', base)):
                return
            self._start()
        now = self._pace.now()
        if self._pace.late > _LATE:
            self.get_logger().warning(  # type: ignore[no-untyped-call]
                f'this machine does not keep up with real_time_factor {self._config.real_time_factor:g}: the run '
                'takes longer, and leaves nothing out',
                once=True,
            )
        duration = self._config.duration
        over = 0.0 < duration <= now
        self._compute(now)
        while self._waiting and self._waiting[0].time <= now:
            timed = self._waiting.popleft()
            self._publish_clock(timed.time)
            self._topics[timed.topic].publish(timed.message)
        if over:
            for publisher in (*self._topics.values(), self._clock_topic):
                if publisher is not None:
                    publisher.wait_for_all_acked(Duration(seconds=_PATIENCE))
            self.get_logger().info(f'{duration:g} s are over')  # type: ignore[no-untyped-call]
            self.over = True

    def _on_trajectory(self, message: JointTrajectory) -> None:
        """Let the joints follow a trajectory."""
        try:
            begin = self._run.add_trajectory(trajectory_of(message))
        except DataError as error:
            self.get_logger().error(f'joint_trajectory refused: {error}')  # type: ignore[no-untyped-call]
            return
        names = ', '.join(message.joint_names)
        self.get_logger().info(f'following a trajectory of {names} from {begin:.3f} s on')  # type: ignore[no-untyped-call]

    def _compute(self, now: float) -> None:
        """Simulate ahead when less than half of that is left."""
        ahead = _AHEAD * self._config.real_time_factor
        end = self._config.duration or math.inf
        if self._computed >= min(now + 0.5 * ahead, end):
            return
        self._computed = min(now + ahead, end)
        self._waiting.extend(self._run.read(self._computed))

    def _publish_clock(self, when: float) -> None:
        if self._clock_topic is not None and when > self._clock_published:
            self._clock_topic.publish(self._run.clock(when))
            self._clock_published = when

    def _log_run(self) -> None:
        config = self._config
        length = f'{config.duration:g} s' if config.duration > 0.0 else 'until it is stopped'
        seed = '' if self._run.errors.is_zero else f' of model_errors.seed {config.model_errors.seed}'
        self.get_logger().info(  # type: ignore[no-untyped-call]
            f"robot '{self._run.model.name}'{seed}, target link '{self._run.target.name}', motion "
            f'{config.motion.kind}, {length}'
        )


def main(_arguments: argparse.Namespace, interrupt: Interrupt) -> int:
    """Run the node until it is interrupted, and return the exit code; `mbaid_ros.nodes.start` calls it within ROS."""
    node = SimulatorNode()
    spin(node, lambda: interrupt.requested or node.over)
    return 0
