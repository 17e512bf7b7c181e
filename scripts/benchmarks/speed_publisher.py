"""Publishes the joint states and odometry of a bag at a rate, stamped with the times they are due.

usage: speed_publisher.py BAG RATE

It says `ready` once both topics have a subscriber, begins on a line of input, and tells the number of messages on each
topic once the subscriber has all of them.
"""

from __future__ import annotations

import gc
import struct
import sys
import time
from pathlib import Path

from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from mbaid_ros.bags import BagReader
from mbaid_ros.nodes.runner import ros
from mbaid_ros.nodes.subscriptions import DEPTH, qos, quiet_publisher

_STAMP = struct.Struct('<iI')  # of a message's header: after the four bytes that say how it is encoded
_LOOK = 0.02  # s, between two looks for subscribers
_PATIENCE = Duration(seconds=20.0)


def main() -> None:
    """Publish."""
    messages = _messages(Path(sys.argv[1]))
    rate = float(sys.argv[2])
    with ros([]) as interrupt:
        node = Node('publisher')
        publishers = {
            topic: quiet_publisher(node, kind, topic, qos(DEPTH))
            for topic, kind in (('/joint_states', JointState), ('/odom', Odometry))
        }
        while not interrupt.requested and not all(each.get_subscription_count() for each in publishers.values()):
            time.sleep(_LOOK)
        print('ready', flush=True)
        sys.stdin.readline()
        gc.freeze()  # looking through all of it for garbage would take longer than what is measured
        _publish(publishers, messages, rate)
        if not all(publisher.wait_for_all_acked(_PATIENCE) for publisher in publishers.values()):
            raise RuntimeError('not everything was received')
        print(len(messages['/odom']), flush=True)
        sys.stdin.readline()


def _messages(bag: Path) -> dict[str, list[bytearray]]:
    """Return the bytes of all messages by topic."""
    messages: dict[str, list[bytearray]] = {'/joint_states': [], '/odom': []}
    with BagReader(bag) as reader:
        for topic, data, _ in reader.raw(messages):
            messages[topic].append(bytearray(data))
    return messages


def _publish(publishers: dict[str, Publisher], messages: dict[str, list[bytearray]], rate: float) -> None:
    begin = time.time_ns()
    for number in range(len(messages['/odom'])):
        due = begin + round(number / rate * 1e9)
        time.sleep(max(0.0, 1e-9 * (due - time.time_ns())))
        # When it was due: what the publisher is late counts as latency, too.
        for topic, publisher in publishers.items():
            data = messages[topic][number]
            _STAMP.pack_into(data, 4, *divmod(due, 1_000_000_000))
            publisher.publish(bytes(data))


if __name__ == '__main__':
    main()
