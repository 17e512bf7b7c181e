"""rclpy's class of a message type that is known by name only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from std_msgs.msg import String

from mbaid_ros.config.capture import DebrisConfig, SelfCalibrationConfig
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import KnownLinksConfig
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.nodes.qos import LATCHED, qos
from mbaid_ros.session import Session


@cache
def message_class(type_name: str) -> Any:
    """Return rclpy's class of a message type: ``package/msg/Type``."""
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


def tf_message(because: str, accepted: str) -> Any:
    """Return the class of the messages on /tf, which not every installation has.

    Parameters
    ----------
    because : which parameter asks for it
    accepted : what that may be without

    Raises
    ------
    ParameterError
        It is not installed.
    """
    try:
        return import_module('tf2_msgs.msg').TFMessage
    except ImportError as error:
        raise ParameterError(
            f'{because}, but the message package tf2_msgs is not installed; accepted: {accepted}, '
            'or apt install ros-jazzy-tf2-msgs'
        ) from error


# A robot that any method can be set up for: tells parameters that can never work from a robot description to come.
_ANY_ROBOT = """\
<robot name="any"><link name="base_link"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"""


def check_without_robot(config: EstimatorConfig) -> None:
    """Refuse parameters that no robot description can be used with.

    Raises
    ------
    ParameterError
        They contradict each other.
    """
    # What is about links can only be checked with the robot.
    config = replace(config, base_link='', target_link='', debris=DebrisConfig(), known_links=KnownLinksConfig())
    Session(replace(config, calibration=SelfCalibrationConfig()), _ANY_ROBOT)


class DescriptionSubscription:
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

    def close(self) -> None:
        """Receive no more."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _subscribe_to_unlatched(self) -> None:
        if len(self._subscriptions) == 1:
            self._subscriptions.append(self._node.create_subscription(String, 'robot_description', self._take, qos(1)))
