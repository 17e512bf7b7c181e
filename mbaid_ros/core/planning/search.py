"""The search for the motion that tells most, or for the shortest that tells enough.

Motions are drawn, made as large as joints and base allow, and the best is where an evolution strategy begins
(`evolution.py`), whose motions are made as large as allowed, too. Whenever one tells enough, shorter ones are looked
for from it. What the limits ask for thus holds of all motions that are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.planning.evolution import GENERATION, Evolution
from mbaid_ros.core.planning.limits import BaseLimits
from mbaid_ros.core.planning.motions import Motions

Criterion = Literal['worst', 'mean', 'volume']

_DRAWN = 48  # motions at first
_TURNS = 8  # of a joint, at most, in these
_SHARP = 8  # exponent of the mean that stands for the worst, smooth enough to be climbed
_SHORTER = 0.97  # of the length at which a motion is expected to tell enough
ENOUGH = 0.97  # of the ratio that is wanted: what the search's few windows tell is right within some 2 %
_PATIENCE = 8  # generations of one length, before another is tried
_FAR = 1.25  # ratio from which a length is not the one to try long


@dataclass(frozen=True, eq=False)
class Wanted:
    """What a motion is to reach.

    Attributes
    ----------
    relative : (10,) relative standard deviations wanted
    asked : (10,) which of them count
    criterion : what is made small: the worst of the ratios to what is wanted, their mean square, or their volume
    """

    relative: Array
    asked: Flags
    criterion: Criterion = 'worst'

    def ratio(self, relative: Array) -> Array:
        """Return the largest ratio (...) of (..., 10) to what is wanted: 1 is reached."""
        return np.asarray((relative / self.relative)[..., self.asked].max(axis=-1))

    def cost(self, relative: Array) -> Array:
        """Return what the search makes small, (...)."""
        ratios = (relative / self.relative)[..., self.asked]
        if self.criterion == 'volume':
            return np.asarray(np.exp(np.log(ratios).mean(axis=-1)))
        power = _SHARP if self.criterion == 'worst' else 2
        return np.asarray((ratios**power).mean(axis=-1) ** (1.0 / power))


@dataclass(frozen=True, eq=False)
class Candidate:
    """A motion.

    Attributes
    ----------
    motions : those of its length
    speeds : (K, k)
    cost, ratio : as `Wanted` has them
    """

    motions: Motions
    speeds: Array
    cost: float
    ratio: float

    @property
    def duration(self) -> float:
        """Its length, s."""
        return self.motions.splines.duration

    def lasting(self, duration: float) -> Candidate:
        """Return the motion that goes by the same speeds for another time, s, as far as the joints may go."""
        motions = self.motions.lasting(duration)
        return replace(self, motions=motions, speeds=motions.within(self.speeds))


class Search:
    """Looks for one motion.

    Parameters
    ----------
    motions : of the length to begin at
    wanted : Wanted
    base : limits of what motions do to the base, if the robot is as it is known best; may change on the way
    seed : the same seed leads to the same motion
    first : motions that are drawn, at most
    allowed : whether one motion (K, k) is, whatever its size: none of the others is taken

    Attributes
    ----------
    best : the motion that tells most, of the latest length; joints at rest while none is allowed
    reached : the shortest that tells enough; None while there is none
    """

    def __init__(
        self,
        motions: Motions,
        wanted: Wanted,
        base: BaseLimits,
        seed: int,
        allowed: Callable[[Motions, Array], bool],
        first: int,
    ) -> None:
        self._motions = motions
        self._wanted = wanted
        self.base = base
        self._allowed = allowed
        self._generator = np.random.default_rng(seed)
        self.reached: Candidate | None = None
        self._first = min(first, _DRAWN)
        self.best = self._best_of(self._drawn(self._first)) or self._still()
        self._evolution = Evolution(self.best.speeds)

    def at_length(self) -> Iterator[int]:
        """Improve the best motion of the length there is; yield how many motions each part has compared."""
        yield self._first
        while True:
            self._generation()
            yield GENERATION

    def shortest(self, longest: float) -> Iterator[int]:
        """Look for the shortest motion that reaches what is wanted, of `longest` s at most, likewise."""
        yield self._first
        tried = 0  # generations of this length
        while True:
            if self.best.ratio <= ENOUGH:
                self._take()
                length = self.best.duration * max(0.6, self.best.ratio**0.6 * _SHORTER)
            elif tried >= (_PATIENCE if self.best.ratio < _FAR else 1):
                length = self._longer(longest)
            else:
                tried += 1
                self._generation()
                yield GENERATION
                continue
            tried = 0
            if length != self.best.duration:
                self._change(length)
                yield 1

    def _longer(self, longest: float) -> float:
        """Return the length to go on with where the best motion of one does not tell enough."""
        now, reached = self.best.duration, self.reached
        longer = min(now * min(self.best.ratio**0.6, 2.0) * 1.01, longest)
        if reached is None:
            return longer
        # No longer than half way to what is known to do; close to that, it is all about this length.
        return min(longer, 0.5 * (now + reached.duration)) if now < 0.99 * reached.duration else now

    def _take(self) -> None:
        if self.reached is None or self.best.duration < self.reached.duration:
            self.reached = self.best

    def _change(self, duration: float) -> None:
        """Go on with motions of another length: those of the best one's speeds, and of its path."""
        self._motions = motions = self._motions.lasting(duration)
        seeds = [self.best.speeds, self.best.speeds * self.best.duration / duration]
        if self.reached is not None:
            seeds.append(self.reached.speeds)
        self.best = self._best_of(np.stack(seeds)) or self._still()
        self._evolution = self._evolution.begun_at(self.best.speeds)

    def _generation(self) -> None:
        """Draw motions about the best ones."""
        drawn = self._evolution.drawn(self._size(), self._generator)
        possible, cost, ratio = self._compared(drawn)
        self._evolution.move(possible, cost)
        best = self._first_allowed(possible, cost, ratio, self.best.cost)
        if best is not None:
            self.best = best

    def _size(self) -> Array:
        """Return the size (k,) of speeds that the joints' limits allow."""
        reach = np.sqrt(np.mean(self.best.speeds**2, axis=0))
        if not reach.any():
            reach = np.sqrt(np.mean(self._drawn(1)[0] ** 2, axis=0))
        return np.asarray(np.where(self._motions.limits.moved, np.maximum(reach, 0.2 * reach.max()), 0.0))

    def _drawn(self, count: int) -> Array:
        """Return motions of all joints as fast as these may go: there and back, with turns at instants that are drawn."""
        splines, limits = self._motions.splines, self._motions.limits
        joints = len(limits.moved)
        turns = self._generator.random((count, 1, joints, _TURNS))
        turns[self._generator.random(turns.shape) > self._generator.random((count, 1, 1, 1))] = 0.0
        share = np.arange(0.5, splines.count)[:, None, None] / splines.count
        sign = self._generator.choice([-1.0, 1.0], (count, 1, joints))
        speed = np.where(limits.moved, limits.velocity, 0.0)
        return np.asarray(speed * sign * (-1.0) ** (share > turns).sum(axis=-1))

    def _best_of(self, speeds: Array) -> Candidate | None:
        """Return the best of some motions, as large as allowed; None where none is allowed."""
        return self._first_allowed(*self._compared(speeds), np.inf)

    def _compared(self, speeds: Array) -> tuple[Array, Array, Array]:
        """Return motions (B, K, k) as large as allowed, their costs (B,) and their ratios (B,)."""
        motions = self._motions
        possible = motions.gentle(motions.within(speeds), self.base)
        relative = motions.relative(possible, motions.coarse)
        return possible, self._wanted.cost(relative), self._wanted.ratio(relative)

    def _first_allowed(self, possible: Array, cost: Array, ratio: Array, less_than: float) -> Candidate | None:
        """Return the best motion that costs less than the best so far and is allowed; None where none is."""
        for place in np.argsort(cost).tolist():
            if not cost[place] < less_than:
                break
            if self._allowed(self._motions, possible[place]):
                return Candidate(self._motions, possible[place], float(cost[place]), float(ratio[place]))
        return None

    def _still(self) -> Candidate:
        """Return joints at rest, which tell nothing worth comparing."""
        limits = self._motions.limits
        shape = (self._motions.splines.count, len(limits.moved))
        return Candidate(self._motions, np.zeros(shape), np.inf, np.inf)
