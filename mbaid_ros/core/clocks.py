"""Clocks: stamps that jump, come late or in patterns; offset and drift of the joints' stamps."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import Counter, OrderedDict, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from mbaid_ros.core.contracts import CLEAR, Convention, Linear, Motion, NominalModel, Unknown, Words, converted
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.noise import white_noise
from mbaid_ros.core.outliers import REPEATED
from mbaid_ros.core.repair import Conversion, Repair, wider_prior
from mbaid_ros.core.results.estimate import with_band
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import NO_STAMP, BaseStream, ImuStream, JointStream, Stamps
from mbaid_ros.core.windows import Window
from mbaid_ros.parameters import parameter

ZERO_STAMP = 'stamp is zero'
BAD_NANOSEC = 'nanosec of the stamp is 1e9 or more'
STRAY_STAMP = 'stamp far from those before and after'
OTHER_CLOCK = 'stamp from before the other topic jumped back in time'
LATE = 'stamp before one that was already used'
# A message that was this much late shows that others may be a little later still.
_MARGIN = 1.5
Stream = TypeVar('Stream', JointStream, BaseStream, ImuStream)
_REMEMBERED = 20_000  # stamps of a topic, among which those of late copies are looked for
LARGEST_BACKLOG = 100_000  # measurements of one stream waiting for the other: more are memory without an end
Found = tuple[str, int, str]  # symptom, from which stamp on (ns), and in words
_SKIPPED = 10  # intervals, before which the mean is not known
_PATTERN = 60  # intervals that show a pattern
_SECOND = 1_000_000_000  # ns
_MANY = 3  # readings a second, which no clock stamps all at its begin
_REPEATS = 0.5  # share of repeated stamps, from which they are rounded: copies of messages are fewer
_SHORT, _BATCHED = 0.2, 0.4  # part of the mean interval that is short; share of such ones: of random ones it is a fifth
_STEP = 50_000_000  # ns, that a clock is set by at least: less is jitter, or messages that overtake each other
_LONGEST = 200_000_000  # ns between readings around a step: of slower ones the motion is not known
_EVEN = 0.5  # part of the usual interval, that those around a step differ by: others are no regular stamps
_REGULAR = 0.02  # the same around a step of less than _STEP: jitter makes a short interval after a long one
_GAP = 5.0  # usual intervals that make a gap
_STEADY, _MISSING = 0.2, 0.3  # part by which the speed changes over a gap, and of its motion that is there at most
_PLAIN = 50.0  # standard deviations that a gap's motion should be at least
_AROUND = 6  # readings that a step is looked at with, before and after
# Readings of a block, whose rate and scatter are compared; blocks, at most and at least; least correlation of the two;
# times the rest, that the scatter by the rate is at least; s of jitter, of which less is common.
_BLOCK, _BLOCKS, _ENOUGH, _ALONG, _MOSTLY, _JITTER = 60, 200, 12, 0.7, 4.0, 1e-3
_EVEN = 0.5  # of the usual interval, by which those of a block may differ from it
_COARSE = 0.1  # share of readings that repeat: the scatter of coarse encoders grows with the rate as well
# Part of the unevenness of stamps that readings follow: those that were measured then follow all of it, up to so many
# standard deviations; s of it, of which less does no harm; part of a block from which stamps are cut, and not uneven.
_FOLLOWED, _SURELY, _HARMLESS, _UNREAL = 0.5, 4.0, 2e-3, 0.1
_UNUSUAL, _LEAST_STEP = 20.0, 1e-3  # times the usual unevenness, and s at least, of a step of the stamps
# Part of the readings of a block that is smooth by their number: a polynomial, by an orthonormal basis (_BLOCK, 6).
_SMOOTH = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, _BLOCK), 6, increasing=True))[0]
OFFSET, CLOCK, POSITION_LATE = 'time offset', 'clock drift', 'position late'
_LARGEST_DRIFT = 0.01  # of time_offset.drift_std
# s, late or early by 50 ms to half a second: less is within the prior of the time offset.
_DELAYS = 0.05 * np.concatenate((np.arange(-10, 0), np.arange(1, 11)))


class Gate:
    """Collects the messages of one stream.

    Parameters
    ----------
    threshold : ns, difference between consecutive stamps that counts as a jump

    Attributes
    ----------
    messages : those that have passed, in the order of arrival
    newest : ns, latest stamp that passed; None before the first
    epoch : number of jumps back so far
    dropped : messages that did not pass, by cause
    """

    def __init__(self, threshold: int) -> None:
        self._threshold = threshold
        self._suspect: tuple[int, Any] | None = None
        self.messages: list[Any] = []
        self.newest: int | None = None
        self._first = 0  # ns, first stamp since the latest jump back
        self._ended = 0  # ns, of the times between jumps back
        self.epoch = 0
        # The latest stamps that passed since the latest jump back, in order.
        self._passed: OrderedDict[int, None] = OrderedDict()
        self._copied = False  # whether a copy came between messages that went on
        self.dropped: Counter[str] = Counter()

    def add(self, stamp: int, message: Any) -> int:
        """Add a message; return the size (ns) of a jump back in time before it, else 0.

        Copies that come late between messages that go on are no jump.

        After a jump back, `messages` holds those before it; `confirm_jump` adds those after it.
        """
        newest = self.newest
        if stamp == NO_STAMP:
            self.dropped[BAD_NANOSEC] += 1
            return 0
        if newest is not None and not -self._threshold <= stamp - newest <= self._threshold:
            return self._far(stamp, message, newest)
        if stamp == 0 and newest is not None:  # a run of simulated time may begin with it, once
            self.dropped[ZERO_STAMP] += 1
            return 0
        if self._suspect is not None:
            self._drop_suspect()
        self.messages.append(message)
        self._remember((stamp,))
        if newest is None:
            self._first = stamp
        if newest is None or stamp > newest:
            self.newest = stamp
        return 0

    @property
    def span(self) -> int:
        """Time from the first stamp to the latest, ns, without what jumps back repeat; 0 before the first."""
        return self._ended + (0 if self.newest is None else self.newest - self._first)

    def all_pass(self, stamp: Stamps) -> bool:
        """Return whether messages with these stamps (N,) all pass at once."""
        if not len(stamp):
            return True
        if self.newest is None or self._suspect is not None or np.any(stamp == NO_STAMP):
            return False
        steps = stamp - self._newest_before(stamp)
        return bool(np.all(np.abs(steps) <= self._threshold) and np.all(stamp != 0))

    def add_regular(self, stamp: Stamps, messages: Sequence[Any]) -> None:
        """Add messages that all pass according to `all_pass`, with their stamps (N,); some may be together."""
        if len(stamp):
            self.messages += messages
            self._remember(stamp.tolist())
            self.newest = max(int(self._newest_before(stamp)[-1]), int(stamp[-1]))

    def confirm_jump(self, message: Any) -> None:
        """Pass the two messages after a jump back: the one held, and `message`, which confirmed it."""
        if self._suspect is not None:
            self.messages += (self._suspect[1], message)
            self._suspect = None

    def _remember(self, stamps: Sequence[int]) -> None:
        """Keep stamps that passed, to know copies by."""
        self._passed.update(dict.fromkeys(stamps))
        while len(self._passed) > _REMEMBERED:
            self._passed.popitem(last=False)

    def pop_all(self) -> list[Any]:
        """Return the messages that have passed and forget them."""
        messages, self.messages = self.messages, []
        return messages

    def _newest_before(self, stamp: Stamps) -> Stamps:
        """Return the latest stamp before each of some messages that all pass."""
        return np.maximum.accumulate(np.concatenate((np.array([self.newest], dtype=np.int64), stamp[:-1])))

    def _far(self, stamp: int, message: Any, newest: int) -> int:
        """Add a message whose stamp is far from the newest; zero may be the begin of simulated time."""
        held = self._suspect
        if self._copied and stamp in self._passed:
            self.dropped[REPEATED] += 1
            return 0
        if stamp == 0 and held is not None:
            self.dropped[ZERO_STAMP] += 1
            return 0
        agrees = held is not None and (held[0] > newest) == (stamp > newest) and stamp >= held[0] - self._threshold
        if held is not None and held[0] == 0 and stamp > self._threshold:
            agrees = False
        if held is None or not agrees:
            self._drop_suspect()
            self._suspect = (stamp, message)
            return 0
        if held[0] > newest:  # time goes on after a gap
            self._suspect = None
            self.messages.append(held[1])
            self.newest = held[0]
            return self.add(stamp, message)
        self.epoch += 1
        self._passed, self._copied = OrderedDict(), False
        self._ended, self._first = self.span, min(held[0], stamp)
        self.newest = max(held[0], stamp)
        return newest - held[0]

    def _drop_suspect(self) -> None:
        if self._suspect is not None:
            copied = self._suspect[0] in self._passed
            self._copied |= copied
            self.dropped[REPEATED if copied else STRAY_STAMP if self._suspect[0] else ZERO_STAMP] += 1
            self._suspect = None


class Reorder(Generic[Stream]):
    """Puts one stream in order; the result does not depend on how it is cut into calls.

    Nothing waits until a stamp comes late for the first time. That one is lost; from then on measurements wait as long
    as it was late, and half as much again.

    Parameters
    ----------
    limit : ns, longest time that a measurement may wait for others

    Attributes
    ----------
    hold : ns, time that measurements wait now
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._waiting: Stream | None = None  # in order
        self._newest: int | None = None
        self._released: int | None = None
        self.hold = 0
        self.dropped: Counter[str] = Counter()

    def push(self, stream: Stream | None) -> Stream | None:
        """Add measurements; return those released, in order, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        if self.hold == 0 and self._in_order(stream.stamp):
            self._newest = self._released = int(stream.stamp[-1])
            return stream
        joined = stream if self._waiting is None else stream.concatenate((self._waiting, stream))
        held = len(joined.stamp) - len(stream.stamp)
        released, waiting = self._sort(joined.stamp.tolist(), held)
        self._waiting = joined[np.array(waiting, dtype=np.intp)]
        return joined[np.array(released, dtype=np.intp)] if released else None

    def _in_order(self, stamp: Stamps) -> bool:
        after = self._released is None or stamp[0] > self._released
        return bool(after and np.all(stamp[1:] > stamp[:-1]))

    def _sort(self, stamps: list[int], held: int) -> tuple[list[int], list[int]]:
        """Return the indices of the measurements released, in order, and of those that wait on."""
        waiting = [(stamp, index) for index, stamp in enumerate(stamps[:held])]
        released: list[int] = []
        for index in range(held, len(stamps)):
            stamp = stamps[index]
            if self._accepted(stamp, waiting):
                insort(waiting, (stamp, index))
                self._newest = stamp if self._newest is None else max(self._newest, stamp)
                ready = bisect_left(waiting, (self._newest - self.hold + 1,))
                if ready:
                    released += (place for _, place in waiting[:ready])
                    self._released = waiting[ready - 1][0]
                    del waiting[:ready]
        return released, [place for _, place in waiting]

    def _accepted(self, stamp: int, waiting: list[tuple[int, int]]) -> bool:
        """Return whether a stamp is new and not too late; adapt the waiting time to one that is late."""
        place = bisect_left(waiting, (stamp,))
        if stamp == self._released or (place < len(waiting) and waiting[place][0] == stamp):
            self.dropped[REPEATED] += 1
            return False
        if self._released is None or self._newest is None or stamp > self._released:
            return True
        self.dropped[LATE] += 1
        late = self._newest - stamp
        if late <= self._limit:
            self.hold = max(self.hold, min(round(_MARGIN * late), self._limit))
        return False


class StampPattern:
    """Follows the stamps of one kind of messages; the result does not depend on how they are cut into calls.

    Parameters
    ----------
    what : the messages, in words
    noise : standard deviation of the positions, rad or m
    """

    def __init__(self, what: str, noise: float) -> None:
        self._what, self._noise = what, noise
        self._first, self._count, self._short = 0, 0, 0
        self._equal, self._largest = 0, 0  # stamps that repeat the one before; ns, the largest part of a second
        self._stamp: Stamps = np.zeros(0, dtype=np.int64)
        self._position: Array = np.zeros((0, 0))
        # Readings of the block that is open; by block and column, squared rates and scatter; and whether that is named.
        self._open: tuple[Stamps, Array] = self._stamp, self._position
        self._blocks: deque[Array] = deque(maxlen=_BLOCKS)
        self._repeated = self._number = 0  # readings in blocks that repeat, and all of them
        self._uneven = UnevenStamps(what, noise)
        self._jitters = False

    def add(self, stamp: Stamps, position: Array) -> Iterator[Found]:
        """Add readings (N,), (N, k), in the order of arrival; yield the faults of their stamps."""
        if not len(stamp):
            return
        if not self._count:
            self._first, self._position = int(stamp[0]), position[:0]
        begin = self._count - len(self._stamp)  # number of the first of the readings that are kept
        yield from self._resolution(stamp)
        yield from self._batches(stamp)
        yield from self._jitter(stamp, position)
        self._stamp = np.concatenate((self._stamp, stamp))
        self._position = np.concatenate((self._position, position))
        interval = np.diff(self._stamp)
        before = np.concatenate((interval[:1], interval[:-1]))
        gap = interval > np.maximum(_STEP, _GAP * before)
        early = (interval != 0) & (interval < _EVEN * before)
        for place in np.flatnonzero((interval < -_STEP) | gap | early).tolist():
            if _AROUND - 1 <= place <= len(interval) - _AROUND and begin + place > _PATTERN:
                yield from self._step(place, (int(self._stamp[place]) - self._first) / (begin + place))
        keep = 2 * _AROUND - 1
        self._stamp, self._position = self._stamp[-keep:], self._position[-keep:]

    def _resolution(self, stamp: Stamps) -> Iterator[Found]:
        """Yield that most stamps are those of the reading before: they are rounded."""
        joined = np.concatenate((self._stamp[-1:], stamp))
        equal = np.diff(joined) == 0
        number = self._count + len(stamp) - len(equal) + 1 + np.arange(len(equal))
        repeats = self._equal + np.cumsum(equal)
        largest = np.maximum(self._largest, np.maximum.accumulate(joined[1:] % _SECOND))
        known = np.flatnonzero(number > _PATTERN)
        rounded = known[repeats[known] > _REPEATS * number[known]]
        if len(rounded):
            whole = largest[rounded[0]] == 0
            how = 'whole seconds: fill in nanosec of header.stamp' if whole else 'rounded: publish all digits'
            text = f'most stamps of {self._what} repeat the one before, they are {how}'
            yield f'rounded: {self._what}', int(joined[1:][rounded[0]]), text
        # So many in a second, and all at its begin.
        often = (number[known] - 1) * _SECOND > _MANY * (joined[1:][known] - self._first)
        begun = known[often & (largest[known] > 0) & (largest[known] < _SECOND // 1000)]
        if len(begun):
            unit, factor = ('milliseconds', 10**6) if largest[begun[0]] < 1000 else ('microseconds', 1000)
            text = (
                f'nanosec of the stamps of {self._what} is {largest[begun[0]]} at most: {unit}, not nanoseconds; '
                f'multiply it by {factor}'
            )
            yield f'nanosec: {self._what}', int(joined[1:][begun[0]]), text
        if len(equal):
            self._equal, self._largest = int(repeats[-1]), int(largest[-1])

    def _batches(self, stamp: Stamps) -> Iterator[Found]:
        """Yield that most messages are stamped right after each other, and then none for long."""
        joined = np.concatenate((self._stamp[-1:], stamp))
        interval = np.diff(joined)
        number = self._count + 1 + np.arange(len(stamp))  # readings up to each
        mean = (stamp - self._first) / np.maximum(number - 1, 1)
        interval = np.concatenate((np.full(len(stamp) - len(interval), np.iinfo(np.int64).max), interval))
        short = self._short + np.cumsum((interval < _SHORT * mean) & (interval > 0) & (number > _SKIPPED))
        self._count, self._short = int(number[-1]), int(short[-1])
        batched = np.flatnonzero((number > _PATTERN) & (short > _BATCHED * number))
        if len(batched) and not 0 < self._largest < _SECOND // 1000:
            size = 1.0 / max(1.0 - short[batched[0]] / (number[batched[0]] - _SKIPPED), 0.01)
            text = (
                f'{self._what} come in batches of about {size:.0f}, stamped right after each other: stamped on '
                'arrival, not when they were measured; stamp them in the driver'
            )
            yield f'batches: {self._what}', int(stamp[batched[0]]), text

    def _jitter(self, stamp: Stamps, position: Array) -> Iterator[Found]:
        """Yield that readings scatter by a time times their rate: they are not those of their stamps."""
        if self._jitters or not position.shape[1]:
            return
        kept = self._open if len(self._open[0]) else (stamp[:0], position[:0])
        stamp, position = np.concatenate((kept[0], stamp)), np.concatenate((kept[1], position))
        whole = len(stamp) - len(stamp) % _BLOCK
        self._open = stamp[whole:], position[whole:]
        for begin in range(0, whole, _BLOCK):
            own, time = position[begin : begin + _BLOCK], stamp[begin : begin + _BLOCK]
            yield from self._uneven.add(time, own)
            interval = np.diff(time)
            if np.max(np.abs(interval - np.median(interval))) > _EVEN * np.median(interval):
                continue  # readings are missing: differences between them are not those of a regular series
            duration = max(1e-9 * float(time[-1] - time[0]), 1e-9)
            self._blocks.append(np.stack((((own[-1] - own[0]) / duration) ** 2, white_noise(own, 4) ** 2)))
            self._repeated += int(np.sum(np.diff(own, axis=0) == 0.0))
            self._number += own.size
            jitter = self._scatter_in_time()
            if jitter > _JITTER:
                self._jitters = True
                text = (
                    f'{self._what} scatter by {1e3 * jitter:.2g} ms times their rate: the stamps jitter, or the '
                    'readings are older than them by chance; stamp each reading when it is measured'
                )
                yield f'jitter: {self._what}', int(time[-1]), text
                return

    def _scatter_in_time(self) -> float:
        """Return the s by which readings scatter along their motion; 0 where something else makes the scatter."""
        if len(self._blocks) < _ENOUGH or self._repeated > _COARSE * self._number:
            return 0.0
        rate, scatter = np.swapaxes(np.array(self._blocks), 0, 1)
        away, beyond = rate - np.mean(rate, axis=0), scatter - np.mean(scatter, axis=0)
        products, squares = float(np.sum(away * beyond)), float(np.sum(away**2))
        if products <= _ALONG * np.sqrt(squares * np.sum(beyond**2)) or squares == 0.0:
            return 0.0
        slope, mean = products / squares, float(np.mean(rate))
        rest = max(float(np.mean(scatter)) - slope * mean, self._noise**2)
        return float(np.sqrt(slope)) if slope * mean > _MOSTLY * rest else 0.0

    def _step(self, place: int, usual: float) -> Iterator[Found]:
        """Yield that a clock was set between the reading at a place and the next one; `usual` interval in ns."""
        around = np.diff(self._stamp[place - _AROUND + 1 : place + _AROUND + 1]).astype(float)
        step = float(around[_AROUND - 1])
        around = np.delete(around, _AROUND - 1)
        even = _EVEN if abs(step) > _STEP else _REGULAR
        if usual <= 0.0 or np.any(around > _LONGEST) or np.any(np.abs(around - usual) > even * usual):
            return
        at = 1e-9 * (int(self._stamp[place]) - self._first)
        since = int(max(self._stamp[place], self._stamp[place + _AROUND]))  # windows before a step back are out already
        if step < _EVEN * usual:
            back = 1e-9 * (float(np.mean(around)) - step)
            text = (
                f'the stamps of {self._what} went back by {back:.2g} s at {at:.1f} s: a clock was set; readings '
                'stamped twice are left out, later ones are wrong if no other clock was set'
            )
            yield f'set back: {self._what}', since, text
        elif self._goes_on(place, step):
            text = f'the stamps of {self._what} went forward by {1e-9 * step:.2g} s at {at:.1f} s without the motion: '
            yield f'set forward: {self._what}', since, f'{text}a clock was set'

    def _goes_on(self, place: int, step: float) -> bool:
        """Return whether the readings around a gap (ns) move as if it were none."""
        stamp, position = self._stamp.astype(float), self._position
        before, after = (
            (position[one] - position[other]) / (stamp[one] - stamp[other])
            for one, other in ((place, place - _AROUND + 1), (place + _AROUND, place + 1))
        )
        speed = 0.5 * (before + after)
        steady = np.abs(after - before) < _STEADY * np.abs(speed)
        expected = np.abs(speed * step)
        moved = np.abs(position[place + 1] - position[place])
        plain = steady & (expected > _PLAIN * self._noise)
        return bool(np.any(plain)) and bool(np.all(moved[plain] < _MISSING * expected[plain]))


class UnevenStamps:
    """Compares blocks of readings with uneven stamps: those that were measured then are as uneven.

    Parameters
    ----------
    what : the messages, in words
    noise : standard deviation of the readings
    """

    def __init__(self, what: str, noise: float) -> None:
        self._what, self._noise = what, noise
        self._first: int | None = None
        self._before: tuple[Stamps, Array] | None = None  # the block before
        self._blocks: deque[Array] = deque(maxlen=_BLOCKS)  # as of `_unevenness`

    def add(self, stamp: Stamps, position: Array) -> Iterator[Found]:
        """Add a block (_BLOCK,), (_BLOCK, k) of readings; yield the faults of its stamps."""
        self._first = int(stamp[0]) if self._first is None else self._first
        interval = np.diff(stamp)
        # Over a gap neither stamps nor readings need be smooth by their number.
        if np.max(interval) <= max(_LONGEST, _GAP * float(np.median(interval))):
            self._blocks.append(_unevenness(stamp, position))
        if len(self._blocks) >= _ENOUGH:
            jitter = self._alone(np.sum(self._blocks, axis=0))
            if _HARMLESS < jitter < _UNREAL * 1e-9 * float(np.ptp(stamp)):
                text = (
                    f'the stamps of {self._what} jitter by {1e3 * jitter:.2g} ms, the readings do not: stamped on '
                    'arrival, or rounded; stamp each reading when it is measured'
                )
                yield f'jitter: {self._what}', int(stamp[-1]), text
        if self._before is not None:
            joined = np.concatenate((self._before[0], stamp)), np.concatenate((self._before[1], position))
            yield from self._steps(*joined)
        self._before = stamp, position

    def _alone(self, sums: Array) -> float:
        """Return the s by which the stamps of blocks are uneven by their sums; 0 if the readings may be as well."""
        number, uneven, squares, products, rest = sums.tolist()
        if products >= _FOLLOWED * squares:
            return 0.0
        noise = max(float(np.sqrt(max(rest - products**2 / squares, 0.0) / number)), self._noise)
        return float(np.sqrt(uneven / number)) if squares - products > _SURELY * noise * np.sqrt(squares) else 0.0

    def _steps(self, stamp: Stamps, position: Array) -> Iterator[Found]:
        """Yield a step of the stamps in the middle of two blocks, by a part of the intervals or a few of them."""
        interval = np.diff(stamp)
        usual = float(np.median(interval))
        off = interval - usual
        least = max(_UNUSUAL * float(np.median(np.abs(off))), _REGULAR * usual, 1e9 * _LEAST_STEP)
        single = (np.abs(off) > least) & (interval >= _EVEN * usual) & (interval <= max(_STEP, _GAP * usual))
        half = _BLOCK // 2
        for place in half + np.flatnonzero(single[half : half + _BLOCK]):
            around = slice(place + 1 - half, place + 1 + half)
            others = np.delete(off[around.start : around.stop - 1], half - 1)
            if np.max(np.abs(others)) < least and self._alone(_unevenness(stamp[around], position[around])):
                text = (
                    f'the stamps of {self._what} step by {1e-6 * float(off[place]):+.2g} ms at '
                    f'{1e-9 * (int(stamp[place]) - (self._first or 0)):.1f} s, the readings do not: a clock was set; '
                    'synchronise it by its rate'
                )
                yield f'step: {self._what}', int(stamp[around][-1]), text


def _unevenness(stamp: Stamps, position: Array) -> Array:
    """Return sums over a block: the number of readings, and squares and products of two parts that are not smooth.

    They are how late stamps are, s^2; how far the readings would move by that, and how far they do.
    """
    time = 1e-9 * (stamp - stamp[0])
    late = _rest(time[:, None], 2)
    smooth = _SMOOTH @ (_SMOOTH.T @ position)
    meant = _rest(np.gradient(smooth, axis=0) * late) * (_BLOCK - 1) / max(float(time[-1]), 1e-9)
    read, columns = _rest(position), position.shape[1]
    return np.array([position.size, columns * np.sum(late**2), np.sum(meant**2), np.sum(meant * read), np.sum(read**2)])


def _rest(values: Array, numbers: int = 6) -> Array:
    """Return values (_BLOCK, k) without what a polynomial of so many numbers fits."""
    basis = _SMOOTH[:, :numbers]
    return values - basis @ (basis.T @ values)


@dataclass(frozen=True)
class TimeOffsetConfig:
    """A constant offset between the stamps of JointState and Odometry."""

    estimate: bool = parameter(default=True)
    """Estimate how late JointState is stamped relative to Odometry (trajectory only)."""
    prior_std: float = parameter(0.02, 's', minimum=0.0, exclusive_minimum=True)
    """Prior standard deviation of the time offset between JointState and Odometry, about zero."""
    drift_std: float = parameter(5e-5, minimum=0.0, maximum=0.01)
    """Standard deviation of the drift between the clocks of JointState and Odometry, s a second: 2e-5 for a computer's
    own quartz; 0: one clock, or synchronised clocks."""


@dataclass(frozen=True, eq=False)
class TimeOffset(Unknown):
    """A constant delay of the joints' stamps, s. A pose error that comes of joints tau too late is -tau (w, v)."""

    words: ClassVar = {
        OFFSET: Words(
            remedy='the offset between the stamps: more motion determines it',
            deviation=lambda _, value: f'the joints are stamped {1e3 * np.sum(value):+.3g} ms late: check the stamps',
        )
    }
    of_measurement = True
    in_equations = False  # of the measured motion at one instant

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the offset as uncertain as it is large."""
        del cause, kernel
        found = f'the joints are stamped {with_band(value, std, 1e3)} ms late'
        return _estimated(wider_prior(found, 'time_offset.prior_std', value, std, 's'))

    def measured(self, sensor: str, motion: Motion) -> Array:
        """Return how much further on any sensor of the base reads."""
        del sensor
        return motion.slope[..., None]

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return the delay that the joints are taken later by: none, unless it is clearly one."""
        return np.where(np.abs(value) > CLEAR * deviation, value, 0.0)

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this delay."""
        return replace(nominal, delay=nominal.delay + float(value[0]))


def time_offset(deviation: float) -> TimeOffset:
    """Return the offset as an unknown, of a standard deviation, s."""
    return TimeOffset(np.array([[deviation]]), (OFFSET,))


@dataclass(frozen=True, eq=False)
class ClockDrift(Linear):
    """How fast the joints' clock runs, s/s: a delay that grows with time since the run began.

    The momentum is then that of the joints' clock. Linear, as far as the base's motion is over that delay: to some
    50 ms, eight minutes at 100 ppm.
    """

    words: ClassVar = {
        CLOCK: Words(
            remedy='the drift between the clocks of joints and odometry: synchronise them (time_offset.drift_std)',
            deviation=lambda _, value: (
                f'the clocks drift apart by {1e6 * np.sum(value):+.3g} ppm: synchronise them, or raise '
                'time_offset.drift_std'
            ),
        )
    }

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the drift as uncertain as it is large."""
        del cause, kernel
        found = f'the clocks drift apart by {with_band(value, std, 1e6)} ppm'
        return _estimated(wider_prior(found, 'time_offset.drift_std', value, std, most=_LARGEST_DRIFT))

    def measured(self, sensor: str, motion: Motion) -> Array:
        """Return how much further on any sensor of the base reads, and how much faster by the joints' clock."""
        del sensor
        return (motion.time[:, None] * motion.slope + motion.rate)[..., None]


def _estimated(repair: Repair) -> Repair:
    """Return the repair of a clock, which is estimated even where the parameters had forbidden it."""
    return replace(repair, parameters={'time_offset.estimate': True} | dict(repair.parameters or {}))


def clock_drift(deviation: float) -> ClockDrift:
    """Return the drift as an unknown, of a standard deviation, s/s."""
    return ClockDrift(np.array([[deviation]]), (CLOCK,))


@dataclass(frozen=True, eq=False)
class PositionLate(Linear):
    """By how much the position is behind the orientation of the same pose, s: a message of two sources."""

    words: ClassVar = {
        POSITION_LATE: Words(
            deviation=lambda _, value: (
                f'the position of the odometry is {1e3 * np.sum(value):+.3g} ms late against its orientation: two '
                'sources in one message; publish both of one time'
            )
        )
    }

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return the earlier position."""
        return np.where(np.arange(6) < 3, 0.0, -motion.twist)[..., None] if sensor == 'pose' else None


def position_late(deviation: float) -> PositionLate:
    """Return the delay of the position as an unknown, of a standard deviation, s."""
    return PositionLate(np.array([[deviation]]), (POSITION_LATE,))


def joints_stamped_late(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield joints that are stamped too late or too early."""
    for delay in _DELAYS.tolist():
        more = ' or more' if abs(delay) == _DELAYS[-1] else ''
        how = f'{1e3 * abs(delay):.0f} ms{more} {"late" if delay > 0.0 else "early"}'
        text = (
            f'the joints are stamped some {how} against the poses: correct the stamps, or raise time_offset.prior_std'
        )
        repair = replace(converted(text, Conversion(delay=delay)), value=delay, unit='s')
        yield Convention(text, kernel, partial(restamped, delay=delay), delay=delay, repair=repair)


def restamped(windows: Sequence[Window], delay: float = 0.0, rate: float = 1.0) -> list[Window]:
    """Return windows with joints whose stamps are late by a delay, s, and run so fast; those that were read by then."""
    times = [each.start + each.spacing * (np.arange(len(each.knots)) - each.inside.start) for each in windows]
    # Windows share knots with their neighbours.
    every, place = np.unique(np.round(np.concatenate(times), 6), return_index=True)
    values = np.concatenate([each.knots.joint_position for each in windows])[place]
    known = np.isfinite(values).all(axis=1)
    every, values = every[known], values[known]
    moved = []
    for each, own in zip(windows, times, strict=True):
        read = np.isfinite(each.knots.joint_position).all(axis=1)
        then, position = np.round(rate * own + delay, 6), np.full_like(each.knots.joint_position, np.nan)
        if np.all((then >= every[0]) & (then <= every[-1]) | ~read):
            position[read] = np.column_stack([np.interp(then[read], every, joint) for joint in values.T])
            moved.append(replace(each, knots=replace(each.knots, joint_position=position)))
    return moved


def declared_offset(config: TimeOffsetConfig, *, jointed: bool = True) -> TimeOffset:
    """Return the offset of the joints' stamps; none where there are no joints."""
    return time_offset(config.prior_std if config.estimate and jointed else 0.0)


def declared_drift(config: TimeOffsetConfig, *, jointed: bool = True) -> ClockDrift:
    """Return the drift of the joints' clock; none where there are no joints."""
    return clock_drift(config.drift_std if config.estimate and jointed else 0.0)
