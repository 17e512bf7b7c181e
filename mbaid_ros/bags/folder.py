"""Rosbag2 folders: their metadata.yaml, checked value by value, and the files it names."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import ReaderMetadata
from rosbags.rosbag2.reader import DirectoryReader

from mbaid_ros import limits
from mbaid_ros.bags.chunks import Block, ChunkReader
from mbaid_ros.bags.compression import unpack_file
from mbaid_ros.bags.sqlite import SqliteReader
from mbaid_ros.bags.writer import parse_profiles, parse_yaml
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.samples import Stamps
from mbaid_ros.files import require_regular

T = TypeVar('T')
_NEWEST = 9  # version of the metadata
_KINDS: Mapping[type, str] = {list: 'list', str: 'text', int: 'number'}
_NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, '')


class FolderReader(DirectoryReader):
    """A folder of files and their metadata."""

    STORAGE_PLUGINS: Mapping[str, type[Any]] = {'mcap': ChunkReader, 'sqlite3': SqliteReader}

    def open(self) -> None:
        """Open the files that the metadata name; raise a ReaderError where the metadata cannot be used."""
        folder = Path(str(self.path))
        self.stack = ExitStack()
        self._parts: list[tuple[type[ChunkReader | SqliteReader], Path]] = []
        try:
            declared = _read(folder / 'metadata.yaml')
            plugin = self.STORAGE_PLUGINS.get(_value(declared, 'storage_identifier', str))
            if plugin is None:
                raise ReaderError(f'storage {declared["storage_identifier"]!r:.40} is not known')
            mode = _compression(declared)
            files = _files(declared, folder)
            self.connections = self._topics(declared)
            self.metadata = ReaderMetadata(0, 0, 0, _value(declared, 'message_count', int), None, mode, None, None)
            for path in self._unpacked(files) if mode == 'file' else files:
                self._parts.append((plugin, path))
            self._find_definitions()
        except BaseException:
            with suppress(ReaderError):
                self.close()
            raise

    def blocks(self, connections: Collection[Connection]) -> Iterator[Block]:
        """Yield the messages of connections, of each file in the order of their times."""
        wanted = {(connection.topic, connection.msgtype) for connection in connections}
        for part in self._parts:
            with _opened(*part) as file:
                chosen = [each for each in file.connections if (each.topic, each.msgtype) in wanted]
                if chosen:
                    yield from file.blocks(chosen)

    def _topics(self, declared: Mapping[str, Any]) -> list[Connection]:
        topics = _value(declared, 'topics_with_message_count', list)
        if len(topics) > limits.TOPICS:
            raise DataError(f"bag '{self.path}' has {len(topics)} topics; at most {limits.TOPICS} are accepted")
        return [self._topic(number, _mapping(each)) for number, each in enumerate(topics, start=1)]

    def _topic(self, number: int, declared: Mapping[str, Any]) -> Connection:
        topic = _mapping(declared.get('topic_metadata'))
        profiles = topic.get('offered_qos_profiles', [])
        encoding = _value(topic, 'serialization_format', str)
        if encoding != 'cdr':
            raise ReaderError(f'a topic is encoded as {encoding!r:.40}; accepted: cdr')
        return Connection(
            number,
            _value(topic, 'name', str),
            _value(topic, 'type', str),
            _NO_DEFINITION,
            '',
            _value(declared, 'message_count', int),
            ConnectionExtRosbag2(encoding, parse_profiles(profiles if isinstance(profiles, str | list) else [])),
            self,
        )

    def _find_definitions(self) -> None:
        """Take the definitions of the types from the files."""
        found: dict[str, MessageDefinition] = {}
        types = {each.msgtype for each in self.connections}
        for plugin, path in self._parts:
            if types <= found.keys():
                plugin.require_whole(path)  # of thousands of files, without a look at their index
                continue
            with _opened(plugin, path) as storage:
                for connection in storage.connections:
                    if connection.msgdef.format != MessageDefinitionFormat.NONE:
                        found.setdefault(connection.msgtype, connection.msgdef)
        self.connections = [each._replace(msgdef=found.get(each.msgtype, each.msgdef)) for each in self.connections]

    def _unpacked(self, files: Collection[Path]) -> Iterator[Path]:
        """Yield the files without their compression, in a folder that goes when the bag is closed."""
        if self.stack is None:
            raise ReaderError('the bag is not open')
        folder = Path(self.stack.enter_context(TemporaryDirectory()))
        for file in files:
            unpack_file(file, folder / file.stem)
            yield folder / file.stem


def _opened(plugin: type[ChunkReader | SqliteReader], path: Path) -> closing[ChunkReader | SqliteReader]:
    """Open one file of a bag for a block: a process may not have thousands of them open."""
    storage = plugin(path)
    storage.open()
    return closing(storage)


def _read(path: Path) -> Mapping[str, Any]:
    require_regular(path, 'metadata')
    with path.open('rb') as file:
        content = file.read(limits.METADATA_BYTES + 1)
    if len(content) > limits.METADATA_BYTES:
        raise DataError(f"metadata '{path}' has more than {limits.METADATA_BYTES} bytes, which is the limit")
    declared = _mapping(_mapping(parse_yaml(content.decode())).get('rosbag2_bagfile_information'))
    if _value(declared, 'version', int) > _NEWEST:
        raise ReaderError(f'metadata of version {declared["version"]}; accepted: up to {_NEWEST}')
    return declared


def _files(declared: Mapping[str, Any], folder: Path) -> list[Path]:
    names = _value(declared, 'relative_file_paths', list)
    if len(names) > limits.FOLDER_FILES:
        raise DataError(f"bag '{folder}' has {len(names)} files; at most {limits.FOLDER_FILES} are accepted")
    if not all(isinstance(name, str) and '\0' not in name for name in names):
        raise ReaderError('relative_file_paths has an entry that is not a name')
    paths = [folder / PurePath(name).name for name in names]
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        times = f'{paths.count(twice)} times; accepted: once'
        raise DataError(f"metadata of bag '{folder}' list file '{twice.name}' {times}")
    for path in paths:
        if not path.exists():
            raise ReaderError(f"file '{path}' is missing")
        require_regular(path, 'bag')
    return paths


def _compression(declared: Mapping[str, Any]) -> str:
    """Return the unit of compression: messages, files, or none."""
    mode = str(declared.get('compression_mode') or '').lower()
    if mode in {'', 'none'}:
        return ''
    if mode not in {'file', 'message'} or declared.get('compression_format') != 'zstd':
        raise ReaderError(f'compression {mode!r:.40} as {declared.get("compression_format")!r:.40} is not known')
    return mode


def _mapping(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise ReaderError('metadata lack a mapping')
    return value


def _value(declared: Mapping[str, Any], key: str, kind: type[T]) -> T:
    value = declared.get(key)
    if not isinstance(value, kind) or (isinstance(value, int) and not 0 <= value < 2**63):
        raise ReaderError(f'metadata have no {_KINDS[kind]} {key}')
    return value


Timed = tuple[str, Any, int]  # topic, message, and the time it was recorded at, ns


@dataclass(frozen=True)
class Recorded:
    """N messages: the topic of each in recorded order; each topic's messages (a list, or `Packets`) and times, ns."""

    topics: Sequence[str]
    messages: Mapping[str, Sequence[Any]]
    times: Mapping[str, Stamps]

    def __len__(self) -> int:
        return len(self.topics)

    def __iter__(self) -> Iterator[Timed]:
        left = {topic: zip(self.of(topic), self.times[topic].tolist(), strict=True) for topic in self.messages}
        return ((topic, *next(left[topic])) for topic in self.topics)

    def of(self, topic: str) -> Sequence[Any]:
        """Return the messages of a topic."""
        return self.messages.get(topic, ())

    def runs(self, topic: str) -> Iterator[Recorded]:
        """Yield the same messages in parts: those of a topic that follow one another, and those between them."""
        if topic not in self.messages:
            yield self
            return
        done = dict.fromkeys(self.messages, 0)
        for _, group in groupby(self.topics, key=topic.__eq__):
            names = list(group)
            some = {name: slice(done[name], done[name] + names.count(name)) for name in dict.fromkeys(names)}
            yield Recorded(
                names,
                {name: self.messages[name][part] for name, part in some.items()},
                {name: self.times[name][part] for name, part in some.items()},
            )
            done.update({name: part.stop for name, part in some.items()})
