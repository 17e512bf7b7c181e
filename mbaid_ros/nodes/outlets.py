"""What the estimator publishes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np
from geometry_msgs.msg import InertiaStamped
from mbaid_msgs.msg import InertiaEstimate
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String

from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.urdf_output import replace_inertial
from mbaid_ros.nodes.message_classes import message_class
from mbaid_ros.nodes.qos import LATCHED, quiet_publisher
from mbaid_ros.outgoing import Frames, MessageTypes, estimate_message, inertia_message

_PATIENCE = Duration(nanoseconds=50_000_000)  # with a subscriber that has died, or has no time


TYPES = MessageTypes(find=message_class, flags=lambda flags: flags.tolist())


class Outlets:
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
        self._holding: set[str] = set()  # of ~/inertia, ~/robot_description, those whose last message can be used
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
        self._publishers, self._holding = {}, set()

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
        if is_usable(estimate):
            self._hold('~/inertia', inertia_message(estimate, TYPES, frames))
        elif '~/inertia' in self._holding:
            # Who reads this topic alone has to learn that the last numbers are not to be computed with any more.
            nothing = replace(estimate, parameters=np.full(estimate.parameters.shape, np.nan))
            self._publish('~/inertia', inertia_message(nothing, TYPES, frames))
            self._holding.remove('~/inertia')
        if is_complete(estimate):
            text = replace_inertial(urdf, frames.target_link, estimate.parameters)
            self._hold('~/robot_description', String(data=text))
        elif '~/robot_description' in self._holding:
            self._withdraw('~/robot_description')

    def tell_stale(self, estimate: Estimate, frames: Frames, reasons: Sequence[str]) -> None:
        """Publish an estimate once more, as one that nothing follows for reasons."""
        self._publish('~/estimate', estimate_message(estimate, TYPES, frames, reasons, stale=True))

    def publish_debris(self, message: InertiaEstimate) -> None:
        """Publish the captured body on its own."""
        self._publish('~/debris', message)

    def _open(self, topic: str) -> None:
        self._publishers[topic] = quiet_publisher(self._node, self._topics[topic], topic, LATCHED)

    def _withdraw(self, topic: str) -> None:
        """Forget what a latched topic holds, which only a publisher's end does."""
        self._node.destroy_publisher(self._publishers[topic])
        self._open(topic)
        self._holding.remove(topic)

    def _hold(self, topic: str, message: Any) -> None:
        self._publish(topic, message)
        self._holding.add(topic)

    def _publish(self, topic: str, message: Any) -> None:
        # A latched topic keeps one message, and would forget it for the next when several windows close at once: that
        # waits until the subscribers have the one before, which they mostly have long since.
        self._publishers[topic].wait_for_all_acked(_PATIENCE)
        self._publishers[topic].publish(message)


def is_usable(estimate: Estimate) -> bool:
    """Tell whether an estimate says enough to compute with, at least in a plane.

    That is a positive mass, two coordinates of the centre of mass and a moment of inertia.
    """
    mass, com, moments = estimate.parameters[0], estimate.parameters[1:4], estimate.parameters[[4, 7, 9]]
    known = mass > 0.0 and np.sum(np.isfinite(com)) >= 2 and np.any(moments > 0.0)
    return bool(known) and estimate.status != 'inconsistent'


def is_complete(estimate: Estimate) -> bool:
    """Tell whether all ten parameters of a link are known."""
    return is_usable(estimate) and bool(np.all(estimate.identifiable & np.isfinite(estimate.parameters)))


def last_of_each_window(estimates: Sequence[Estimate], window: float) -> list[Estimate]:
    """Return the last estimate of each window: the methods of the paper give one a sample, which nobody can follow.

    Windows are told apart by the stamps of the samples alone, so how many come at once makes no difference.
    """
    windows = groupby(estimates, key=lambda estimate: int((estimate.time + 1e-9) / window))
    return [list(several)[-1] for _, several in windows]
