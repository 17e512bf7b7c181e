"""Messages as their bytes: plain little-endian CDR (DDSI-RTPS 2.5, 10.2), many messages of one layout at a time.

Numbers stand after the strings and lengths, which mostly repeat.

Alignment counts from the byte after the four of the encapsulation header. Bytes are not trusted: a layout exists only
after every length has been checked against the bytes that there are.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Stamps

JOINT_STATE_TYPE = 'sensor_msgs/msg/JointState'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'

ENCAPSULATION = b'\x00\x01'  # plain CDR, little-endian
_BODY = 4  # where the message begins
_HEADER = 12  # where the message goes on after its stamp
_SPARE = 3  # bytes that may follow a message: it is padded to a multiple of four
_MOST_NAMES = 10_000
_LONGEST_HEAD = 100_000  # bytes: layouts are kept, with their constant parts
_POSE, _TWIST = slice(0, 7), slice(43, 49)  # in the numbers of an Odometry: pose, covariance, twist, covariance
_POSE_COVARIANCE, _TWIST_COVARIANCE = slice(7, 43), slice(49, 85)
_NUMBERS = 85

_length = struct.Struct('<I').unpack_from


class MisfitError(Exception):
    """The bytes are not laid out as they are understood here; a general deserialiser may know more."""


class Cursor:
    """Goes through the bytes of a message and notes the parts that all messages laid out alike have in common.

    Raises MisfitError where the bytes are encoded in another way, or too few.
    """

    def __init__(self, data: bytes) -> None:
        if len(data) < _HEADER or data[:2] != ENCAPSULATION:
            raise MisfitError
        self._data = data
        self._place = _HEADER
        self.constant = [(0, len(ENCAPSULATION))]  # begin and end

    def length(self) -> int:
        """Return the length that stands next."""
        begin = self._aligned(4)
        if begin + 4 > len(self._data):
            raise MisfitError
        self._note(begin, begin + 4)
        return int(_length(self._data, begin)[0])

    def string(self) -> str:
        """Return the text that comes next."""
        length = self.length()
        begin, end = self._place, self._place + length
        if length < 1 or end > len(self._data) or end > _LONGEST_HEAD or self._data.find(0, begin, end) != end - 1:
            raise MisfitError
        self._note(begin, end)
        try:
            return self._data[begin : end - 1].decode()
        except UnicodeDecodeError as error:
            raise MisfitError from error

    def strings(self) -> tuple[str, ...]:
        """Return the texts that come next, after their number."""
        count = self.length()
        if count > _MOST_NAMES:
            raise MisfitError
        return tuple(self.string() for _ in range(count))

    def sequence(self) -> tuple[int, int]:
        """Return place and number of the doubles that come next, after their number; they may vary."""
        count = self.length()
        return self.doubles(count), count

    def doubles(self, count: int) -> int:
        """Return the place of so many doubles that come next; they may vary."""
        begin = self._aligned(8) if count else self._place
        if begin + 8 * count > len(self._data):
            raise MisfitError
        self._place = begin + 8 * count
        return begin

    def end(self) -> None:
        """Check that nothing follows but padding."""
        if len(self._data) - self._place > _SPARE:
            raise MisfitError

    def _aligned(self, size: int) -> int:
        return _BODY + (self._place - _BODY + size - 1) // size * size

    def _note(self, begin: int, end: int) -> None:
        """Go on to an end; the bytes between must be the same in other messages. Padding, which varies, is left out."""
        if self.constant[-1][1] == begin:
            begin = self.constant.pop()[0]
        self.constant.append((begin, end))
        self._place = end


class _Layout:
    """The common parts of messages of one layout: size in bytes, strings and lengths, and the places of the numbers."""

    def __init__(self, data: bytes, cursor: Cursor, places: dict[str, tuple[int, int]]) -> None:
        cursor.end()
        self.size = len(data)
        self._constant = [(begin, data[begin:end]) for begin, end in cursor.constant]
        self._record = np.dtype(
            {
                'names': ['stamp', *places],
                'formats': [[('sec', '<i4'), ('nanosec', '<u4')], *(('<f8', (n,)) for _, n in places.values())],
                'offsets': [_BODY, *(place for place, _ in places.values())],
                'itemsize': len(data),
            }
        )

    def fits(self, data: bytes) -> bool:
        """Return whether a message is laid out like this."""
        return len(data) == self.size and all(data.startswith(part, begin) for begin, part in self._constant)

    def stamps(self, joined: bytes) -> Stamps | None:
        """Return the stamps (N,), ns, of N messages of this size in a row, None if one is not laid out like this."""
        content = np.frombuffer(joined, np.uint8).reshape(-1, self.size)
        for begin, part in self._constant:
            if not np.all(content[:, begin : begin + len(part)] == np.frombuffer(part, np.uint8)):
                return None
        return _stamps(np.frombuffer(joined, self._record))

    def _read(self, messages: Sequence[Packets[Any]]) -> tuple[Stamps, npt.NDArray[np.void]]:
        """Return the stamps (N,), ns, of N messages that are laid out like this, and all their numbers."""
        data = messages[0].data if len(messages) == 1 else b''.join([message.data for message in messages])
        records = np.frombuffer(data, self._record)
        return _stamps(records), records


def _stamps(records: npt.NDArray[np.void]) -> Stamps:
    stamp = records['stamp']
    return stamp['sec'].astype(np.int64) * 1_000_000_000 + stamp['nanosec'].astype(np.int64)


class JointStateLayout(_Layout):
    """The layout of a sensor_msgs/JointState: the joints' names, and the numbers of positions and velocities.

    Raises MisfitError where its bytes are not understood.
    """

    type_name: ClassVar[str] = JOINT_STATE_TYPE

    def __init__(self, data: bytes) -> None:
        cursor = Cursor(data)
        cursor.string()
        self.names = cursor.strings()
        position, velocity = cursor.sequence(), cursor.sequence()
        cursor.sequence()
        self.positions, self.velocities = position[1], velocity[1]
        super().__init__(data, cursor, {'position': position, 'velocity': velocity})

    def columns(self, messages: Sequence[Packets[Any]]) -> tuple[Stamps, Array, Array]:
        """Return stamps (N,), ns, positions (N, p) and velocities (N, v) of N messages that are laid out like this."""
        stamp, records = self._read(messages)
        return stamp, records['position'].astype(float, 'C'), records['velocity'].astype(float, 'C')


class OdometryLayout(_Layout):
    """The layout of a nav_msgs/Odometry with the names of its frames.

    Raises MisfitError where its bytes are not understood.
    """

    type_name: ClassVar[str] = ODOMETRY_TYPE

    def __init__(self, data: bytes) -> None:
        cursor = Cursor(data)
        self.frame_id, self.child_frame_id = cursor.string(), cursor.string()
        super().__init__(data, cursor, {'numbers': (cursor.doubles(_NUMBERS), _NUMBERS)})

    def columns(self, messages: Sequence[Packets[Any]]) -> tuple[Stamps, Array, Array, Array]:
        """Return stamps (N,), ns, numbers (N, 13) and covariances (N, 36) of pose and twist of N such messages.

        The numbers are position (3), orientation (4), linear and angular velocity (3 each).
        """
        stamp, records = self._read(messages)
        given = records['numbers'].astype(float, 'C')
        numbers = np.concatenate((given[:, _POSE], given[:, _TWIST]), axis=1)
        return stamp, numbers, given[:, _POSE_COVARIANCE], given[:, _TWIST_COVARIANCE]


_MOST_LAYOUTS = 64  # that are remembered of a topic

_stamp = struct.Struct('<4xiI').unpack_from

Layout = TypeVar('Layout', bound=_Layout)


class Packets(Sequence[Any], Generic[Layout]):
    """N messages of one checked layout as their bytes, one after the other, with their stamps (N,), ns."""

    __slots__ = ('data', 'layout', 'stamps')

    def __init__(self, data: bytes, layout: Layout, stamps: Stamps) -> None:
        self.data = data
        self.layout: Layout = layout
        self.stamps = stamps

    def __len__(self) -> int:
        return len(self.stamps)

    def __getitem__(self, place: int | slice) -> Packets[Layout]:
        """Return one of them, or some."""
        some = slice(place, place + 1 or None) if isinstance(place, int) else place
        chosen = np.frombuffer(self.data, f'V{self.layout.size}')[some]
        if isinstance(place, int) and not len(chosen):
            raise IndexError(place)  # ends an iteration
        return Packets(chosen.tobytes(), self.layout, self.stamps[some])


class Packer(Generic[Layout]):
    """Makes packets of the messages of a topic, whose type has a kind of layout."""

    def __init__(self, kind: Callable[[bytes], Layout]) -> None:
        self._kind = kind
        self._known: dict[int, list[Layout]] = {}  # by the size of the messages
        self._count = 0

    def __call__(self, data: bytes) -> Packets[Layout] | None:
        """Return a message as packets, None where its bytes are not understood: a general deserialiser is to try."""
        for layout in self._known.get(len(data), ()):
            if layout.fits(data):
                return _packet(data, layout)
        try:
            learnt: Layout = self._kind(data)
        except MisfitError:
            return None
        if self._count == _MOST_LAYOUTS:
            self._known.clear()
            self._count = 0
        self._known.setdefault(len(data), []).append(learnt)
        self._count += 1
        return _packet(data, learnt)

    def many(self, given: Sequence[bytes]) -> Packets[Layout] | None:
        """Return messages together, None where not all are laid out as the first: then look at them one by one."""
        first = self(given[0]) if given else None
        if first is None:
            return None
        data = b''.join(given)
        stamps = first.layout.stamps(data) if set(map(len, given)) == {first.layout.size} else None
        return None if stamps is None else Packets(data, first.layout, stamps)


def _packet(data: bytes, layout: Layout) -> Packets[Layout]:
    second, nanosecond = _stamp(data)
    return Packets(data, layout, np.array([second * 1_000_000_000 + nanosecond]))


def packer(type_name: str) -> Packer[JointStateLayout] | Packer[OdometryLayout] | None:
    """Return the maker of packets for messages of a type, None if its layout is not known."""
    if type_name == JOINT_STATE_TYPE:
        return Packer(JointStateLayout)
    return Packer(OdometryLayout) if type_name == ODOMETRY_TYPE else None
