"""Poses in the place of Odometry, one source in a run, and frames whose names have a prefix."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from rclpy.serialization import serialize_message
from tf2_msgs.msg import TFMessage

from mbaid_ros.bags import BAG_TYPES, BagWriter
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.odometry.stream import OTHER_SOURCE
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import WRONG_CHILD_FRAME
from mbaid_ros.errors import DataError
from mbaid_ros.estimate_messages import Frames, estimate_message
from mbaid_ros.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.one_bag import replay_bag
from mbaid_ros.session.explanation import explain, intake_warnings
from mbaid_ros.session.session import Session
from streams import run, urdf

SECONDS = 2.1
Make = Callable[[Any], Any]


def bare(message: Any) -> Any:
    """Return an Odometry with no more than a pose has."""
    message = deepcopy(message)
    message.pose.covariance, message.twist.covariance = np.zeros(36), np.zeros(36)
    for part in (message.twist.twist.linear, message.twist.twist.angular):
        part.x = part.y = part.z = np.nan
    return message


def pose(message: Any) -> PoseStamped:
    return PoseStamped(header=message.header, pose=message.pose.pose)


def with_covariance(message: Any) -> PoseWithCovarianceStamped:
    return PoseWithCovarianceStamped(header=message.header, pose=bare(message).pose)


def transform(message: Any, child: str = 'base_link') -> TransformStamped:
    made = TransformStamped(header=message.header, child_frame_id=child)
    place, made.transform.rotation = message.pose.pose.position, message.pose.pose.orientation
    made.transform.translation.x, made.transform.translation.y = place.x, place.y
    made.transform.translation.z = place.z
    return made


def tf(message: Any) -> TFMessage:
    other = transform(message, 'link1')
    return TFMessage(transforms=[other, transform(message, 'mocap/robot')])


def taken(make: Make | None, parameters: Mapping[str, object], at_once: int = 10_000) -> tuple[Session, list[Estimate]]:
    """Return a session that has taken some seconds of a robot whose base is located in another way."""
    session = Session(build(EstimatorConfig, {'method': 'difference', **parameters}), urdf('table1'))
    found: list[Estimate] = []
    for place, timed in enumerate(run('table1', SECONDS)):
        if timed.topic == 'odom':
            session.add_odometry(bare(timed.message) if make is None else make(timed.message))
        else:
            session.add_joint_state(timed.message)
        if place % at_once == at_once - 1:
            found += session.process()
    return session, [*found, *session.process()]


@pytest.fixture(scope='module')
def expected() -> list[Estimate]:
    return taken(None, {})[1]


def same(found: Sequence[Estimate], expected: Sequence[Estimate]) -> None:
    assert len(found) == len(expected) >= 3
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.parameters, other.parameters)
        np.testing.assert_array_equal(one.covariance, other.covariance)


@pytest.mark.parametrize(
    ('make', 'parameters'),
    [
        (pose, {}),
        (with_covariance, {}),
        (transform, {}),
        (lambda message: transform(message, 'vicon/robot'), {'marker.position': [0.0, 0.0, 0.0]}),
        (tf, {'pose.tf_child_frame': '/mocap/robot', 'marker.position': [0.0, 0.0, 0.0]}),
    ],
)
def test_a_pose_says_as_much_as_odometry_without_a_twist(
    make: Make, parameters: dict[str, object], expected: list[Estimate]
) -> None:
    session, found = taken(make, parameters, at_once=73)
    same(found, expected)
    assert not session.dropped
    assert found[-1].warnings[-1] == expected[-1].warnings[-1]


def test_a_pose_of_the_marker_is_not_that_of_the_base() -> None:
    away = {'marker.position': [0.3, 0.0, 0.0]}
    _, moved = taken(pose, away)
    _, odometry = taken(lambda message: bare(_of(message, 'marker')), away)
    same(moved, odometry)


def _of(message: Any, child: str) -> Any:
    message = deepcopy(message)
    message.child_frame_id = child
    return message


def test_another_source_than_the_first_is_not_used_and_reported() -> None:
    session, _ = taken(None, {})
    before = session.received['odom']
    session.add_odometry(pose(_last_odometry()))
    session.process()
    assert session.received['odom'] == before
    assert session.dropped[OTHER_SOURCE] == 1
    assert explain(session, [OTHER_SOURCE]) == [f'{OTHER_SOURCE}: Odometry was first']


def _last_odometry() -> Any:
    return [timed.message for timed in run('table1', SECONDS) if timed.topic == 'odom'][-1]


def test_a_frame_that_is_not_on_the_base_is_refused() -> None:
    session, found = taken(tf, {'pose.tf_child_frame': 'mocap/robot'})
    assert not found
    assert explain(session, [WRONG_CHILD_FRAME])[0].endswith('with marker.position, any that is no link of the robot')


def turned_round(message: Any) -> TFMessage:
    made = transform(message, 'world')
    made.header.frame_id = 'base_link'
    return TFMessage(transforms=[made])


@pytest.mark.parametrize(
    ('make', 'child', 'said'),
    [
        (
            tf,
            'base_link',
            "no transform to 'base_link' (pose.tf_child_frame) comes, only from '{0}' to 'link1'",
        ),
        (
            turned_round,
            'base_link',
            "no transform to 'base_link' (pose.tf_child_frame) comes: it is the pose of 'world'",
        ),
        (
            turned_round,
            'world',
            "'world' in 'base_link', parent and child turned round: publish that of 'base_link' in",
        ),
    ],
)
def test_transforms_of_other_frames_are_named(make: Make, child: str, said: str) -> None:
    session, found = taken(make, {'pose.tf_child_frame': child})
    assert not found
    assert said.format(_last_odometry().header.frame_id) in ' '.join(intake_warnings(session))


@pytest.mark.parametrize(
    ('topic', 'make', 'parameters', 'inputs'),
    [
        ('/pose', pose, {}, Inputs()),
        ('/vrpn/base', with_covariance, {}, Inputs(odometry='/vrpn/base')),
        ('/tf', tf, {'pose.tf_child_frame': 'mocap/robot', 'marker.position': [0.0, 0.0, 0.0]}, Inputs(odometry='/tf')),
    ],
)
def test_a_bag_of_poses_gives_the_same(
    tmp_path: Path, expected: list[Estimate], topic: str, make: Make, parameters: dict[str, object], inputs: Inputs
) -> None:
    kind = type(make(_last_odometry()))
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        bag.add_topic(topic, f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}')
        for timed in run('table1', SECONDS):
            base = timed.topic == 'odom'
            message = make(timed.message) if base else timed.message
            stamp = timed.message.header.stamp
            time = stamp.sec * 1_000_000_000 + stamp.nanosec
            bag.write_raw(topic if base else '/joint_states', serialize_message(message), time)
    config = build(EstimatorConfig, {'method': 'difference', **parameters})
    found = replay_bag(str(tmp_path / 'bag'), config, urdf('table1'), inputs)
    if topic == '/vrpn/base':
        with pytest.raises(DataError, match=r"has no topic '/odom' or '/pose'; give --pose /vrpn/base$"):
            replay_bag(str(tmp_path / 'bag'), config, urdf('table1'), Inputs())
    assert found.topics[1].topic == topic
    np.testing.assert_array_equal(found.final.parameters, expected[-1].parameters)
    np.testing.assert_array_equal(found.final.covariance, expected[-1].covariance)


def test_a_base_located_in_several_frames_is_reported() -> None:
    def make(message: Any) -> Any:
        message = deepcopy(message)
        message.header.frame_id = next(names)
        return message

    names: Iterator[str] = chain(['odom', '/odom'], repeat('map'))
    session, found = taken(make, {})
    assert len(found) >= 3
    (reported,) = intake_warnings(session)
    assert reported.startswith("the base is located in the frames 'odom', 'map', which count as one")
    names = repeat('map')
    assert not intake_warnings(taken(make, {})[0])


# -- frames whose names have a prefix

PREFIX = 'servicer/'


def test_a_prefix_changes_no_estimate_and_a_frame_without_it_is_refused() -> None:
    _, plain = taken(lambda message: message, {})
    session, found = taken(lambda message: _of(message, PREFIX + message.child_frame_id), {'frame_prefix': PREFIX})
    same(found, plain)
    np.testing.assert_array_equal(found[-1].momentum, plain[-1].momentum)
    assert not session.dropped[WRONG_CHILD_FRAME]
    session, made = taken(lambda message: message, {'frame_prefix': PREFIX})
    assert not made
    assert "accepted: 'servicer/base_link'" in explain(session, [WRONG_CHILD_FRAME])[0]
    message = estimate_message(Estimate('difference', 'waiting'), BAG_TYPES, Frames('link7', 'odom', PREFIX))
    assert (message.header.frame_id, message.momentum_frame) == ('servicer/link7', 'odom')
