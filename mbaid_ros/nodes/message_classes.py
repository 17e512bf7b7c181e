"""rclpy's class of a message type that is known by name only."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from mbaid_ros.core.errors import ParameterError


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
