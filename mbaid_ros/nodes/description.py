"""The robot description as others publish it."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from std_msgs.msg import String

from mbaid_ros.nodes.qos import LATCHED, qos


class DescriptionInlet:
    """Receives robot descriptions: latched ones, and those of a publisher that does not latch (``ros2 topic pub``).

    Parameters
    ----------
    node : Node
    take : callable
        Called with each message.

    Attributes
    ----------
    topic : name of the topic as the graph has it, after remapping
    """

    def __init__(self, node: Node, take: Callable[[String], None]) -> None:
        self._node = node
        self._take = take
        late = SubscriptionEventCallbacks(
            incompatible_qos=lambda _event: self._subscribe_to_unlatched(), use_default_callbacks=False
        )
        self._subscriptions = [
            node.create_subscription(String, 'robot_description', take, LATCHED, event_callbacks=late)
        ]
        self.topic = str(self._subscriptions[0].topic_name)

    def _subscribe_to_unlatched(self) -> None:
        if len(self._subscriptions) == 1:
            self._subscriptions.append(self._node.create_subscription(String, 'robot_description', self._take, qos(1)))
