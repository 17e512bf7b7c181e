"""Writing bags: rosbag2 folders with one MCAP file, compressed in chunks, which `ros2 bag` and every MCAP tool read."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError

from mbaid_ros.bags.types import definition, serialize
from mbaid_ros.core.errors import DataError

_FOREVER = QosTime(9223372036, 854775807)


class BagWriter:
    """A bag that is being written; a context manager, which completes the bag whatever ends it.

    Parameters
    ----------
    path : the folder to make; it must not exist

    Raises
    ------
    DataError
        The folder exists, or cannot be made.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.messages = 0
        self._connections: dict[str, Connection] = {}
        self._types: dict[str, str] = {}
        self._unflushed = False
        try:
            self._writer = Writer(self.path, version=9, storage_plugin=StoragePlugin.MCAP)
            # By chunks, not by messages: other readers do not understand compressed messages.
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
            self._hand_over()  # by now a reader can tell what it is, and that it holds nothing
        except WriterError as error:
            raise DataError(f"bag '{self.path}' exists already; a bag is never overwritten") from error
        except OSError as error:
            raise DataError(f"bag '{self.path}' cannot be made: {error.strerror or error}") from error

    def add_topic(self, topic: str, type_name: str, *, latched: bool = False, reliable: bool = True) -> None:
        """Declare a topic, once.

        Parameters
        ----------
        topic : full name
        type_name : ``package/msg/Type``
        latched : True if its publisher keeps the last message for who comes later (transient local)
        reliable : False if its publisher offers best effort only

        Raises
        ------
        DataError
            The type is not known, or the topic has another one.
        """
        if topic in self._types:
            if self._types[topic] != type_name:
                raise DataError(f"topic '{topic}' is {self._types[topic]} in this bag; it cannot also be {type_name}")
            return
        text, digest = definition(type_name)
        profile = _profile(latched=latched, reliable=reliable)
        connection = self._writer.add_connection(
            topic, type_name, msgdef=text, rihs01=digest, offered_qos_profiles=[profile]
        )
        self._types[topic] = type_name
        self._connections[topic] = connection

    def write(self, topic: str, message: Any, time: int) -> None:
        """Write a message of a declared topic; `time` in ns is when it was received."""
        self.write_raw(topic, serialize(message, self._types[topic]), time)

    def write_raw(self, topic: str, data: bytes, time: int) -> None:
        """Write the CDR bytes of a message of a declared topic; `time` in ns is when it was received."""
        self._writer.write(self._connections[topic], time, data)
        self.messages += 1
        self._unflushed = True

    def flush(self) -> None:
        """Hand what was written to the system, so that it survives the end of this process, however that comes."""
        storage: Any = self._writer.storage
        if self._unflushed and storage is not None:
            storage.close_chunk()
            self._hand_over()
            self._unflushed = False

    def _hand_over(self) -> None:
        storage: Any = self._writer.storage
        storage.bio.flush()

    def close(self) -> None:
        """Write the index and the metadata; a bag that is not closed can be read only up to its last flush."""
        if self._writer.storage is not None:
            self._writer.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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
