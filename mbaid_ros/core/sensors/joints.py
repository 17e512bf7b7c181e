"""Joint measurements from messages that each hold all joints, or only some, merged to one stream.

Publishers of some joints stamp their messages at different times. The messages with the first joints set the stamps;
the others are interpolated to them, over no gap longer than allowed. A message with all joints counts as one of each
part, once the parts together hold all of them.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.samples import JointStream, Stamps
from mbaid_ros.core.sensors.streams import Reorder
from mbaid_ros.core.sensors.synchroniser import LARGEST_BACKLOG
from mbaid_ros.core.sensors.unwrapping import TurnCounter

NO_PARTNER = 'no message with the other joints around the stamp'
PARTNER_GAP = 'gap in the messages with the other joints'
OFTEN = 'more often than the messages with the other joints'
REDUNDANT = 'joints that other messages hold, too'

# Standard deviations that a part changes by from one message to the next while it rests: a message of joints at rest
# may serve several times, as nothing of it is interpolated.
_STILL = 6.0
_GOES_ON = 1_000_000_000  # ns, that messages with all joints may pause
_NEVER = -(1 << 62)  # ns
_AT_REST = 10  # times the longest interpolated interval, that such messages may be apart

Joints = tuple[int, ...]  # indices in the model


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
        lead, leader.waiting = leader.waiting[:ready], leader.waiting[ready:]
        lead = lead[self._usable(lead.stamp, others)]
        merged = self._interpolated(lead, leader, others) if len(lead) else None
        for part in others:
            pending = leader.waiting.stamp[0] if len(leader.waiting) else part.waiting.stamp[-1]
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
