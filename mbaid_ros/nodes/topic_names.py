"""Names of topics as bags, parameters and other programs give them, which may be none to ROS."""

from __future__ import annotations

from rclpy.node import Node

from mbaid_ros.files import as_utf8
from mbaid_ros.nodes.runner import RCLError


def why_no_topic(node: Node, name: str) -> str:
    """Return why a node can have no topic of a name; empty if it can."""
    try:
        node.resolve_topic_name(as_utf8(name))  # with what is no text escaped, it is a name even less
    except RCLError as error:
        return str(error).removeprefix('failed to resolve name: ').partition(', at /')[0]
    return ''
