"""Which messages locate the base: Odometry, poses of motion capture, or a transform on /tf; one kind in a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from mbaid_ros.cdr import Packets
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.messages import PoseReader, Source, source_of
from mbaid_ros.session.robot import Robot

OTHER_SOURCE = 'the pose of the base comes from another source'


class BaseSource:
    """Takes the messages of the source that comes first, or of the one that the parameters name.

    Parameters
    ----------
    config : EstimatorConfig
    robot : Robot

    Attributes
    ----------
    kind : of the source; empty before the first message
    dropped : messages of other sources

    Raises
    ------
    ParameterError
        A frame that the parameters name is not on the base.
    """

    def __init__(self, config: EstimatorConfig, robot: Robot) -> None:
        pose = config.pose
        links = {config.frame_prefix + link.name: link.body for link in robot.model.links}
        carried = [name for name, body in links.items() if body == 0]
        if pose.frame and pose.frame not in carried and (robot.marker is None or pose.frame in links):
            raise ParameterError(
                f"parameter 'pose.frame' is '{pose.frame}'; accepted: {listing(carried)}, or with marker.position one "
                'that is no link of the robot'
            )
        base = config.frame_prefix + robot.model.base_link
        # A frame without a name is no link's: that of the marker.
        frame = pose.frame or ('' if robot.marker is not None else base)
        self._poses = PoseReader(frame, pose.frame, pose.tf_parent_frame, pose.tf_child_frame)
        self._needed = not config.imu.alone
        self.kind: Source | None = 'tf' if pose.tf_child_frame else None
        self.dropped: Counter[str] = Counter()

    def poses(self, messages: Sequence[Any]) -> Sequence[Any]:
        """Return messages as Odometry or as poses, whatever the source."""
        if isinstance(messages, Packets):
            return messages
        each = ([message] if source_of(message) == 'odom' else self._poses.read(message) for message in messages)
        return [pose for poses in each for pose in poses]

    def takes(self, messages: Sequence[Any]) -> bool:
        """Tell whether messages are all of the source that is used."""
        return all(self._is_used(kind) for kind in _kinds(messages))

    def located(self, messages: Sequence[Any]) -> Sequence[Any]:
        """Return what messages say of the base, as Odometry or as poses; those of other sources are counted."""
        for kind in _kinds(messages):
            if self.kind is None and kind != 'tf':
                self.kind = kind
        if isinstance(messages, Packets):
            if self._is_used('odom'):
                return messages
            self.dropped[OTHER_SOURCE] += len(messages)
            return []
        used = [message for message in messages if self._is_used(source_of(message))]
        self.dropped[OTHER_SOURCE] += len(messages) - len(used)
        return self.poses(used)

    def _is_used(self, kind: Source) -> bool:
        if not self._needed:
            return False
        return kind == self.kind or (self.kind is None and kind != 'tf')


def _kinds(messages: Sequence[Any]) -> set[Source]:
    if isinstance(messages, Packets):
        return {'odom'}
    return {source_of(message) for message in messages}
