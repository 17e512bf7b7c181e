"""Writing bags; the YAML that bags hold, and the QoS profiles in it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, ReaderError, StoragePlugin, Writer, WriterError
from rosbags.rosbag2.metadata import parse_qos

from mbaid_ros import limits
from mbaid_ros.bags.types import definition, serialize
from mbaid_ros.errors import DataError

_MERGE = 'tag:yaml.org,2002:merge'


class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc] # faster where it is installed
    """The safe loader without merged mappings, a few lines of which take minutes."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Refuse keys that merge a mapping into another."""
        if any(key.tag == _MERGE for key, _ in node.value):
            raise yaml.YAMLError('merge keys (<<) are not supported')


def parse_yaml(text: str) -> Any:
    """Return the content of a bag's YAML; a DataError if it exceeds a bound, a ReaderError if it is no YAML."""
    try:
        _check_size(text)
        return yaml.load(text, _Loader)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        raise ReaderError(f'not YAML: {" ".join(str(error).split())}') from error


def _check_size(text: str) -> None:
    """Refuse documents that take long to load, or are nested so deeply that libyaml ends the process."""
    depth = 0
    for count, event in enumerate(yaml.parse(text, _Loader)):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > limits.YAML_DEPTH:
            raise DataError(f'YAML of a bag is nested more than {limits.YAML_DEPTH} deep, which is the limit')
        if count > limits.YAML_VALUES:
            raise DataError(f'YAML of a bag has more than {limits.YAML_VALUES} values, which is the limit')


def parse_profiles(given: str | list[Any]) -> list[Qos]:
    """Return the profiles of a topic; a ReaderError if they are none."""
    if isinstance(given, str) and len(given) > limits.PROFILE_CHARACTERS:
        raise DataError(f'QoS profiles of {len(given)} characters; at most {limits.PROFILE_CHARACTERS} are accepted')
    items = parse_yaml(given) if isinstance(given, str) else given
    try:
        return parse_qos(items or [])
    except (TypeError, ValueError, LookupError, AttributeError) as error:
        raise ReaderError(f'QoS profiles that are none: {error}') from error


_FOREVER = QosTime(9223372036, 854775807)


class BagWriter:
    """A bag that is being written into a new folder; a context manager, which completes the bag however it ends.

    Where that is an error before the first message, nothing is left of it. A disk that takes no more ends it, too:
    messages that have been handed over by then stay, and can be read.

    Raises DataError: The folder exists, or cannot be made; in every method: cannot be written any more.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.messages = 0
        self._connections: dict[str, Connection] = {}
        self._types: dict[str, str] = {}
        self._unflushed = False
        self._whole = self._handed_over = 0  # bytes of the file, and messages in them, that a reader can do with
        self._chunks = 0
        made = not self.path.exists()
        try:
            self._writer = Writer(self.path, version=9, storage_plugin=StoragePlugin.MCAP)
            # By chunks, not by messages: other readers do not understand compressed messages.
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
            self._write_through()  # from here on a reader takes it for an empty bag
        except WriterError as error:
            raise DataError(f"bag '{self.path}' exists already; a bag is never overwritten") from error
        except OSError as error:
            if made:
                self._remove_files()
            raise DataError(f"bag '{self.path}' cannot be made: {error.strerror or error}") from error

    def add_topic(self, topic: str, type_name: str, *, latched: bool = False, reliable: bool = True) -> None:
        """Declare a topic, latched (transient local) or not, reliable or best effort.

        Raises DataError: The type is not known, or the topic has another one.
        """
        if topic in self._types:
            if self._types[topic] != type_name:
                raise DataError(f"topic '{topic}' is {self._types[topic]} in this bag; it cannot also be {type_name}")
            return
        text, digest = definition(type_name)
        profile = _profile(latched=latched, reliable=reliable)
        self._types[topic] = type_name
        self._connections[topic] = self._writer.add_connection(
            topic, type_name, msgdef=text, rihs01=digest, offered_qos_profiles=[profile]
        )

    def write(self, topic: str, message: Any, time: int) -> None:
        """Write a message of a declared topic; `time` in ns is when it was received."""
        self.write_raw(topic, serialize(message, self._types[topic]), time)

    def write_raw(self, topic: str, data: bytes, time: int) -> None:
        """Write the CDR bytes of a message of a declared topic; `time` in ns is when it was received."""
        with self._no_more_than_whole():
            self._writer.write(self._connections[topic], time, data)
            self.messages += 1
            self._unflushed = True
            if len(self._storage.chunks) > self._chunks:  # a large one is complete
                self._write_through()

    def flush(self) -> None:
        """Flush the written bytes to the system, so that they survive any end of this process."""
        if self._unflushed and self._storage is not None:
            with self._no_more_than_whole():
                self._storage.close_chunk()
                self._write_through()

    def close(self) -> None:
        """Write the index and the metadata; a bag that is not closed can be read only up to its last flush."""
        self.flush()
        if self._storage is not None:
            with self._no_more_than_whole():
                self._writer.close()

    @property
    def _storage(self) -> Any:
        """The file; None once it is closed."""
        return self._writer.storage

    def _write_through(self) -> None:
        self._storage.bio.flush()
        self._whole, self._handed_over = self._storage.bio.tell(), self.messages
        self._chunks, self._unflushed = len(self._storage.chunks), False

    @contextmanager
    def _no_more_than_whole(self) -> Iterator[None]:
        """Keep the bytes flushed before a failing write, and no others."""
        storage = self._storage
        try:
            yield
        except OSError as error:
            self._writer.metapath.with_suffix('.yaml.tmp').unlink(missing_ok=True)
            if self._handed_over:
                self._close_storage(storage)
                left = f'it contains {self._handed_over} of {self.messages} messages'
            else:
                self._remove_files()
                left = 'nothing is left of it'
            raise DataError(f"bag '{self.path}' cannot be written: {error.strerror or error}; {left}") from error

    def _close_storage(self, storage: Any) -> None:
        self._writer.storage = None
        if storage is not None and not storage.bio.closed:
            os.ftruncate(storage.bio.fileno(), self._whole)
            storage.bio.raw.close()  # not the buffer above it, which would try once more

    def _remove_files(self) -> None:
        """Remove the file, and the folder that was made for it; files of others stay."""
        storage = self._storage
        self._close_storage(storage)
        if storage is not None:
            storage.path.unlink(missing_ok=True)
        if self.path.is_dir() and not any(self.path.iterdir()):
            self.path.rmdir()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and not self.messages:
            self._remove_files()
        else:
            self.close()


def _profile(*, latched: bool, reliable: bool) -> Qos:
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if latched else 10,
        reliability=QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=_FOREVER,
        lifespan=_FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_FOREVER,
        avoid_ros_namespace_conventions=False,
    )
