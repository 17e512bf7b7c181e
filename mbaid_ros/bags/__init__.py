"""Recorded bags: the only place, beside the replay, that knows their formats."""

from mbaid_ros.bags.chunks import Batch, Timed
from mbaid_ros.bags.reader import BagReader
from mbaid_ros.bags.types import BAG_TYPES, deserialize, message_class, message_types, serialize
from mbaid_ros.bags.writer import BagWriter

__all__ = [
    'BAG_TYPES',
    'BagReader',
    'BagWriter',
    'Batch',
    'Timed',
    'deserialize',
    'message_class',
    'message_types',
    'serialize',
]
