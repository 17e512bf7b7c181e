"""How far off the robot looks beside what is declared of it, and what that adds to the variances.

Numbers of a kind, the zeros of all joints, say, are declared by one standard deviation. The windows see combinations of
them. Where those are as far off as k times that would make them, what the windows do not see is likely to be as well.
And a single thing may be mistaken where all others of its kind are right, the inertial of one link, or a part of that,
its mass. The estimate stays what it is: of its errors, the part that comes from the kind, thing or part is k times as
large (docs/trajectory.md, eq. 7). In geodesy these are variance components (Koch 1999, section 3.6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.results.evidence import (
    AS_DECLARED,
    Distance,
    LikelyScale,
    PriorComparison,
)

# Chance beforehand that a kind is declared too certain, and up to which that counts for nothing.
_TOO_SMALL = (0.05, 0.05)
# Chance beforehand that a single thing is mistaken, and up to which that counts for nothing: of many right ones, one
# looks so by chance.
_MISTAKEN = (0.01, 0.2)
# The two chances of a part that is mistaken by itself more often than the thing it is part of: a link's mass.
_PART_MISTAKEN = (0.05, 0.1)
# Chance that something is further off than declared, from which that is told: the opposite is nine times less likely.
_SURE = 0.9


@dataclass(frozen=True, eq=False)
class PriorScaleFactors:
    """How many times as far off as declared things are.

    Attributes
    ----------
    sizes : by kind of cause ('zero', 'link', ...), by single cause ('zero:joint1'), and by part of one ('mass:link1')
    distances : by single cause, of what the data see of it
    each : (e,) that factor of each of the unknowns' independent numbers
    covariance : (e, e) of these, of unit variance beforehand, if all are as declared
    within : of each of these names, those of what it belongs to
    """

    sizes: Mapping[str, LikelyScale]
    distances: Mapping[str, Distance]
    each: Array
    covariance: Array
    within: Mapping[str, Sequence[str]]

    @staticmethod
    def of(values: Array, covariance: Array, causes: Sequence[str], parts: Sequence[str]) -> PriorScaleFactors:
        """Return what data say of them.

        Parameters
        ----------
        values, covariance : (e,), (e, e) of the numbers, of unit variance about zero beforehand
        causes : what each of them belongs to, 'zero:joint1'
        parts : what of that each is by itself, 'mass:link1'; empty where nothing
        """
        each, groups = np.ones(len(values)), _Groups.of(tuple(causes), tuple(parts))
        sizes: dict[str, LikelyScale] = {}
        distances: dict[str, Distance] = {}
        beyond = values**2 + covariance.diagonal() - 1.0  # on average at most zero of what looks as declared
        for names, own, chances, single in groups.alike:
            if not (single or np.any(np.add.reduce(beyond[own], axis=1) > 0.0)):
                sizes |= dict.fromkeys(names, AS_DECLARED)
                continue
            numbers = PriorComparison.of(values[own], covariance[own[:, :, None], own[:, None, :]])
            likely, away = numbers.likely_sizes(*chances), numbers.distances
            each[own] = np.maximum(each[own], likely[0][:, None])
            sizes |= dict(zip(names, map(LikelyScale, *map(np.ndarray.tolist, likely)), strict=True))
            distances |= dict(zip(names, map(Distance, *map(np.ndarray.tolist, away)), strict=True))
        return PriorScaleFactors(
            {name: sizes[name] for name in groups.within},
            {thing: distances[thing] for thing in groups.things},
            each,
            covariance,
            groups.within,
        )

    @property
    def as_declared(self) -> bool:
        """Whether nothing is further off."""
        return not np.any(self.each > 1.0)

    def beside(self, contributions: Array) -> Array:
        """Return what a covariance's factor grows by, (m, n): columns, of what each number contributes, (e, m).

        An estimate errs by that for each number of unit variance; where they are s times as far off, its variance has
        s^2 - 1 times the square beside what it had (docs/trajectory.md, eq. 7).
        """
        larger = self.each > 1.0
        return np.asarray(contributions[larger].T * np.sqrt(self.each[larger] ** 2 - 1.0))

    @property
    def likeliest(self) -> tuple[str, float]:
        """The kind or thing that would explain most by being further off, and what the log-likelihood gains by that."""
        return max(
            ((cause, size.gain) for cause, size in self.sizes.items()), key=lambda each: each[1], default=('', 0.0)
        )

    @property
    def sure(self) -> tuple[tuple[str, float], ...]:
        """What is surely further off than declared, and further than what it belongs to; how many times as far."""
        found = {cause: size.factor for cause, size in self.sizes.items() if size.chance > _SURE}
        return tuple(
            (cause, size)
            for cause, size in found.items()
            if all(size > found.get(whole, 1.0) for whole in self.within[cause])
        )


def _kind(cause: str) -> str:
    """Return the kind of a cause of the error budget: of 'link:arm', 'link'."""
    return cause.partition(':')[0]


@dataclass(frozen=True, eq=False)
class _Groups:
    """Which numbers belong together.

    Attributes
    ----------
    within : by name of kinds, of single causes that are no kinds and of parts of these, what each belongs to
    things : single causes
    alike : names of groups of as many numbers, where these are, (B, n), the chances that they are declared wrong, and
        whether single causes are among them
    """

    within: Mapping[str, Sequence[str]]
    things: tuple[str, ...]
    alike: tuple[tuple[tuple[str, ...], Integers, tuple[float, float], bool], ...]

    @staticmethod
    @lru_cache(maxsize=8)  # a run asks at each window
    def of(causes: tuple[str, ...], parts: tuple[str, ...]) -> _Groups:
        """Return the groups that causes, and parts of them, make."""
        kinds: dict[str, list[int]] = {}
        things: dict[str, list[int]] = {}
        for place, cause in enumerate(causes):
            kinds.setdefault(_kind(cause), []).append(place)
            things.setdefault(cause, []).append(place)
        alone = {part: [place] for place, part in enumerate(parts) if part}
        within: dict[str, Sequence[str]] = dict.fromkeys(kinds, ())
        within |= {thing: (_kind(thing),) for thing in things if thing not in kinds}
        within |= {part: (_kind(causes[place]), causes[place]) for part, (place,) in alone.items()}
        alike: dict[tuple[int, tuple[float, float]], dict[str, list[int]]] = {}
        for name, places in {**things, **kinds, **alone}.items():  # a kind may be a single thing
            chances = _TOO_SMALL if name in kinds else _PART_MISTAKEN if name in alone else _MISTAKEN
            alike.setdefault((len(places), chances), {})[name] = places
        return _Groups(
            within,
            tuple(things),
            tuple(
                (tuple(own), np.array(list(own.values())), chances, not things.keys().isdisjoint(own))
                for (_, chances), own in alike.items()
            ),
        )
