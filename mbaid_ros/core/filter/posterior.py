"""The posterior of a run: variance components of the priors, shares of the variance, the start of the next run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import groupby
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.linalg.lapack import dpotri, dtrtrs

from mbaid_ros.core.contracts import Hypothesis, Unknown
from mbaid_ros.core.filter.gaussian import SquareRootInformation, upper_ones
from mbaid_ros.core.filter.time_update import new_motion
from mbaid_ros.core.geometry import Array, Flags, Integers, cross
from mbaid_ros.core.joints.model import InformationCorrection
from mbaid_ros.core.results.estimate import SENSOR_NOISE, DeferredBudget, ErrorBudget
from mbaid_ros.core.results.verdict import LARGEST_SHIFT, Distance
from mbaid_ros.core.robot.body import physical_jacobian
from mbaid_ros.core.samples import FEWEST, Samples, SensorNoise, with_rates
from mbaid_ros.core.state import BODY, BODY_PLACES, LINEAR, MOMENTUM, Declared, Layout, Point, Variables
from mbaid_ros.core.windows import WindowNoise, window_noises

# Prior probability that a kind is set too certain, and the posterior below which that counts for nothing; the same
# of a single thing (of many right ones, one looks mistaken by chance), and of a part of one: a link's mass.
_KIND, _THING, _PART = (0.05, 0.05), (0.01, 0.2), (0.05, 0.1)
_SURE = 0.9  # probability that something is further off than specified, from which that is reported
# Of a standard deviation, which a cause is tried with: the likelihood is flat enough for steps of three.
_FACTORS = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
# Times that from which a factor is the rarer, and by which power: of a number that the data hardly observe all factors
# are as likely, and the largest ones would lead.
_OFTEN, _RARER = 10.0, 2.0
# Times a standard deviation, among which the likeliest is looked for: finer than for causes, as intervals depend on
# it.
_SIZES = (1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 16.0, 25.0, 40.0, 63.0, 100.0)
# Of the prior's variance, which data have to take off a direction for it to be seen: quotients of less are rounding.
_SEEN = 0.01
FIRST = LINEAR.start  # after the pose error, which each motion draws anew
U = TypeVar('U', bound=Unknown)
_ROUNDING = 1e-3  # of a variance: a share further below zero is a difference of large numbers


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
    by D = 1 - 1/k^2, and the log-likelihood of the data grows by (intervals.md, eq. 3)

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
        most, factor = self._largest(_SIZES, _RARER * np.log(np.maximum(np.array(_SIZES) / _OFTEN, 1.0)))
        odds = too_small * np.exp(np.minimum(most, 100.0))
        chance = np.maximum(0.0, (odds / (1.0 - too_small + odds) - doubt) / (1.0 - doubt))
        chance = np.where(larger, chance, 0.0)
        return np.sqrt(1.0 + chance * (factor**2 - 1.0)), chance, np.where(larger, np.maximum(most, 0.0), 0.0)

    def _largest(self, factors: Sequence[float], rarer: Array | float = 0.0) -> tuple[Array, Array]:
        k = np.array(factors)[:, None]
        less = 1.0 - k**-2
        mean, left = self.mean[..., None, :], 1.0 - less * self.variance[..., None, :]
        gains = 0.5 * np.add.reduce(less * mean**2 / left - np.log(left) - 2.0 * np.log(k), axis=-1) - rarer
        return np.asarray(gains.max(axis=-1)), k[gains.argmax(axis=-1), 0]


@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """Variance components of the unknowns' priors (Koch 1999, section 3.6; intervals.md, eq. 4).

    If the observed unknowns of a kind are k times as far off as declared, the unobserved ones probably are as well. A
    single thing, or a part of one, may be mistaken where all others of its kind are right. The estimate stays; the part
    of its errors that comes from the kind, thing or part is k times as large.
    """

    # by kind of cause ('zero', 'link', ...), by single cause ('zero:joint1'), by part of one ('mass:link1'), and by
    # direction of one, its density
    scales: Mapping[str, LikelyScale]
    distances: Mapping[str, Distance]  # by single cause, of its observed part
    factors: Array  # (e,) the factor of each of the unknowns' independent numbers
    covariance: Array  # (e, e) of these, of unit variance a priori, if all are as declared
    within: Mapping[str, Sequence[str]]  # the names that each of these names belongs to

    @staticmethod
    def from_posterior(
        values: Array,
        covariance: Array,
        causes: Sequence[str],
        parts: Sequence[str],
        moved: Array | None = None,
        directions: Mapping[str, Array] | None = None,
    ) -> VarianceComponents:
        """Return the factors that data make likely.

        Parameters
        ----------
        values, covariance : (e,), (e, e) of the numbers, of unit variance about zero a priori
        causes, parts : 'zero:joint1' that each belongs to, 'mass:link1' that it is by itself, or empty
        moved : (d, e) as of `Nonlinearity.unknowns`
        directions : by name, unit vectors (e,) along which a single cause may be mistaken as a whole: it is scaled then
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
        within = dict(groups.within)
        for name, along in (directions or {}).items():
            cause = causes[int(np.argmax(np.abs(along)))]
            shift = None if moved is None else (moved @ along)[:, None]
            numbers = PriorComparison.from_posterior(
                along @ values[:, None], (along @ covariance @ along)[None, None], shift
            )
            scales[name] = LikelyScale(*map(float, numbers.likely_scales(*_PART)))
            own, within[name] = groups.places[cause], (_kind(cause), cause)
            each[own] = np.maximum(each[own], scales[name].factor)
        return VarianceComponents(
            {name: scales[name] for name in within},
            {thing: distances[thing] for thing in groups.things},
            each,
            covariance,
            within,
        )

    @property
    def as_declared(self) -> bool:
        """Whether nothing is further off."""
        return not np.any(self.factors > 1.0)

    def added_columns(self, contributions: Array) -> Array:
        """Return the columns (m, n) that a covariance factor gains, of the contributions (e, m) of each number.

        Numbers s times as far off add s^2 - 1 times the square of their contribution (intervals.md, eq. 4).
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
    def from_gaussian(gaussian: SquareRootInformation, variables: Variables) -> MeanAndCovariance:
        """Return them of a Gaussian in information form."""
        both, count = np.column_stack(gaussian.mean_and_shift()), len(variables.scale)
        force = variables.force[:, : gaussian.size - count] @ both[count:, 0]
        mean, shift = variables.state_columns(both[:count]).T
        return MeanAndCovariance(gaussian, variables, mean, shift, force)

    @cached_property
    def factor(self) -> Array:
        """Factor of the covariance of the state, (s, v), without the parts outside the variables."""
        return self.variables.state_columns(self.gaussian.factor[: len(self.variables.scale)])

    @property
    def force_factor(self) -> Array:
        """Factor of the covariance of the constant force, (6, v)."""
        count = len(self.variables.scale)
        return np.asarray(self.variables.force[:, : self.gaussian.size - count] @ self.gaussian.factor[count:])

    @cached_property
    def variance(self) -> Array:
        """Variances of the state, (s,)."""
        return np.add.reduce(self.factor**2, axis=1) + self.variables.covariance_outside.diagonal()

    @property
    def deviation(self) -> Array:
        """Standard deviations, (s,)."""
        return np.sqrt(self.variance)

    def factor_of(self, numbers: Array) -> Array:
        """Return a covariance factor (m, v) of numbers (m, w) that are linear in the first w variables."""
        right = np.zeros((self.gaussian.size, len(numbers)), order='F')
        right[: numbers.shape[1]] = numbers.T
        return np.asarray(dtrtrs(self.gaussian.triangle, right, trans=1, overwrite_b=True)[0]).T

    def impulse_of_force(self, impulse: Array) -> Array:
        """Return the (6,) change of the momentum by a constant force, of `impulse` as of `HypothesisFilter`."""
        variables, count = self.variables, len(self.variables.scale)
        if self.gaussian.size == count:
            return np.zeros(6)
        numbers = self.gaussian.mean_and_shift()[0][count:]
        change = np.broadcast_to(impulse, (variables.moving - variables.pose_size, len(numbers))) @ numbers
        return np.asarray(variables.to_state[MOMENTUM, variables.pose_size : variables.moving] @ change)

    def covariance(self, rows: Integers) -> Array:
        """Return the covariance (r, r) of some numbers of the state."""
        part = self.factor_of(self.variables.to_state[rows])
        return np.asarray(part @ part.T + self.variables.covariance_outside[np.ix_(rows, rows)])

    def published(self, prior_scales: VarianceComponents, layout: Layout, rows: Integers) -> tuple[Array, Array]:
        """Return some numbers (r,) of the state, the body's among them, and a covariance factor (r, w), as published.

        With the correction for noise in the rows (intervals.md, eq. 2), and the priors scaled (eq. 4).
        """
        part = self.factor_of(self.variables.to_state[rows])
        body, attenuation = self._attenuated
        times = self.error_amplification(part, rows)
        columns = [times @ part, self.by_score(part)]
        if not prior_scales.as_declared:
            columns.append(times @ prior_scales.added_columns(self.contributions(part, layout)))
        return self.mean[rows] + part @ (body.T @ attenuation.shift), np.concatenate(columns, axis=1)

    def error_amplification(self, part: Array, rows: Integers) -> Array:
        """Return the (r, r) amplification of errors by noise in the rows, of numbers with a factor `part` (r, v)."""
        body, attenuation = self._attenuated
        more = part @ body.T @ attenuation.gain
        return np.asarray(np.eye(len(rows)) + more @ self.variables.from_state[self.variables.body, rows])

    def by_score(self, part: Array) -> Array:
        """Return the columns (m, b) that the score of noise in the rows adds to a covariance factor (m, v)."""
        body, attenuation = self._attenuated
        return np.asarray(part @ body.T @ attenuation.score)

    @cached_property
    def _attenuated(self) -> tuple[Array, InformationCorrection]:
        """A covariance factor (b, v) of the body's variables, and their correction (intervals.md, eq. 2)."""
        variables = self.variables
        body = self.factor_of(np.eye(variables.first_unknown)[variables.body])
        mean = variables.from_state[variables.body, BODY] @ self.mean[BODY]
        return body, InformationCorrection.from_information(body @ body.T, self.gaussian.bias_information, mean)

    def with_variables(self, factor: Array) -> Array:
        """Return the covariance (v, m) of the variables with numbers of a covariance factor (m, v)."""
        return np.asarray(dtrtrs(self.gaussian.triangle, factor.T)[0])

    def unknowns(self, layout: Layout) -> tuple[Array, Array]:
        """Return the unknowns' numbers (e,), of unit variance about zero a priori, and their covariance (e, e).

        They come last, with a force: the lower rows of the triangle are the root of their marginal information.
        """
        known = layout.known
        values, covariance = self.mean[BODY.stop :] - known.mean, self.unknowns_covariance
        if known.independent:
            return values, covariance
        return known.whitening @ values, known.whitening @ covariance @ known.whitening.T

    @cached_property
    def unknowns_covariance(self) -> Array:
        """The covariance (e, e) of the unknowns in the state."""
        first = self.variables.first_unknown
        count = len(self.variables.scale) - first
        if not count:  # LAPACK complains of empty triangles, on the terminal
            return np.zeros((0, 0))
        upper = dpotri(self.gaussian.triangle[first:, first:])[0][:count, :count]
        return np.where(upper_ones(count), upper, upper.T)

    def unknowns_as_declared(self, layout: Layout) -> tuple[Array, Array]:
        """Return the same where numbers that noise drives beyond their priors count as right."""
        values, covariance = self.unknowns(layout)
        if layout.noise_driven.any():
            free = 1.0 - layout.noise_driven
            values, covariance = values * free, covariance * np.outer(free, free) + np.diag(layout.noise_driven)
        return values, covariance

    def prior_scales(self, layout: Layout, moved: Array | None = None) -> VarianceComponents:
        """Return the scale factors of the unknowns' priors; `moved` (d, e) as of `Nonlinearity.unknowns`."""
        numbers = self.unknowns_as_declared(layout)
        return VarianceComponents.from_posterior(*numbers, layout.cause_of, layout.part_of, moved, layout.directions)

    def contributions(self, factor: Array, layout: Layout) -> Array:
        """Return the contributions (e, m) of the unknowns' independent numbers to the errors of m numbers.

        That of a number of unit variance is its covariance with the estimate. `factor` (m, v) is that of `factor_of`.
        """
        with_unknowns = self.with_variables(factor)[self.variables.first_unknown : len(self.variables.scale)]
        return with_unknowns if layout.known.independent else np.asarray(layout.known.whitening @ with_unknowns)


@dataclass(frozen=True, eq=False)
class End:
    """The last sample of a run, and the rate and noise of its sensors by then."""

    rate: float  # samples a second
    noise: WindowNoise  # of one sample; NaN twist where it is not measured
    time: float  # s since the run's first sample
    joint_position: Array  # (n,) as read
    joint_velocity: Array  # (n,) as read
    stored: Array  # (c,) readings of stored momentum
    # base_rotation, base_position: (3, 3), (3,) m, of the base, from the run's origin
    base_rotation: Array
    base_position: Array
    origin: Array  # (3,) m, the run's, in the odometry frame
    momentum_change: Array  # (6,) change of the momentum by thrust and orbit since the run began, L about its origin

    @property
    def measures_twist(self) -> bool:
        """Whether the base's twist is measured, beside its pose."""
        return bool(np.all(np.isfinite(self.noise.twist)))

    @staticmethod
    def from_window(window: Samples, noise: SensorNoise, length: float, origin: Array, momentum_change: Array) -> End:
        """Return it from the last window of a run, of a length in s, that began at an origin (3,) m.

        `momentum_change` (6,) is the change of the momentum since then, L about the odometry's origin.
        """
        last = window_noises([window[-1:]], noise)[0]
        if window.missing_rates[1]:
            last = replace(last, twist=np.full((6, 6), np.nan))
        rate = len(window) / length
        if window.missing_rates[0] and len(window) >= FEWEST:
            window = with_rates(window)
        return End(
            rate,
            last,
            float(window.time[-1]),
            window.joint_position[-1],
            np.nan_to_num(window.joint_velocity[-1]),
            window.stored[-1],
            window.base_rotation[-1],
            window.base_position[-1] - origin,
            origin,
            np.concatenate((momentum_change[:3], momentum_change[3:] - cross(origin, momentum_change[:3]))),
        )


@dataclass(frozen=True, eq=False)
class Continuation:
    """The information that a run leaves to the next one of the same robot and target, without widening."""

    planar: bool  # whether the run was, and has the numbers of a planar motion
    # root, bias: as of `Variables.for_continued_run`
    root: Array
    bias: Array

    @staticmethod
    def from_gaussian(gaussian: SquareRootInformation, variables: Variables) -> Continuation:
        """Return that of the Gaussian at the end of a run."""
        root = variables.without_force(new_motion(gaussian, variables).root)
        rest = slice(variables.moving, None)
        return Continuation(variables.pose_size < 6, root[rest, rest], gaussian.bias_information)


@dataclass(frozen=True, eq=False)
class Posterior:
    """The trajectory filter's state at the end of a run."""

    layout: Layout  # of the state
    variables: Variables  # of the state
    hypothesis: Hypothesis  # the best one
    mean: Array  # (s,) of the state
    triangle: Array  # (s - 6, s - 6) upper T, T^T T the covariance of the state without the pose error
    end: End
    continuation: Continuation  # as the filter has it

    @property
    def deviation(self) -> Array:
        """Standard deviations of the state, (s,); zero for the pose error."""
        return np.concatenate((np.zeros(FIRST), np.sqrt(np.add.reduce(self.triangle**2, axis=0))))

    @property
    def state(self) -> Array:
        """The mean with the present momentum, (s,)."""
        state = self.mean.copy()
        state[LINEAR.start : LINEAR.start + 6] += self.end.momentum_change
        return state

    @property
    def point(self) -> Point:
        """The linearisation point of the next motion."""
        return self.layout.point(self.state, self.deviation)

    def drawn(self, count: int, seed: int) -> list[Point]:
        """Return `count` points drawn from the posterior, each with its mirror image, of at least half the mass."""
        generator = np.random.default_rng(seed)
        half = generator.standard_normal((-(-count // 2), len(self.triangle)))
        away = np.concatenate((half, -half))[:count] @ self.triangle
        # Numbers that do not act in a plane have the width of a prior, and a normal a milliradian off mixes them in.
        inside = self.variables.basis[FIRST:]
        away = away @ inside @ inside.T if self.layout.plane is not None else away
        mean, points = self.state, []
        mass = LINEAR.start + 6
        for each in away:
            state = mean.copy()
            least = 0.5 * abs(mean[mass])
            part = min(1.0, least / max(least, -each[mass - FIRST])) if mean[mass] > 0.0 else 0.0
            state[FIRST:] += part * each
            points.append(self.layout.point(state, self.deviation))
        return points


def posterior(
    layout: Layout, hypothesis: Hypothesis, distribution: MeanAndCovariance, prior_scales: VarianceComponents, end: End
) -> Posterior:
    """Return the posterior of a run, as published, from the mean and covariance of its state."""
    variables, rows, mean = distribution.variables, np.arange(FIRST, layout.size), distribution.mean.copy()
    outside = variables.factor - variables.basis @ (variables.basis.T @ variables.factor)
    mean[rows], factor = distribution.published(prior_scales, layout, rows)
    triangle = np.asarray(np.linalg.qr(np.concatenate((factor, outside[rows]), axis=1).T, mode='r'))
    continuation = Continuation.from_gaussian(distribution.gaussian, variables)
    return Posterior(layout, variables, hypothesis, mean, triangle, end, continuation)


def error_budget(
    distribution: MeanAndCovariance,
    layout: Layout,
    declared: Declared,
    prior_scales: VarianceComponents,
    known: Flags,
) -> ErrorBudget:
    """Return the variance by source of the ten parameters; NaN where unknown. The rest of all priors is sensor noise.

    Parameters
    ----------
    distribution, layout : of the filter
    declared : priors of target and momentum, where they are given
    prior_scales : scale factors of the unknowns' priors
    known : (10,) which parameters are determined
    """
    given = []
    if declared.target is not None and declared.target.declared:
        given.append(('target prior', distribution.variables.body))
    if declared.linear_momentum > 0.0:
        given.append(('momentum prior', slice(distribution.variables.pose_size, distribution.variables.moving)))
    names = (SENSOR_NOISE, *layout.causes, *(name for name, _ in given))
    # Kept with many estimates: without the 150 kB that have been computed from this one.
    fresh, each = replace(distribution), prior_scales.factors
    return DeferredBudget(names, lambda: _shares(fresh, layout, [which for _, which in given], each, known))


def _shares(
    distribution: MeanAndCovariance, layout: Layout, given: list[slice], scales: Array, known: Flags
) -> tuple[Array, Flags]:
    """Return the shares (10, c), and which are unobserved, as of `error_budget`; `given` are variables with a prior."""
    variables = distribution.variables
    jacobian, part = physical_jacobian(distribution.mean[BODY]), distribution.factor_of(variables.to_state[BODY])
    factor = jacobian @ distribution.error_amplification(part, BODY_PLACES) @ part
    errors = distribution.contributions(factor, layout).T * scales
    squares = errors**2
    priors = np.array([_prior_part(factor, distribution, variables, which) for which in given]).reshape(-1, len(factor))
    total = np.sum(factor**2, axis=1) + np.sum(distribution.by_score(jacobian @ part) ** 2, axis=1)
    noise = total - np.sum((errors / scales) ** 2, axis=1) - priors.sum(axis=0)
    noise = np.where(noise < -_ROUNDING * total, np.nan, np.maximum(noise, 0.0))
    parts = np.column_stack((noise, squares @ layout.belongs, priors.T))
    with np.errstate(divide='ignore', invalid='ignore'):
        shares = parts / parts.sum(axis=1, keepdims=True)
    unobserved = np.zeros(shares.shape, dtype=bool)
    declared = slice(1, 1 + len(layout.causes))
    covariance = distribution.unknowns_as_declared(layout)[1]
    unobserved[:, declared] = shares[:, declared] > _observed(errors, covariance, layout)
    return np.where(known[:, None], shares, np.nan), unobserved


def _observed(errors: Array, covariance: Array, layout: Layout) -> Array:
    """Return the part (m, c) of each cause's prior variance that the data remove, along the errors (m, e).

    A cause that is k of its deviations off shifts an estimate by k sqrt(share) standard deviations, and raises the
    chi-square by k^2 times this part: where the part is below the share, the data do not warn in time.
    """
    cause = layout.belongs.argmax(axis=1)
    within = np.where(cause[:, None] == cause, covariance, 0.0)
    left = ((errors @ within) * errors) @ layout.belongs
    return np.asarray(1.0 - left / np.maximum(errors**2 @ layout.belongs, np.finfo(float).tiny))


def _prior_part(factor: Array, distribution: MeanAndCovariance, variables: Variables, which: slice) -> Array:
    """Return the part (m,) of variances that comes from the prior of some variables, independent of all others."""
    gather = variables.from_state[which]
    root = np.linalg.cholesky(gather @ variables.factor @ variables.factor.T @ gather.T)
    return np.asarray(np.sum(np.linalg.solve(root, distribution.with_variables(factor)[which]) ** 2, axis=0))
