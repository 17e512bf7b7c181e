"""Faults of bags, tables and robot descriptions as robots really publish them, put into the shipped ones."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from benchmarks.input_faults import JOINTS, RANDOM, Make, Source, changed, fixed, messages, pose_of, read_pose, write
from mbaid_ros.recordings.convert import main as convert

EPOCH = 1_700_000_000  # s
_TENSOR = re.compile(r'(i[xyz]{2})="([^"]*)"')


def with_robot(change: Callable[[str], str]) -> Make:
    """Return what makes another robot description."""

    def make(folder: Path, source: Source) -> tuple[Path, Path]:
        (folder / 'robot.urdf').write_text(change(source.urdf.read_text()))
        return source.folder, folder / 'robot.urdf'

    return make


def replaced(*pairs: str) -> Make:
    """Return what replaces texts of the robot description, once each."""

    def change(text: str) -> str:
        for old, new in zip(pairs[::2], pairs[1::2], strict=True):
            assert old in text, f'{old} is in the description'
            text = text.replace(old, new, 1)
        return text

    return with_robot(change)


def inertia(link: str, factor: float) -> Make:
    """Return what makes the inertia of a link so many times as large."""

    def change(text: str) -> str:
        def scaled(found: re.Match[str]) -> str:
            return f'{found[1]}="{factor * float(found[2]):g}"'

        begin = text.index('<inertia ', text.index(f'<link name="{link}">'))
        end = text.index('/>', begin)
        return text[:begin] + _TENSOR.sub(scaled, text[begin:end]) + text[end:]

    return with_robot(change)


def renamed(joint: str, name: str) -> Make:
    """Return what gives a joint another name, in the description and in the messages."""

    def make(folder: Path, source: Source) -> tuple[Path, Path]:
        urdf = source.urdf.read_text().replace(f'name="{joint}"', f'name="{name}"')
        (folder / 'robot.urdf').write_text(urdf)

        def rename(message: Any, _number: int, _time: float) -> None:
            message.name = [name if each == joint else each for each in message.name]

        return changed(rename)(folder, source)[0], folder / 'robot.urdf'

    return make


def rewritten(**how: Any) -> Make:
    """Return what writes the MCAP file anew, by arguments of the writer."""

    def make(folder: Path, source: Source) -> tuple[Path, Path]:
        (folder / 'bag.mcap').write_bytes(_copied(source, **how))
        return folder / 'bag.mcap', source.urdf

    return make


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


def compressed(*ends: float) -> Make:
    """Return what makes a folder of parts (until so many s) without metadata, all but the last one compressed."""

    def make(folder: Path, source: Source) -> tuple[Path, Path]:
        (folder / 'bag').mkdir()
        for number, (begin, end) in enumerate(zip((0.0, *ends), (*ends, np.inf), strict=True)):
            part, last = _copied(source, begin, end), number == len(ends) > 0
            name = folder / 'bag' / f'bag_{number}.mcap{"" if last else ".zstd"}'
            name.write_bytes(part if last else zstandard.compress(part))
        return folder / 'bag', source.urdf

    return make


def cut(folder: Path, source: Source) -> tuple[Path, Path]:
    """Return a file that a crash has cut off."""
    (folder / 'bag.mcap').write_bytes(_copied(source, chunk_size=65536)[:-100_000])
    return folder / 'bag.mcap', source.urdf


def ros1(folder: Path, source: Source) -> tuple[Path, Path]:
    """Return a file that begins as a bag of ROS 1."""
    (folder / 'run.bag').write_bytes(b'#ROSBAG V2.0\n' + bytes(4096))
    return folder / 'run.bag', source.urdf


def recorded_at(of: Callable[[int, int], int]) -> Make:
    """Return what records messages at other times (ns), a function of their number and time; stamps are right."""

    def make(folder: Path, source: Source) -> tuple[Path, Path]:
        given = []
        for number, (topic, message, time) in enumerate(messages(source)):
            message.header.stamp.sec += EPOCH
            given.append((topic, message, of(number, EPOCH * 10**9 + time)))
        return write(folder / 'bag', given), source.urdf

    return make


def table(separator: str = ',', first: str = '', end: str = '\n', *, degrees: bool = False) -> Make:
    """Return what makes a bag of a table, by `convert`."""

    def make(folder: Path, source: Source) -> tuple[Path, Path]:
        base, rows, names = np.zeros(7), [], []
        for topic, message, time in messages(source):
            if topic == JOINTS:
                names = list(message.name)
                joints = np.degrees(message.position) if degrees else message.position
                rows.append([1e-9 * time, *base, *joints])
            else:
                place, turn = read_pose(message)
                base = np.concatenate((place, turn.as_quat()))
                if rows:
                    rows[-1][1:8] = base
        header = ['time', *['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'], *names]
        lines = [separator.join(header), *(separator.join(f'{each:.12g}' for each in row) for row in rows[1:])]
        (folder / 'run.csv').write_text(first + end.join(lines) + end, encoding='utf-8', newline='')
        (folder / 'columns.yaml').write_text(_columns(names, separator))
        words = ['csv', str(folder / 'run.csv'), '--columns', str(folder / 'columns.yaml'), '--output']
        assert convert([*words, str(folder / 'bag')]) == 0, 'the table is read'
        return folder / 'bag', source.urdf

    return make


def _columns(names: Sequence[str], separator: str) -> str:
    joints = ''.join(f'  {name}: {{position: {name}}}\n' for name in names)
    base = 'base: {position: [x, y, z], orientation: [qx, qy, qz, qw]}'
    return f'separator: "{separator}"\ntime: time\n{base}\njoints:\n{joints}'


def parked(folder: Path, source: Source) -> tuple[Path, Path]:
    """Return a robot at rest, one joint at a half turn, and some poses without a quaternion."""

    def rest(message: Any, _number: int, _time: float) -> None:
        position = np.linspace(0.4, np.pi, len(message.name)) + 1e-4 * RANDOM.standard_normal(len(message.name))
        message.position = np.angle(np.exp(1j * position))
        message.velocity = 1e-3 * RANDOM.standard_normal(len(message.name))

    def drift(message: Any, number: int, time: float) -> None:
        fixed(1e-3)(message, number, time)
        if number % 100 == 60:
            pose_of(message, (0, 0, 0), (0, 0, 0, 0))

    return changed(rest, drift)(folder, source)


UNINDEXED = {'index_types': IndexType.CHUNK}
UNCHUNKED = {'use_chunking': False}
LZ4 = {'compression': CompressionType.LZ4}
