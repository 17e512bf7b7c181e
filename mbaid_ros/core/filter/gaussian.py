"""Mean and covariance of the state as published, and the scale of the unknowns' priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from itertools import groupby

import numpy as np
from scipy.linalg.lapack import dpotri, dtrtrs

from mbaid_ros.core.filter.joint_noise import InformationCorrection
from mbaid_ros.core.filter.square_root import SquareRootInformation
from mbaid_ros.core.filter.state import BODY, MOMENTUM, Layout
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.geometry import Array, Flags, Integers
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

    Where what the windows see of a kind of unknowns is as far off as k times its declared deviation would make it, what
    they do not see probably is as well. A single thing, or a part of one, may be mistaken where all others of its kind
    are right. The estimate stays; the part of its errors that comes from the kind, thing or part is k times as large.

    Attributes
    ----------
    sizes : by kind of cause ('zero', 'link', ...), by single cause ('zero:joint1'), and by part of one ('mass:link1')
    distances : by single cause, of what the data see of it
    each : (e,) the factor of each of the unknowns' independent numbers
    covariance : (e, e) of these, of unit variance a priori, if all are as declared
    within : the names that each of these names belongs to
    """

    sizes: Mapping[str, LikelyScale]
    distances: Mapping[str, Distance]
    each: Array
    covariance: Array
    within: Mapping[str, Sequence[str]]

    @staticmethod
    def of(values: Array, covariance: Array, causes: Sequence[str], parts: Sequence[str]) -> PriorScaleFactors:
        """Return the factors that data make likely.

        Parameters
        ----------
        values, covariance : (e,), (e, e) of the numbers, of unit variance about zero a priori
        causes, parts : 'zero:joint1' that each belongs to, 'mass:link1' that it is by itself, or empty
        """
        groups = _Groups.of(tuple(causes), tuple(parts))
        each, names = np.ones(len(values)), groups.narrow.names
        table = np.zeros((2, len(names), groups.narrow.width))
        table[1] = 1.0  # beyond its numbers a row has nothing that the data observe
        for rows, own in groups.narrow.alike:
            numbers = PriorComparison.of(values[own], covariance[own[:, :, None], own[:, None, :]])
            table[0, rows, : own.shape[1]], table[1, rows, : own.shape[1]] = numbers.mean, numbers.variance
        numbers = PriorComparison(*table)
        likely, away = numbers.likely_sizes(*groups.narrow.chances), numbers.distances
        for row in np.flatnonzero(likely[0] > 1.0).tolist():
            own = groups.places[names[row]]
            each[own] = np.maximum(each[own], likely[0][row])
        sizes = dict(zip(names, map(LikelyScale, *map(np.ndarray.tolist, likely)), strict=True))
        distances = dict(zip(names, map(Distance, *map(np.ndarray.tolist, away)), strict=True))
        beyond = values**2 + covariance.diagonal() - 1.0  # on average at most zero of what looks as declared
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
        """Names that are surely further off than declared, and than what they belong to, with the factor."""
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
class _Narrow:
    """Groups that are compared together, as rows of one table.

    Attributes
    ----------
    names : of the rows
    alike : (rows, places (B, n)) of the groups of n numbers
    chances : (B,) each, prior probabilities of the rows
    width : the most numbers of a row
    """

    names: tuple[str, ...]
    alike: tuple[tuple[slice, Integers], ...]
    chances: tuple[Array, Array]
    width: int

    @staticmethod
    def of(places: Mapping[str, Integers], chances: Mapping[str, tuple[float, float]]) -> _Narrow:
        """Return the rows of groups, by name."""
        names = sorted(places, key=lambda name: len(places[name]))
        alike, start = [], 0
        for _, equal in groupby(names, key=lambda name: len(places[name])):
            own = np.array([places[name] for name in equal])
            alike.append((slice(start, start + len(own)), own))
            start += len(own)
        width = max((own.shape[1] for _, own in alike), default=0)
        too_small, doubt = np.array([chances[name] for name in names]).reshape(-1, 2).T
        return _Narrow(tuple(names), tuple(alike), (too_small, doubt), width)


@dataclass(frozen=True, eq=False)
class _Groups:
    """Groups of numbers: `within` as above, single causes, places by name, and kinds of several causes (`wide`)."""

    within: Mapping[str, Sequence[str]]
    things: tuple[str, ...]
    places: Mapping[str, Integers]
    wide: tuple[str, ...]
    narrow: _Narrow  # single causes, and parts of them

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
        chances = {name: _KIND if name in kinds else _PART if name in alone else _THING for name in places}
        wide = tuple(kind for kind in kinds if kind not in things)  # a kind may be a single thing
        narrow = {name: own for name, own in places.items() if name not in wide}
        return _Groups(within, tuple(things), places, wide, _Narrow.of(narrow, chances))


@dataclass(frozen=True, eq=False)
class MeanAndCovariance:
    """Mean (s,) and covariance of the state, SI units.

    `shift` (s,) is the part of the mean that corrects for shared noise; `force` (6,) a constant force and torque.
    """

    gaussian: SquareRootInformation
    variables: Variables
    mean: Array
    shift: Array
    force: Array

    @staticmethod
    def of(gaussian: SquareRootInformation, variables: Variables) -> MeanAndCovariance:
        """Return them of a Gaussian in information form."""
        mean, shift = gaussian.moments()
        count, spread = len(variables.scale), variables.spread
        force = variables.force[:, : gaussian.size - count] @ mean[count:]
        return MeanAndCovariance(gaussian, variables, spread @ mean[:count], spread @ shift[:count], force)

    @cached_property
    def factor(self) -> Array:
        """Factor of the covariance of the state, (s, v), without what the variables leave out."""
        return self.variables.of_state(self.gaussian.factor[: len(self.variables.scale)])

    @property
    def force_factor(self) -> Array:
        """Factor of the covariance of the constant force, (6, v)."""
        count = len(self.variables.scale)
        return np.asarray(self.variables.force[:, : self.gaussian.size - count] @ self.gaussian.factor[count:])

    @cached_property
    def variance(self) -> Array:
        """Variances of the state, (s,)."""
        return np.add.reduce(self.factor**2, axis=1) + self.variables.outside.diagonal()

    @property
    def deviation(self) -> Array:
        """Standard deviations, (s,)."""
        return np.sqrt(self.variance)

    def factor_of(self, numbers: Array) -> Array:
        """Return a covariance factor (m, v) of numbers (m, w) that are linear in the first w variables."""
        right = np.zeros((self.gaussian.size, len(numbers)), order='F')
        right[: numbers.shape[1]] = numbers.T
        return np.asarray(dtrtrs(self.gaussian.root[:, :-2], right, trans=1, overwrite_b=True)[0]).T

    def by_force(self, pushed: Array) -> Array:
        """Return the (6,) change of the momentum by a constant force, of `pushed` (p, f) as of `HypothesisFilter`."""
        variables, count = self.variables, len(self.variables.scale)
        if self.gaussian.size == count:
            return np.zeros(6)
        numbers = self.gaussian.moments()[0][count:]
        change = np.broadcast_to(pushed, (variables.head - variables.poses, len(numbers))) @ numbers
        return np.asarray(variables.spread[MOMENTUM, variables.poses : variables.head] @ change)

    def covariance(self, rows: Integers) -> Array:
        """Return the covariance (r, r) of some numbers of the state."""
        part = self.factor_of(self.variables.spread[rows])
        return np.asarray(part @ part.T + self.variables.outside[np.ix_(rows, rows)])

    def published(self, sizes: PriorScaleFactors, layout: Layout, rows: Integers) -> tuple[Array, Array]:
        """Return some numbers (r,) of the state, the body's among them, and a covariance factor (r, w), as published.

        With the correction for noise in the rows (trajectory.md, eq. 14), and the priors scaled (eq. 7).
        """
        body, attenuation = self._attenuated
        part = self.factor_of(self.variables.spread[rows])
        times = self.amplification(part, rows)
        columns = [times @ part, self.by_score(part)]
        if not sizes.as_declared:
            columns.append(times @ sizes.beside(self.contributions(part, layout)))
        return self.mean[rows] + part @ (body.T @ attenuation.shift), np.concatenate(columns, axis=1)

    def amplification(self, part: Array, rows: Integers) -> Array:
        """Return the (r, r) amplification of errors by noise in the rows, of numbers with a factor `part` (r, v)."""
        body, attenuation = self._attenuated
        more = part @ body.T @ attenuation.gain
        return np.asarray(np.eye(len(rows)) + more @ self.variables.gather[self.variables.body, rows])

    def by_score(self, part: Array) -> Array:
        """Return the columns (m, b) that the score of noise in the rows adds to a covariance factor (m, v)."""
        body, attenuation = self._attenuated
        return np.asarray(part @ body.T @ attenuation.score)

    @cached_property
    def _attenuated(self) -> tuple[Array, InformationCorrection]:
        """A covariance factor (b, v) of the body's variables, and their correction (trajectory.md, eq. 14)."""
        variables = self.variables
        body = self.factor_of(np.eye(variables.own)[variables.body])
        mean = variables.gather[variables.body, BODY] @ self.mean[BODY]
        return body, InformationCorrection.of(body @ body.T, self.gaussian.bias_information, mean)

    def with_variables(self, factor: Array) -> Array:
        """Return the covariance (v, m) of the variables with numbers of a covariance factor (m, v)."""
        return np.asarray(dtrtrs(self.gaussian.root[:, :-2], factor.T)[0])

    def unknowns(self, layout: Layout) -> tuple[Array, Array]:
        """Return the unknowns' numbers (e,), of unit variance about zero a priori, and their covariance (e, e).

        They come last, with a force: the lower rows of the triangle are the root of their marginal information.
        """
        known = layout.known
        values, covariance = self.mean[BODY.stop :] - known.mean, self.of_unknowns
        if known.independent:
            return values, covariance
        return known.whitening @ values, known.whitening @ covariance @ known.whitening.T

    @cached_property
    def of_unknowns(self) -> Array:
        """The covariance (e, e) of the unknowns in the state."""
        first = self.variables.own
        count = len(self.variables.scale) - first
        if not count:  # LAPACK complains of empty triangles, on the terminal
            return np.zeros((0, 0))
        upper = dpotri(self.gaussian.root[first:, first:-2])[0][:count, :count]
        return np.where(_upper(count), upper, upper.T)

    def sizes(self, layout: Layout) -> PriorScaleFactors:
        """Return the scale factors of the unknowns' priors."""
        return PriorScaleFactors.of(*self.unknowns(layout), layout.cause_of, layout.part_of)

    def contributions(self, factor: Array, layout: Layout) -> Array:
        """Return the contributions (e, m) of the unknowns' independent numbers to the errors of m numbers.

        That of a number of unit variance is its covariance with the estimate. `factor` (m, v) is that of `factor_of`.
        """
        with_unknowns = self.with_variables(factor)[self.variables.own : len(self.variables.scale)]
        return with_unknowns if layout.known.independent else np.asarray(layout.known.whitening @ with_unknowns)


@cache
def _upper(size: int) -> Flags:
    """Return which places are those of an upper triangle."""
    return np.asarray(np.triu(np.ones((size, size), dtype=bool)))
