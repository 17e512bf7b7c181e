"""Damaged MCAP files: in their bytes, in their records, in the definitions of their types, in what messages mean."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from backports import zstd
from mcap.writer import CompressionType, Writer

from fuzzing.damage import Damage, cut, flipped, of_bytes, one, overwritten
from fuzzing.meanings import TYPES, meaning
from mbaid_ros.bags.types import definition, serialize
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.simulated_run import SimulatedRun

CONFIG = Path(__file__).resolve().parents[2] / 'config'
_MAGIC = b'\x89MCAP0\r\n'
_CHUNK = 6  # opcode
_KINDS = 16  # opcodes, the next one is none
Record = tuple[int, bytes]
Message = tuple[str, bytes, int]

LIES: tuple[Callable[[str], str], ...] = (
    lambda text: text.replace('float64[] position', 'float64[1000000000] position'),
    lambda text: text.replace('float64[] position', 'string position'),
    lambda text: text.replace('float64[36] covariance', 'float64[3600000] covariance'),
    lambda text: text.replace('float64[] velocity', ''),
    lambda text: text.replace('string[] name', 'string name'),
    lambda text: text.replace('std_msgs/Header header', 'uint8 header'),
    lambda text: text.replace('float64 x', 'x float64'),
    lambda _text: '',
    lambda text: text * 2,
    lambda text: text.replace('geometry_msgs/Point position', 'geometry_msgs/Pose position'),
)


@cache
def recorded() -> tuple[Message, ...]:
    """Return topic, CDR bytes and time, ns, of the messages of eight seconds of the paper's case."""
    config = build(SimulatorConfig, load_parameter_file(CONFIG / 'table1_simulator.yaml', 'simulator'))
    config = replace(config, joint_rate=20.0, odometry_rate=20.0)
    run = SimulatedRun(config, (CONFIG / 'table1.urdf').read_text(encoding='utf-8'), BAG_TYPES)
    return tuple(
        (timed.topic, serialize(timed.message, TYPES[timed.topic]), run.stamp(timed.time)) for timed in run.read(8.0)
    )


def written(
    messages: Sequence[Message], compression: CompressionType = CompressionType.NONE, lie: Callable[[str], str] = str
) -> bytes:
    """Return a bag of messages; `lie` changes the text of its schemas."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4_000, compression=compression)
    writer.start(profile='ros2')
    channels = {}
    for topic, kind in TYPES.items():
        schema = writer.register_schema(kind, 'ros2msg', lie(definition(kind)[0]).encode())
        channels[topic] = writer.register_channel(f'/{topic}', 'cdr', schema)
    for count, (topic, data, stamp) in enumerate(messages):
        writer.add_message(channels[topic], stamp, data, stamp, count)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


@cache
def whole(compression: CompressionType) -> bytes:
    """Return a bag that nothing is wrong with."""
    return written(recorded(), compression)


@cache
def lying(which: int) -> bytes:
    """Return a bag whose schemas say something else than its messages hold."""
    return written(recorded(), lie=LIES[which])


def any_compression(generator: np.random.Generator) -> CompressionType:
    """Return how a bag is compressed, if at all."""
    return one((CompressionType.NONE, CompressionType.ZSTD), generator)


def in_bytes(_data: bytes, generator: np.random.Generator) -> bytes:
    """Return a bag with any bytes damaged."""
    return of_bytes(whole(any_compression(generator)), generator)


def in_schemas(_data: bytes, generator: np.random.Generator) -> bytes:
    """Return a bag whose schemas lie, are themselves damaged, or that is damaged besides."""
    if generator.random() < 0.5:
        return of_bytes(lying(int(generator.integers(0, len(LIES)))), generator)
    return written(recorded(), lie=lambda text: of_bytes(text.encode(), generator).decode(errors='replace'))


def in_meaning(_data: bytes, generator: np.random.Generator) -> bytes:
    """Return a bag some of whose messages mean something else, are damaged, or come at other times."""
    share = one((0.01, 0.1, 1.0), generator)
    messages = list(recorded())
    for place, (topic, data, time) in enumerate(messages):
        if generator.random() < share:
            way = generator.random()
            content = meaning(topic, data, generator) if way < 0.6 else data
            content = of_bytes(data, generator) if 0.6 <= way < 0.9 else content
            later = one((0, 1, 2**62, time + 10**9, max(0, time - 10**9)), generator) if way >= 0.9 else time
            messages[place] = topic, content, later
        if generator.random() < 0.01:
            return written(messages[: place + 1], any_compression(generator))
    return written(messages, any_compression(generator))


def in_records(_data: bytes, generator: np.random.Generator) -> bytes:
    """Return a bag whose records are damaged, those in its chunks among them, with lengths that fit all the same."""
    data = whole(any_compression(generator))
    same_size = generator.random() < 0.5  # then what the index says of places is still right
    found = _records(data[len(_MAGIC) : -len(_MAGIC)])
    return _MAGIC + _joined(_changed(found, generator, same_size=same_size)) + _MAGIC


def _records(data: bytes) -> list[Record]:
    """Return opcode and content of each record."""
    found, place = [], 0
    while place + 9 <= len(data):
        (length,) = struct.unpack_from('<Q', data, place + 1)
        found.append((data[place], data[place + 9 : place + 9 + length]))
        place += 9 + length
    return found


def _joined(records: Sequence[Record]) -> bytes:
    return b''.join(bytes([kind]) + struct.pack('<Q', len(content)) + content for kind, content in records)


def _changed(records: list[Record], generator: np.random.Generator, *, same_size: bool) -> list[Record]:
    """Return the records with one to three of them damaged."""
    records = list(records)
    for _ in range(int(generator.integers(1, 4))):
        kinds = sorted({kind for kind, _ in records})
        wanted = one(kinds, generator) if kinds else 0  # rare kinds as often as messages
        places = [place for place, (kind, _) in enumerate(records) if kind == wanted]
        if not places:
            continue
        place = one(places, generator)
        kind, content = records[place]
        way = generator.random()
        if kind == _CHUNK and way < 0.6:
            records[place] = kind, _chunk(content, generator, same_size=same_size)
        elif same_size or way < 0.75:
            changes: tuple[Damage, ...] = (flipped, overwritten) if same_size else (flipped, overwritten, cut)
            records[place] = kind, one(changes, generator)(content, generator)
            records[place] = kind, records[place][1][: len(content)] if same_size else records[place][1]
        elif way < 0.8:
            records[place] = int(generator.integers(0, _KINDS)), content
        elif way < 0.9:
            records[place : place + 1] = [records[place]] * one((0, 2, 100), generator)
        else:
            records.insert(int(generator.integers(0, len(records) + 1)), records.pop(place))
    return records


def _chunk(content: bytes, generator: np.random.Generator, *, same_size: bool) -> bytes:
    """Return the content of a chunk with damaged records in it, and no checksum."""
    begin, end, _size, _crc, length = struct.unpack_from('<QQQII', content)
    compression = content[32 : 32 + length]
    packed = content[40 + length :]
    inside = zstd.decompress(packed) if compression == b'zstd' else packed
    inside = _joined(_changed(_records(inside), generator, same_size=same_size))
    packed = zstd.compress(inside) if compression == b'zstd' else inside
    size = one((len(inside), len(inside), len(inside), 0, 2**40), generator)
    head = struct.pack('<QQQII', begin, end, size, 0, length)
    return head + compression + struct.pack('<Q', len(packed)) + packed
