"""Damaged MCAP files: in their bytes, or in the definitions of their types."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from fuzzing.damage import of_bytes, one
from mbaid_ros.bags.types import definition, serialize
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.replay.run import BAG_TYPES
from mbaid_ros.simulated_run import SimulatedRun

CONFIG = Path(__file__).resolve().parents[2] / 'config'
TYPES = {'joint_states': 'sensor_msgs/msg/JointState', 'odom': 'nav_msgs/msg/Odometry'}
Message = tuple[str, bytes, int]
_CONTRADICTIONS = (
    ('float64[] position', 'float64[1000000000] position'),
    ('float64[] position', 'string position'),
    ('float64[36] covariance', 'float64[3600000] covariance'),
    ('float64[] velocity', ''),
    ('string[] name', 'string name'),
    ('std_msgs/Header header', 'uint8 header'),
    ('float64 x', 'x float64'),
    ('geometry_msgs/Point position', 'geometry_msgs/Pose position'),
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


def any_compression(generator: np.random.Generator) -> CompressionType:
    """Return how a bag is compressed, if at all."""
    return one((CompressionType.NONE, CompressionType.ZSTD), generator)


def in_bytes(_data: bytes, generator: np.random.Generator) -> bytes:
    """Return a bag with any bytes damaged."""
    return of_bytes(whole(any_compression(generator)), generator)


def in_schemas(_data: bytes, generator: np.random.Generator) -> bytes:
    """Return a bag whose schemas contradict its messages and whose bytes are damaged, or with damaged schemas."""
    if generator.random() < 0.5:
        old, new = one(_CONTRADICTIONS, generator)
        return of_bytes(written(recorded(), lie=lambda text: text.replace(old, new)), generator)
    return written(recorded(), lie=lambda text: of_bytes(text.encode(), generator).decode(errors='replace'))
