"""Reading bags: rosbag2 folders and bare files, also those cut off while being written."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, suppress
from itertools import compress
from math import inf
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from rosbags.typesys.store import Typestore

from mbaid_ros import limits
from mbaid_ros.bags.chunks import Batch, Block, Raw, Timed, in_blocks
from mbaid_ros.bags.compression import is_compressed, unpacked
from mbaid_ros.bags.opening import Source, files_of, open_file, reason_of, unread_log
from mbaid_ros.bags.sources import DAMAGE, Topic, by_name
from mbaid_ros.bags.types import ADDED, defined, is_standard, message_types, other_encapsulation
from mbaid_ros.core.samples import Stamps
from mbaid_ros.errors import DataError, listing
from mbaid_ros.packets import packer

_SCHEMALESS = '__schemaless__'  # type of a channel whose schema the index lacks
_SIMULATED = 10**15  # ns: clocks of simulations begin at zero, others in 1970


class BagReader:
    """A recorded bag, a rosbag2 folder (MCAP or sqlite3) or a bare ``.mcap`` or ``.db3`` file; a context manager.

    Raises DataError: There is no bag, or not one message in it.

    Parameters
    ----------
    path : of the bag
    start, end : s from the bag's first message, between which messages are read

    Attributes
    ----------
    topics : the topics by name, with all their messages
    messages : number of messages on all of them
    warnings : for the user, one line each; reading may add to them
    """

    def __init__(self, path: str | Path, start: float = 0.0, end: float = inf) -> None:
        self.path = Path(path)
        self._slice = start, end
        self._first: int | None = None  # ns, when the bag's first message was recorded
        self.warnings: list[str] = []
        self._scratch = ExitStack()  # folders of files that were compressed as a whole
        try:
            self._sources = self._open()
        except BaseException:
            self._scratch.close()
            raise
        self.topics, left_out = by_name(topic for source in self._sources for topic in source.topics.values())
        self.messages = sum(topic.count for topic in self.topics.values())
        whole = all(source.complete for source in self._sources)
        if not whole:
            self.warnings.append(
                f"bag '{self.path}' was cut off while it was written: read up to the cut, {self.messages} messages"
            )
        files = sorted(self.path.glob('*.db3')) if self.path.is_dir() else [self.path]
        self.warnings += filter(None, map(unread_log, files))
        for name, count in sum((source.left_out for source in self._sources), left_out).items():
            self.warnings.append(
                f"topic '{name}' of bag '{self.path}' is of type {self.topics[name].type}, and {count} of its messages "
                'are of another: they are left out'
            )
        if not self.messages:
            self.close()
            why = '; '.join(self.warnings) if whole else 'it was cut off before the first one'
            raise DataError(f"bag '{self.path}' contains no messages" + (f': {why}' if why else ''))

    def of_types(self, *types: str) -> list[str]:
        """Return the topics with messages of one of some types."""
        return sorted(name for name, found in self.topics.items() if found.type in types and found.count)

    def require(self, topic: str, *types: str) -> None:
        """Check that messages of one of some types are there.

        Raises DataError: The bag has no such topic, it has another type, or no message is on it.
        """
        there = ((f'{name} ({found.type})') for name, found in sorted(self.topics.items()))
        if topic not in self.topics:
            raise DataError(f"bag '{self.path}' has no topic '{topic}'; topics: {listing(there)}")
        found = self.topics[topic]
        if found.type in {'', _SCHEMALESS}:
            raise DataError(
                f"topic '{topic}' of bag '{self.path}' has no schema, so the type of its messages is not known; "
                f'accepted: a schema named {listing(types)}'
            )
        if found.type not in types:
            accepted = listing(types)
            raise DataError(f"topic '{topic}' of bag '{self.path}' is of type {found.type}; accepted: {accepted}")
        if found.encoding != 'cdr':
            raise DataError(f"topic '{topic}' of bag '{self.path}' is encoded as {found.encoding}; accepted: cdr")
        if not found.count:
            raise DataError(f"topic '{topic}' of bag '{self.path}' contains no messages")

    def blocks(self, topics: Collection[str]) -> Iterator[Block]:
        """Yield the messages of topics in recorded order, a chunk at a time; damaged bytes end it, with a warning."""
        chosen = set(topics)
        if self._first is None and self._slice != (0.0, inf):
            self._first = self._begin()
        for source in self._sources:
            read = 0
            reason = ''
            there = (topic for name, topic in source.topics.items() if name in chosen)
            own = {topic.name: topic.count for topic in there if topic.type == self.topics[topic.name].type}
            try:
                for block in source.blocks(own):
                    read += len(block)
                    yield from _without_compression(self._within(block))
            except (*DAMAGE, OSError) as error:
                reason = reason_of(error)
            expected = sum(own.values())
            if reason or read < expected:
                because = f': {reason}' if reason else ''
                self.warnings.append(f"bag '{self.path}' is damaged: read {read} of {expected} messages{because}")

    def _within(self, block: Block) -> Block:
        """Return the messages between start and end."""
        if self._first is None:
            return block
        start, end = self._slice
        inside = (block.times >= self._first + 1e9 * start) & (block.times <= self._first + 1e9 * end)
        return block.select(np.flatnonzero(inside))

    def _begin(self) -> int:
        """Return when the first message of all topics was recorded, ns."""
        for source in self._sources:
            zero = False
            with suppress(*DAMAGE, OSError):
                for block in source.blocks(self.topics):
                    if np.any(block.times > 0):
                        first = int(block.times[np.argmax(block.times > 0)])
                        zero |= bool(block.times[0] == 0)
                        return 0 if zero and first < _SIMULATED else first  # or zeros were never filled in
                    zero |= len(block) > 0
        return 0

    def raw(self, topics: Collection[str] | None = None) -> Iterator[Raw]:
        """Yield (topic, CDR bytes, log time in ns) in recorded order, as `blocks` does; of all topics by default."""
        for block in self.blocks(self.topics if topics is None else topics):
            yield from block

    def read(self, topics: Collection[str]) -> Iterator[Timed]:
        """Yield (topic, message, log time in ns) in recorded order; a DataError if a message is not of its type."""
        deserializers = {name: self._deserializer(name, self._typestore(self.topics[name])) for name in topics}
        for topic, data, time in self.raw(topics):
            yield topic, deserializers[topic](data, time), time

    def read_packed(self, topics: Collection[str], at_once: int) -> Iterator[Batch]:
        """Yield messages in recorded order, so many at once at most; a DataError if a message is not of its type.

        Messages of the types that `mbaid_ros.packets` knows are packets, which takes a fraction of the time; they are
        objects where the bag defines the type in another way than ROS 2 Jazzy, or the bytes are not understood.
        """
        make = {name: self._maker(name) for name in topics}
        parts = (
            block.part(begin, begin + at_once)
            for block in self.blocks(topics)
            for begin in range(0, len(block), at_once)
        )
        for block in parts:
            messages, times = {}, {}
            for name in dict.fromkeys(block.topics):
                of_it = list(map(name.__eq__, block.topics))
                times[name] = block.times[of_it]
                messages[name] = make[name](list(compress(block.contents, of_it)), times[name])
            yield Batch(block.topics, messages, times)

    def missing_fields(self, topic: str) -> set[str]:
        """Return the fields that messages of a topic lack because they are older than these."""
        type_name = self.topics[topic].type
        added = ADDED.get(type_name)
        if not added:
            return set()
        return added - {field for field, _ in self._typestore(self.topics[topic]).fielddefs[type_name][1]}

    def close(self) -> None:
        """Remove the files that were unpacked; no other is open but while it is read."""
        self._scratch.close()
        self._sources = []

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _maker(self, name: str) -> Callable[[list[bytes], Stamps], Sequence[Any]]:
        """Return the reader of a topic's messages from bytes that were recorded at times (N,), ns."""
        store, type_name = self._typestore(self.topics[name]), self.topics[name].type
        deserialize = self._deserializer(name, store)
        pack = packer(type_name) if is_standard(store, type_name) else None

        def make(given: list[bytes], times: Stamps) -> Sequence[Any]:
            together = None if pack is None else pack.many(given)
            if together is not None:
                return together
            single = [None] * len(given) if pack is None else map(pack, given)
            return [
                deserialize(data, time) if packet is None else packet
                for packet, data, time in zip(single, given, times.tolist(), strict=True)
            ]

        return make

    def _deserializer(self, name: str, store: Typestore) -> Callable[[bytes, int], Any]:
        """Return the reader of a topic's messages from bytes that were recorded at a time, ns."""
        type_name = self.topics[name].type

        def deserialize(data: bytes, time: int) -> Any:
            if (encapsulation := other_encapsulation(data)) and self.topics[name].encoding == 'cdr':
                raise DataError(
                    f"topic '{name}' of bag '{self.path}' is encapsulated as {encapsulation}; accepted: plain CDR "
                    '(XCDR version 1): set the data representation of its publisher to that'
                )
            try:
                return store.deserialize_cdr(data, type_name)
            except (SerdeError, *DAMAGE) as error:
                raise DataError(
                    f"a message on topic '{name}' of bag '{self.path}' at {time} ns is not a {type_name}"
                ) from error

        return deserialize

    def _typestore(self, topic: Topic) -> Typestore:
        """Return the types as the bag defines them, or else as they are known; refuse types that lack known fields."""
        if len(topic.definition) > limits.DEFINITION_CHARACTERS:
            raise DataError(
                f"topic '{topic.name}' of bag '{self.path}' defines its type in {len(topic.definition)} characters; at "
                f'most {limits.DEFINITION_CHARACTERS} are accepted'
            )
        with suppress(TypesysError, *DAMAGE):  # then as they are known
            if topic.definition:
                store = defined(topic.definition, topic.type, idl=topic.idl)
                self._compare_with_known(store, topic)
                return store
        if topic.type not in message_types().types:
            raise DataError(
                f"topic '{topic.name}' of bag '{self.path}' is of type {topic.type}, which neither the bag nor ROS 2 "
                'Jazzy defines'
            )
        return message_types()

    def _compare_with_known(self, store: Typestore, topic: Topic) -> None:
        known = message_types().fielddefs
        for name in store.fielddefs.keys() & known.keys():
            lost = {field for field, _ in known[name][1]} - {field for field, _ in store.fielddefs[name][1]}
            lost -= ADDED.get(name, set())
            if lost:
                raise DataError(
                    f"topic '{topic.name}' of bag '{self.path}' cannot be read: the bag defines {name} without "
                    f"'{min(lost)}'"
                )

    def _open(self) -> list[Source]:
        if not self.path.exists():
            raise DataError(f"bag '{self.path}' does not exist")
        if not self.path.is_dir():
            return [open_file(self.path, self._scratch)]
        files, reason = files_of(self.path)
        sources = self._open_parts(files)
        if reason and all(source.complete for source in sources):
            self.warnings.append(
                f"metadata.yaml of bag '{self.path}' cannot be used ({reason}): its files are read in the order of "
                'their names'
            )
        return sources

    def _open_parts(self, files: Sequence[Path]) -> list[Source]:
        """Return the messages of each part of a bag; a part that has none is left out, with a warning."""
        sources: list[Source] = []
        unread: list[DataError] = []
        for file in files:
            source = self._open_part(file)
            if isinstance(source, DataError):
                unread.append(source)
            else:
                sources.append(source)
        if not sources:
            raise unread[0]
        if unread:
            more = f' (and {len(unread) - 1} others)' if len(unread) > 1 else ''
            self.warnings.append(f"a part of bag '{self.path}' is left out: {unread[0]}{more}")
        return sources

    def _open_part(self, file: Path) -> Source | DataError:
        try:
            return open_file(file, self._scratch)
        except DataError as error:
            return error


def _without_compression(block: Block) -> Iterator[Block]:
    """Yield messages that may have been compressed one by one, no more of them at once than memory should hold."""
    if not any(map(is_compressed, block.contents)):
        yield block
        return
    yield from in_blocks(
        (topic, unpacked(data, limits.MESSAGE_BYTES, f"a message on topic '{topic}'"), time)
        if is_compressed(data)
        else (topic, data, time)
        for topic, data, time in block
    )
