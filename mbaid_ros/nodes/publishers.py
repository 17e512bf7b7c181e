"""What the estimator publishes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from geometry_msgs.msg import InertiaStamped
from mbaid_msgs.msg import InertiaEstimate
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String

from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.publication import InertiaPublication, is_complete
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.nodes.description import message_class
from mbaid_ros.nodes.qos import LATCHED, quiet_publisher
from mbaid_ros.outgoing import Frames, MessageTypes, estimate_message, inertia_message

_PATIENCE = Duration(nanoseconds=50_000_000)  # with a subscriber that has died, or has no time


TYPES = MessageTypes(find=message_class, flags=lambda flags: flags.tolist())


class Publishers:
    """The latched topics of the estimate: ~/estimate, ~/inertia, ~/robot_description and, if asked for, ~/debris.

    Parameters
    ----------
    node : Node
    with_debris : whether the captured body is published on its own, too
    """

    def __init__(self, node: Node, *, with_debris: bool = False) -> None:
        self._node = node
        self._topics = {'~/estimate': InertiaEstimate, '~/inertia': InertiaStamped, '~/robot_description': String}
        if with_debris:
            self._topics['~/debris'] = InertiaEstimate
        self._publishers: dict[str, Publisher] = {}
        self._inertia = InertiaPublication()
        self._described = False  # whether ~/robot_description holds a robot
        self.clear()

    def clear(self) -> None:
        """Forget what has been published: whoever subscribes from now on gets nothing of it."""
        self.close()
        for topic in self._topics:
            self._open(topic)

    def close(self) -> None:
        """Publish no more."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers, self._inertia, self._described = {}, InertiaPublication(), False

    def publish(self, estimate: Estimate, frames: Frames, urdf: str) -> None:
        """Publish an estimate in the forms it is good for, and take back the one before in those it is not good for.

        Parameters
        ----------
        estimate : Estimate
        frames : Frames
        urdf : str
            The robot description that it belongs to.
        """
        self._publish('~/estimate', estimate_message(estimate, TYPES, frames))
        told = self._inertia.follow(estimate)
        if told is not None:
            self._publish('~/inertia', inertia_message(told, TYPES, frames))
        described, self._described = self._described, is_complete(estimate)
        if self._described:
            text = replace_inertial(urdf, frames.target_link, estimate.parameters)
            self._publish('~/robot_description', String(data=text))
        elif described:
            # A robot without numbers is none, and only a publisher's end makes a latched topic forget.
            self._node.destroy_publisher(self._publishers['~/robot_description'])
            self._open('~/robot_description')

    def tell_stale(self, estimate: Estimate, frames: Frames, reasons: Sequence[str]) -> None:
        """Publish an estimate once more, as one that nothing follows for reasons."""
        self._publish('~/estimate', estimate_message(estimate, TYPES, frames, reasons, stale=True))

    def publish_debris(self, message: InertiaEstimate) -> None:
        """Publish the captured body on its own."""
        self._publish('~/debris', message)

    def _open(self, topic: str) -> None:
        self._publishers[topic] = quiet_publisher(self._node, self._topics[topic], topic, LATCHED)

    def _publish(self, topic: str, message: Any) -> None:
        # A latched topic keeps one message, and would forget it for the next when several windows close at once: that
        # waits until the subscribers have the one before, which they mostly have long since.
        self._publishers[topic].wait_for_all_acked(_PATIENCE)
        self._publishers[topic].publish(message)


def last_of_each_window(estimates: Sequence[Estimate], window: float) -> list[Estimate]:
    """Return the last estimate of each window: the methods of the paper give one a sample, which nobody can follow.

    Windows are told apart by the stamps of the samples alone, so how many come at once makes no difference.
    """
    windows = groupby(estimates, key=lambda estimate: int((estimate.time + 1e-9) / window))
    return [list(several)[-1] for _, several in windows]
