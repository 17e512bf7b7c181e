"""When the messages of a topic arrived: rate, gaps, course."""

from __future__ import annotations

from array import array

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Stamps
from mbaid_ros.replay.results import TopicStatistics

_PIECES = 120  # points of the rate's course
_GAP = 3.0  # usual intervals that make a gap
_LISTED = 20  # gaps that are kept, the longest


class Arrivals:
    """Collects the times at which a topic's messages were recorded."""

    def __init__(self) -> None:
        self._times = array('q')

    def add(self, times: Stamps) -> None:
        """Take the times of messages, (N,) ns."""
        self._times.frombytes(times.tobytes())

    def statistics(self, topic: str, type_name: str, messages: int, origin: int) -> TopicStatistics:
        """Return what there is to say.

        Parameters
        ----------
        topic, type_name : full names
        messages : number of messages that the bag claims to hold
        origin : ns, the time that counts as zero
        """
        times = 1e-9 * (np.array(self._times, dtype=np.int64) - origin)
        span = float(times[-1] - times[0]) if len(times) else 0.0
        return TopicStatistics(
            topic=topic,
            type=type_name,
            messages=messages,
            rate=(messages - 1) / span if span > 0.0 else float('nan'),
            gaps=_gaps(times),
            course=_course(times, span),
        )

    @property
    def first(self) -> int | None:
        """The first time, ns."""
        return self._times[0] if self._times else None


def _gaps(times: Array) -> tuple[tuple[float, float], ...]:
    """Return (begin, length), s, of the longest intervals without a message, in order."""
    intervals = np.diff(times)
    if not len(intervals):
        return ()
    long = np.flatnonzero(intervals > _GAP * max(float(np.median(intervals)), 1e-9))
    longest = np.sort(long[np.argsort(-intervals[long], kind='stable')][:_LISTED])
    return tuple((float(times[index]), float(intervals[index])) for index in longest)


def _course(times: Array, span: float) -> tuple[tuple[float, float], ...]:
    """Return (time, rate), s and Hz, of pieces of the run with equal numbers of messages."""
    pieces = min(_PIECES, len(times) // 8)
    if pieces < 2 or span <= 0.0:
        return ()
    edges = np.linspace(0, len(times) - 1, pieces + 1).astype(int)
    begin, end = times[edges[:-1]], times[edges[1:]]
    rate = np.diff(edges) / np.maximum(end - begin, 1e-9)
    return tuple((float(time), float(each)) for time, each in zip(0.5 * (begin + end), rate, strict=True))
