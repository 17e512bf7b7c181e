"""The floor under the live node: a node with the same two subscriptions, which does nothing with the messages."""

from __future__ import annotations

import sys

from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState

from mbaid_ros.nodes.runner import ros, spin
from mbaid_ros.nodes.subscriptions import DEPTH, qos


def main() -> None:
    """Receive until interrupted."""
    with ros(sys.argv[1:]) as interrupt:
        node = Node('bare')
        for kind, topic in ((JointState, 'joint_states'), (Odometry, 'odom')):
            node.create_subscription(kind, topic, lambda _message: None, qos(DEPTH))
        spin(node, lambda: interrupt.requested)


if __name__ == '__main__':
    main()
