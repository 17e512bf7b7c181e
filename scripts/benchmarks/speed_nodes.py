"""Nodes beside the estimator in measurements of speed.

usage: speed_nodes.py bare          the same two subscriptions, without any processing: the floor under the live node
       speed_nodes.py BAG RATE      publishes joint states and odometry of a bag at a rate, stamped with the due times

The publisher prints `ready` once both topics have a subscriber, begins on a line of input, and prints the number of
messages on each topic once the subscriber has received them.
"""

import gc
import struct
import sys
import time
from pathlib import Path

from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState

from mbaid_ros.bags import BagReader
from mbaid_ros.nodes.runner import ros, spin
from mbaid_ros.nodes.subscriptions import DEPTH, qos, quiet_publisher

KINDS = {'/joint_states': JointState, '/odom': Odometry}
_STAMP = struct.Struct('<iI')  # of a message's header, after four bytes for the encoding
_PATIENCE = Duration(seconds=20.0)


def bare() -> None:
    """Receive until interrupted."""
    with ros([]) as interrupt:
        node = Node('bare')
        for topic, kind in KINDS.items():
            node.create_subscription(kind, topic, lambda _message: None, qos(DEPTH))
        spin(node, lambda: interrupt.requested)


def publish(bag: Path, rate: float) -> None:
    """Publish a bag."""
    messages: dict[str, list[bytearray]] = {topic: [] for topic in KINDS}
    with BagReader(bag) as reader:
        for topic, content, _ in reader.raw(messages):
            messages[topic].append(bytearray(content))
    with ros([]) as interrupt:
        node = Node('publisher')
        publishers = {topic: quiet_publisher(node, kind, topic, qos(DEPTH)) for topic, kind in KINDS.items()}
        while not interrupt.requested and not all(each.get_subscription_count() for each in publishers.values()):
            time.sleep(0.02)
        print('ready', flush=True)
        sys.stdin.readline()
        gc.freeze()  # a collection would take longer than the measured times
        begin = time.time_ns()
        for number in range(len(messages['/odom'])):
            due = begin + round(number / rate * 1e9)
            time.sleep(max(0.0, 1e-9 * (due - time.time_ns())))
            # Stamped with the due time: the publisher's delay counts as latency, too.
            for topic, publisher in publishers.items():
                data = messages[topic][number]
                _STAMP.pack_into(data, 4, *divmod(due, 1_000_000_000))
                publisher.publish(bytes(data))
        if not all(publisher.wait_for_all_acked(_PATIENCE) for publisher in publishers.values()):
            raise RuntimeError('not everything was received')
        print(len(messages['/odom']), flush=True)
        sys.stdin.readline()


if __name__ == '__main__':
    if sys.argv[1:] == ['bare']:
        bare()
    else:
        publish(Path(sys.argv[1]), float(sys.argv[2]))
