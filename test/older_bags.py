"""A bag of estimates from before their messages had a budget."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mbaid_ros.bags.types import ADDED, ESTIMATE_TYPE, definition
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.outgoing import Frames, MessageTypes, estimate_message
from mbaid_ros.replay.run import BAG_TYPES

TOPIC = '/estimator/estimate'


def older_estimates(path: Path, estimate: Estimate) -> Path:
    """Write one estimate as a bare .mcap whose definition lacks the fields that have been added since."""
    text = re.sub(rf'^\S+ ({"|".join(ADDED[ESTIMATE_TYPE])})\n', '', definition(ESTIMATE_TYPE)[0], flags=re.MULTILINE)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, ESTIMATE_TYPE))

    def older(**fields: Any) -> Any:
        return store.types[ESTIMATE_TYPE](**{name: fields[name] for name in fields.keys() - ADDED[ESTIMATE_TYPE]})

    types = MessageTypes(lambda name: older if name == ESTIMATE_TYPE else store.types[name], BAG_TYPES.flags)
    message = estimate_message(estimate, types, Frames('link7', 'odom'))
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2')
        schema = writer.register_schema(ESTIMATE_TYPE, 'ros2msg', text.encode())
        channel = writer.register_channel(TOPIC, 'cdr', schema)
        writer.add_message(channel, 0, bytes(store.serialize_cdr(message, ESTIMATE_TYPE)), 0)
        writer.finish()  # type: ignore[no-untyped-call]
    return path
