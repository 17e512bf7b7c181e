"""The topics of a bag that are read, and how their messages reach a session."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

from mbaid_ros.errors import DataError, ParameterError

if TYPE_CHECKING:  # `--help` needs the defaults alone
    from mbaid_ros.bags import BagReader, Batch
    from mbaid_ros.config.estimator_parameters import EstimatorConfig
    from mbaid_ros.core.samples import Input
    from mbaid_ros.session.session import Session

JOINT_STATE_TYPE = 'sensor_msgs/msg/JointState'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'
# Types that locate the base without a twist.
POSE_TYPES = (
    'geometry_msgs/msg/PoseStamped',
    'geometry_msgs/msg/PoseWithCovarianceStamped',
    'geometry_msgs/msg/TransformStamped',
    'tf2_msgs/msg/TFMessage',
)
IMU_TYPE = 'sensor_msgs/msg/Imu'
THRUST_TYPE = 'geometry_msgs/msg/WrenchStamped'
# Types that locate the target before its capture.
TARGET_POSE_TYPES = ('geometry_msgs/msg/PoseStamped', 'geometry_msgs/msg/PoseWithCovarianceStamped', ODOMETRY_TYPE)
STORED_MOMENTUM_TYPE = 'geometry_msgs/msg/Vector3Stamped'
ODOMETRY, POSE, TF = '/odom', '/pose', '/tf'
# Read where a bag has it, even if not asked for.
THRUST, STORED_MOMENTUM, IMU, TARGET_POSE = '/thrust', '/stored_momentum', '/imu', '/target_pose'


def between(arguments: argparse.Namespace) -> tuple[float, float]:
    """Return the seconds from a bag's first message between which it is read.

    Raises ParameterError: There is nothing between the two.
    """
    start, end = getattr(arguments, 'slice_start', None) or 0.0, getattr(arguments, 'slice_end', None)
    end = inf if end is None else end
    if end <= start:
        raise ParameterError(f'--start {start:g} and --end {end:g} leave nothing; accepted: an end after the start')
    return start, end


@dataclass(frozen=True)
class Inputs:
    """The topics to read; an empty name stands for the usual topic, where a bag has it."""

    joint_states: str = '/joint_states'
    # locates the base: of type nav_msgs/Odometry, or one of POSE_TYPES; empty is /odom or else /pose
    odometry: str = ''
    thrust: str = ''
    stored_momentum: str = ''
    imu: str = ''
    target_pose: str = ''
    named: Mapping[str, Input] = field(default_factory=dict)  # further sensors, read where a bag has their topics
    located: bool = True  # whether anything locates the base; else an IMU has to be there
    # start, end: s from a bag's first message, between which it is read
    start: float = 0.0
    end: float = inf

    @property
    def sliced(self) -> bool:
        """Whether only a part of a bag is read."""
        return (self.start, self.end) != (0.0, inf)

    @staticmethod
    def from_arguments(arguments: argparse.Namespace, config: EstimatorConfig) -> Inputs:
        """Return the topics that the arguments of an executable name.

        Raises ParameterError: Two topics locate the base.
        """
        if arguments.odom and arguments.pose:
            raise ParameterError(
                f'--odom {arguments.odom} and --pose {arguments.pose} are given; accepted: one of them'
            )
        from mbaid_ros.session.catalogue import inputs  # noqa: PLC0415 - `--help` needs the defaults alone

        base = arguments.odom or arguments.pose or (TF if config.pose.tf_child_frame else '')
        others = arguments.thrust, arguments.stored_momentum, arguments.imu, arguments.target_pose
        start, end = between(arguments)
        named = {name: each for name, each in inputs(config).items() if name != 'imu'}
        return Inputs(
            arguments.joint_states, base, *others, named=named, located=config.by_odometry, start=start, end=end
        )

    def resolved(self, bag: BagReader) -> Inputs:
        """Return the same with the topic of a bag that locates the base.

        Raises DataError: It is none of the usual ones, and others may be it.
        """
        if self.odometry or not self.located:
            return self
        holds_poses = POSE in bag.topics and bag.topics[POSE].type in POSE_TYPES
        if ODOMETRY not in bag.topics and not holds_poses:
            bag.require(self.joint_states, JOINT_STATE_TYPE)
            options = (('--odom', (ODOMETRY_TYPE,)), ('--pose', POSE_TYPES[:-1]))
            found = [f'{option} {name}' for option, types in options for name in bag.of_types(*types)]
            if found:
                raise DataError(f"bag '{bag.path}' has no topic '{ODOMETRY}' or '{POSE}'; give {' or '.join(found)}")
        return replace(self, odometry=POSE if holds_poses and ODOMETRY not in bag.topics else ODOMETRY)

    def topics(self, bag: BagReader) -> tuple[str, ...]:
        """Return the topics of a bag to read, joint states and the base's location first.

        Raises DataError: The bag lacks a topic, or has it with another type.
        """
        bag.require(self.joint_states, JOINT_STATE_TYPE)
        chosen = [self.joint_states]
        if self.located:
            chosen.append(self.resolved(bag).odometry)
            bag.require(chosen[-1], ODOMETRY_TYPE, *POSE_TYPES)
        elif not self.named:
            bag.require(self.imu or IMU, IMU_TYPE)
        for wanted, usual, kinds in (
            (self.thrust, THRUST, (THRUST_TYPE,)),
            (self.stored_momentum, STORED_MOMENTUM, (STORED_MOMENTUM_TYPE,)),
            (self.imu, IMU, (IMU_TYPE,)),
            (self.target_pose, TARGET_POSE, TARGET_POSE_TYPES),
            *(('', f'/{each.topic}', each.types) for each in self.named.values()),
        ):
            if wanted:
                bag.require(wanted, *kinds)
            if wanted or (usual in bag.topics and bag.topics[usual].type in kinds):
                chosen.append(wanted or usual)
        return tuple(chosen)

    def add_to(self, session: Session, messages: Batch) -> None:
        """Hand messages of the topics to a session, many at once where their order allows it."""
        thrust, stored = self.thrust or THRUST, self.stored_momentum or STORED_MOMENTUM
        target = self.target_pose or TARGET_POSE
        named = {'imu': self.imu or IMU, **{name: f'/{each.topic}' for name, each in self.named.items()}}
        add: dict[str, Callable[[Any], object]] = {
            self.joint_states: session.add_joint_state,
            self.odometry: session.add_odometry,
            stored: session.add_stored_momentum,
            target: session.add_target_pose,
            **{topic: partial(session.add_named, name=name) for name, topic in named.items()},
        }
        for part in messages.runs(thrust):
            if thrust in part.messages:
                for message in part.on_topic(thrust):
                    session.add_thrust(message)
            elif session.add_at_once(
                part.on_topic(self.joint_states),
                part.on_topic(self.odometry),
                {name: part.on_topic(topic) for name, topic in named.items()},
            ):
                for message in part.on_topic(stored):
                    session.add_stored_momentum(message)
                for message in part.on_topic(target):
                    session.add_target_pose(message)
            else:
                for topic, message, _ in part:
                    add[topic](message)
