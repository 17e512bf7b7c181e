"""The floor under a replay: read a bag, the only argument, and deserialise its messages with rosbags."""

import sys
from pathlib import Path

from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
with Reader(Path(sys.argv[1])) as bag:
    for connection, _, data in bag.messages():
        store.deserialize_cdr(data, connection.msgtype)
