"""rclpy's class of a message type that is known by name only."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any


@cache
def message_class(type_name: str) -> Any:
    """Return rclpy's class of a message type: ``package/msg/Type``."""
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)
