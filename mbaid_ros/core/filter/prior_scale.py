"""The scale of the unknowns' priors: deviations beyond the declared ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby

import numpy as np

from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.results.evidence import (
    AS_DECLARED,
    Distance,
    LikelyScale,
    PriorComparison,
)

# Prior probability that a kind is declared too certain, and the posterior below which that counts for nothing; the same
# of a single thing (of many right ones, one looks mistaken by chance), and of a part of one: a link's mass.
_KIND, _THING, _PART = (0.05, 0.05), (0.01, 0.2), (0.05, 0.1)
_SURE = 0.9  # probability that something is further off than declared, from which that is reported


@dataclass(frozen=True, eq=False)
class PriorScaleFactors:
    """Variance components of the unknowns' priors (Koch 1999, section 3.6; trajectory.md, eq. 7).

    If the observed unknowns of a kind are k times as far off as declared, the unobserved ones probably are as well. A
    single thing, or a part of one, may be mistaken where all others of its kind are right. The estimate stays; the part
    of its errors that comes from the kind, thing or part is k times as large.
    """

    # by kind of cause ('zero', 'link', ...), by single cause ('zero:joint1'), and by part of one ('mass:link1')
    sizes: Mapping[str, LikelyScale]
    distances: Mapping[str, Distance]  # by single cause, of its observed part
    each: Array  # (e,) the factor of each of the unknowns' independent numbers
    covariance: Array  # (e, e) of these, of unit variance a priori, if all are as declared
    within: Mapping[str, Sequence[str]]  # the names that each of these names belongs to

    @staticmethod
    def of(
        values: Array, covariance: Array, causes: Sequence[str], parts: Sequence[str], moved: Array | None = None
    ) -> PriorScaleFactors:
        """Return the factors that data make likely.

        Parameters
        ----------
        values, covariance : (e,), (e, e) of the numbers, of unit variance about zero a priori
        causes, parts : 'zero:joint1' that each belongs to, 'mass:link1' that it is by itself, or empty
        moved : (d, e) as of `Curvature.unknowns`
        """
        groups = _Groups.of(tuple(causes), tuple(parts))
        each, names = np.ones(len(values)), groups.rows
        table = np.zeros((3, len(names), groups.alike[-1][1].shape[1] if names else 0))
        table[1] = 1.0  # beyond its numbers a row has nothing that the data observe
        for rows, own in groups.alike:
            shifts = None if moved is None else moved[:, own]
            numbers = PriorComparison.of(values[own], covariance[own[:, :, None], own[:, None, :]], shifts)
            table[:, rows, : own.shape[1]] = numbers.mean, numbers.variance, numbers.curved
        numbers = PriorComparison(table[0], table[1], table[2] > 0.0)
        likely, away = numbers.likely_sizes(*groups.chances), numbers.distances
        for row in np.flatnonzero(likely[0] > 1.0).tolist():
            own = groups.places[names[row]]
            each[own] = np.maximum(each[own], likely[0][row])
        sizes = dict(zip(names, map(LikelyScale, *map(np.ndarray.tolist, likely)), strict=True))
        distances = dict(zip(names, map(Distance, *map(np.ndarray.tolist, away)), strict=True))
        beyond = values**2 + covariance.diagonal() - 1.0  # on average at most zero for numbers as declared
        for kind in groups.wide:
            own, sizes[kind] = groups.places[kind], AS_DECLARED
            if np.add.reduce(beyond[own]) > 0.0:
                found = PriorComparison.of(values[own], covariance[own[:, None], own]).likely_sizes(*_KIND)
                sizes[kind] = LikelyScale(*map(float, found))
                each[own] = np.maximum(each[own], sizes[kind].factor)
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
        """Return the columns (m, n) that a covariance factor gains, of the contributions (e, m) of each number.

        Numbers s times as far off add s^2 - 1 times the square of their contribution (trajectory.md, eq. 7).
        """
        larger = self.each > 1.0
        return np.asarray(contributions[larger].T * np.sqrt(self.each[larger] ** 2 - 1.0))

    @property
    def likeliest(self) -> tuple[str, float]:
        """The kind or thing that explains most by being further off, and the gain of log-likelihood."""
        return max(
            ((cause, size.gain) for cause, size in self.sizes.items()), key=lambda each: each[1], default=('', 0.0)
        )

    @property
    def sure(self) -> tuple[tuple[str, float], ...]:
        """Names that are surely further off than declared, and than their group, with the factor."""
        factors = {cause: factor.factor for cause, factor in self.sizes.items() if factor.chance > _SURE}
        return tuple(
            (cause, factor)
            for cause, factor in factors.items()
            if all(factor > factors.get(whole, 1.0) for whole in self.within[cause])
        )


def _kind(cause: str) -> str:
    """Return the kind of a cause of the error budget: of 'link:arm', 'link'."""
    return cause.partition(':')[0]


@dataclass(frozen=True, eq=False)
class _Groups:
    """Groups of numbers, by name: single causes and parts of them, compared as rows of one table, and kinds."""

    # within, places: the names that each belongs to, as above; the indices of its numbers
    within: Mapping[str, Sequence[str]]
    places: Mapping[str, Integers]
    # things, wide, rows: single causes; kinds of several causes; names of the rows
    things: tuple[str, ...]
    wide: tuple[str, ...]
    rows: tuple[str, ...]
    alike: tuple[tuple[slice, Integers], ...]  # (rows, places (B, n)) of the groups of n numbers
    chances: tuple[Array, Array]  # prior probabilities of the rows, (B,) each of the pair

    @staticmethod
    @lru_cache(maxsize=8)  # a run asks at each window
    def of(causes: tuple[str, ...], parts: tuple[str, ...]) -> _Groups:
        """Return the groups of causes, and of parts of them."""
        kinds: dict[str, list[int]] = {}
        things: dict[str, list[int]] = {}
        for place, cause in enumerate(causes):
            kinds.setdefault(_kind(cause), []).append(place)
            things.setdefault(cause, []).append(place)
        alone = {part: [place] for place, part in enumerate(parts) if part}
        within: dict[str, Sequence[str]] = dict.fromkeys(kinds, ())
        within |= {thing: (_kind(thing),) for thing in things if thing not in kinds}
        within |= {part: (_kind(causes[place]), causes[place]) for part, (place,) in alone.items()}
        places = {name: np.array(own) for name, own in {**things, **kinds, **alone}.items()}
        wide = tuple(kind for kind in kinds if kind not in things)  # a kind may be a single thing
        rows = sorted((name for name in places if name not in wide), key=lambda name: len(places[name]))
        alike: list[tuple[slice, Integers]] = []
        for _, equal in groupby(rows, key=lambda name: len(places[name])):
            own = np.array([places[name] for name in equal])
            start = alike[-1][0].stop if alike else 0
            alike.append((slice(start, start + len(own)), own))
        chances = [_KIND if name in kinds else _PART if name in alone else _THING for name in rows]
        too_small, doubt = np.array(chances).reshape(-1, 2).T
        return _Groups(within, places, tuple(things), wide, tuple(rows), tuple(alike), (too_small, doubt))
