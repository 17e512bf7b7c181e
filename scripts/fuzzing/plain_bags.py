"""Bags with nothing wrong, of the first messages of a shipped one, which the fuzzer and the tests damage."""

import io
import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import cache
from itertools import islice
from pathlib import Path

from mcap.writer import CompressionType, Writer

from mbaid_ros.bags import BagReader
from mbaid_ros.bags.types import definition

CONFIG = Path(__file__).resolve().parents[2] / 'config'
BAG = CONFIG.parent / 'bags' / 'table1_live'
TYPES = {'/joint_states': 'sensor_msgs/msg/JointState', '/odom': 'nav_msgs/msg/Odometry'}

# As the storage plugin of rosbag2 makes it.
SCHEMA = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL,
  offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema VALUES (4, 'jazzy');
"""


@cache
def recorded(count: int) -> tuple[tuple[str, bytes, int], ...]:
    """Return topic, CDR bytes and time, ns, of the first messages."""
    with BagReader(BAG) as bag:
        return tuple(islice(bag.raw(TYPES), count))


def mcap(count: int, compression: CompressionType = CompressionType.NONE, lie: Callable[[str], str] = str) -> bytes:
    """Return an MCAP file of so many messages; `lie` changes the text of its schemas."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4_000, compression=compression)
    writer.start(profile='ros2')
    channels = {}
    for topic, kind in TYPES.items():
        schema = writer.register_schema(kind, 'ros2msg', lie(definition(kind)[0]).encode())
        channels[topic] = writer.register_channel(topic, 'cdr', schema)
    for number, (topic, data, time) in enumerate(recorded(count)):
        writer.add_message(channels[topic], time, data, time, number)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def database(path: Path, count: int, change: str = '', pack: Callable[[bytes], bytes] = bytes) -> Path:
    """Write a bag of sqlite3 with so many messages, whose columns take anything, and change it by SQL."""
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(SCHEMA.replace(' NOT NULL', ''))
        numbers = {topic: number for number, topic in enumerate(TYPES, start=1)}
        for topic, kind in TYPES.items():
            row = (numbers[topic], topic, kind, 'cdr', '', '')
            connection.execute('INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)', row)
            meaning = (numbers[topic], kind, 'ros2msg', definition(kind)[0], '')
            connection.execute('INSERT INTO message_definitions VALUES (?, ?, ?, ?, ?)', meaning)
        rows = [(None, numbers[topic], time, pack(data)) for topic, data, time in recorded(count)]
        connection.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', rows)
        connection.executescript(change)
        connection.commit()
    return path
