"""JointState messages as one stream of joints: names, bytes, merged publishers, full turns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.clocks import LARGEST_BACKLOG, Reorder
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.outliers import QUARTILE_OF_ONE, Channels
from mbaid_ros.core.samples import (
    JOINT_MISSING,
    JOINT_STATE_TYPE,
    LENGTH_MISMATCH,
    MOST_NAMES,
    NAMED_TWICE,
    NOT_FINITE,
    NOT_REAL,
    TOO_MANY_NAMES,
    Cursor,
    JointStream,
    PacketLayout,
    Packets,
    Stamps,
    number_of,
    stamps_of,
)

# rad from one reading to the next by the velocity: compared with the positions, and trusted more than the shorter way.
_COMPARED, _FAST = 0.1, 0.5 * np.pi
_AGREES = 0.5  # rad, and times the step, that positions and velocities may differ by
_TRUSTED = 0.5  # share of the steps compared so far, in which they agree
NO_PARTNER = 'no message with the other joints around the stamp'
PARTNER_GAP = 'gap in the messages with the other joints'
OFTEN = 'more often than the messages with the other joints'
REDUNDANT = 'joints that are also in other messages'
# Standard deviations that a part changes by from one message to the next while it rests: a message of joints at rest
# may serve several times, as nothing of it is interpolated.
_STILL = 6.0
_GOES_ON = 1_000_000_000  # ns, that messages with all joints may pause
_NEVER = -(1 << 62)  # ns
_AT_REST = 10  # times the longest interpolated interval, that such messages may be apart
Joints = tuple[int, ...]  # indices in the model
_LARGEST_JOINT = 1e6  # rad, m
_LARGEST_VELOCITY = 1e6  # m/s, rad/s
_NOWHERE = np.zeros(0, dtype=np.intp)


def joint_channels(noise: float) -> tuple[Channels, ...]:
    """Return the joints' positions as channels, of a declared standard deviation in rad or m."""
    return (
        Channels(
            lambda joints: joints.position[:, :, None],
            1.0,
            lambda joints: np.full(joints.position.shape, noise),
            lambda joints: (joints.position - joints.position[0])[:, :, None],
            QUARTILE_OF_ONE,
        ),
    )


class TurnCounter:
    """Counts the whole turns that wrapped angles leave out; the count does not depend on how readings are cut.

    A wheel may turn by more than a half between two readings. Where its velocities have agreed with its positions, they
    predict the step, and the number of turns nearest to that counts; else the shorter way.
    """

    def __init__(self, joints: int) -> None:
        self._last: JointStream | None = None  # latest two readings
        self._count, self._step = np.zeros((2, joints))  # turns so far, and those of the latest step
        self._off = np.zeros(joints, dtype=bool)  # whether that step contradicts the velocity
        self._agreed, self._compared = np.zeros((2, joints))  # steps so far

    def turn_counts(self, stream: JointStream) -> Array:
        """Return the whole turns (N, n) to subtract from the next readings."""
        joined = stream if self._last is None else stream.concatenate((self._last, stream))
        new = len(stream.stamp) - (self._last is None)  # steps
        self._last = joined[-2:]
        if not new:
            return np.zeros((len(stream.stamp), len(self._count)))
        step, expected, change = (each[-new:] for each in position_steps(joined))
        left, size = step - expected, np.abs(expected)
        turns = np.round(left / (2.0 * np.pi))
        agrees = np.abs(left - 2.0 * np.pi * turns) < _AGREES * np.minimum(size, 1.0)
        compared = self._compared + np.cumsum(size > _COMPARED, axis=0)
        agreed = self._agreed + np.cumsum(agrees & (size > _COMPARED), axis=0)
        fast = (size > _FAST) & (agreed >= _TRUSTED * compared)
        turns = np.where(fast, turns, np.round(step / (2.0 * np.pi)))
        off = fast & ~(agrees & (change < _AGREES))  # wrong readings may agree by chance
        if np.any(off | self._off):
            self._skip_wrong_readings(joined, turns, off)
        self._compared, self._agreed = compared[-1], agreed[-1]
        self._step, self._off = turns[-1], off[-1]
        counted = self._count + np.cumsum(turns, axis=0)
        before, self._count = self._count, counted[-1]
        return counted if len(counted) == len(stream.stamp) else np.concatenate((before[None], counted))

    def _skip_wrong_readings(self, joined: JointStream, turns: Array, off: Flags) -> None:
        """Count over single wrong readings, in place: the steps to one and back may not add up."""
        step, expected, change = position_steps(joined, 2)
        across = np.round((step - expected) / (2.0 * np.pi))
        agrees = np.abs(step - expected - 2.0 * np.pi * across) + change < _AGREES
        before, skipped = (self._step, self._off), len(off) - len(step)
        for place in range(len(off)):
            if place >= skipped:
                over = before[1] & off[place] & agrees[place - skipped]
                turns[place] = np.where(over, across[place - skipped] - before[0], turns[place])
                off[place] &= ~over
            before = turns[place], off[place]


def position_steps(stream: JointStream, over: int = 1) -> tuple[Array, Array, Array]:
    """Return the steps of the positions from each reading to one of the next, and those by the mean velocity.

    The last result is how far the latter may be off as the velocity changes; without any velocity they are NaN.
    """
    first, last = stream.velocity[:-over], stream.velocity[over:]
    first, last = np.where(np.isnan(first), last, first), np.where(np.isnan(last), first, last)
    elapsed = 1e-9 * (stream.stamp[over:] - stream.stamp[:-over])[:, None]
    step = stream.position[over:] - stream.position[:-over]
    return step, 0.5 * (first + last) * elapsed, 0.5 * np.abs(last - first) * elapsed


class _Part:
    """The measurements of some joints: in order, angles without jumps of a turn."""

    def __init__(self, joints: Joints, turning: Flags, reorder_limit: int) -> None:
        self.joints = np.array(joints, dtype=np.intp)
        self.reorder = Reorder[JointStream](reorder_limit)
        self._turning = turning[self.joints]
        self._turns = TurnCounter(len(joints))
        self.waiting = JointStream(np.zeros(0, dtype=np.int64), *np.zeros((2, 0, len(joints))))
        self.own: list[int] = []  # columns of the joints that this part is used for

    def push(self, stream: JointStream) -> JointStream | None:
        """Return the measurements that are in order now, unwrapped."""
        ordered = self.reorder.push(stream)
        if ordered is None:
            return None
        # Whole turns are counted, not angles added up: the count is exact however the stream is cut.
        turns = np.where(self._turning, self._turns.turn_counts(ordered), 0.0)
        return JointStream(ordered.stamp, ordered.position - 2.0 * np.pi * turns, ordered.velocity)


class JointMerge:
    """Merges messages by the joints they hold into one stream of all joints.

    Parameters
    ----------
    turning : (n,) True for joints that turn
    maximum_gap, reorder_limit : ns, longest interpolated interval, and longest wait for late messages
    beside : number of the last of n that are no joints: they never set the stamps, and may come less often
    noise : rad or m, standard deviation of a joint position
    """

    def __init__(
        self, turning: Flags, maximum_gap: int, reorder_limit: int, beside: int = 0, noise: float = 0.0
    ) -> None:
        self._turning = turning
        self._joints = len(turning) - beside
        self._maximum_gap = maximum_gap
        self._noise = noise
        self._reorder_limit = reorder_limit
        self._whole = _Part(tuple(range(len(turning))), turning, reorder_limit)
        self._parts: dict[Joints, _Part] = {}
        self._used: Stamps = np.zeros(0, dtype=np.int64)  # latest messages of the other parts; none before the first
        self._own: Counter[str] = Counter()
        self.slow: Joints = ()  # joints whose messages were too far apart
        self._newest = [_NEVER, _NEVER]  # ns, stamps of messages with all joints, and with some

    @property
    def dropped(self) -> Counter[str]:
        """Measurements that were not used, by cause."""
        return sum((part.reorder.dropped for part in self._all()), self._own)

    @property
    def hold(self) -> int:
        """Longest time for which measurements wait now, ns."""
        return max(part.reorder.hold for part in self._all())

    @property
    def partial(self) -> bool:
        """Whether the joints come in parts, and not all at once as well."""
        whole, some = self._newest
        return bool(self._parts) and some > whole + _GOES_ON

    @property
    def missing(self) -> Joints:
        """Joints that were in no message."""
        seen = {int(joint) for part in self._parts.values() for joint in part.joints}
        return tuple(joint for joint in range(len(self._turning)) if joint not in seen)

    @property
    def newest(self) -> dict[Joints, int]:
        """Latest stamp (ns) of each kind of message with some of the joints."""
        parts = self._parts.items()
        return {joints: int(part.waiting.stamp[-1]) for joints, part in parts if len(part.waiting)}

    def push(self, streams: dict[Joints, JointStream]) -> JointStream | None:
        """Add measurements by their joints, in the order of arrival; return those of all joints."""
        whole = streams.get(tuple(range(len(self._turning))))
        some = {joints: stream for joints, stream in streams.items() if stream is not whole}
        for place, given in enumerate(([] if whole is None else [whole], some.values())):
            self._newest[place] = max(
                (self._newest[place], *(int(each.stamp[-1]) for each in given if len(each.stamp)))
            )
        for joints in some:
            self._expect(joints)
        if whole is not None and self._parts and not self.missing:
            for joints in self._parts:
                own = JointStream(whole.stamp, whole.position[:, joints], whole.velocity[:, joints])
                both = JointStream.concatenate((some[joints], own)) if joints in some else own
                some[joints] = both[np.argsort(both.stamp, kind='stable')]
        for joints, stream in some.items():
            self._add(joints, stream)
        if not self._parts or self.missing:
            complete = None if whole is None else self._whole.push(whole)
            if complete is not None:
                self._forget_until(int(complete.stamp[-1]))
            return complete
        return self._merge()

    def _forget_until(self, stamp: int) -> None:
        """Drop the parts up to a message that holds all joints: they add nothing to it."""
        for part in self._parts.values():
            count = int(np.searchsorted(part.waiting.stamp, stamp, side='right'))
            self._own[REDUNDANT] += count
            part.waiting = part.waiting[count:]

    def _all(self) -> list[_Part]:
        return [self._whole, *self._parts.values()]

    def _expect(self, joints: Joints) -> None:
        """Make a part of the messages' joints, if no other part has all of them."""
        new = [joint for joint in self.missing if joint in joints]
        if joints not in self._parts and new:
            part = self._parts[joints] = _Part(joints, self._turning, self._reorder_limit)
            part.own = [joints.index(joint) for joint in new]

    def _add(self, joints: Joints, stream: JointStream) -> None:
        if joints not in self._parts:
            self._own[REDUNDANT] += len(stream.stamp)
            return
        part = self._parts[joints]
        ordered = part.push(stream)
        if ordered is None:
            return
        part.waiting = ordered.concatenate((part.waiting, ordered))
        excess = len(part.waiting.stamp) - LARGEST_BACKLOG
        if excess > 0:
            self._own[NO_PARTNER] += excess
            part.waiting = part.waiting[excess:]

    def _merge(self) -> JointStream | None:
        """Return the measurements at the first part's stamps around which every other part has some."""
        leader, *others = sorted(self._parts.values(), key=self._is_beside)
        if not all(len(part.waiting) for part in (leader, *others)):
            return None
        until = min(part.waiting.stamp[-1] for part in (others or [leader]))
        ready = int(np.searchsorted(leader.waiting.stamp, until, side='right'))
        last = leader.waiting.stamp[max(ready - 1, 0)]
        lead, leader.waiting = leader.waiting[:ready], leader.waiting[ready:]
        lead = lead[self._usable(lead.stamp, others)]
        merged = self._interpolated(lead, leader, others) if len(lead) else None
        for part in others:
            pending = leader.waiting.stamp[0] if len(leader.waiting) else last
            first = max(int(np.searchsorted(part.waiting.stamp, pending, side='right')) - 1, 0)
            part.waiting = part.waiting[first:]
        return merged

    def _is_beside(self, part: _Part) -> bool:
        """Return whether a part holds no joint."""
        return bool(np.all(part.joints[part.own] >= self._joints))

    def _usable(self, stamps: Stamps, others: list[_Part]) -> Flags:
        """Return which stamps every other part brackets closely, with a new message each time if its joints move.

        Otherwise the same error of one message would count as that of many.
        """
        early: Flags = np.zeros(len(stamps), dtype=bool)
        apart, widest = early, 0
        ends: list[Stamps] = []  # of the parts with joints: the messages that end the intervals
        moves: list[Flags] = []  # and whether the joints move by them
        for part in others:
            known = part.waiting.stamp
            right = np.searchsorted(known, stamps, side='left')
            left = np.where(known[right] == stamps, right, right - 1)
            step = np.diff(part.waiting.position, axis=0, prepend=part.waiting.position[:1])
            still = np.all(np.abs(step) <= _STILL * self._noise, axis=1)[right]
            gap = known[right] - known[np.maximum(left, 0)]
            far = (left >= 0) & (gap > np.where(still, _AT_REST, 1) * self._maximum_gap)
            if np.max(gap[far], initial=0) > widest:
                widest, self.slow = int(np.max(gap[far])), tuple(part.joints[part.own].tolist())
            early, apart = early | (left < 0), apart | far
            if not self._is_beside(part):
                ends.append(known[right])
                moves.append(~still)
        self._own[NO_PARTNER] += int(np.sum(early))
        self._own[PARTNER_GAP] += int(np.sum(apart & ~early))
        usable: Flags = ~early & ~apart
        for index in np.flatnonzero(usable) if ends else ():
            now, moving = (np.array([each[index] for each in parts]) for parts in (ends, moves))
            if len(self._used) and np.any((now <= self._used) & moving):
                usable[index] = False
                self._own[OFTEN] += 1
            else:
                self._used = now
        return usable

    def _interpolated(self, lead: JointStream, leader: _Part, others: list[_Part]) -> JointStream:
        count = len(self._turning)
        position, velocity = np.empty((len(lead.stamp), count)), np.empty((len(lead.stamp), count))
        position[:, leader.joints[leader.own]] = lead.position[:, leader.own]
        velocity[:, leader.joints[leader.own]] = lead.velocity[:, leader.own]
        for part in others:
            places, rates = interpolate(part.waiting, lead.stamp)
            position[:, part.joints[part.own]] = places[:, part.own]
            velocity[:, part.joints[part.own]] = rates[:, part.own]
        return JointStream(lead.stamp, position, velocity)


def interpolate(stream: JointStream, stamps: Stamps) -> tuple[Array, Array]:
    """Return positions and velocities at stamps within a stream: cubic with the velocities at both ends, else even."""
    right = np.searchsorted(stream.stamp, stamps, side='left')
    left = np.where(stream.stamp[right] == stamps, right, right - 1)
    length = (stream.stamp[right] - stream.stamp[left])[:, None] * 1e-9
    s = (stamps - stream.stamp[left])[:, None] * 1e-9 / np.where(length > 0.0, length, 1.0)
    start, end = stream.position[left], stream.position[right]
    even = (end - start) / np.where(length > 0.0, length, np.inf)
    rates = stream.velocity[left], stream.velocity[right]
    slopes = [np.where(np.isfinite(rate), rate, even) for rate in rates]
    bend = s * (1.0 - s) ** 2 * slopes[0] - s * s * (1.0 - s) * slopes[1]
    position = start + s * s * (3.0 - 2.0 * s) * (end - start) + length * bend
    return position, rates[0] + s * (rates[1] - rates[0])


class JointStateLayout(PacketLayout):
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


class JointStateShape(NamedTuple):
    """The names of joints, and numbers of positions and velocities, that several JointStates share."""

    names: tuple[str, ...]
    positions: int
    velocities: int

    def columns(self, messages: Sequence[Any]) -> tuple[Stamps, Array, Array]:
        """Return stamps (N,), ns, positions (N, p) and velocities (N, v) of N such messages."""
        position = np.array([message.position for message in messages], dtype=float)
        velocity = np.array([message.velocity for message in messages], dtype=float)
        return (
            stamps_of(messages),
            position.reshape(len(position), self.positions),
            velocity.reshape(len(velocity), self.velocities),
        )


def joint_state_shape(message: Any) -> JointStateShape | JointStateLayout:
    """Return the shape of a JointState, or of packets together."""
    if isinstance(message, Packets):
        return message.layout
    return JointStateShape(tuple(message.name), len(message.position), len(message.velocity))


_Shape = JointStateShape | JointStateLayout


class JointReader:
    """Reads JointState messages: joints by name, in any order, others ignored; all joints of the robot or some.

    Wheels, which are no joints of the robot, come after these: they need velocities, and their positions are read as
    zero.

    Parameters
    ----------
    joint_names, wheels : names
    passive : those of unreported joints; their values in messages are ignored, and they are read as zero
    """

    def __init__(self, joint_names: Sequence[str], wheels: Sequence[str] = (), passive: Sequence[str] = ()) -> None:
        self._names = (*joint_names, *wheels)
        self._first_wheel = len(joint_names)
        self._passive = tuple(place for place, name in enumerate(joint_names) if name in passive)
        self.all: Joints = tuple(range(len(self._names)))
        self._layouts: dict[tuple[str, ...], _Layout] = {}
        self.others: tuple[str, ...] = ()  # further names in the last message that was laid out
        self.unknown: tuple[str, ...] = ()  # names of the last message that lacked a joint
        self.missing: tuple[str, ...] = ()
        self.unequal = ''  # numbers of names and values in the last message where they differ
        self.not_finite: Counter[str] = Counter()  # messages with a NaN or infinite value, by field and joint
        self.heard: dict[str, None] = {}  # every name that a message has had, in order; a bounded number

    def read(self, messages: Sequence[Any]) -> tuple[dict[Joints, JointStream], Counter[str]]:
        """Return the measurements by their joints, and the numbers of dropped messages by cause.

        A velocity that is not given is NaN. Packets may be together.
        """
        dropped: Counter[str] = Counter()
        runs: dict[Joints, list[_Run]] = {}
        for shape, group in groupby(messages, key=joint_state_shape):
            run = list(group)
            layout = self._layout(shape.names)
            cause = layout.refused or self._misfit(shape)
            if cause:
                dropped[cause] += number_of(run)
                continue
            earlier = runs.setdefault(layout.joints, [])
            if earlier and earlier[-1][1] == shape:
                earlier[-1][2].extend(run)
            else:
                earlier.append((layout, shape, run))
        streams = {}
        for joints, read in runs.items():
            wheels = [place for place, joint in enumerate(joints) if joint >= self._first_wheel]
            stream, lacking = _finite_joints(read, wheels, dropped)
            self.not_finite.update({self._field(joints[place]): count for place, count in lacking.items()})
            if len(stream.stamp):
                every, stream = self._with_passive(joints, stream)
                streams[every] = stream
        return streams, +dropped

    def _field(self, joint: int) -> str:
        return f'{"position" if joint < self._first_wheel else "velocity"} of {self._names[joint]}'

    def _with_passive(self, joints: Joints, stream: JointStream) -> tuple[Joints, JointStream]:
        """Return the measurements with passive joints at zero, where they are of joints at all."""
        if not self._passive or all(joint >= self._first_wheel for joint in joints):
            return joints, stream
        every = tuple(sorted((*joints, *self._passive)))
        held = [every.index(joint) for joint in joints]
        position, velocity = np.zeros((2, len(stream.stamp), len(every)))
        position[:, held], velocity[:, held] = stream.position, stream.velocity
        return every, JointStream(stream.stamp, position, velocity)

    def _misfit(self, shape: _Shape) -> str:
        """Return why messages of a shape cannot be used, empty if they can."""
        count = len(shape.names)
        if shape.positions != count or shape.velocities not in {0, count}:
            self.unequal = f'{count} names, {shape.positions} positions, {shape.velocities} velocities'
            return LENGTH_MISMATCH
        return ''

    def _layout(self, key: tuple[str, ...]) -> _Layout:
        """Return which joints a message with certain names holds, and where."""
        if len(key) > MOST_NAMES:
            return _Layout((), _NOWHERE, TOO_MANY_NAMES)
        known = self._layouts.get(key)
        if known is None:
            if len(self._layouts) > 64:
                self._layouts.clear()
            known = self._layouts[key] = self._laid_out(key)
            if len(self.heard) < MOST_NAMES:
                self.heard.update(dict.fromkeys(key))
        if len(known.joints) < len(self._names) - len(self._passive):
            self.unknown = key
            reported = (name for place, name in enumerate(self._names) if place not in self._passive)
            self.missing = tuple(name for name in reported if name not in key)
        return known

    def _laid_out(self, names: tuple[str, ...]) -> _Layout:
        place = {name: index for index, name in enumerate(names)}
        joints = tuple(joint for joint, name in enumerate(self._names) if name in place and joint not in self._passive)
        if any(names.count(self._names[joint]) > 1 for joint in joints):
            return _Layout(joints, _NOWHERE, NAMED_TWICE)
        self.others = tuple(name for name in names if name not in self._names)
        refused = JOINT_MISSING if not joints and self._names else ''
        places = np.array([place[self._names[joint]] for joint in joints], dtype=np.intp)
        return _Layout(joints, places, refused)


class _Layout(NamedTuple):
    """Indices of the robot's joints in the model and in messages with certain names; why such messages are refused."""

    joints: Joints
    places: npt.NDArray[np.intp]
    refused: str

    def chosen(self, values: Array) -> Array:
        """Return the (N, k) values of the joints from those of N messages (N, c); NaN where c is 0."""
        return values[:, self.places] if values.shape[1] else np.full((len(values), len(self.places)), np.nan)


_Run = tuple[_Layout, _Shape, list[Any]]  # messages in a row that have the same shape


def _finite_joints(
    runs: Sequence[_Run], wheels: Sequence[int], dropped: Counter[str]
) -> tuple[JointStream, dict[int, int]]:
    """Return the contents of messages that have every position, and the speed of every wheel; others are counted.

    The second result is the number of messages that lack each of these, by its column.
    """
    parts = [(layout, *shape.columns(messages)) for layout, shape, messages in runs]
    stream = JointStream(
        np.concatenate([stamp for _, stamp, _, _ in parts]),
        np.concatenate([layout.chosen(position) for layout, _, position, _ in parts]),
        np.concatenate([layout.chosen(velocity) for layout, _, _, velocity in parts]),
    )
    stream.position[:, wheels] = 0.0
    known = np.isfinite(stream.position)
    known[:, wheels] = np.isfinite(stream.velocity[:, wheels])
    finite = np.all(known, axis=1)
    lacking = {place: int(count) for place, count in enumerate(np.sum(~known, axis=0).tolist()) if count}
    real = np.all(np.abs(stream.position) < _LARGEST_JOINT, axis=1)
    dropped[NOT_FINITE] += int(np.sum(~finite))
    dropped[NOT_REAL] += int(np.sum(finite & ~real))
    with np.errstate(invalid='ignore'):
        stream.velocity[~(np.abs(stream.velocity) < _LARGEST_VELOCITY)] = np.nan
    usable = finite & real
    return stream if np.all(usable) else stream[usable], lacking
