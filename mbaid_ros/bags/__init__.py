"""Recorded bags: the only place, beside the replay, that knows their formats."""

from mbaid_ros.bags.chunks import Recorded, Timed
from mbaid_ros.bags.reader import BagReader
from mbaid_ros.bags.types import deserialize, message_class, message_types, serialize
from mbaid_ros.bags.writer import BagWriter

__all__ = ['BagReader', 'BagWriter', 'Recorded', 'Timed', 'deserialize', 'message_class', 'message_types', 'serialize']
