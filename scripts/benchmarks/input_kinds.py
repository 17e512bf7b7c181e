"""Faults of bags and robot descriptions, and the table of all faults with the right outcomes."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer

from benchmarks import input_faults as faults
from benchmarks.input_faults import BAG, RANDOM, ROBOT, changed, messages, write

EPOCH = 1_700_000_000  # s
NONE = ' '.join(f'{name}="0"' for name in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'))


@dataclass(frozen=True)
class Kind:
    """A fault: makers of its bag and robot description, and the right outcome."""

    name: str
    make: Callable[[Path], tuple[Path, Path]]
    right: str  # part of the first cause or of a warning; empty is the true mass
    arguments: tuple[str, ...] = ()
    at_rest: bool = False


def in_a_namespace(text: str) -> str:
    """Return a robot description with a default namespace."""
    return text.replace('<robot ', '<robot xmlns="urdf" ', 1)


def without_inertia(text: str) -> str:
    """Return a robot description with a base that has no inertia."""
    return re.sub(r'ixx="248".*?/>', f'{NONE}/>', text, count=1)


def with_robot(change: Callable[[str], str]) -> Any:
    """Return a maker of another robot description."""

    def make(folder: Path) -> tuple[Path, Path]:
        (folder / 'robot.urdf').write_text(change(ROBOT.read_text()))
        return BAG, folder / 'robot.urdf'

    return make


def same_name(folder: Path) -> tuple[Path, Path]:
    """Return a robot, one joint of which is named as a link."""
    (folder / 'robot.urdf').write_text(ROBOT.read_text().replace('name="joint3"', 'name="link2"'))

    def rename(message: Any, _number: int, _time: float) -> None:
        message.name = ['link2' if name == 'joint3' else name for name in message.name]

    return changed(rename)(folder)[0], folder / 'robot.urdf'


def without_message_index(folder: Path) -> tuple[Path, Path]:
    """Return an MCAP file with an index of chunks alone."""
    (source,) = BAG.glob('*.mcap')
    with source.open('rb') as file, (folder / 'bag.mcap').open('wb') as out:
        writer = Writer(out, index_types=IndexType.CHUNK)
        writer.start('ros2', 'test')
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in channels and schema is not None:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, known)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    return folder / 'bag.mcap', ROBOT


def compressed(folder: Path) -> tuple[Path, Path]:
    """Return a folder with a compressed file and no metadata."""
    (source,) = BAG.glob('*.mcap')
    (folder / 'bag').mkdir()
    (folder / 'bag' / 'bag_0.mcap.zstd').write_bytes(zstandard.compress(source.read_bytes()))
    return folder / 'bag', ROBOT


def ros1(folder: Path) -> tuple[Path, Path]:
    """Return a file that begins as a bag of ROS 1."""
    (folder / 'run.bag').write_bytes(b'#ROSBAG V2.0\n' + bytes(4096))
    return folder / 'run.bag', ROBOT


def recorded_at_zero(folder: Path) -> tuple[Path, Path]:
    """Return messages of which the first 20 were recorded at time 0."""
    given = []
    for place, (topic, message, time) in enumerate(messages()):
        message.header.stamp.sec += EPOCH
        given.append((topic, message, 0 if place < 20 else EPOCH * 10**9 + time))
    return write(folder / 'bag', given), ROBOT


def parked(folder: Path) -> tuple[Path, Path]:
    """Return a robot at rest, one joint at a half turn, and some poses without a quaternion."""

    def rest(message: Any, _number: int, _time: float) -> None:
        position = np.array([0.4, 0.7, np.pi, 0.9, 0.5, -0.6, 0.2]) + 1e-4 * RANDOM.standard_normal(7)
        message.position[:], message.velocity[:] = np.angle(np.exp(1j * position)), 1e-3 * RANDOM.standard_normal(7)

    def drift(message: Any, number: int, time: float) -> None:
        faults.bolted(message, number, time)
        if number % 100 == 60:
            faults.pose_of(message, (0, 0, 0), (0, 0, 0, 0))

    made: tuple[Path, Path] = changed(rest, drift)(folder)
    return made


KINDS = (
    Kind('1 chunks without message index', without_message_index, ''),
    Kind('2 compressed file, no metadata', compressed, ''),
    Kind('3 a joint named as a link', same_name, ''),
    Kind('4 a joint parked at a half turn, at rest', parked, 'joint_position: 1.0e-04', at_rest=True),
    Kind('5 a wheel at 8 rad a reading', faults.with_part('wheel', 1e-9, 1e-6, lambda t: 400.0 * t, 400.0, 1), ''),
    Kind('6 joint states of zeros now and then', changed(faults.zeros), ''),
    Kind('7 a second source of joint states', faults.second_stream, 'joint states come from two sources'),
    Kind('8 default namespace in the URDF', with_robot(in_a_namespace), ''),
    Kind('9 a link without inertia', with_robot(without_inertia), 'no inertia'),
    Kind('10 joints new every 0.1 s', faults.held, ''),
    Kind('11 positions in other axes', changed(None, faults.mixed_axes), 'the odometry are (x, -z, y) in'),
    Kind('11 the frame turned by 90 degrees', changed(None, faults.turned), 'turned by 90 degrees about (0, 0, 1)'),
    Kind('13 all stamps set back by 0.4 s', changed(faults.set_back, faults.set_back), ''),
    Kind(
        '13 stamps of the joints set back',
        changed(faults.set_back),
        'joint states went back by 0.4 s',
    ),
    Kind('14 joints in parts after all at once', faults.in_parts, ''),
    Kind('15 three seconds of lost tracking', changed(None, faults.lost), ''),
    Kind('15 quaternions of zeros, at rest', parked, 'base_orientation: 5', at_rest=True),
    Kind('16 poses stamped in batches', changed(None, faults.batched), 'come in batches'),
    Kind('18 a finger at rest, read seldom', faults.with_part('finger', 1e-9, 1e-6, lambda _: 0.1, 0.0, 20), ''),
    Kind('19 velocities of zero', changed(faults.no_velocity), '', ('--method', 'difference')),
    Kind('20 encoder ticks', changed(faults.ticks), 'reads whole numbers'),
    Kind('22 a bag of ROS 1', ros1, 'ROS 1'),
    Kind('23 recorded at time zero', recorded_at_zero, ''),
    Kind('25 a joint that is NaN', changed(faults.nan_joint), 'position of joint4 is NaN'),
    Kind('26 a base that is bolted', changed(None, faults.bolted), 'the base does not move while the arm does'),
)
