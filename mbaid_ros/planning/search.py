"""The variables of the search: the legs of each joint, their lengths and their ends.

The shortest motions go at full speed nearly all the time, so they differ by the times when they turn. In legs that is
a few numbers, of which a small change is a small change of the motion, while in speeds at given instants a turn that
comes a little later is a large change of one of them. Where the base's limit binds, the places of the joints count: a
change of one place leaves those after it as they were.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.planning.evolution import CHOSEN, GENERATION, EvolutionStrategy
from mbaid_ros.planning.motions import Motions
from mbaid_ros.planning.requirements import BaseLimits, Goal

LEGS = 8  # of a joint: more turns help where the base's limit binds
NUMBERS = 2 * LEGS + 1  # of a joint: logarithms of lengths, places, logarithm of a part of the speed
_SLOWER = 3.0  # that logarithm in the beginning, at most, of half of the motions: where the base binds, joints differ


def drawn_legs(count: int, joints: int, generator: np.random.Generator) -> Array:
    """Return legs of drawn lengths and directions, (count, NUMBERS, k), in half of the motions at full speed."""
    shape = (count, LEGS, joints)
    slower = generator.uniform(-_SLOWER, 0.0, (count, 1, joints))
    slower[::2] = 0.0
    lengths = generator.standard_normal(shape)
    places = np.cumsum(_durations(lengths) * generator.choice([-1.0, 1.0], shape), axis=1)
    return np.concatenate((lengths, LEGS * places, slower), axis=1)


def _durations(lengths: Array) -> Array:
    """Return which part of a motion each leg lasts, (B, LEGS, k), by logarithms."""
    lasting = np.exp(lengths)
    return np.asarray(lasting / lasting.sum(axis=1, keepdims=True))


def speeds_of(legs: Array, count: int) -> Array:
    """Return the mean speeds in each of `count` equal parts of a motion, in parts of the joints' limits, (B, count, k).

    Places are in units of an equal share of the way at full speed; the limits cut off faster motion later.

    Parameters
    ----------
    legs : (B, NUMBERS, k)
    count : number
    """
    begin = ((0, 0), (1, 0), (0, 0))
    ends = np.pad(np.cumsum(_durations(legs[:, :LEGS]), axis=1), begin)
    places = np.pad(legs[:, LEGS:-1] / LEGS, begin)
    share = np.arange(count + 1) / count
    passed = np.empty((len(legs), count + 1, legs.shape[-1]))
    for motion, joint in np.ndindex(len(legs), legs.shape[-1]):
        passed[motion, :, joint] = np.interp(share, ends[motion, :, joint], places[motion, :, joint])
    return np.asarray(np.diff(passed, axis=1) * count * np.exp(legs[:, -1:]))


_DRAWN = 48  # motions at first
_SHORTER = 0.97  # of the length at which a motion is expected to suffice
ENOUGH = 0.97  # of the wanted ratio: the search's few windows are right within some 2 %
_PATIENCE = 8  # generations of one length, before another is tried
_FAR = 1.25  # ratio from which a length is not the one to try long


@dataclass(frozen=True, eq=False)
class Candidate:
    """A motion."""

    motions: Motions  # those of its length
    legs: Array  # (NUMBERS, k) that the search has it of
    speeds: Array  # (K, k) within the limits
    cost: float  # as `Goal` has them
    ratio: float  # as `Goal` has them
    part: float = 1.0  # of the size that it would have if nothing of the robot were in its own way

    @property
    def duration(self) -> float:
        """Its length, s."""
        return self.motions.splines.duration

    def with_duration(self, duration: float) -> Candidate:
        """Return the motion that goes by the same speeds for another time, s, as far as the joints may go."""
        motions = self.motions.with_duration(duration)
        return replace(self, motions=motions, speeds=motions.limited(self.speeds))


class Search:
    """Looks for one motion.

    Parameters
    ----------
    motions : of the length to begin at
    base : limits of the base's motion, for the best estimate of the robot; may change on the way
    seed : the same seed leads to the same motion
    first : motions that are drawn, at most
    clear : to which part of its size one motion (K, k) has to be made smaller, for the robot not to be in its own way;
        0 where that does not help

    Attributes
    ----------
    best : the motion with most information, of the latest length; joints at rest where none is clear
    nearest : the one with most information, of any length
    reached : the shortest that reaches the wanted precision; None while there is none
    """

    def __init__(
        self,
        motions: Motions,
        wanted: Goal,
        base: BaseLimits,
        seed: int,
        clear: Callable[[Motions, Array], float],
        first: int,
    ) -> None:
        self._motions = motions
        self._wanted = wanted
        self.base = base
        self._clear = clear
        self._generator = np.random.default_rng(seed)
        self.reached: Candidate | None = None
        self._first = min(first, _DRAWN)
        drawn = drawn_legs(self._first, len(motions.limits.moved), self._generator)
        self.best = self.nearest = self._best_of(drawn)
        self._evolution = EvolutionStrategy(self.best.legs)

    def improve(self) -> Iterator[int]:
        """Improve the best motion of the length there is; yield how many motions each part has compared."""
        yield self._first
        while True:
            self._generation()
            yield GENERATION

    def shortest(self, longest: float) -> Iterator[int]:
        """Look for the shortest motion that reaches the wanted precision, of `longest` s at most, likewise."""
        yield self._first
        tried = 0  # generations of this length
        longer_helps = True  # where the base's limit binds, more time alone hardly does
        while True:
            if self.best.ratio <= ENOUGH:
                self._take()
                length = self.best.duration * max(0.6, self.best.ratio**0.6 * _SHORTER)
            elif tried >= (1 if self.best.ratio > _FAR and longer_helps else _PATIENCE):
                length = self._longer(longest)
            else:
                tried += 1
                self._generation()
                yield GENERATION
                continue
            tried = 0
            before = self.best
            if length != before.duration:
                self._change_duration(length)
                yield 1
                if length > before.duration:
                    longer_helps = self.best.ratio * length < before.ratio * before.duration

    def _longer(self, longest: float) -> float:
        """Return the length to go on with if the best motion of one does not suffice."""
        now, reached = self.best.duration, self.reached
        longer = min(now * min(self.best.ratio**0.6, 2.0) * 1.01, longest)
        if reached is None:
            return longer
        # No longer than half way to a length that suffices; close to that, it is all about this length.
        return min(longer, 0.5 * (now + reached.duration)) if now < 0.99 * reached.duration else now

    def _take(self) -> None:
        if self.reached is None or self.best.duration < self.reached.duration:
            self.reached = self.best

    def _change_duration(self, duration: float) -> None:
        """Continue with motions of another duration, from the legs of the best and of the shortest that suffices."""
        self._motions = self._motions.with_duration(duration)
        legs = [each.legs for each in (self.best, self.reached) if each is not None]
        self.best = self._best_of(np.stack(legs))
        self._note_nearest()
        self._evolution = self._evolution.restarted_at(self.best.legs)

    def _generation(self) -> None:
        """Draw motions about the best ones."""
        legs = self._evolution.sample(self._motions.limits.moved, self._generator)
        found = self._compared(legs)
        self._evolution.update(found.legs, found.cost)
        if found.cost.min() < self.best.cost:
            self.best = self._candidate(found, int(np.argmin(found.cost)))
            self._note_nearest()

    def _note_nearest(self) -> None:
        if self.best.ratio < self.nearest.ratio:
            self.nearest = self.best

    def _best_of(self, legs: Array) -> Candidate:
        """Return the best of some motions, as large as allowed; joints at rest where none is."""
        found = self._compared(legs)
        place = int(np.argmin(found.cost))
        return self._candidate(found, place) if np.isfinite(found.cost[place]) else self._resting()

    def _compared(self, legs: Array) -> _Compared:
        """Return the outcomes of motions (B, NUMBERS, k), as large as allowed."""
        motions = self._motions
        fastest = np.where(motions.limits.moved, motions.limits.velocity, 0.0)
        speeds = motions.scaled_to_limits(motions.limited(speeds_of(legs, motions.splines.count) * fastest), self.base)
        return self._collision_free(_Compared(legs, speeds, *self._scores(speeds), np.ones(len(legs))))

    def _scores(self, speeds: Array) -> tuple[Array, Array]:
        """Return costs and ratios (B,) of motions."""
        relative = self._motions.relative(speeds, self._motions.coarse)
        cost, ratio = self._wanted.cost(relative), self._wanted.ratio(relative)
        return np.where(np.isfinite(cost), cost, np.inf), ratio

    def _collision_free(self, found: _Compared) -> _Compared:
        """Return motions, the best of them scaled down until the robot is clear of itself."""
        legs, speeds, cost, ratio, part = (each.copy() for each in found)
        looked_at: set[int] = set()
        while due := [place for place in np.argsort(cost)[:CHOSEN].tolist() if place not in looked_at]:
            looked_at.update(due)
            part[due] = [self._clear(self._motions, speeds[place]) for place in due]
            smaller = [place for place in due if 0.0 < part[place] < 1.0]
            cost[[place for place in due if part[place] == 0.0]] = np.inf
            if smaller:
                legs[smaller, -1] += np.log(part[smaller])[:, None]
                speeds[smaller] *= part[smaller, None, None]
                cost[smaller], ratio[smaller] = self._scores(speeds[smaller])
        return _Compared(legs, speeds, cost, ratio, part)

    def _candidate(self, found: _Compared, place: int) -> Candidate:
        cost, ratio, part = (float(each[place]) for each in (found.cost, found.ratio, found.part))
        return Candidate(self._motions, found.legs[place], found.speeds[place], cost, ratio, part)

    def _resting(self) -> Candidate:
        """Return joints at rest, which give no information worth comparing."""
        joints = len(self._motions.limits.moved)
        speeds = np.zeros((self._motions.splines.count, joints))
        return Candidate(self._motions, np.zeros((NUMBERS, joints)), speeds, np.inf, np.inf)


class _Compared(NamedTuple):
    """Motions side by side, as `Candidate` has one: (B, NUMBERS, k), (B, K, k), and (B,) each."""

    legs: Array
    speeds: Array
    cost: Array
    ratio: Array
    part: Array
