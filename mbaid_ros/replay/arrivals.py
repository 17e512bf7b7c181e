"""When the messages of a topic arrived: rate, gaps, course."""

from __future__ import annotations

from array import array

import numpy as np

from mbaid_ros.core.samples import Stamps
from mbaid_ros.replay.results import TopicStatistics

_PIECES = 120  # points of the rate's course
_GAP = 3.0  # usual intervals that make a gap
_LISTED = 20  # gaps that are kept, the longest
_KEPT = 400_000  # times that are kept, at most


class Arrivals:
    """Collects the times at which a topic's messages were recorded: of many every second, every fourth ...

    Attributes
    ----------
    first : ns, the first time; None before there is one
    """

    def __init__(self) -> None:
        self.first: int | None = None
        self._last = 0  # ns
        self._count = 0
        self._stride = 1  # messages from one whose time is kept to the next one
        self._times, self._intervals = array('q'), array('q')  # ns; since the message before
        # Interval and its begin, ns, number of the message after it.
        self._longest: Stamps = np.zeros((0, 3), dtype=np.int64)

    def add(self, times: Stamps) -> None:
        """Take the times of messages, (N,) ns."""
        if not len(times):
            return
        if self.first is None:
            self.first = self._last = int(times[0])
        intervals = np.diff(times, prepend=self._last)
        self._note(times, intervals)
        kept = slice(-self._count % self._stride, None, self._stride)
        self._times.frombytes(times[kept].tobytes())
        self._intervals.frombytes(intervals[kept].tobytes())
        self._count, self._last = self._count + len(times), int(times[-1])
        while len(self._times) > _KEPT:
            self._times, self._intervals = self._times[::2], self._intervals[::2]
            self._stride *= 2

    def _note(self, times: Stamps, intervals: Stamps) -> None:
        """Keep the longest intervals."""
        least = self._longest[:, 0].min() if len(self._longest) == _LISTED else np.iinfo(np.int64).min
        long = np.flatnonzero(intervals > least)
        if len(long):
            new = np.column_stack((intervals[long], times[long] - intervals[long], self._count + long))
            both = np.concatenate((self._longest, new))
            self._longest = both[np.argsort(-both[:, 0], kind='stable')[:_LISTED]]

    def statistics(self, topic: str, type_name: str, messages: int, origin: int) -> TopicStatistics:
        """Return what there is to say.

        Parameters
        ----------
        topic, type_name : full names
        messages : number of messages that the bag claims to hold
        origin : ns, the time that counts as zero
        """
        span = 0.0 if self.first is None else 1e-9 * (self._last - self.first)
        return TopicStatistics(
            topic=topic,
            type=type_name,
            messages=messages,
            rate=(messages - 1) / span if span > 0.0 else float('nan'),
            gaps=self._gaps(origin),
            course=self._course(origin, span),
        )

    def _gaps(self, origin: int) -> tuple[tuple[float, float], ...]:
        """Return (begin, length), s, of the longest intervals without a message, in order."""
        if len(self._intervals) < 2:
            return ()
        usual = max(1e-9 * float(np.median(np.array(self._intervals)[1:])), 1e-9)
        in_order = self._longest[np.argsort(self._longest[:, 2])]
        gaps = ((1e-9 * (int(begin) - origin), 1e-9 * int(length)) for length, begin, _ in in_order)
        return tuple((begin, length) for begin, length in gaps if length > _GAP * usual)

    def _course(self, origin: int, span: float) -> tuple[tuple[float, float], ...]:
        """Return (time, rate), s and Hz, of pieces of the run with equal numbers of messages."""
        times = 1e-9 * (np.array(self._times, dtype=np.int64) - origin)
        pieces = min(_PIECES, len(times) // 8)
        if pieces < 2 or span <= 0.0:
            return ()
        edges = np.linspace(0, len(times) - 1, pieces + 1).astype(int)
        begin, end = times[edges[:-1]], times[edges[1:]]
        rate = self._stride * np.diff(edges) / np.maximum(end - begin, 1e-9)
        return tuple((float(time), float(each)) for time, each in zip(0.5 * (begin + end), rate, strict=True))
