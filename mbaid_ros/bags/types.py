"""Message types without a ROS installation: those of ROS 2 Jazzy, this project's own, and any that are installed."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mbaid_ros.errors import DataError
from mbaid_ros.estimate_messages import MessageTypes

ESTIMATE_TYPE = 'mbaid_msgs/msg/InertiaEstimate'
EVENT_TYPE = 'mbaid_msgs/msg/MomentumEvent'
# Fields that a type had not always: bags from before them are read by their own definition, without these.
ADDED = {
    ESTIMATE_TYPE: {
        'stage',
        'standard_deviation',
        'budget_causes',
        'budget_shares',
        'phase',
        'stale',
        'events',
        'repairs',
    }
}
_DEFINITION = re.compile(r'^\s*(?:([a-z]\w*)/)?(?:msg/)?([A-Z]\w*)', re.MULTILINE)


@cache
def message_types() -> Typestore:
    """Return the known message types: those of Jazzy, and mbaid_msgs."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in (EVENT_TYPE, ESTIMATE_TYPE):
        store.register(get_types_from_msg(_own_definition(name.rpartition('/')[2]), name))
    return store


def message_class(type_name: str) -> Any:
    """Return the class of a message type, for messages that `serialize` takes; a DataError if it is not known."""
    _ensure(type_name)
    return message_types().types[type_name]


BAG_TYPES = MessageTypes(find=message_class, flags=np.asarray)  # of messages made without a graph


def serialize(message: object, type_name: str) -> bytes:
    """Return a message as CDR bytes, as they go over the wire and into a bag."""
    _ensure(type_name)
    return bytes(message_types().serialize_cdr(message, type_name))


def deserialize(data: bytes, type_name: str) -> Any:
    """Return the message that CDR bytes hold."""
    _ensure(type_name)
    return message_types().deserialize_cdr(data, type_name)


def definition(type_name: str) -> tuple[str, str]:
    """Return the full text of a known type's definition and its RIHS01 hash, as a bag stores them."""
    _ensure(type_name)
    store = message_types()
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    return text, store.hash_rihs01(type_name)


@lru_cache(maxsize=16)  # it takes longer than reading thousands of messages, and bags of one robot define the same
def defined(text: str, name: str, *, idl: bool) -> Typestore:
    """Return the types of a definition, that of a name among them; a TypesysError if it cannot be understood."""
    parse = _types_from_idl if idl else get_types_from_msg
    store = get_typestore(Stores.EMPTY)
    store.register(parse(text, name))
    store.get_msgdef(name)
    return store


def _types_from_idl(text: str, _name: str) -> Any:
    """Return the types of an IDL definition, which a bag stores with a headline before each file."""
    types = {}
    for part in text.split(f'{"=" * 80}\n'):
        body = part.split('\n', 1)[1] if part.startswith('IDL: ') else part
        if body.strip():
            types.update(get_types_from_idl(body))
    return types


# Encapsulations by their identifier (DDS-XTYPES 1.3, 7.6.3.1.2), but for plain CDR, 0 and 1.
_ENCAPSULATIONS = {
    **dict.fromkeys((2, 3), 'PL_CDR (parameter lists, XCDR version 1)'),
    4: 'XML',
    **dict.fromkeys((6, 7), 'XCDR2 (CDR2)'),
    **dict.fromkeys((8, 9), 'XCDR2 (D_CDR2, delimited)'),
    **dict.fromkeys((10, 11), 'XCDR2 (PL_CDR2, parameter lists)'),
}


def other_encapsulation(data: bytes) -> str:
    """Return in which encapsulation a message is that is not in plain CDR; empty where its header names none."""
    return _ENCAPSULATIONS.get(int.from_bytes(data[:2], 'big'), '') if len(data) >= 4 else ''


def is_standard(store: Typestore, type_name: str) -> bool:
    """Return whether a type, and all that it is made of, is defined in a store as in ROS 2 Jazzy."""
    standard = message_types()
    wanted, seen = [type_name], set()
    while wanted:
        name = wanted.pop()
        if name not in seen:
            seen.add(name)
            if name not in standard.fielddefs or name not in store.fielddefs:
                return False
            fields = standard.fielddefs[name][1]
            if list(store.fielddefs[name][1]) != list(fields):
                return False
            wanted += [part for _, described in fields for part in _named(described)]
    return True


def _named(described: Any) -> list[str]:
    """Return the name of the message type in a field's description, if there is one."""
    kind, value = described
    if kind == Nodetype.NAME:
        return [value]
    return _named(value[0]) if kind in {Nodetype.ARRAY, Nodetype.SEQUENCE} else []


def _ensure(type_name: str) -> None:
    """Make a type known, from the .msg files of the installed interface packages if need be."""
    store = message_types()
    wanted = [type_name]
    while wanted:
        name = wanted.pop()
        if name in store.types:
            continue
        text = _installed_definition(name)
        try:
            store.register(get_types_from_msg(text, name))
        except TypesysError as error:
            raise DataError(f"the definition of message type '{name}' cannot be read: {error}") from error
        package = name.split('/')[0]
        wanted += [f'{other or package}/msg/{kind}' for other, kind in _DEFINITION.findall(text)]


def _installed_definition(type_name: str) -> str:
    parts = type_name.split('/')
    if len(parts) == 3:
        for prefix in _prefixes():
            path = prefix / 'share' / parts[0] / parts[1] / f'{parts[2]}.msg'
            if path.is_file():
                return path.read_text(encoding='utf-8')
    raise DataError(f"message type '{type_name}' is not known: it is not in ROS 2 Jazzy, nor installed")


def _own_definition(name: str) -> str:
    """Return the text of one of mbaid_msgs' definitions, from the source tree or the installation."""
    places = [folder / 'msg_defs' / 'msg' for folder in list(Path(__file__).resolve().parents)[2:3]]
    places += [prefix / 'share' / 'mbaid_ros' / 'msg' for prefix in _prefixes()]
    for place in places:
        path = place / f'{name}.msg'
        if path.is_file():
            return path.read_text(encoding='utf-8')
    searched = ', '.join(str(place) for place in places)
    raise DataError(f'{name}.msg is not found; is the workspace sourced? Searched: {searched}')


def _prefixes() -> Iterator[Path]:
    """Yield the folders packages are installed in: the one this file is in, then those of the ament index."""
    for folder in Path(__file__).resolve().parents:
        if (folder / 'share' / 'mbaid_ros').is_dir():
            yield folder
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        if prefix:
            yield Path(prefix)
