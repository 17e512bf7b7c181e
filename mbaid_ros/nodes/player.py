"""The node `player`: publishes a bag's messages at their times, for machines without `ros2 bag play`."""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Sequence

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from mbaid_ros.bags import BagReader
from mbaid_ros.cli import EXIT_NOT_DETERMINED, warn
from mbaid_ros.errors import DataError, listing
from mbaid_ros.nodes.runner import LATENCY, Interrupt, NoParameters, declare_parameters
from mbaid_ros.nodes.subscriptions import message_class, qos, why_no_topic

NAME = 'player'

_CLOCK_PERIOD = 0.01  # s, of /clock
_DEPTH = 1000  # messages kept for a subscriber that is behind
_UNCONFIRMED = _DEPTH // 2  # messages that may be on their way to reliable subscribers
_PATIENCE = 60.0  # s, for subscribers that are behind


class PlayerNode(Node):
    """Publishes the messages of a bag.

    Raises DataError: The bag lacks a topic, or its type is not installed.

    Parameters
    ----------
    bag, topics : the open bag and its topics to publish; empty: all that can be
    rate, clock : speed relative to the recording; whether to publish /clock
    interrupt : ends the playing
    """

    def __init__(
        self, bag: BagReader, topics: Sequence[str], rate: float, *, clock: bool, interrupt: Interrupt
    ) -> None:
        super().__init__(NAME, start_parameter_services=False)
        declare_parameters(self, NoParameters)
        self._log = self.get_logger()  # type: ignore[no-untyped-call]
        self._bag = bag
        self._rate = rate
        self._interrupt = interrupt
        self._topics: dict[str, Publisher] = {}
        self._sent: Counter[str] = Counter()  # messages since the last that were confirmed
        self._lost: Counter[str] = Counter()  # messages that were not confirmed
        for topic in topics or bag.topics:
            if not (clock and topic == '/clock'):  # there is one clock: this node's
                self._add(topic, required=bool(topics))
        self._clock_topic = self.create_publisher(Clock, '/clock', qos(1)) if clock else None
        self._last_clock = -_CLOCK_PERIOD
        self._origin = (0.0, 0)  # monotonic time in s and bag time in ns that belong together

    def _add(self, name: str, *, required: bool) -> None:
        if name not in self._bag.topics:
            raise DataError(f"bag '{self._bag.path}' has no topic '{name}'; topics: {listing(self._bag.topics)}")
        topic = self._bag.topics[name]
        if reason := why_no_topic(self, name):
            self._leave_out(f"topic '{name}' cannot be played: {reason}", required=required)
            return
        try:
            message_type = message_class(topic.type)
        except (ImportError, AttributeError, ValueError) as error:
            why = f"topic '{name}' cannot be played: its type '{topic.type}' is not installed"
            self._leave_out(why, error, required=required)
            return
        if missing := self._bag.missing_fields(name):
            why = f"topic '{name}' cannot be played: its messages are older than the installed '{topic.type}'"
            self._leave_out(f'{why}, without {listing(sorted(missing))}', required=required)
            return
        depth = min(topic.count, _DEPTH) if topic.latched else _DEPTH
        profile = qos(max(1, depth), best_effort=not topic.reliable, latched=topic.latched)
        self._topics[name] = self.create_publisher(message_type, name, profile)

    def _leave_out(self, why: str, cause: Exception | None = None, *, required: bool) -> None:
        if required:
            raise DataError(why) from cause
        self._log.warning(why)

    def wait_for_subscribers(self, timeout: float) -> None:
        """Wait until every topic has a subscriber, or the time (s) is over."""
        end = time.monotonic() + timeout
        while alone := [name for name, publisher in self._topics.items() if not publisher.get_subscription_count()]:
            if time.monotonic() > end or self._interrupt.requested:
                self._log.warning(f'playing without subscribers of {listing(alone)}')
                return
            time.sleep(_CLOCK_PERIOD)

    def play(self) -> None:
        """Publish every message when it is due."""
        first = True
        total = sum(self._bag.topics[topic].count for topic in self._topics)
        with tqdm(total=total, unit=' messages', disable=None, leave=False) as bar:
            for topic, data, due in self._bag.raw(self._topics):
                if first:
                    self._origin, first = (time.monotonic(), due), False
                self._wait_until(due)
                if self._interrupt.requested:
                    return
                self._topics[topic].publish(data)
                self._sent[topic] += 1
                if self._sent[topic] == _UNCONFIRMED:
                    self._confirm(topic)
                bar.update()

    def finish(self) -> list[str]:
        """Wait until reliable subscribers have everything, or have had time for it; return what may be lost."""
        for topic in self._topics:
            self._confirm(topic)
        return [
            f"{count} messages on '{topic}' may be lost: a subscriber has not confirmed them in {_PATIENCE:g} s"
            for topic, count in self._lost.items()
        ]

    def _confirm(self, topic: str) -> None:
        """Wait until reliable subscribers have confirmed all messages; not again for one that has let time pass."""
        patience = 0.0 if topic in self._lost else _PATIENCE
        if not self._topics[topic].wait_for_all_acked(Duration(seconds=patience)):
            self._lost[topic] += self._sent[topic]
        self._sent[topic] = 0

    def _wait_until(self, due: int) -> None:
        """Return at a bag time (ns), with the clock going on until then."""
        begin, origin = self._origin
        while not self._interrupt.requested:
            now = time.monotonic()
            passed = origin + round((now - begin) * self._rate * 1e9)
            if self._clock_topic and now - self._last_clock >= _CLOCK_PERIOD:
                self._publish_clock(min(passed, due))
                self._last_clock = now
            if passed >= due:
                return
            time.sleep(min((due - passed) * 1e-9 / self._rate, _CLOCK_PERIOD if self._clock_topic else LATENCY))

    def _publish_clock(self, when: int) -> None:
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(when, 1_000_000_000)
        if self._clock_topic:
            self._clock_topic.publish(message)


def main(arguments: argparse.Namespace, interrupt: Interrupt) -> int:
    """Run the node until it is interrupted, and return the exit code; `mbaid_ros.nodes.start` calls it within ROS."""
    with BagReader(arguments.bag) as bag:
        node = PlayerNode(bag, arguments.topics, arguments.rate, clock=arguments.clock, interrupt=interrupt)
        if arguments.wait_for_subscribers:
            node.wait_for_subscribers(arguments.wait_for_subscribers)
        node.play()
        while arguments.loop and not interrupt.requested:
            node.play()
        lost = [] if interrupt.requested else node.finish()
        warn(NAME, [*bag.warnings, *lost])
    return EXIT_NOT_DETERMINED if lost else 0
