"""Topics: qualities of service, subscriptions that lose nothing of a reliable publisher, and robot descriptions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cache
from importlib import import_module
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import String

from mbaid_ros.errors import ParameterError
from mbaid_ros.estimate_messages import MessageTypes
from mbaid_ros.files import as_utf8
from mbaid_ros.nodes.runner import RCLError
from mbaid_ros.packets import packer

RMWError = rclpy_implementation.RMWError

DEPTH = 5000  # messages, as arrive at 1 kHz during five seconds of work on a window
LOST = 'were lost on the way: play slower, or give the node more of the machine'  # of messages that have not come
_OVERRIDABLE = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)


def qos(depth: int, *, best_effort: bool = False, latched: bool = False) -> QoSProfile:
    """Return a profile that keeps the last `depth` messages; latched: for later subscribers, too (transient local)."""
    return QoSProfile(  # type: ignore[no-untyped-call]
        depth=depth,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


LATCHED = qos(1, latched=True)


def quiet_publisher(node: Node, message_type: type, topic: str, profile: QoSProfile) -> Publisher:
    """Return a publisher without the two event handlers that rclpy adds to each.

    They only log that a subscriber asks for more than is offered, but the executor visits all handlers of a node for
    every message: a tenth of the work of a node that receives thousands a second.
    """
    return node.create_publisher(
        message_type,
        topic,
        copy(profile),  # overrides go into it
        event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
    )


@cache
def message_class(type_name: str) -> Any:
    """Return rclpy's class of a message type: ``package/msg/Type``."""
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


TYPES = MessageTypes(find=message_class, flags=lambda flags: flags.tolist())


def type_name_of(message_type: type) -> str:
    """Return the name of a ROS message class: ``package/msg/Type``."""
    return message_type.__module__.split('.')[0] + '/msg/' + message_type.__name__


def tf_message() -> Any:
    """Return the class of the messages on /tf, which not every installation has.

    Raises ParameterError: It is not installed.
    """
    try:
        return import_module('tf2_msgs.msg').TFMessage
    except ImportError as error:
        raise ParameterError(
            "parameter 'pose.tf_child_frame' is set, but the message package tf2_msgs is not installed; accepted: "
            'empty, or apt install ros-jazzy-tf2-msgs'
        ) from error


def why_no_topic(node: Node, name: str) -> str:
    """Return why a node can have no topic of a name; empty if it can."""
    try:
        node.resolve_topic_name(as_utf8(name))  # undecodable bytes are escaped, which no topic name allows
    except RCLError as error:
        return str(error).removeprefix('failed to resolve name: ').partition(', at /')[0]
    return ''


class Subscriptions:
    """Receives messages of one topic and loses none of a reliable publisher.

    It asks for reliable delivery, and for best effort as long as a publisher offers no more. A reliability set by a
    parameter qos_overrides.<topic>.subscription.reliability stays.

    Parameters
    ----------
    node, message_type, topic : as for rclpy
    callback : called with each message: as a packet of `mbaid_ros.packets` if that knows the type and understands the
        bytes, which takes a fraction of the time; else as an object
    others : further message classes; one of these is subscribed to if publishers offer it before anything has come
    """

    def __init__(
        self, node: Node, message_type: type, topic: str, callback: Callable[[Any], None], others: Sequence[type] = ()
    ) -> None:
        self._node = node
        self._message_type = message_type
        self._types = {type_name_of(each): each for each in (message_type, *others)}
        self.given_topic = topic
        self._callback = callback
        self._pack = packer(self.type_name)
        self.received = 0
        self.lost = 0  # messages between others of the only publisher that have not come
        self._number = 0  # the publisher's, of the last message
        self.best_effort = False
        self._profile = qos(DEPTH)
        self._profile.history = HistoryPolicy.KEEP_ALL  # where that is full, a reliable publisher keeps them
        self._subscription = self._subscribe(QoSOverridingOptions(_OVERRIDABLE))  # overrides go into the profile
        self._overridden = self._profile.reliability == ReliabilityPolicy.BEST_EFFORT
        self.best_effort = self._overridden

    @property
    def topic(self) -> str:
        """Name of the topic on the graph, after remapping."""
        return str(self._subscription.topic_name)

    @property
    def type_name(self) -> str:
        """Name of the message type: ``package/msg/Type``."""
        return type_name_of(self._message_type)

    @property
    def type_names(self) -> tuple[str, ...]:
        """Names of all accepted types."""
        return tuple(self._types)

    def refresh(self) -> None:
        """Follow the types and reliability that publishers offer. Call it regularly."""
        if not self.received and len(self._types) > 1:
            self._follow_type()
        if self.best_effort and not self._overridden and not self._subscription.get_publisher_count():
            self._resubscribe(best_effort=False)

    def publishers(self) -> list[TopicEndpointInfo]:
        """Return the topic's publishers."""
        return list(self._node.get_publishers_info_by_topic(self.topic))

    def elsewhere(self) -> list[str]:
        """Return other topics on the graph on which an accepted type is published."""
        found = self._node.get_topic_names_and_types()
        names = [name for name, types in found if name != self.topic and self._types.keys() & set(types)]
        return sorted(name for name in names if self._node.count_publishers(name))

    def _follow_type(self) -> None:
        """Subscribe with the type of the publishers if it is another accepted one."""
        offered = [info.topic_type for info in self.publishers()]
        wanted = [name for name in offered if name in self._types]
        if wanted and self.type_name not in wanted:
            self._message_type = self._types[wanted[0]]
            self._pack = packer(self.type_name)
            self._resubscribe(best_effort=self.best_effort)

    def _resubscribe(self, *, best_effort: bool) -> None:
        self.best_effort = best_effort
        self._node.destroy_subscription(self._subscription)
        # The parameters of the first subscription hold its reliability: they would bring that back.
        self._profile.reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        self._subscription = self._subscribe(None)

    def _subscribe(self, overrides: QoSOverridingOptions | None) -> Subscription:
        events = SubscriptionEventCallbacks(
            incompatible_qos=None if self.best_effort else self._on_incompatible, use_default_callbacks=False
        )
        return self._node.create_subscription(
            self._message_type,
            self.given_topic,
            self._on_message,  # type: ignore[arg-type] # two arguments, as rclpy has it
            self._profile,
            event_callbacks=events,
            qos_overriding_options=overrides,
            raw=self._pack is not None,
        )

    def _on_message(self, message: Any, info: Mapping[str, int]) -> None:
        number, last = info['publication_sequence_number'], self._number
        self._number = number
        if 0 < last < number - 1 and self._subscription.get_publisher_count() <= 1:
            self.lost += number - last - 1
        if self._pack is not None:
            message = self._pack(message) or self._object(message)
        if message is None:
            return
        self.received += 1
        self._callback(message)

    def _object(self, data: bytes) -> Any:
        """Return the message in bytes, None if the middleware cannot decode them."""
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


class DescriptionSubscription:
    """Receives robot descriptions: latched ones, and those of a publisher that does not latch (``ros2 topic pub``)."""

    def __init__(self, node: Node, callback: Callable[[String], None]) -> None:
        self._node = node
        self._callback = callback
        events = SubscriptionEventCallbacks(
            incompatible_qos=lambda _event: self._subscribe_to_unlatched(), use_default_callbacks=False
        )
        self._subscriptions = [
            node.create_subscription(String, 'robot_description', callback, LATCHED, event_callbacks=events)
        ]
        self.topic = str(self._subscriptions[0].topic_name)  # after remapping

    def _subscribe_to_unlatched(self) -> None:
        if len(self._subscriptions) == 1:
            unlatched = self._node.create_subscription(String, 'robot_description', self._callback, qos(1))
            self._subscriptions.append(unlatched)
