"""Messages as their bytes, of which only the stamps have been read."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Generic, TypeVar, overload

import numpy as np

from mbaid_ros.cdr.layouts import JOINT_STATE_TYPE, ODOMETRY_TYPE, JointStateLayout, MisfitError, OdometryLayout
from mbaid_ros.core.samples import Stamps

_MOST_LAYOUTS = 64  # that are remembered of a topic

_stamp = struct.Struct('<4xiI').unpack_from

Layout = TypeVar('Layout', JointStateLayout, OdometryLayout)


class Packet(Generic[Layout]):
    """A message as its bytes (CDR with its encapsulation header), with its checked layout and its stamp, ns."""

    __slots__ = ('data', 'layout', 'stamp')

    def __init__(self, data: bytes, layout: Layout, stamp: int) -> None:
        self.data = data
        self.layout: Layout = layout
        self.stamp = stamp


class Packets(Sequence[Packet[Layout]]):
    """N messages of one checked layout as their bytes, one after the other, with their stamps (N,), ns."""

    __slots__ = ('data', 'layout', 'stamps')

    def __init__(self, data: bytes, layout: Layout, stamps: Stamps) -> None:
        self.data = data
        self.layout: Layout = layout
        self.stamps = stamps

    def __len__(self) -> int:
        return len(self.stamps)

    @overload
    def __getitem__(self, place: int) -> Packet[Layout]: ...

    @overload
    def __getitem__(self, place: slice) -> Packets[Layout]: ...

    def __getitem__(self, place: int | slice) -> Packet[Layout] | Packets[Layout]:
        chosen = np.frombuffer(self.data, f'V{self.layout.size}')[place].tobytes()
        if isinstance(place, slice):
            return Packets(chosen, self.layout, self.stamps[place])
        return Packet(chosen, self.layout, int(self.stamps[place]))


class Packer(Generic[Layout]):
    """Makes packets of the messages of a topic, whose type has a kind of layout."""

    def __init__(self, kind: type[Layout]) -> None:
        self._kind: type[Layout] = kind
        self._known: dict[int, list[Layout]] = {}  # by the size of the messages
        self._count = 0

    def __call__(self, data: bytes) -> Packet[Layout] | None:
        """Return a message as a packet, None where its bytes are not understood: a general deserialiser is to try."""
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


def _packet(data: bytes, layout: Layout) -> Packet[Layout]:
    second, nanosecond = _stamp(data)
    return Packet(data, layout, second * 1_000_000_000 + nanosecond)


def packer(type_name: str) -> Packer[JointStateLayout] | Packer[OdometryLayout] | None:
    """Return the maker of packets for messages of a type, None if its layout is not known."""
    if type_name == JOINT_STATE_TYPE:
        return Packer(JointStateLayout)
    return Packer(OdometryLayout) if type_name == ODOMETRY_TYPE else None
