"""The parameters of the estimator about what tells of the base's motion beside Odometry."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.config.parameters import parameter


@dataclass(frozen=True)
class PoseConfig:
    """Poses of the base without a twist: PoseStamped and its like on the topic pose, or a transform on /tf."""

    frame: str = parameter(
        '',
        'Frame on the base that a PoseStamped locates: the base link, another link fixed to it, or the one that marker '
        'places. Empty: that of marker, where it is set, or else the base link.',
    )
    tf_child_frame: str = parameter(
        '',
        'Take the pose of the base from /tf: child frame of the transform, in the same place unless pose.frame names '
        'another. Empty does not read /tf.',
    )
    tf_parent_frame: str = parameter('', 'Parent frame of that transform, which is inertial; empty is any.')
