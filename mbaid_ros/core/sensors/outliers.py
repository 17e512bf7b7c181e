"""Single poses far from those before and after: left out, for one of them can spoil a whole run.

A pose is suspicious if it is not where the two before it lead to. Suspicious ones wait until the motion after them is
known; those far from a parabola through what is around them are outliers. Where no parabola holds all around, the base
has jumped, or what is known of its pose has, and nothing is left out. Nothing waits while nothing is suspicious.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.geometry import Array, Flags, log
from mbaid_ros.core.samples import BaseStream

OUTLIER = 'pose far from those before and after'

_FAR = 7.0  # standard deviations that no noise reaches: of a vector, one in 10^10
_AROUND = 4.0  # times the largest misfit of what is around: a motion that begins or ends is no outlier
_BEFORE, _AFTER = 4, 3  # poses around suspicious ones
_NEAR = 200_000_000  # ns: of poses further apart it is the motion that shows
_LONGEST = 40  # suspicious poses in a row: more are no outliers, and nothing waits for longer
_BLOCK = 64  # misfits that tell the scale of the next as many
_FEW = 6  # misfits that tell no scale yet
_UNDERSTATED = 10.0  # times as large as declared noise may be, as long as too few tell
_QUARTILE = 1.10  # a quarter of the vectors of three independent numbers of unit variance are shorter


@dataclass(frozen=True)
class _Looked(ArrayRecord):
    """Odometry that has been looked at: whether it is suspicious, and the scale (N, 2) of position and orientation."""

    base: BaseStream
    suspicious: Flags
    scale: Array

    def __len__(self) -> int:
        return len(self.suspicious)


class Outliers:
    """Lets poses pass, in order, but for those that are single outliers; the same however the stream is cut.

    Parameters
    ----------
    maximum_gap : ns, between poses that tell of each other

    Attributes
    ----------
    dropped : measurements that did not pass
    """

    def __init__(self, maximum_gap: int) -> None:
        self._near = min(maximum_gap, _NEAR)
        self._reach = _BEFORE * self._near
        self._scale = _Scale()
        self._last: BaseStream | None = None  # the latest two
        self._passed: _Looked | None = None  # the latest that have passed
        self._waiting: _Looked | None = None  # from a suspicious one on
        self.dropped: Counter[str] = Counter()

    def push(self, base: BaseStream | None) -> BaseStream | None:
        """Take measurements in the order of their stamps and return those that pass, None if there are none."""
        if base is None or not len(base.stamp):
            return None
        looked = self._look(base)
        if self._waiting is None and not np.any(looked.suspicious):
            self._passed = looked[-_BEFORE:] if len(looked) >= _BEFORE else _last([self._passed, looked])
            return base
        joined = _joined([self._passed, self._waiting, looked])
        begin = 0 if self._passed is None else len(self._passed)
        passing, end = self._decide(joined, begin)
        self.dropped[OUTLIER] += end - begin - (len(passing) - begin)
        self._waiting = joined[end:] if end < len(joined) else None
        self._passed = joined[np.array(passing[-_BEFORE:], dtype=np.intp)]
        return joined.base[np.array(passing[begin:], dtype=np.intp)] if len(passing) > begin else None

    def _look(self, base: BaseStream) -> _Looked:
        """Return measurements with how far they are from where the two before lead to."""
        joined = base if self._last is None else BaseStream.concatenate((self._last, base))
        misfit: Array = np.zeros((len(joined.stamp), 2))
        step = np.diff(joined.stamp)
        first, second = step[:-1], step[1:]
        ratio = (second / first)[:, None]
        noise = np.sqrt(1.0 + (1.0 + ratio[:, 0]) ** 2 + ratio[:, 0] ** 2)
        near = np.maximum(first, second) <= self._near
        # A turn's length is that of the change of the matrix over the square root of two.
        for column, values, size in ((0, joined.position, 1.0), (1, joined.rotation.reshape(-1, 9), np.sqrt(2.0))):
            change = np.diff(values, axis=0)
            away = np.sqrt(np.sum((change[1:] - ratio * change[:-1]) ** 2, axis=1))
            misfit[2:, column] = np.where(near, away / (size * noise), 0.0)
        misfit = misfit[len(joined.stamp) - len(base.stamp) :]
        self._last = joined[-2:]
        variance = np.diagonal(base.pose_covariance, axis1=1, axis2=2).reshape(-1, 2, 3)
        declared = np.sqrt(np.mean(variance, axis=2))
        scale = np.maximum(declared, self._scale.of(misfit, declared))
        return _Looked(base, np.any(misfit > _FAR * scale, axis=1), scale)

    def _decide(self, looked: _Looked, begin: int) -> tuple[list[int], int]:
        """Return which measurements pass, with those before `begin`, and where those begin that have to wait."""
        passing = list(range(begin))
        suspicious = [*(begin + np.flatnonzero(looked.suspicious[begin:])).tolist(), len(looked) + _LONGEST]
        place = begin
        while suspicious[0] < len(looked):
            start = suspicious[0]
            passing += range(place, start)
            last = start
            while suspicious[0] <= min(last + _AFTER, start + _LONGEST - 1):
                last = suspicious.pop(0)
            place = last + 1
            if suspicious[0] <= last + _AFTER:
                place = suspicious[0]
                passing += range(start, place)
            elif last + _AFTER >= len(looked):
                return passing, start
            else:
                around = [*passing[-_BEFORE:], *range(place, place + _AFTER)]
                far = self._far(looked, around, range(start, place))
                passing += (index for index, out in zip(range(start, place), far, strict=True) if not out)
        passing += range(place, len(looked))
        return passing, len(looked)

    def _far(self, looked: _Looked, around: list[int], members: range) -> Flags:
        """Return which of some poses are far from a parabola through others around them."""
        stamp = looked.base.stamp
        ends = np.clip(around, members[0], members[-1])
        near = np.array(around)[np.abs(stamp[around] - stamp[ends]) <= self._reach]
        if np.sum(near < members[0]) < 2 or np.sum(near > members[-1]) < 2:
            return np.zeros(len(members), dtype=bool)
        base = looked.base[near[0] : near[-1] + 1]
        near, own = near - near[0], np.array(members) - near[0]
        powers = ((base.stamp - base.stamp[own[0]]) * 1e-9)[:, None] ** np.arange(3)
        solve = np.linalg.pinv(powers[near])
        spread = np.sqrt(1.0 + np.sum((powers[own] @ solve) ** 2, axis=1))
        far: Flags = np.zeros(len(own), dtype=bool)
        turn = log(base.rotation[0].T @ base.rotation)
        for column, values in enumerate((base.position - base.position[0], turn)):
            left = np.sqrt(np.sum((values - powers @ (solve @ values[near])) ** 2, axis=1))
            limit = max(_FAR * float(looked.scale[members[0], column]), _AROUND * float(np.max(left[near])))
            far |= left[own] > limit * spread
        return far


class _Scale:
    """The size of misfits as they are, whatever is declared, from the lower quartile of the block before.

    An outlier is in three misfits: the median of a block with many of them would be one of theirs.
    """

    def __init__(self) -> None:
        self._block: Array = np.zeros((0, 2))  # misfits of the block that is not complete
        self._before: Array | None = None  # scale of the one before it

    def of(self, misfit: Array, declared: Array) -> Array:
        """Return the scale (N, 2) that the next misfits (N, 2) are measured by; the first by what is declared."""
        known = len(self._block)
        joined = np.concatenate((self._block, misfit))
        complete = len(joined) // _BLOCK
        blocks = joined[: complete * _BLOCK].reshape(complete, _BLOCK, 2)
        own = np.sort(blocks, axis=1)[:, _BLOCK // 4] / _QUARTILE
        if self._before is None:  # the first block has none before it: the misfits so far serve, once they are some
            so_far = [joined[min(2, end) : end + 1] for end in range(known, min(len(joined), _BLOCK))]
            first = [
                np.sort(each, axis=0)[len(each) // 4] / _QUARTILE if len(each) > _FEW else _UNDERSTATED * least
                for each, least in zip(so_far, declared, strict=False)
            ]
            scales = np.concatenate((np.reshape(first, (-1, 2)), np.repeat(own, _BLOCK, axis=0)))[: len(misfit)]
        else:
            scales = np.repeat(np.concatenate((self._before[None], own)), _BLOCK, axis=0)[known : len(joined)]
        if complete:
            self._before = own[-1]
        self._block = joined[complete * _BLOCK :]
        return scales


def _joined(parts: list[_Looked | None]) -> _Looked:
    given = [part for part in parts if part is not None]
    return _Looked(
        BaseStream.concatenate([part.base for part in given]),
        np.concatenate([part.suspicious for part in given]),
        np.concatenate([part.scale for part in given]),
    )


def _last(parts: list[_Looked | None]) -> _Looked:
    """Return the latest of some measurements, as many as are looked at before suspicious ones."""
    return _joined(parts)[-_BEFORE:]


REPEATED_POSE = 'pose repeated'

STILL = 1_000_000_000  # ns that the same pose has to last to be that of a base at rest


class Repeats:
    """Lets the first of equal poses pass, and the others only if they last; in order, however the stream is cut.

    Attributes
    ----------
    dropped : measurements that did not pass
    """

    def __init__(self) -> None:
        self._last: BaseStream | None = None  # latest measurement
        self._since = 0  # ns, when its pose came
        self._waiting: BaseStream | None = None  # those with its pose, until it is known whether they pass
        self.dropped: Counter[str] = Counter()

    def push(self, base: BaseStream | None) -> BaseStream | None:
        """Take measurements in the order of their stamps and return those that pass, None if there are none."""
        if base is None or not len(base.stamp):
            return None
        new = self._new(base)
        if np.all(new) and self._waiting is None:
            self._last, self._since = base[-1:], int(base.stamp[-1])
            return base
        waiting = 0 if self._waiting is None else len(self._waiting.stamp)
        joined = base if self._waiting is None else BaseStream.concatenate((self._waiting, base))
        passing, open_ = self._sorted(joined, np.concatenate((np.zeros(waiting, dtype=bool), new)))
        self.dropped[REPEATED_POSE] += int(np.sum(~passing & ~open_))
        self._last, self._waiting = base[-1:], joined[open_] if np.any(open_) else None
        return joined[passing] if np.any(passing) else None

    def _new(self, base: BaseStream) -> Flags:
        """Return which measurements have another pose than the one before, (N,)."""
        before = base[:1] if self._last is None else self._last
        position = np.concatenate((before.position, base.position))
        rotation = np.concatenate((before.rotation, base.rotation)).reshape(-1, 9)
        new = np.any(position[1:] != position[:-1], axis=1) | np.any(rotation[1:] != rotation[:-1], axis=1)
        if self._last is None:
            new[0] = True
        return np.asarray(new)

    def _sorted(self, base: BaseStream, new: Flags) -> tuple[Flags, Flags]:
        """Return which measurements pass, and which have to wait until it is known how long their pose lasts.

        Parameters
        ----------
        base : those that have waited, and those that come
        new : which have another pose than the one before
        """
        pose = np.cumsum(new)  # which one, 0 for that of the measurements before
        since = np.concatenate(([self._since], base.stamp[new]))
        until = since.copy()
        until[pose] = base.stamp  # the last assignment stays: the latest stamp
        lasts = until - since >= STILL
        self._since = int(since[-1])
        passing = new | lasts[pose]
        return passing, ~passing & (pose == pose[-1])
