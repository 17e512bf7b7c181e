"""Faults of bags, tables and robot descriptions as robots really publish them, put into the shipped ones."""

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from benchmarks import input_faults as faults
from benchmarks.input_faults import JOINTS, RANDOM, Made, Source, messages
from mbaid_ros.recordings.convert import main as convert

EPOCH = 1_700_000_000  # s
_TENSOR = re.compile(r'(i[xyz]{2})="([^"]*)"')


def replaced(folder: Path, source: Source, *pairs: str) -> Made:
    """Return another robot description, with texts replaced once each."""
    text = source.urdf.read_text()
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        assert old in text, f'{old} is in the description'
        text = text.replace(old, new, 1)
    (folder / 'robot.urdf').write_text(text)
    return source.folder, folder / 'robot.urdf'


def inertia(folder: Path, source: Source, link: str, factor: float) -> Made:
    """Return a robot description in which the inertia of a link is so many times as large."""
    text = source.urdf.read_text()
    begin = text.index('<inertia ', text.index(f'<link name="{link}">'))
    old = text[begin : text.index('/>', begin)]
    return replaced(folder, source, old, _TENSOR.sub(lambda e: f'{e[1]}="{factor * float(e[2]):g}"', old))


def renamed(folder: Path, source: Source, joint: str, name: str) -> Made:
    """Return a bag and a robot description in which a joint has another name."""

    def rename(message: Any, _number: int, _time: float) -> None:
        message.name = [name if each == joint else each for each in message.name]

    bag, _ = faults.changed(folder, source, [JOINTS], rename)
    (folder / 'robot.urdf').write_text(source.urdf.read_text().replace(f'name="{joint}"', f'name="{name}"'))
    return bag, folder / 'robot.urdf'


def rewritten(folder: Path, source: Source, **how: Any) -> Made:
    """Return the MCAP file written anew, by arguments of the writer."""
    (folder / 'bag.mcap').write_bytes(_copied(source, **how))
    return folder / 'bag.mcap', source.urdf


def _copied(source: Source, begin: float = 0.0, end: float = np.inf, **how: Any) -> bytes:
    """Return an MCAP file with the messages of a span (s)."""
    (path,), out = source.folder.glob('*.mcap'), io.BytesIO()
    with path.open('rb') as file:
        writer = Writer(out, **how)
        writer.start('ros2', 'test')
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in channels and schema is not None:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, known)
            if begin <= 1e-9 * message.log_time < end:
                writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def compressed(folder: Path, source: Source, *ends: float) -> Made:
    """Return a folder of parts (until so many s) without metadata, all but the last one compressed."""
    (folder / 'bag').mkdir()
    for number, (begin, end) in enumerate(zip((0.0, *ends), (*ends, np.inf), strict=True)):
        part, last = _copied(source, begin, end), number == len(ends) > 0
        name = folder / 'bag' / f'bag_{number}.mcap{"" if last else ".zstd"}'
        name.write_bytes(part if last else zstandard.compress(part))
    return folder / 'bag', source.urdf


def cut(folder: Path, source: Source) -> Made:
    """Return a file that a crash has cut off."""
    (folder / 'bag.mcap').write_bytes(_copied(source, chunk_size=65536)[:-100_000])
    return folder / 'bag.mcap', source.urdf


def ros1(folder: Path, source: Source) -> Made:
    """Return a file that begins as a bag of ROS 1."""
    (folder / 'run.bag').write_bytes(b'#ROSBAG V2.0\n' + bytes(4096))
    return folder / 'run.bag', source.urdf


def recorded_at(folder: Path, source: Source, of: Callable[[int, int], int]) -> Made:
    """Return a bag recorded at other times (ns), a function of a message's number and time; stamps are right."""
    given = []
    for number, (topic, message, time) in enumerate(messages(source)):
        message.header.stamp.sec += EPOCH
        given.append((topic, message, of(number, EPOCH * 10**9 + time)))
    return faults.write(folder / 'bag', given), source.urdf


def table(
    folder: Path, source: Source, separator: str = ',', first: str = '', end: str = '\n', *, degrees: bool = False
) -> Made:
    """Return a bag that `convert` makes of a table."""
    base, rows, names = np.zeros(7), [], []
    for topic, message, time in messages(source):
        if topic == JOINTS:
            names = list(message.name)
            joints = np.degrees(message.position) if degrees else message.position
            rows.append([1e-9 * time, *base, *joints])
        else:
            place, turn = faults.read_pose(message)
            base = np.concatenate((place, turn.as_quat()))
            if rows:
                rows[-1][1:8] = base
    header = ['time', *['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'], *names]
    lines = [separator.join(header), *(separator.join(f'{each:.12g}' for each in row) for row in rows[1:])]
    (folder / 'run.csv').write_text(first + end.join(lines) + end, encoding='utf-8', newline='')
    columns = ''.join(f'  {name}: {{position: {name}}}\n' for name in names)
    axes = 'base: {position: [x, y, z], orientation: [qx, qy, qz, qw]}'
    (folder / 'columns.yaml').write_text(f'separator: "{separator}"\ntime: time\n{axes}\njoints:\n{columns}')
    words = ['csv', str(folder / 'run.csv'), '--columns', str(folder / 'columns.yaml'), '--output']
    assert convert([*words, str(folder / 'bag')]) == 0, 'the table is read'
    return folder / 'bag', source.urdf


def parked(folder: Path, source: Source) -> Made:
    """Return a robot at rest, one joint at a half turn, and some poses without a quaternion."""
    given = messages(source)
    faults.spoil(given, JOINTS, _rest)
    faults.spoil(given, faults.ODOM, _drift)
    return faults.write(folder / 'bag', given), source.urdf


def _rest(message: Any, _number: int, _time: float) -> None:
    position = np.linspace(0.4, np.pi, len(message.name)) + 1e-4 * RANDOM.standard_normal(len(message.name))
    message.position = np.angle(np.exp(1j * position))
    message.velocity = 1e-3 * RANDOM.standard_normal(len(message.name))


def _drift(message: Any, number: int, time: float) -> None:
    faults.fixed(message, number, time, 1e-3)
    if number % 100 == 60:
        faults.pose_of(message, (0, 0, 0), (0, 0, 0, 0))


UNINDEXED = {'index_types': IndexType.CHUNK}
UNCHUNKED = {'use_chunking': False}
LZ4 = {'compression': CompressionType.LZ4}
