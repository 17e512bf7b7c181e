"""The node `recorder`: writes topics to an MCAP bag as they arrive, for machines without `ros2 bag record`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.subscription import Subscription

from mbaid_ros.bags import BagWriter
from mbaid_ros.cli import one_line
from mbaid_ros.config.recorder_parameters import RecorderConfig
from mbaid_ros.errors import ParameterError
from mbaid_ros.nodes.runner import Interrupt, declare_parameters
from mbaid_ros.nodes.subscriptions import message_class, qos, why_no_topic
from mbaid_ros.parameters import INPUT_TOPICS

NAME = 'recorder'

_OUTPUT_TYPES = ('geometry_msgs/msg/InertiaStamped', 'diagnostic_msgs/msg/DiagnosticArray')
_DISCOVERY_PERIOD = 0.1  # s
_FLUSH_PERIOD = 1.0  # s, longest loss if the machine fails; a tenth of its age of a younger recording
_DEPTH = 5000  # messages, as arrive at 1 kHz during five seconds of a busy disk
_ON_ITS_WAY = 300_000_000  # ns, in which messages sent before an interrupt are received
_IDLE_TURNS = 20  # turns of the executor without a message, after which nothing received is left


class RecorderNode(Node):
    """Subscribes to topics as they appear on the graph, and writes the bytes of their messages.

    Raises ParameterError, DataError: A parameter is not accepted, or the bag cannot be made.
    """

    def __init__(self) -> None:
        super().__init__(NAME)
        self._log = self.get_logger()  # type: ignore[no-untyped-call]
        self._config = declare_parameters(self, RecorderConfig)
        self._wanted = [self._resolved(topic) for topic in self._config.topics or INPUT_TOPICS]
        self._subscriptions_of: dict[str, Subscription] = {}
        self._offers: dict[str, tuple[bool, bool]] = {}
        self._refused: set[str] = set()
        self._begin: float | None = None  # monotonic time of the first message
        self._flushed = 0.0  # monotonic time
        self._until = sys.maxsize  # ns, system time: messages received later are not written
        self._writer = BagWriter(self._config.output or time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S'))
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DISCOVERY_PERIOD, self._discover, clock=clock)
        self.create_timer(_DISCOVERY_PERIOD, self._flush, clock=clock)
        self._log.info(f"recording into '{self._writer.path}'")

    @property
    def messages(self) -> int:
        """Number of messages written."""
        return self._writer.messages

    @property
    def over(self) -> bool:
        """Whether the wanted duration has passed."""
        duration = self._config.duration
        return duration > 0.0 and self._begin is not None and time.monotonic() - self._begin >= duration

    def finish(self) -> None:
        """Write no further messages, except those that are on their way."""
        self._until = time.time_ns() + _ON_ITS_WAY

    def close(self) -> str:
        """Complete the bag and return a sentence about its contents."""
        self._writer.close()
        return f"{self.messages} messages on {len(self._offers)} topics in '{self._writer.path}'"

    def _resolved(self, topic: str) -> str:
        """Return the full name of a topic of the parameters.

        Raises ParameterError: It is none.
        """
        if reason := why_no_topic(self, topic):
            raise ParameterError(f"parameter 'topics' names '{topic}': {reason}; accepted: names like /joint_states")
        return str(self.resolve_topic_name(topic))

    def _discover(self) -> None:
        """Subscribe to topics that have appeared, and anew where a publisher offers less than those before."""
        for topic, types in self.get_topic_names_and_types():
            if topic not in self._refused and self._is_wanted(topic, types[0]):
                publishers = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
                if publishers:
                    self._subscribe(topic, types[0], publishers)

    def _flush(self) -> None:
        """Flush: at first more often, as a chunk that is complete can be read after a kill."""
        now = time.monotonic()
        age = 0.0 if self._begin is None else now - self._begin
        if now - self._flushed >= min(_FLUSH_PERIOD, 0.1 * age):
            self._writer.flush()
            self._flushed = now

    def _is_wanted(self, topic: str, type_name: str) -> bool:
        if topic in self._wanted:
            return True
        return not self._config.topics and (
            type_name.startswith('mbaid_msgs/')
            or type_name in _OUTPUT_TYPES
            or (type_name == 'std_msgs/msg/String' and topic.endswith('/robot_description'))
        )

    def _subscribe(self, topic: str, type_name: str, publishers: Sequence[Any]) -> None:
        # A subscription that asks for more than a publisher offers gets nothing from it.
        reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in publishers)
        latched = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in publishers)
        before = self._offers.get(topic)
        if before is not None:
            reliable, latched = reliable and before[0], latched and before[1]
        if before == (reliable, latched):
            return
        try:
            message_type = message_class(type_name)
        except (ImportError, AttributeError, ValueError):
            self._refuse(topic, f'its type {type_name} is not installed')
            return
        if reason := why_no_topic(self, topic):
            self._refuse(topic, reason)
            return
        if before is None:
            self._writer.add_topic(topic, type_name, latched=latched, reliable=reliable)
            self._log.info(f'recording {topic} ({type_name})')
        else:
            self.destroy_subscription(self._subscriptions_of[topic])
        self._offers[topic] = (reliable, latched)
        profile = qos(_DEPTH, best_effort=not reliable, latched=latched)
        take = partial(self._write_message, topic)
        self._subscriptions_of[topic] = self.create_subscription(message_type, topic, take, profile, raw=True)

    def _refuse(self, topic: str, reason: str) -> None:
        self._refused.add(topic)
        self._log.warning(f"topic '{topic}' is not recorded: {reason}")

    def _write_message(self, topic: str, data: bytes, info: Mapping[str, int]) -> None:
        if info['received_timestamp'] > self._until:
            return
        if self._begin is None:
            self._begin = time.monotonic()
        self._writer.write_raw(topic, data, info['received_timestamp'])


def record(node: RecorderNode, interrupt: Interrupt) -> None:
    """Run the node until it is interrupted or its time is over, and then until all it had received is written."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not interrupt.requested and not node.over:
        executor.spin_once(timeout_sec=_DISCOVERY_PERIOD)
    node.finish()  # or it would go on for as long as messages come without a pause
    idle = 0
    while idle < _IDLE_TURNS and not node.over:
        before = node.messages
        executor.spin_once(timeout_sec=0.0)
        idle = 0 if node.messages > before else idle + 1


def main(_arguments: argparse.Namespace, interrupt: Interrupt) -> int:
    """Run the node until it is interrupted, and return the exit code; `mbaid_ros.nodes.start` calls it within ROS."""
    node = RecorderNode()
    try:
        record(node, interrupt)
    finally:
        account = node.close()
    print(one_line(account))
    return 0
