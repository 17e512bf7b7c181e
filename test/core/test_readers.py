"""Messages to arrays: bytes, objects and any mixture lead to the same bits; wheels beside the joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import fields
from itertools import groupby
from typing import Any

import numpy as np
import pytest

from checked import some
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.stream import JointReader
from mbaid_ros.core.samples import (
    BAD_QUATERNION,
    JOINT_STATE_TYPE,
    LENGTH_MISMATCH,
    LOST_TRACKING,
    NOT_FINITE,
    NOT_REAL,
    ODOMETRY_TYPE,
    POSE_COVARIANCE,
    TWIST_COVARIANCE,
    WRONG_CHILD_FRAME,
    Packer,
    Packets,
)
from mbaid_ros.packets import packer
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from recorded import again, as_bytes, joint_state, odometry
from simulated import CONFIG

COUNT = 300
MARKER: dict[str, object] = {'marker.position': (0.1, 0.2, 0.3)}
TOGETHER = 'bytes, those of one layout that follow one another together'
Mixture = Callable[[list[Any], list[Any]], list[Any]]

MIXTURES: dict[str, Mixture] = {
    'bytes': lambda packets, _objects: packets,
    'bytes and objects by turns': lambda packets, objects: [
        (packet, message)[index % 2] for index, (packet, message) in enumerate(zip(packets, objects, strict=True))
    ],
    TOGETHER: lambda packets, _objects: packets,
    'bytes, then objects': lambda packets, objects: packets[: COUNT // 3] + objects[COUNT // 3 :],
}


def session(parameters: dict[str, object]) -> Session:
    return Session(build(EstimatorConfig, parameters), (CONFIG / 'table1.urdf').read_text(encoding='utf-8'))


def joint_states(seed: int, *, whole: bool) -> list[bytes]:
    """Return JointStates with and without defects: other orders, foreign joints, halves, no velocities, NaN."""
    random = np.random.default_rng(seed)
    names = ['joint1', 'joint2', 'joint3', 'joint4', 'finger', 'joint1']
    made = []
    for index in range(COUNT):
        kind = random.integers(8)
        chosen = list(range(4)) if kind < 3 else list(random.permutation(5 if whole else 4))
        chosen = {4: chosen[:3], 5: [*chosen, 5]}.get(int(kind), chosen)
        position, velocity = random.standard_normal((2, len(chosen)))
        if kind == 6:
            velocity = velocity[: random.integers(0, 2) * len(chosen)]
        elif kind == 7:
            defect = random.integers(4)
            position[defect % len(position)] = [np.nan, np.inf, 1e7, 1.0][defect]
            velocity[0] = [np.nan, 1e9, 1.0, -np.inf][defect]
            position = position if defect < 3 else position[:-1]
        made.append(as_bytes(joint_state([names[k] for k in chosen], position, velocity, stamp=index + 1)))
    return made


def odometries(seed: int) -> list[bytes]:
    """Return Odometry with and without defects: other frames, NaN, no unit quaternion, covariances that are not set."""
    random = np.random.default_rng(seed)
    made = []
    for index in range(COUNT):
        numbers, covariances = random.standard_normal(13), np.tile(1e-4 * np.eye(6), (2, 1, 1))
        numbers[3:7] /= np.linalg.norm(numbers[3:7])
        frames = {'frame': 'odom', 'child': 'base_link'}
        kind = random.integers(9)
        if kind == 3:
            frames['child'] = ['link4', 'marker', '/base_link', ''][random.integers(4)]
        elif kind == 4:
            frames['frame'] = f'map{random.integers(3)}'
        elif kind == 5:
            numbers[random.integers(13)] = [np.nan, np.inf, 1e13][random.integers(3)]
        elif kind == 6:
            numbers[3:7] *= [0.0, 2.0, 1.05][random.integers(3)]
        elif kind == 7:
            covariances[random.integers(2)] *= [0.0, -1.0, np.nan][random.integers(3)]
        elif kind == 8:
            covariances *= 1.0 + random.random()
        made.append(as_bytes(odometry(numbers, covariances, stamp=index + 1, **frames)))
    return made


def mixed(data: list[bytes], type_name: str, mixture: str) -> tuple[list[Any], list[Any]]:
    """Return messages as objects, and as a mixture."""
    make: Packer[Any] = some(packer(type_name))
    packets = [make(each) for each in data]
    assert None not in packets
    objects = [again(each, type_name) for each in data]
    return objects, MIXTURES[mixture](packets, objects)


def arranged(messages: list[Any], mixture: str) -> list[Any]:
    """Return messages as the mixture says: packets of one layout that follow one another may be together."""
    if mixture != TOGETHER:
        return messages
    runs = [(layout, list(run)) for layout, run in groupby(messages, key=lambda packet: packet.layout)]
    assert any(len(run) > 1 for _, run in runs) or len(messages) == 1
    return [
        Packets(b''.join(each.data for each in run), layout, np.concatenate([each.stamps for each in run]))
        for layout, run in runs
    ]


def bits(stream: Any) -> list[tuple[tuple[int, ...], bytes]]:
    return [(getattr(stream, f.name).shape, getattr(stream, f.name).tobytes()) for f in fields(stream)]


@pytest.mark.parametrize('mixture', MIXTURES)
@pytest.mark.parametrize('whole', [True, False])
@pytest.mark.parametrize('seed', range(3))
def test_joint_states(seed: int, mixture: str, *, whole: bool) -> None:
    objects, given = mixed(joint_states(seed, whole=whole), JOINT_STATE_TYPE, mixture)
    expected, found = session({}).intake.joint_reader, session({}).intake.joint_reader
    seen: Counter[str] = Counter()
    for part in (slice(0, 1), slice(1, 90), slice(90, None)):
        (streams, dropped), (others, others_dropped) = (
            expected.read(objects[part]),
            found.read(arranged(given[part], mixture)),
        )
        assert list(streams) == list(others)
        assert [bits(stream) for stream in streams.values()] == [bits(stream) for stream in others.values()]
        assert dropped == others_dropped
        assert (expected.unknown, expected.missing) == (found.unknown, found.missing)
        seen += dropped
    assert {LENGTH_MISMATCH, NOT_FINITE, NOT_REAL} <= set(seen)


@pytest.mark.parametrize('mixture', MIXTURES)
@pytest.mark.parametrize('parameters', [{}, MARKER, {'twist_frame': 'inertial'}], ids=['base', 'marker', 'inertial'])
@pytest.mark.parametrize('seed', range(2))
def test_odometry(seed: int, parameters: dict[str, object], mixture: str) -> None:
    objects, given = mixed(odometries(seed), ODOMETRY_TYPE, mixture)
    expected, found = session(parameters).intake.odometry_reader, session(parameters).intake.odometry_reader
    seen: Counter[str] = Counter()
    for part in (slice(0, 1), slice(1, 90), slice(90, None)):
        (stream, dropped), (other, other_dropped) = (
            expected.read(objects[part]),
            found.read(arranged(given[part], mixture)),
        )
        assert bits(some(stream)) == bits(some(other))
        assert dropped == other_dropped
        for name in ('frame', 'other_child_frame', 'replaced'):
            assert getattr(expected, name) == getattr(found, name)
        seen += dropped
    assert {BAD_QUATERNION, NOT_FINITE, NOT_REAL, WRONG_CHILD_FRAME} <= set(seen)
    assert min(found.replaced[cause] for cause in (POSE_COVARIANCE, TWIST_COVARIANCE)) > 0


GOOD = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8, *[0.1] * 6])


def changed(**values: float) -> Array:
    """Return the numbers of a pose of which some are others: position 0 to 2, orientation 3 to 6."""
    numbers = GOOD.copy()
    for place, value in values.items():
        numbers[int(place[1:])] = value
    return numbers


@pytest.mark.parametrize(
    ('numbers', 'reason'),
    [
        (GOOD, None),
        (changed(p3=0.1), None),  # a length that is off by less than a tenth
        (changed(p0=np.nan), NOT_FINITE),
        (changed(p6=np.inf), NOT_FINITE),
        (changed(p9=np.nan), None),  # a twist may be missing
        (changed(p6=2.0), BAD_QUATERNION),
        (changed(p6=2.0, p1=1e30), BAD_QUATERNION),  # of several reasons the first
        (changed(p1=1e30), NOT_REAL),
        (changed(p5=0.0, p6=0.0), LOST_TRACKING),
        (np.append(np.zeros(6), [1.0, *[0.0] * 6]), LOST_TRACKING),  # the origin, as it never was before
        (np.append(np.zeros(5), [0.6, 0.8, *[0.0] * 6]), None),  # turned there
    ],
)
def test_why_a_pose_is_not_used(numbers: Array, reason: str | None) -> None:
    """Each is counted once, for one reason; the pose before it is used."""
    reader, covariances = session({}).intake.odometry_reader, np.tile(1e-6 * np.eye(6), (2, 1, 1))
    stream, dropped = reader.read([odometry(GOOD, covariances, stamp=1), odometry(numbers, covariances, stamp=2)])
    assert +dropped == ({} if reason is None else {reason: 1})
    assert len(some(stream).stamp) == (2 if reason is None else 1)


def test_the_numbers_are_those_of_the_messages() -> None:
    random = np.random.default_rng(5)
    numbers = random.standard_normal((4, 13))
    numbers[:, 3:7] = [0.0, 0.0, 0.0, 1.0]
    position, velocity = random.standard_normal((2, 4, 4))
    make_joints: Packer[Any] = some(packer(JOINT_STATE_TYPE))
    make_odometry: Packer[Any] = some(packer(ODOMETRY_TYPE))
    names = ['joint3', 'joint1', 'joint4', 'joint2']
    run = session({})
    joints = [as_bytes(joint_state(names, *row, stamp=9)) for row in zip(position, velocity, strict=True)]
    streams, _ = run.intake.joint_reader.read([make_joints.many(joints)])
    poses = [as_bytes(odometry(row, np.tile(np.eye(6), (2, 1, 1)), stamp=9)) for row in numbers]
    base, _ = run.intake.odometry_reader.read([make_odometry.many(poses)])
    order = [1, 3, 0, 2]
    assert np.array_equal(streams[0, 1, 2, 3].position, position[:, order])
    assert np.array_equal(streams[0, 1, 2, 3].velocity, velocity[:, order])
    base = some(base)
    assert np.array_equal(base.position, numbers[:, :3])
    assert np.array_equal(base.linear_velocity, numbers[:, 7:10])
    assert np.array_equal(base.angular_velocity, numbers[:, 10:])
    assert list(base.stamp) == [9] * 4


# -- Wheels beside the joints in JointState: their speeds are read, their positions are not.

NAMES = ('wheel', 'elbow', 'finger', 'shoulder')


def test_their_speeds_come_after_the_joints() -> None:
    reader = JointReader(('shoulder', 'elbow'), ('wheel',))
    message = joint_state(NAMES, [np.nan, 0.2, 9.0, 0.4], [300.0, 2.0, 9.0, 4.0], stamp=5)
    streams, dropped = reader.read([message])
    assert not dropped
    (joints, stream), *others = streams.items()
    assert joints == reader.all == (0, 1, 2)
    assert not others
    assert stream.position.tolist() == [[0.4, 0.2, 0.0]]
    assert stream.velocity.tolist() == [[4.0, 2.0, 300.0]]


@pytest.mark.parametrize('velocity', [[np.nan, 2.0, 9.0, 4.0], []])
def test_a_message_without_their_speed_is_not_used(velocity: list[float]) -> None:
    reader = JointReader(('shoulder', 'elbow'), ('wheel',))
    streams, dropped = reader.read([joint_state(NAMES, [1e9, 0.2, 9.0, 0.4], velocity, stamp=5)])
    assert not streams
    assert dropped == {NOT_FINITE: 1}


def test_wheels_may_have_messages_of_their_own() -> None:
    reader = JointReader(('shoulder', 'elbow'), ('wheel',))
    messages = [
        joint_state(('shoulder', 'elbow'), [0.1, 0.2], [1.0, 2.0], stamp=5),
        joint_state(('wheel',), [0.0], [7.0], stamp=6),
    ]
    streams, dropped = reader.read(messages)
    assert not dropped
    assert set(streams) == {(0, 1), (2,)}
    assert streams[2,].velocity.tolist() == [[7.0]]
