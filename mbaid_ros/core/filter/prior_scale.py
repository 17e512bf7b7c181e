"""The scale of the unknowns' priors: deviations beyond the declared ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, Integers
from mbaid_ros.core.results.reporting import LARGEST_SHIFT
from mbaid_ros.core.results.status import Distance

# Prior probability that a kind is declared too certain, and the posterior below which that counts for nothing; the same
# of a single thing (of many right ones, one looks mistaken by chance), and of a part of one: a link's mass.
_KIND, _THING, _PART = (0.05, 0.05), (0.01, 0.2), (0.05, 0.1)
_SURE = 0.9  # probability that something is further off than declared, from which that is reported


# Of a standard deviation, which a cause is tried with: the likelihood is flat enough for steps of three.
_FACTORS = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
# Times a standard deviation, among which the likeliest is looked for: finer than for causes, as intervals depend on
# it.
_SIZES = (1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0)
# Of the prior's variance, which data have to take off a direction for it to be seen: quotients of less are rounding.
_SEEN = 0.01


class LikelyScale(NamedTuple):
    """How many times as far from zero as declared numbers are, the chance of more than once, the gain of likelihood."""

    factor: float
    chance: float
    gain: float


AS_DECLARED = LikelyScale(1.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class PriorComparison:
    """Numbers of unit variance beforehand, in the directions that the data know independently.

    If the prior is right, the posterior mean m varies about zero with S = 1 - P, P the posterior covariance; if the
    numbers are k times as far off, with S + (k^2 - 1) S^2. With k times the standard deviation, prior information falls
    by D = 1 - 1/k^2, and the log-likelihood of the data grows by (trajectory.md, eq. 8)

        1/2 m^T (1/D - P)^-1 m  -  1/2 log|1 - D P|  -  n log k
    """

    # mean, variance, curved: (..., n) along these directions; any groups of as many numbers side by side
    mean: Array
    variance: Array
    curved: Flags

    @staticmethod
    def from_posterior(mean: Array, covariance: Array, moved: Array | None = None) -> PriorComparison:
        """Return numbers by their mean (..., n) and covariance (..., n, n).

        A direction is curved along which these have `moved` (d, ..., n), where windows were linearised elsewhere, by a
        good part of the deviation sqrt(1 - variance) that means have: the data observe it at second order only.
        """
        variance, directions = np.linalg.eigh(covariance)
        variance, back = np.clip(variance, 0.0, 1.0), np.swapaxes(directions, -1, -2)
        along = (back @ mean[..., None])[..., 0]
        shifts = np.zeros((0, *along.shape)) if moved is None else (back @ moved[..., None])[..., 0]
        return PriorComparison(along, variance, np.any(shifts**2 > LARGEST_SHIFT**2 * (1.0 - variance), axis=0))

    @property
    def distances(self) -> tuple[Array, Array, Array]:
        """The observed distance of each group from zero: (...) for each field of `Distance`."""
        seen = 1.0 - self.variance
        enough = (seen > _SEEN) & ~self.curved
        squares = np.where(enough, self.mean**2, 0.0) / np.where(enough, seen, 1.0)
        twice = squares / (1.0 + 3.0 * seen)
        return np.add.reduce(squares, axis=-1), np.add.reduce(twice, axis=-1), np.add.reduce(enough, axis=-1)

    def gain(self, most: float) -> tuple[Array, Array]:
        """Return the largest gains of log-likelihood (...), and the factors k up to `most` that do it."""
        return self._largest([factor for factor in _FACTORS if factor <= most])

    def likely_scales(self, too_small: float | Array, doubt: float | Array) -> tuple[Array, Array, Array]:
        """Return the distance of each group from zero over the declared one: (...) for each field of `LikelyScale`.

        The root mean square of one and the likeliest factor, by the chance of either; numbers that the data
        do not observe leave it at one.

        Parameters
        ----------
        too_small : chance that they are declared too certain, before the data are asked; of all groups or (...) each
        doubt : chance afterwards up to which that counts for nothing
        """
        # Only a mean larger than the data expect can gain by a factor.
        larger = np.add.reduce(self.mean**2, axis=-1) > np.add.reduce(1.0 - self.variance, axis=-1)
        if not larger.any():
            nothing = np.zeros(larger.shape)
            return nothing + 1.0, nothing, nothing
        most, factor = self._largest(_SIZES)
        odds = too_small * np.exp(np.minimum(most, 100.0))
        chance = np.maximum(0.0, (odds / (1.0 - too_small + odds) - doubt) / (1.0 - doubt))
        chance = np.where(larger, chance, 0.0)
        return np.sqrt(1.0 + chance * (factor**2 - 1.0)), chance, np.where(larger, np.maximum(most, 0.0), 0.0)

    def _largest(self, factors: Sequence[float]) -> tuple[Array, Array]:
        k = np.array(factors)[:, None]
        less = 1.0 - k**-2
        mean, left = self.mean[..., None, :], 1.0 - less * self.variance[..., None, :]
        gains = 0.5 * np.add.reduce(less * mean**2 / left - np.log(left) - 2.0 * np.log(k), axis=-1)
        return np.asarray(gains.max(axis=-1)), k[gains.argmax(axis=-1), 0]


@dataclass(frozen=True, eq=False)
class PriorScaleFactors:
    """Variance components of the unknowns' priors (Koch 1999, section 3.6; trajectory.md, eq. 7).

    If the observed unknowns of a kind are k times as far off as declared, the unobserved ones probably are as well. A
    single thing, or a part of one, may be mistaken where all others of its kind are right. The estimate stays; the part
    of its errors that comes from the kind, thing or part is k times as large.
    """

    # by kind of cause ('zero', 'link', ...), by single cause ('zero:joint1'), and by part of one ('mass:link1')
    scales: Mapping[str, LikelyScale]
    distances: Mapping[str, Distance]  # by single cause, of its observed part
    factors: Array  # (e,) the factor of each of the unknowns' independent numbers
    covariance: Array  # (e, e) of these, of unit variance a priori, if all are as declared
    within: Mapping[str, Sequence[str]]  # the names that each of these names belongs to

    @staticmethod
    def from_posterior(
        values: Array, covariance: Array, causes: Sequence[str], parts: Sequence[str], moved: Array | None = None
    ) -> PriorScaleFactors:
        """Return the factors that data make likely.

        Parameters
        ----------
        values, covariance : (e,), (e, e) of the numbers, of unit variance about zero a priori
        causes, parts : 'zero:joint1' that each belongs to, 'mass:link1' that it is by itself, or empty
        moved : (d, e) as of `Curvature.unknowns`
        """
        groups = _Groups.from_causes(tuple(causes), tuple(parts))
        each, names = np.ones(len(values)), groups.rows
        table = np.zeros((3, len(names), groups.alike[-1][1].shape[1] if names else 0))
        table[1] = 1.0  # beyond its numbers a row has nothing that the data observe
        for rows, own in groups.alike:
            shifts = None if moved is None else moved[:, own]
            numbers = PriorComparison.from_posterior(values[own], covariance[own[:, :, None], own[:, None, :]], shifts)
            table[:, rows, : own.shape[1]] = numbers.mean, numbers.variance, numbers.curved
        numbers = PriorComparison(table[0], table[1], table[2] > 0.0)
        likely, away = numbers.likely_scales(*groups.chances), numbers.distances
        for row in np.flatnonzero(likely[0] > 1.0).tolist():
            own = groups.places[names[row]]
            each[own] = np.maximum(each[own], likely[0][row])
        scales = dict(zip(names, map(LikelyScale, *map(np.ndarray.tolist, likely)), strict=True))
        distances = dict(zip(names, map(Distance, *map(np.ndarray.tolist, away)), strict=True))
        beyond = values**2 + covariance.diagonal() - 1.0  # on average at most zero for numbers as declared
        for kind in groups.wide:
            own, scales[kind] = groups.places[kind], AS_DECLARED
            if np.add.reduce(beyond[own]) > 0.0:
                found = PriorComparison.from_posterior(values[own], covariance[own[:, None], own]).likely_scales(*_KIND)
                scales[kind] = LikelyScale(*map(float, found))
                each[own] = np.maximum(each[own], scales[kind].factor)
        return PriorScaleFactors(
            {name: scales[name] for name in groups.within},
            {thing: distances[thing] for thing in groups.things},
            each,
            covariance,
            groups.within,
        )

    @property
    def as_declared(self) -> bool:
        """Whether nothing is further off."""
        return not np.any(self.factors > 1.0)

    def added_columns(self, contributions: Array) -> Array:
        """Return the columns (m, n) that a covariance factor gains, of the contributions (e, m) of each number.

        Numbers s times as far off add s^2 - 1 times the square of their contribution (trajectory.md, eq. 7).
        """
        larger = self.factors > 1.0
        return np.asarray(contributions[larger].T * np.sqrt(self.factors[larger] ** 2 - 1.0))

    @property
    def likeliest(self) -> tuple[str, float]:
        """The kind or thing that explains most by being further off, and the gain of log-likelihood."""
        return max(
            ((cause, size.gain) for cause, size in self.scales.items()), key=lambda each: each[1], default=('', 0.0)
        )

    @property
    def significant(self) -> tuple[tuple[str, float], ...]:
        """Names that are surely further off than declared, and than their group, with the factor."""
        factors = {cause: factor.factor for cause, factor in self.scales.items() if factor.chance > _SURE}
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
    def from_causes(causes: tuple[str, ...], parts: tuple[str, ...]) -> _Groups:
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
