"""Names of topics as bags, parameters and other programs give them, which may be none to ROS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from mbaid_ros.cdr import packer
from mbaid_ros.files import as_utf8
from mbaid_ros.messages import stamp_of
from mbaid_ros.nodes.qos import overridable, qos
from mbaid_ros.nodes.runner import RCLError


def why_no_topic(node: Node, name: str) -> str:
    """Return why a node can have no topic of a name; empty if it can."""
    try:
        node.resolve_topic_name(as_utf8(name))  # with what is no text escaped, it is a name even less
    except RCLError as error:
        return str(error).removeprefix('failed to resolve name: ').partition(', at /')[0]
    return ''


RMWError = rclpy_implementation.RMWError

DEPTH = 5000  # messages: what arrives at 1 kHz during five seconds of work on a window


class Subscriptions:
    """Receives messages of one topic and loses none of a reliable publisher.

    The subscription asks for reliable delivery. A best-effort publisher does not offer that, and the middleware says so
    when it finds one: only then is best effort asked for, until no publisher is left. A reliability that is set by a
    parameter qos_overrides.<topic>.subscription.reliability stays as it is set.

    Parameters
    ----------
    node : Node
    message_type : type
        The ROS message class.
    topic : str
    take : callable
        Called with each message: as a packet of `mbaid_ros.cdr` where that knows the type and understands the bytes,
        which takes a fraction of the time; else as an object.
    others : sequence of types
        Message classes that are taken, too: of the one that a publisher turns out to have while nothing has come.
    """

    def __init__(
        self, node: Node, message_type: type, topic: str, take: Callable[[Any], None], others: Sequence[type] = ()
    ) -> None:
        self._node = node
        self._message_type = message_type
        self._types = {type_name_of(each): each for each in (message_type, *others)}
        self._given_topic = topic
        self._take = take
        self._pack = packer(self.type_name)
        self.received = 0
        self.timed: tuple[int, int] | None = None  # of a recent message: stamp, and the node's clock at its arrival, ns
        self._to_be_timed = True
        self.best_effort = False
        self._profile = qos(DEPTH)
        self._subscription = self._subscribe(overridable())  # overrides go into the profile
        self._set = self._profile.reliability == ReliabilityPolicy.BEST_EFFORT  # by a parameter
        self.best_effort = self._set

    @property
    def topic(self) -> str:
        """Name of the topic as the graph has it, after remapping."""
        return str(self._subscription.topic_name)

    @property
    def type_name(self) -> str:
        """Name of the message type: ``package/msg/Type``."""
        return type_name_of(self._message_type)

    @property
    def type_names(self) -> tuple[str, ...]:
        """Names of all types that are taken."""
        return tuple(self._types)

    def refresh(self) -> None:
        """Follow what the publishers offer, and time a message. Call it regularly.

        Reliable delivery is asked for again once the best-effort publisher is gone.
        """
        self._to_be_timed = True
        if not self.received and len(self._types) > 1:
            self._take_type()
        if self.best_effort and not self._set and not self._subscription.get_publisher_count():
            self._resubscribe(best_effort=False)

    def publishers(self) -> list[TopicEndpointInfo]:
        """Return what is known of the topic's publishers."""
        return list(self._node.get_publishers_info_by_topic(self.topic))

    def close(self) -> None:
        """Receive no more."""
        self._node.destroy_subscription(self._subscription)

    def _take_type(self) -> None:
        """Subscribe with the type of the publishers, where that is another one that is taken."""
        offered = [info.topic_type for info in self.publishers()]
        wanted = [name for name in offered if name in self._types]
        if wanted and self.type_name not in wanted:
            self._message_type = self._types[wanted[0]]
            self._pack = packer(self.type_name)
            self._resubscribe(best_effort=self.best_effort)

    def _resubscribe(self, *, best_effort: bool) -> None:
        self.best_effort = best_effort
        self._node.destroy_subscription(self._subscription)
        # The parameters of the first subscription hold what it had: they would bring that back.
        self._profile.reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        self._subscription = self._subscribe(None)

    def _subscribe(self, overrides: QoSOverridingOptions | None) -> Subscription:
        events = SubscriptionEventCallbacks(
            incompatible_qos=None if self.best_effort else self._on_incompatible, use_default_callbacks=False
        )
        return self._node.create_subscription(
            self._message_type,
            self._given_topic,
            self._on_message,
            self._profile,
            event_callbacks=events,
            qos_overriding_options=overrides,
            raw=self._pack is not None,
        )

    def _on_message(self, message: Any) -> None:
        if self._pack is not None:
            message = self._pack(message) or self._object(message)
        if message is None:
            return
        self.received += 1
        if self._to_be_timed and not hasattr(message, 'transforms'):
            self._to_be_timed = False
            self.timed = stamp_of(message), self._node.get_clock().now().nanoseconds
        self._take(message)

    def _object(self, data: bytes) -> Any:
        """Return what the middleware makes of bytes, None if it cannot make a message of them."""
        try:
            return deserialize_message(data, self._message_type)
        except RMWError:
            text = f'a message on {self.topic} is not a {self.type_name}: it is not used'
            self._node.get_logger().warning(text, once=True)  # type: ignore[no-untyped-call]
            return None

    def _on_incompatible(self, event: QoSRequestedIncompatibleQoSInfo) -> None:
        if self.best_effort:
            return
        policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
        text = f'a publisher of {self.topic} offers less than asked for ({policy}): best effort is taken instead'
        self._node.get_logger().warning(text)  # type: ignore[no-untyped-call]
        self._resubscribe(best_effort=True)


def type_name_of(message_type: type) -> str:
    """Return the name of a ROS message class: ``package/msg/Type``."""
    return message_type.__module__.split('.')[0] + '/msg/' + message_type.__name__
