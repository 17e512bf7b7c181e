"""The qualities of service that the nodes use."""

from __future__ import annotations

from copy import copy

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions


def qos(depth: int, *, best_effort: bool = False, latched: bool = False) -> QoSProfile:
    """Return a profile that keeps the last `depth` messages.

    Parameters
    ----------
    depth : int
        Number of messages.
    best_effort : bool
        Not repeating what gets lost on the way.
    latched : bool
        Also for subscribers that come later (transient local).
    """
    return QoSProfile(  # type: ignore[no-untyped-call]
        depth=depth,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


LATCHED = qos(1, latched=True)
_OVERRIDABLE = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)


def overridable() -> QoSOverridingOptions:
    """Return what lets parameters qos_overrides.<topic>.<publisher or subscription>.<policy> take effect."""
    return QoSOverridingOptions(_OVERRIDABLE)


def quiet_publisher(node: Node, message_type: type, topic: str, profile: QoSProfile) -> Publisher:
    """Return a publisher without the two event handlers that rclpy adds to each.

    They only log that a subscriber asks for more than is offered, but the executor goes through all handlers of a node
    for every message that it takes: a tenth of the work of a node that takes thousands a second.
    """
    return node.create_publisher(
        message_type,
        topic,
        copy(profile),  # overrides go into it
        event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        qos_overriding_options=overridable(),
    )
