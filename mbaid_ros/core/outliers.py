"""Outliers and repeated readings of any sensor: motion models, gates and channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mbaid_ros.core.geometry import Array, Flags, exp, log, rotate
from mbaid_ros.core.samples import ArrayRecord, BaseStream, ImuStream, JointStream, Stamps, block_std

REPEATED = 'stamp repeated'
REPEATED_POSE = 'pose repeated'
JOINTS_HELD = 'joint positions repeated under a new stamp'
STILL = 1_000_000_000  # ns that the same reading has to last to be that of something at rest
OUTLIER = 'pose far from those before and after'
JOINT_OUTLIER = 'joint position far from those before and after'
FLIPPED = 'orientation flipped faster than a robot turns'
# rad, and rad/s: a turn from one pose to the next is a flip if it is larger than both make it. The smallest angle of a
# symmetric set of ten markers is .6 rad.
_FLIP, _FASTEST = 0.5, 3.0
_LASTING = 500_000_000  # ns, from which another orientation is taken for the present one: single flips are shorter
_SAME_TURN = 0.1  # rad, between flips to the same orientation
_FITTED = 10  # readings, before and after a flip or a jump, that its turn and way are found from
# Standard deviations: of a step from one pose to the next less the motion, that is looked at; of a jump, in its own.
_SUSPICIOUS, _CERTAIN_JUMP = 5.0, 6.0
_LISTED = 5  # jumps whose times are listed
_STANDS_OUT = 3.0  # times the largest misfit nearby: a motion that is no cubic is no jump
_EVEN = 2.5  # times the median interval: longest between poses around a jump. After a gap motion explains what it hides
_SLOWEST = 60_000_000  # ns, longest such interval without a twist: in longer ones an arm may start and stop
_FAR = 7.0  # standard deviations that no noise reaches: of a vector, one in 10^10
_AROUND = 4.0  # times the largest misfit nearby: a motion that begins or ends is no outlier
_BEFORE, _AFTER = 4, 3  # poses around suspicious ones
_NEAR = 200_000_000  # ns: of poses further apart it is the motion that shows
_LONGEST = 40  # suspicious poses in a row: more are no outliers, and nothing waits for longer
_REMEMBERED = 5_000  # readings at most, among which copies are looked for
_LATEST = 64  # misfits, whose lower quartile determines the scale of the next
_UNDERSTATED = 10.0  # times as large as specified noise may be, as long as there are too few
# A quarter of the vectors of three independent numbers of unit variance are shorter, and of single numbers smaller.
_QUARTILE_OF_THREE, QUARTILE_OF_ONE = 1.10, 0.319
Stream = TypeVar('Stream', BaseStream, JointStream, ImuStream)


class Channels(NamedTuple):
    """Channels of one kind: a position, an orientation, each joint."""

    # from N readings to (N, c, w) numbers of c channels, which move along straight lines for a moment
    values: Callable[[Any], Array]
    size: float  # length of a change of a channel's numbers, per unit of the quantity
    declared: Callable[[Any], Array]  # from N readings to the (N, c) standard deviations of the quantity
    local: Callable[[Any], Array]  # from N readings to (N, c, k) coordinates about the first one
    quartile: float = _QUARTILE_OF_THREE  # lower quartile of a channel's error, in its standard deviations


@dataclass(frozen=True)
class _ScoredReadings(ArrayRecord):
    """Readings with whether each is suspicious (N,), and the scale (N, c) of its channels."""

    readings: Any
    suspicious: Flags
    scale: Array


def _joined(*parts: _ScoredReadings | None) -> _ScoredReadings:
    return _ScoredReadings.concatenate([part for part in parts if part is not None])


class MisfitScale:
    """Follows misfits of readings, and finds their size where the declared noise is too small."""

    def __init__(self) -> None:
        self._misfits: Array | None = None  # (_LATEST, c), the latest

    def of_next(self, misfit: Array, declared: Array, quartile: Array) -> Array:
        """Return the size (N, c) of misfits (N, c), each from the lower quartile of those before it, or as declared.

        The first ones have no more than the declared noise. An outlier is in three misfits: the median of a few with
        many of them would be one of theirs.
        """
        if self._misfits is None:
            self._misfits = np.repeat(_UNDERSTATED * declared[:1] * quartile, _LATEST, axis=0)
        joined = np.concatenate((self._misfits, misfit))
        self._misfits = joined[-_LATEST:]
        before = sliding_window_view(joined[:-1], _LATEST, axis=0)
        return np.maximum(declared, np.partition(before, _LATEST // 4, axis=2)[..., _LATEST // 4] / quartile)


class Outliers(Generic[Stream]):
    """Passes readings on, in order, without single outliers.

    Parameters
    ----------
    maximum_gap : ns, between readings that are compared
    channels : of the stream
    cause : under which readings are counted

    Attributes
    ----------
    dropped : readings that were not passed on
    by_channel : how often each channel of one of these was far, by its number
    """

    def __init__(self, maximum_gap: int, channels: Sequence[Channels], cause: str = OUTLIER) -> None:
        self._near = min(maximum_gap, _NEAR)
        self._channels = channels
        self._cause = cause
        self._scale = MisfitScale()
        self.by_channel: Counter[int] = Counter()
        self._last: Stream | None = None  # the latest two
        self._passed: _ScoredReadings | None = None  # the latest that were passed on
        self._waiting: _ScoredReadings | None = None  # from a suspicious one on
        self.dropped: Counter[str] = Counter()

    @property
    def waiting_since(self) -> int | None:
        """Stamp (ns) of the first reading that waits; None if none does."""
        return None if self._waiting is None else int(self._waiting.readings.stamp[0])

    def push(self, stream: Stream | None) -> Stream | None:
        """Add readings in the order of their stamps; return those passed on, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        judged = self._score(stream)
        if self._waiting is None and not np.any(judged.suspicious):
            self._passed = _joined(None if len(judged) >= _BEFORE else self._passed, judged)[-_BEFORE:]
            return stream
        joined = _joined(self._passed, self._waiting, judged)
        begin = 0 if self._passed is None else len(self._passed)
        passing, end = self._decide(joined, begin)
        self.dropped[self._cause] += end - len(passing)
        self._waiting = joined[end:] if end < len(joined) else None
        self._passed = joined[np.array(passing[-_BEFORE:], dtype=np.intp)]
        return joined.readings[np.array(passing[begin:], dtype=np.intp)] if len(passing) > begin else None

    def _score(self, stream: Stream) -> _ScoredReadings:
        """Return readings with their distance from where the two before lead to, compared with its scale."""
        joined = stream if self._last is None else stream.concatenate((self._last, stream))
        step = np.diff(joined.stamp)
        first, second = step[:-1], step[1:]
        ratio = (second / first)[:, None, None]
        noise = np.sqrt(1.0 + (1.0 + ratio[:, 0]) ** 2 + ratio[:, 0] ** 2)
        near = (np.maximum(first, second) <= self._near)[:, None]
        columns = []
        for channels in self._channels:
            change = np.diff(channels.values(joined), axis=0)
            away = np.sqrt(np.sum((change[1:] - ratio * change[:-1]) ** 2, axis=2))
            columns.append(np.where(near, away / (channels.size * noise), 0.0))
        after_two = np.concatenate(columns, axis=1)
        misfit = np.concatenate((np.zeros((2, after_two.shape[1])), after_two))[-len(stream.stamp) :]
        self._last = joined[-2:]
        declared = np.concatenate([channels.declared(stream) for channels in self._channels], axis=1)
        quartiles = [channels.quartile for channels in self._channels]
        scale = self._scale.of_next(misfit, declared, np.repeat(quartiles, [x.shape[1] for x in columns]))
        return _ScoredReadings(stream, np.any(misfit > _FAR * scale, axis=1), scale)

    def _decide(self, judged: _ScoredReadings, begin: int) -> tuple[list[int], int]:
        """Return the readings that pass, with those before `begin`, and the first one that has to wait."""
        passing: list[int] = list(range(begin))
        suspicious = [*(begin + np.flatnonzero(judged.suspicious[begin:])).tolist(), len(judged) + _LONGEST]
        place: int = begin
        while suspicious[0] < len(judged):
            start = suspicious[0]
            passing += range(place, start)
            last = start
            while suspicious[0] <= min(last + _AFTER, start + _LONGEST - 1):
                last = suspicious.pop(0)
            place = last + 1
            if suspicious[0] <= last + _AFTER:
                place = suspicious[0]
                passing += range(start, place)
            elif last + _AFTER >= len(judged):
                return passing, start
            else:
                around = [*passing[-_BEFORE:], *range(place, place + _AFTER)]
                far = self._far(judged, around, range(start, place))
                passing += (index for index, out in zip(range(start, place), far, strict=True) if not out)
        passing += range(place, len(judged))
        return passing, len(judged)

    def _far(self, judged: _ScoredReadings, around: list[int], members: range) -> Flags:
        """Return which of some readings are far from a parabola through others around them."""
        stamp = judged.readings.stamp
        ends = np.clip(around, members[0], members[-1])
        near = np.array(around)[np.abs(stamp[around] - stamp[ends]) <= _BEFORE * self._near]
        if np.sum(near < members[0]) < 2 or np.sum(near > members[-1]) < 2:
            return np.zeros(len(members), dtype=bool)
        readings = judged.readings[near[0] : near[-1] + 1]
        near, own = near - near[0], np.array(members) - near[0]
        powers = ((readings.stamp - readings.stamp[own[0]]) * 1e-9)[:, None] ** np.arange(3)
        solve = np.linalg.pinv(powers[near])
        spread = np.sqrt(1.0 + np.sum((powers[own] @ solve) ** 2, axis=1))
        columns = []
        for channels in self._channels:
            values = channels.local(readings)
            fitted = np.tensordot(powers @ solve, values[near], axes=1)
            columns.append(np.sqrt(np.sum((values - fitted) ** 2, axis=2)))
        left = np.concatenate(columns, axis=1)
        limit = np.maximum(_FAR * judged.scale[members[0]], _AROUND * np.max(left[near], axis=0))
        each = left[own] > limit * spread[:, None]
        self.by_channel.update({place: int(count) for place, count in enumerate(each.sum(axis=0)) if count})
        return np.asarray(np.any(each, axis=1))


class ResidualGate:
    """Finds single readings that leave what another sensor follows, also of sensors that read slowly.

    It follows how far readings are from the motion as the other one has it: mounts and worlds change that slowly.

    Parameters
    ----------
    channels : of each reading
    """

    def __init__(self, channels: int) -> None:
        self._last: Array = np.zeros((0, channels, 3))
        self._good: Array = np.zeros((channels, 3))
        self._steps: Array | None = None  # (_LATEST, c), the latest
        self._out = 0  # readings in a row

    def outliers(self, residual: Array, declared: Array) -> Flags:
        """Return which of the next readings are outliers, (N,), however these are cut.

        Parameters
        ----------
        residual, declared : (N, c, 3), (N, c) of each channel the difference from the other sensor, and the noise
        """
        before = self._last if len(self._last) else residual[:1]
        step = np.linalg.norm(np.diff(np.concatenate((before, residual)), axis=0), axis=-1)
        if self._steps is None:
            self._good = residual[0]
            self._steps = np.repeat(_UNDERSTATED * declared[:1] * _QUARTILE_OF_THREE, _LATEST, axis=0)
        joined = np.concatenate((self._steps, step))
        self._last, self._steps = residual[-1:], joined[-_LATEST:]
        latest = sliding_window_view(joined[:-1], _LATEST, axis=0)
        scale = np.partition(latest, _LATEST // 4, axis=2)[..., _LATEST // 4] / _QUARTILE_OF_THREE
        limit = _FAR * np.maximum(scale, np.sqrt(2.0) * declared)
        found: Flags = np.zeros(len(residual), dtype=bool)
        suspicious = np.any(step > limit, axis=1)
        for place in range(len(residual)) if self._out or suspicious.any() else ():
            far = np.any(np.linalg.norm(residual[place] - self._good, axis=-1) > limit[place])
            found[place] = far and (self._out > 0 or suspicious[place]) and self._out < _AFTER
            self._out = self._out + 1 if found[place] else 0
            self._good = self._good if found[place] else residual[place]
        self._good = self._good if found[-1] else residual[-1]
        return found


class Flips:
    """Passes poses on in one orientation of a symmetric marker set, which a tracker takes for another one now and then.

    A turn that is too fast for any robot is a flip. Poses in another orientation are left out until that has lasted;
    then they are turned back. The poses left out are a gap, after which the odometry begins anew.

    Attributes
    ----------
    dropped : readings that were not passed on
    text : how the latest flip turned, in words
    """

    def __init__(self) -> None:
        self._passed: BaseStream | None = None  # the latest that were passed on
        self._others: BaseStream | None = None  # the first in another orientation, as long as that lasts
        self._other: BaseStream | None = None  # the latest of these, one reading
        self._since = 0  # ns, when it began
        self._back: Array = np.eye(3)  # from the present orientation of the marker set to that at the start
        self._known: list[Array] = [np.eye(3)]  # turns from that to others
        self.text = ''
        self.dropped: Counter[str] = Counter()

    def push(self, stream: BaseStream | None) -> BaseStream | None:
        """Add poses in the order of their stamps; return those passed on, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        joined = stream if self._passed is None else stream.concatenate((self._passed, stream))
        first = len(joined.stamp) - len(stream.stamp)
        steady = self._other is None and np.array_equal(self._back, np.eye(3))
        pairs = slice(max(first - 1, 0), None)
        rotation, apart = joined.rotation[pairs], np.diff(joined.stamp[pairs])
        if steady and not np.any(_leaps(rotation[:-1], rotation[1:], apart)):
            self._passed = joined[-_FITTED:]
            return stream
        passing = [each for place in range(len(stream.stamp)) if (each := self._decide(stream[place : place + 1]))]
        self.dropped[FLIPPED] += len(stream.stamp) - len(passing)
        return BaseStream.concatenate(passing) if passing else None

    def _decide(self, reading: BaseStream) -> BaseStream | None:
        """Return one reading as it passes, turned back; None if it does not."""
        # One that goes on in the other orientation does so however near a robot may have turned to it by then.
        if self._other is None or self._others is None or _leaps_to(self._other, reading):
            turned = self._turned_back(reading)
            if self._passed is None or not _leaps_to(self._passed[-1:], turned):
                return self._pass(turned)
            self._since, self._others = int(reading.stamp[0]), reading
            vector = log(self._passed.rotation[-1].T @ turned.rotation[0])
            angle = float(np.linalg.norm(vector))
            axis = ', '.join(f'{each:.2g}' for each in np.round(vector / angle, 2) + 0.0)
            self.text = f'by {np.degrees(angle):.0f} degrees about ({axis}) in the axes of the base'
        elif len(self._others.stamp) < _FITTED:
            self._others = BaseStream.concatenate((self._others, reading))
        self._other = reading
        if int(reading.stamp[0]) - self._since < _LASTING or self._passed is None:
            return None
        between = (int(self._passed.stamp[-1]) + self._since) // 2
        turn: Array = _rotation_at(self._passed, between).T @ _rotation_at(self._others, between)
        near = [known for known in self._known if np.linalg.norm(log(known.T @ turn)) < _SAME_TURN]
        turn = near[0] if near else turn
        self._known += [] if near else [turn]
        self._back = turn.T
        self._passed = None
        return self._pass(self._turned_back(reading))

    def _pass(self, reading: BaseStream) -> BaseStream:
        before = reading if self._passed is None else BaseStream.concatenate((self._passed, reading))
        self._passed, self._other = before[-_FITTED:], None
        return reading

    def _turned_back(self, reading: BaseStream) -> BaseStream:
        if np.array_equal(self._back, np.eye(3)):
            return reading
        # The twist of a filter that follows the flip is in axes of its own.
        unknown = np.full(reading.linear_velocity.shape, np.nan)
        rotation = reading.rotation @ self._back
        return replace(reading, rotation=rotation, linear_velocity=unknown, angular_velocity=unknown)


def _leaps(before: Array, after: Array, apart: Stamps) -> Flags:
    """Return which turns between rotations (N, 3, 3), ns apart, are too large and fast for a robot, (N,)."""
    cosine = 0.5 * (np.einsum('nij,nij->n', before, after) - 1.0)
    return np.asarray(cosine < np.cos(np.minimum(_FLIP + _FASTEST * 1e-9 * apart, np.pi)))


def _rotation_at(readings: BaseStream, stamp: int) -> Array:
    """Return the orientation (3, 3) at a stamp (ns) beside N readings, that turn evenly."""
    middle = readings.rotation[len(readings.stamp) // 2]
    time = 1e-9 * (readings.stamp - stamp)
    powers = np.vander(time, min(len(time), 2), increasing=True)
    return np.asarray(middle @ exp(np.linalg.lstsq(powers, log(middle.T @ readings.rotation), rcond=None)[0][0]))


def _leaps_to(before: BaseStream, after: BaseStream) -> bool:
    return bool(_leaps(before.rotation, after.rotation, after.stamp - before.stamp)[0])


class FrameJump(NamedTuple):
    """A jump of the frame in which poses are measured."""

    stamp: int  # ns, of the first pose after it
    size: Array  # (2,) of the displacement of the base, m, and of its turn, rad
    variance: Array  # (2,) of each component of the turn, rad^2, and of the displacement, m^2
    clear: tuple[bool, bool]  # whether the displacement, and whether the turn is more than noise


class FrameJumps:
    """Passes poses on in the frame of the first ones, where a map is corrected and they jump once and stay.

    Motion explains no step between two poses beside smooth ones: a push changes the velocity, and the pose is
    continuous. A step after a gap is not looked at, nor one that few poses follow.

    Attributes
    ----------
    found : all jumps
    """

    def __init__(self) -> None:
        self._scale = MisfitScale()
        self._last: BaseStream | None = None  # the latest two
        self._before: BaseStream | None = None  # the latest that were passed on since the latest jump
        self._waiting: BaseStream | None = None  # from a suspicious one on
        self._suspicious: Flags = np.zeros(0, dtype=bool)  # of these
        # From the present frame to that of the first ones.
        self._turn: Array = np.eye(3)
        self._shift: Array = np.zeros(3)
        self.found: list[FrameJump] = []

    def push(self, stream: BaseStream | None) -> BaseStream | None:
        """Add poses in the order of their stamps; return those passed on, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        flags: Flags = self._score(stream)
        if self._waiting is not None:
            stream = BaseStream.concatenate((self._waiting, stream))
            flags = np.concatenate((self._suspicious, flags))
        parts, begin, end = [], 0, len(stream.stamp)
        for place in np.flatnonzero(flags).tolist():
            if not flags[place]:
                continue
            if len(stream.stamp) < place + _FITTED:
                end = place
                break
            self._keep(stream[begin:place])
            parts.append(self._in_first_frame(stream[begin:place]))
            begin, jump = place, self._jump(stream[place : place + _FITTED])
            if jump is not None:
                self.found.append(jump)
                self._before = None
                flags[place + 1] = False  # the way before it led elsewhere
        self._keep(stream[begin:end])
        parts.append(self._in_first_frame(stream[begin:end]))
        self._waiting, self._suspicious = (stream[end:], flags[end:]) if end < len(flags) else (None, flags[:0])
        passed = BaseStream.concatenate(parts)
        return passed if len(passed.stamp) else None

    def variances(self, stamps: Stamps) -> Array:
        """Return the variances (N, 2), rad^2 and m^2, of all corrections of the frame up to stamps (N,), ns."""
        total = np.zeros((len(stamps), 2))
        for jump in self.found:
            total[stamps >= jump.stamp] += jump.variance
        return total

    def text(self, until: int, origin: int) -> str:
        """Return the jumps up to a stamp (ns) in words, with times since an origin (ns); empty if there are none."""
        jumps = [jump for jump in self.found if jump.stamp <= until]
        if not jumps:
            return ''
        seconds = [f'{1e-9 * (jump.stamp - origin):.1f}' for jump in jumps]
        how, frames = (
            f'{_size(jumps)} at {seconds[0]} s, as by a correction of the map',
            'a new frame of the odometry begins',
        )
        if len(jumps) > 1:
            when = f'at {", ".join(seconds[:-1])} and' if len(jumps) <= _LISTED else f'{len(jumps)} times until'
            how = f'up to {_size(jumps)} {when} {seconds[-1]} s, as by corrections of the map'
            frames = 'each time a new frame of the odometry begins'
        return f'the poses of the base jump by {how}: {frames}; publish the odometry without such corrections'

    def _score(self, stream: BaseStream) -> Flags:
        """Return which readings are a step away from the one before that neither their twist nor that before shows."""
        joined = stream if self._last is None else BaseStream.concatenate((self._last, stream))
        self._last = joined[-2:]
        step = 1e-9 * np.diff(joined.stamp)[:, None]
        rotation, velocity = joined.rotation, np.stack((joined.linear_velocity, joined.angular_velocity))
        back = np.swapaxes(rotation[:-1], -1, -2)
        steps = np.stack((np.diff(joined.position, axis=0), log(back @ rotation[1:])))
        by_twist = 0.5 * step * (velocity[:, 1:] + velocity[:, :-1])
        by_twist[1] = rotate(back, by_twist[1])
        ratio = step[1:] / step[:-1]
        known: Flags = np.asarray(np.all(np.isfinite(by_twist[:, 1:]), axis=2))
        away = steps[:, 1:] - np.where(known[..., None], by_twist[:, 1:], ratio * steps[:, :-1])
        noise = np.where(known, np.sqrt(2.0), np.sqrt(1.0 + (1.0 + ratio[:, 0]) ** 2 + ratio[:, 0] ** 2))
        after_two = (np.sqrt(np.sum(away**2, axis=2)) / noise).T
        misfit = np.concatenate((np.zeros((2, 2)), after_two))[-len(stream.stamp) :]
        scale = self._scale.of_next(misfit, block_std(stream.pose_covariance), np.array(_QUARTILE_OF_THREE))
        return np.asarray(np.any(misfit > _SUSPICIOUS * scale, axis=1))

    def _jump(self, after: BaseStream) -> FrameJump | None:
        """Return the jump between the poses that were passed on and those after them, and correct these; None if none.

        Both follow one cubic, less the integral of the twist, whose slope may change at once, and its value by the
        jump. That has to exceed its noise, and what a changed velocity moves the base by from one pose to the next.
        """
        if self._before is None or len(self._before.stamp) < _FITTED:
            return None
        readings = BaseStream.concatenate((self._before, after))
        apart, first = np.diff(readings.stamp), readings.rotation[_FITTED - 1]
        velocity = np.concatenate((readings.linear_velocity, readings.angular_velocity @ first), axis=1)
        with_twist = bool(np.isfinite(velocity).all())
        if apart.max() > min(_EVEN * float(np.median(apart)), _NEAR if with_twist else _SLOWEST):
            return None
        length = 1e-9 * apart[_FITTED - 1]
        time = 1e-9 * (readings.stamp - readings.stamp[_FITTED - 1]) - 0.5 * length
        origin = readings.position[_FITTED - 1]
        way = np.concatenate((readings.position - origin, log(first.T @ readings.rotation)), axis=1)
        steeper = np.zeros(6)
        if with_twist:
            moved = np.cumsum(0.5e-9 * apart[:, None] * (velocity[1:] + velocity[:-1]), axis=0)
            moved = np.concatenate((np.zeros((1, 6)), moved))
            way -= moved - 0.5 * (moved[_FITTED - 1] + moved[_FITTED])
            steeper = np.abs(velocity[_FITTED] - velocity[_FITTED - 1])
        columns = np.stack((time**0, time, time**2, time**3, np.maximum(time, 0.0), time > 0.0), axis=1)
        solve = np.linalg.pinv(columns)
        start, _, _, _, kink, jump = solve @ way
        left = np.sum((way - columns @ (solve @ way)).reshape(-1, 2, 3) ** 2, axis=2)
        deviation = np.sqrt(np.sum(left, axis=0) / (3.0 * (len(time) - len(solve))))
        deviation = np.fmax(block_std(readings.pose_covariance[_FITTED - 1 : _FITTED + 1]).max(axis=0), deviation)
        deviation *= np.sqrt(np.sum(solve[-1] ** 2))
        sizes, slopes, changes = (np.sqrt(np.sum(each.reshape(2, 3) ** 2, axis=1)) for each in (jump, kink, steeper))
        least = np.maximum(_CERTAIN_JUMP * deviation, _STANDS_OUT * np.sqrt(left.max(axis=0)))
        clear = sizes > least + length * (slopes + changes)
        if not np.any(clear):
            return None
        turn = first @ jump[3:]
        place = origin + start[:3]
        back = self._turn @ exp(turn).T
        self._shift = self._shift + self._turn @ place - back @ (place + jump[:3])
        self._turn = back
        variance = np.nan_to_num(deviation**2 + (length * slopes) ** 2 / 12.0)
        return FrameJump(int(after.stamp[0]), sizes, variance[::-1], (bool(clear[0]), bool(clear[1])))

    def _keep(self, passed: BaseStream) -> None:
        joined = passed if self._before is None else BaseStream.concatenate((self._before, passed))
        self._before = joined[-_FITTED:]

    def _in_first_frame(self, stream: BaseStream) -> BaseStream:
        if not self.found:
            return stream
        turn = np.broadcast_to(self._turn, stream.rotation.shape)
        both = np.zeros((len(turn), 6, 6))
        both[:, :3, :3] = both[:, 3:, 3:] = turn
        return replace(
            stream,
            position=rotate(turn, stream.position) + self._shift,
            rotation=turn @ stream.rotation,
            linear_velocity=rotate(turn, stream.linear_velocity),
            angular_velocity=rotate(turn, stream.angular_velocity),
            pose_covariance=both @ stream.pose_covariance @ np.swapaxes(both, -1, -2),
        )


def _size(jumps: Sequence[FrameJump]) -> str:
    """Return the largest displacement and turn of jumps, in words."""
    step, turn = np.max([np.where(jump.clear, jump.size, 0.0) for jump in jumps], axis=0)
    parts = [f'{float(f"{1e3 * step:.2g}"):g} mm'] if step else []
    return ' and '.join([*parts, *([f'{np.degrees(turn):.2g} degrees'] if turn else [])])


class Copies(Generic[Stream]):
    """Passes readings on in the order of arrival, without those that have come before, however late they come again.

    A bridge that echoes sends each message twice, with its stamp: the second is neither late nor of another source.

    Parameters
    ----------
    values : from N readings to the (N, k) numbers that are compared
    span : ns, how far before the newest one a stamp is looked for: those before it are no regular ones

    Attributes
    ----------
    dropped : readings that were not passed on
    """

    def __init__(self, values: Callable[[Any], Array], span: int) -> None:
        self._values, self._span = values, span
        # Of the latest span, in the order of their stamps: stamps (N,), and numbers (N, k).
        self._stamps: Stamps = np.zeros(0, dtype=np.int64)
        self._numbers: Array = np.zeros((0, 0))
        self.dropped: Counter[str] = Counter()

    def push(self, stream: Stream | None) -> Stream | None:
        """Add readings in the order of arrival; return the new ones, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        stamps, numbers = stream.stamp, self._values(stream)
        count = len(self._stamps)
        if count:
            stamps, numbers = np.concatenate((self._stamps, stamps)), np.concatenate((self._numbers, numbers))
        if not np.all(stamps[max(count, 1) :] > stamps[max(count, 1) - 1 : -1]):
            new = _first_of_equals(stamps, numbers)
            self.dropped[REPEATED] += int(np.sum(~new))
            stream, stamps, numbers = stream[new[count:]], stamps[new], numbers[new]
            order = np.argsort(stamps, kind='stable')
            stamps, numbers = stamps[order], numbers[order]
        since = max(int(np.searchsorted(stamps, stamps[-1] - self._span)), len(stamps) - _REMEMBERED)
        self._stamps, self._numbers = stamps[since:], numbers[since:]
        return stream if len(stream.stamp) else None


def _first_of_equals(stamps: Stamps, numbers: Array) -> Flags:
    """Return which of N readings have no equal before them, (N,)."""
    new = np.ones(len(stamps), dtype=bool)
    seen: set[bytes] = set()  # of the latest stamp
    latest = -1
    numbers = np.ascontiguousarray(numbers) + 0.0  # zeros may be negative
    for place in np.argsort(stamps, kind='stable').tolist():
        if stamps[place] != latest:
            latest = stamps[place]
            seen.clear()
        content = numbers[place].tobytes()
        new[place] = content not in seen
        seen.add(content)
    return new


class Repeats(Generic[Stream]):
    """Passes the first of equal readings on, in order, and the others only if they last.

    The result does not depend on how the stream is cut into calls.

    Parameters
    ----------
    channels : of the stream
    cause : under which readings are counted
    together : whether the channels, two at least, change at once where a reading is held. An encoder with coarse steps
        repeats readings, too, but its joints change at different times: nothing is dropped from then on

    Attributes
    ----------
    dropped : readings that were not passed on
    interval : s, between the latest two readings that differ
    """

    def __init__(self, channels: Sequence[Channels], cause: str = REPEATED_POSE, *, together: bool = False) -> None:
        self._channels, self._cause, self._together = channels, cause, together
        self._last: Stream | None = None  # latest reading
        self._since = 0  # ns, when its value came
        self._waiting: Stream | None = None  # those with its value, until it is known whether they pass
        self._moving: Flags = np.zeros(1, dtype=bool)  # channels that have changed
        self._apart = False  # whether some have changed without the others
        self.interval = 0.0
        self.dropped: Counter[str] = Counter()

    @property
    def waiting_since(self) -> int | None:
        """Stamp (ns) of the first reading that waits; None if none does."""
        return None if self._waiting is None else int(self._waiting.stamp[0])

    def push(self, stream: Stream | None) -> Stream | None:
        """Add readings in the order of their stamps; return those passed on, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        changed, first = self._changed(stream), self._last is None
        if self._waiting is not None:
            changed = np.pad(changed, ((len(self._waiting.stamp), 0), (0, 0)))
            stream = stream.concatenate((self._waiting, stream))
        new = np.any(changed, axis=1)
        new[0] |= first
        number = np.cumsum(new)  # of the value, 0 for that of the readings before
        since = np.concatenate(([self._since], stream.stamp[new]))
        until = since.copy()
        until[number] = stream.stamp  # the last assignment stays: the latest stamp
        passing = new | ((until - since >= STILL) | self._coarse(changed[new]))[number]
        undecided = ~passing & (number == number[-1])
        self.dropped[self._cause] += int(np.sum(~passing & ~undecided))
        if len(since) > 1:
            self.interval = 1e-9 * int(since[-1] - since[-2])
        self._since, self._last = int(since[-1]), stream[-1:]
        self._waiting = stream[undecided] if np.any(undecided) else None
        return stream[passing] if np.any(passing) else None

    def _changed(self, stream: Stream) -> Flags:
        """Return which channels of N readings differ from those of the one before, (N, c)."""
        joined = stream.concatenate((stream[:1] if self._last is None else self._last, stream))
        values = [channel.values(joined) for channel in self._channels]
        return np.concatenate([np.any(each[1:] != each[:-1], axis=2) for each in values], axis=1)

    def _coarse(self, changes: Flags) -> Flags:
        """Return for the value before each of G changes (G, c), and the one after them, whether its repeats are new."""
        if not self._together:
            return np.zeros(len(changes) + 1, dtype=bool)
        before = np.broadcast_to(self._moving, (1, changes.shape[1]))
        moving: Flags = np.logical_or.accumulate(np.concatenate((before, changes)))
        apart = np.any(moving[:-1] & ~changes, axis=1) & np.any(changes, axis=1)
        apart = np.logical_or.accumulate(np.append(apart, False)) | self._apart
        self._moving, self._apart = moving[-1], bool(apart[-1])
        # One channel by itself: as well one with coarse steps.
        return np.asarray(apart | np.append(np.sum(changes, axis=1) < 2, False))
