"""The state of the filter: its layout, its scaled variables, the prior of its unknowns, the linearisation point.

State: pose error xi (6), total momentum P, L (6), target body phi (10), then the unknowns of the nominal model in units
of their priors: first those that the prediction depends on, then those of the readings alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.contracts import NamedSensor, NominalModel, PlacedFrame, Unknown, uncertain
from mbaid_ros.core.geometry import Array, Flags, Integers
from mbaid_ros.core.results.innovations import BASE_SENSORS
from mbaid_ros.core.robot.body import body_sizes
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import MomentumKernel, unknown_scale
from mbaid_ros.errors import DataError

# Part of the largest standard deviation (all numbers in units of their own) up to which one is rounding.
_NEGLIGIBLE = 1e-8
POSE, LINEAR, ANGULAR, BODY = slice(0, 6), slice(6, 9), slice(9, 12), slice(12, 22)
_NEAR = 0.5  # of the body's size: no step goes further, as the prediction is linear no further
MOMENTUM = slice(LINEAR.start, ANGULAR.stop)
BODY_PLACES = np.arange(BODY.start, BODY.stop)
_ANGLE, _LENGTH = 1e-3, 1e-2  # rad, m: typical pose errors, which only scale
_OPEN_ANGLE, OPEN_LENGTH = 1e-2, 0.1  # rad, m: standard deviations of the first pose error: no prior, in effect
_OPEN = 30.0  # typical sizes: standard deviation of momentum and body: no prior, in effect
_FORCE = 1e-3  # typical momenta: standard deviation of a constant force (N) and torque (N m), far above a leak's
_NEAR_MASS = 0.1  # relative standard deviation of a mass that is nearly fixed


@dataclass(frozen=True, eq=False)
class UnknownsPrior:
    """A Gaussian of the catalogue's independent numbers, correlated after a calibration."""

    mean: Array  # (e,)
    factor: Array  # (e, w) of their covariance

    @staticmethod
    def standard_normal(numbers: int) -> UnknownsPrior:
        """Return the prior of so many numbers before anything is measured."""
        return UnknownsPrior(np.zeros(numbers), np.eye(numbers))

    @cached_property
    def independent(self) -> bool:
        """Whether the numbers are independent, each of unit variance."""
        return np.array_equal(self.factor, np.eye(len(self.mean)))

    @cached_property
    def whitening(self) -> Array:
        """The (e, e) matrix W that makes W (numbers - mean) independent, of unit variance, each near its own number."""
        size = np.sqrt(np.sum(self.factor**2, axis=1))
        size[size == 0.0] = 1.0  # a planar motion does not depend on it
        left, values, _ = np.linalg.svd(self.factor / size[:, None], full_matrices=False)
        values = np.maximum(values, _NEGLIGIBLE * values.max(initial=0.0))
        return np.asarray((left / values) @ left.T / size)

    @cached_property
    def triangle(self) -> Array:
        """The (e, e) upper triangular square root of the information."""
        return np.asarray(np.linalg.qr(self.whitening, mode='r'))

    def extended(self, count: int, *, before: int) -> UnknownsPrior:
        """Return this prior with `count` more independent numbers of unit variance after the first `before`."""
        if not count:
            return self
        rows = np.arange(len(self.mean))
        place = np.where(rows < before, rows, rows + count)
        width = self.factor.shape[1]
        factor = np.zeros((len(rows) + count, width + count))
        factor[place, :width] = self.factor
        factor[before : before + count, width:] = np.eye(count)
        return UnknownsPrior(np.insert(self.mean, before, np.zeros(count)), factor)

    def drawn_anew(self, which: Flags) -> UnknownsPrior:
        """Return the prior with some of the numbers, (e,) of them True, independent and of unit variance again."""
        if not which.any():
            return self
        mean, factor = np.where(which, 0.0, self.mean), np.where(which[:, None], 0.0, self.factor)
        return UnknownsPrior(mean, np.concatenate((factor, np.eye(len(mean))[:, which]), axis=1))

    def of(self, maps: Sequence[Array]) -> UnknownsPrior:
        """Return the prior of the numbers that linear maps, one for each unknown, make of these."""
        together = block_diag(*maps)
        return UnknownsPrior(together @ self.mean, together @ self.factor)

    def nominal_model(self, kernel: MomentumKernel, unknowns: Sequence[Unknown]) -> NominalModel:
        """Return the nominal model at the mean of the unknowns' numbers."""
        nominal, place = NominalModel.nominal(kernel), 0
        for unknown in unknowns:
            nominal = unknown.applied_to(nominal, unknown.factor @ self.mean[place : place + unknown.count])
            place += unknown.count
        return nominal


def in_plane_map(unknown: Unknown, in_plane: Unknown) -> Array:
    """Return how the independent numbers of an unknown as a planar motion depends on it follow from its own, (p, e)."""
    if in_plane is unknown:
        return np.eye(unknown.count)
    return np.asarray(np.linalg.pinv(in_plane.factor, rcond=1e-12) @ unknown.factor)


class BodyPrior(Protocol):
    """A prior of the target."""

    @property
    def declared(self) -> bool:
        """Whether anything is."""

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o)."""


class WeighedMass(Protocol):
    """A mass of the whole robot."""

    @property
    def mass(self) -> float:
        """Its value, kg."""

    @property
    def std(self) -> float:
        """Its standard deviation, kg."""

    @property
    def with_target(self) -> bool:
        """Whether all of the target is weighed as well."""


class TrackedTarget(Protocol):
    """Knowledge of body and momentum from the target's motion before its capture."""

    @property
    def grasp_known(self) -> bool:
        """Whether it is known how the link holds the body: a search may begin at its motion then."""

    def at(self, point: Point, variables: Variables) -> Array:
        """Return the (k, v + 1) rows of unit variance, values last, linearised at a point."""

    def point(self, mass: float) -> Point:
        """Return where a search begins, with a captured body of some mass, kg."""


@dataclass(frozen=True, eq=False)
class Declared:
    """The declaration of a robot and its run: the unknowns, and the priors of all that is none."""

    unknowns: tuple[Unknown, ...] = ()  # in the order of the state: those that are only read come last
    target: BodyPrior | None = None
    linear_momentum: float = 0.0  # N s, of the total linear momentum about zero; 0 where nothing is known of it
    joint_prior: UnknownsPrior | None = None  # of all independent numbers together, after a calibration
    total_mass: WeighedMass | None = None  # where the whole robot was weighed
    marker: PlacedFrame | None = None  # that the odometry locates; None for the base link or another link
    sensors: tuple[NamedSensor, ...] = ()  # of the base's motion beside encoders and odometry
    odometry: bool = True  # whether the base's poses count by themselves; else the sensors' readings, of which they are

    def with_links(self, links: Unknown) -> Declared:
        """Return the same with these errors of known links."""
        others = (each for each in self.unknowns if each.mass_row() is None)
        return replace(self, unknowns=uncertain(links, *others))


@dataclass(frozen=True, eq=False)
class MomentumDrift:
    """The momentum (P, L) of windows less that at an instant, where forces act in between."""

    starts: Array  # (W,) s, of the windows before, in order
    offsets: Array  # (W, 6) N s and N m s, of them
    instant: float  # s
    rate: Array  # (6,) N and N m, from then on
    mass: float  # kg, of the robot with the target for which it is
    central: bool = True  # whether all forces act at the common centre of mass

    def of_mass(self, mass: float) -> MomentumDrift:
        """Return it for a robot of another mass (kg) that accelerates alike.

        Motion determines ratios of masses and forces; points must not move along what it does not determine.
        """
        part = mass / self.mass
        return replace(self, offsets=part * self.offsets, rate=part * self.rate, mass=mass)

    def since(self, instant: float) -> MomentumDrift:
        """Return it from a later instant on."""
        return replace(self, starts=np.array([instant]), offsets=np.zeros((1, 6)), instant=instant)

    def at(self, starts: Sequence[float]) -> Array:
        """Return that of windows, (B, 6), by their starts."""
        after = (np.array(starts) - self.instant)[:, None]
        return np.where(after < 0.0, self.offsets[self._places(starts)], after * self.rate)

    def until_next(self, starts: Sequence[float], length: float) -> Array:
        """Return the change (B, 6) from windows of a length (s) to the next, by their starts."""
        changes = np.diff(self.offsets, axis=0, append=np.zeros((1, 6)))
        before = (np.array(starts) < self.instant)[:, None]
        return np.where(before, changes[self._places(starts)], length * self.rate)

    def _places(self, starts: Sequence[float]) -> Integers:
        return np.clip(np.searchsorted(self.starts, starts, side='right') - 1, 0, None)


@dataclass(frozen=True, eq=False)
class Point:
    """Where windows are linearised."""

    parameters: Array  # (u,) of the prediction: P, L, phi, unknowns
    nuisance: Array  # (r,) the other unknowns
    nominal: NominalModel  # the nominal model there
    drift: MomentumDrift | None = None  # of the momentum before and after, where a force acts

    @property
    def body(self) -> Array:
        """Standard parameters of the target (10,)."""
        return self.parameters[BODY.start - LINEAR.start : BODY.stop - LINEAR.start]

    @property
    def total_mass(self) -> float:
        """Mass of the robot with the target, kg."""
        return float(np.sum(self.nominal.kernel.body_parameters(self.body)[:, 0]))

    def drifting(self, drift: MomentumDrift | None) -> Point:
        """Return it with a drift of the momentum, as it is for its mass."""
        return self if drift is None else replace(self, drift=drift.of_mass(self.total_mass))

    @property
    def state(self) -> Array:
        """The state (s,) there, without a pose error."""
        return np.concatenate((np.zeros(POSE.stop), self.parameters, self.nuisance))


@dataclass(frozen=True, eq=False)
class Layout:
    """The layout of the state."""

    kernel: MomentumKernel  # of the robot as its URDF has it
    unknowns: tuple[Unknown, ...]  # those of the readings last
    known: UnknownsPrior  # their prior
    # (3, 6) the equations that hold for a planar motion, as `PlaneDetector.equation_selection`; None in space
    plane: Array | None = None
    sensors: tuple[NamedSensor, ...] = ()  # of the base's motion beside encoders and odometry
    odometry: bool = True  # as of Declared

    @staticmethod
    def from_unknowns(
        kernel: MomentumKernel,
        unknowns: Sequence[Unknown],
        known: UnknownsPrior | None = None,
        plane: Array | None = None,
    ) -> Layout:
        """Return the layout of a state with these unknowns, and a joint prior of theirs.

        Raises ValueError: The prior is of other numbers, or the unknowns of the readings are not the last.
        """
        count, last = sum(unknown.count for unknown in unknowns), [unknown.of_measurement for unknown in unknowns]
        if known is None:
            known = UnknownsPrior.standard_normal(count)
        elif len(known.mean) != count or last != sorted(last):
            raise ValueError(f'a posterior of {len(known.mean)} numbers does not match {count} unknowns, in order')
        return Layout(kernel, tuple(sorted(unknowns, key=lambda unknown: unknown.of_measurement)), known, plane)

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """The slice of each unknown in the state."""
        ends = BODY.stop + np.cumsum([0, *(unknown.count for unknown in self.unknowns)])
        return tuple(slice(*pair) for pair in pairwise(ends.tolist()))

    @cached_property
    def parameters(self) -> slice:
        """The slice of the parameters of the prediction."""
        return slice(LINEAR.start, BODY.stop + sum(each.count for each in self.predicted))

    @cached_property
    def nuisance(self) -> slice:
        """The slice of the unknowns that affect the readings only: nuisance parameters of the measurement."""
        return slice(self.parameters.stop, self.size)

    @cached_property
    def size(self) -> int:
        """Size s of the state."""
        return BODY.stop + sum(each.count for each in self.unknowns)

    @cached_property
    def predicted(self) -> tuple[Unknown, ...]:
        """The unknowns that the prediction depends on."""
        return tuple(each for each in self.unknowns if not each.of_measurement)

    @cached_property
    def of_joints(self) -> tuple[tuple[Unknown, slice], ...]:
        """The unknowns that add to the joints' motion, and their slices of the parameters."""
        first = self.parameters.start
        return tuple(
            (unknown, slice(place.start - first, place.stop - first))
            for unknown, place in zip(self.unknowns, self.places, strict=True)
            if unknown.moves_joints
        )

    @cached_property
    def of_measurement(self) -> tuple[Unknown, ...]:
        """The unknowns that only the readings depend on."""
        return tuple(each for each in self.unknowns if each.of_measurement)

    @cached_property
    def causes(self) -> tuple[str, ...]:
        """The c causes in the error budget."""
        return tuple(dict.fromkeys(self.cause_of))

    @cached_property
    def cause_of(self) -> tuple[str, ...]:
        """The cause of each of the unknowns' e independent numbers."""
        return tuple(cause for unknown in self.unknowns for cause in unknown.causes)

    @cached_property
    def part_of(self) -> tuple[str, ...]:
        """The part of its cause that each of these numbers is by itself; empty where none."""
        return tuple(part for unknown in self.unknowns for part in unknown.parts)

    @cached_property
    def directions(self) -> Mapping[str, Array]:
        """The unknowns' directions, unit vectors (e,) in all independent numbers."""
        found: dict[str, Array] = {}
        for unknown, place in zip(self.unknowns, self.places, strict=True):
            for name, along in unknown.directions.items():
                numbers: Array = np.zeros(len(self.cause_of))
                numbers[place.start - BODY.stop : place.stop - BODY.stop] = along
                numbers = numbers if self.known.independent else self.known.whitening @ numbers
                found[name] = numbers / np.linalg.norm(numbers)
        return found

    @cached_property
    def belongs(self) -> Array:
        """Causes of the numbers as (e, c) zeros and ones."""
        return np.array([[float(own == cause) for cause in self.causes] for own in self.cause_of]).reshape(
            len(self.cause_of), len(self.causes)
        )

    def extended(self, more: Sequence[Unknown]) -> Layout:
        """Return the layout with more unknowns, independent of the others."""
        before = len(self.predicted)
        predicted, read = (tuple(each for each in more if each.of_measurement is which) for which in (False, True))
        unknowns = (*self.unknowns[:before], *predicted, *self.unknowns[before:], *read)
        known = self.known.extended(sum(each.count for each in predicted), before=self.nuisance.start - BODY.stop)
        known = known.extended(sum(each.count for each in read), before=len(known.mean))
        return replace(self, unknowns=unknowns, known=known)

    def state(self, body: Array, momentum: Array) -> Array:
        """Return the state (s,) with a body (10,), a momentum (6,), and the unknowns as declared."""
        return np.concatenate((np.zeros(POSE.stop), momentum, body, self.known.mean))

    def point(self, state: Array, deviation: Array | None = None) -> Point:
        """Return the linearisation point of a state (s,) with standard deviations (s,)."""
        values = self.linearisation_state(state, deviation)
        nominal = NominalModel.nominal(self.kernel)
        for unknown, place in zip(self.unknowns, self.places, strict=True):
            nominal = unknown.applied_to(nominal, unknown.factor @ values[place])
        return Point(values[self.parameters], values[self.nuisance], nominal)

    def linearisation_state(self, state: Array, deviation: Array | None = None) -> Array:
        """Return the linearisation point (s,) of windows, for a state (s,) with standard deviations (s,)."""
        values = state.copy()
        for unknown, place in zip(self.unknowns, self.places, strict=True):
            uncertain = np.zeros(unknown.count) if deviation is None else deviation[place]
            values[place] = unknown.linearisation_value(values[place], uncertain)
        return values

    @cached_property
    def time_constants(self) -> Array:
        """Time constants (e,) of the unknowns' numbers, s; inf where they stay. Empty where all do."""
        times = np.concatenate([np.zeros(0), *(unknown.time_constants for unknown in self.unknowns)])
        return times if np.isfinite(times).any() else np.zeros(0)

    @cached_property
    def has_varying_push(self) -> bool:
        """Whether a force or torque from outside varies within a motion."""
        return any(each.pushes and np.isfinite(each.time_constants).any() for each in self.unknowns)

    @cached_property
    def noise_driven(self) -> Array:
        """Which of the unknowns' e numbers the joints' noise drives, too, as ones among zeros."""
        return numbers_of(self.unknowns, [each.noise_driven for each in self.unknowns]).astype(float)

    @cached_property
    def joint_columns(self) -> Array:
        """Offsets (n, f) of the joints by each of the unknowns' f Gauss-Markov processes."""
        steps = [
            np.zeros((self.kernel.model.joints, each.count)) if each.joint_columns is None else each.joint_columns
            for each in self.unknowns
        ]
        times = self.time_constants
        return np.concatenate(steps, axis=1)[:, np.isfinite(times)] if times.size else np.zeros((0, 0))


def numbers_of(unknowns: Sequence[Unknown], which: Sequence[bool]) -> Flags:
    """Return which of the unknowns' e numbers are of certain unknowns."""
    return np.repeat(np.array(which, dtype=bool), [each.count for each in unknowns])


def trust_region(parameters: Array, step: Array) -> float:
    """Return the part of a step from a point's (u,) parameters over which the prediction is linear."""
    body = slice(BODY.start - LINEAR.start, BODY.stop - LINEAR.start)
    if parameters[body][0] == 0.0:
        return 1.0  # nothing is known of a body that has no mass
    far, size = np.abs(step[body]), body_sizes(parameters[body])
    # Numbers without size, as a mass without inertia, stay as they are.
    change = float(np.max(np.divide(far, size, out=np.where(far > 0.0, np.inf, 0.0), where=size != 0.0)))
    return min(1.0, _NEAR / max(change, _NEAR))


def layout_of(kernel: MomentumKernel, declared: Declared, detector: PlaneDetector) -> Layout:
    """Return the layout for the declared unknowns of a robot that moves in a plane or in space."""
    unknowns, known = declared.unknowns, declared.joint_prior
    if known is not None:
        # The swing of passive joints at the start of another run does not apply to this one.
        known = known.drawn_anew(numbers_of(unknowns, [each.redrawn_after_gap for each in unknowns]))
    if detector.planar:
        seen = tuple(unknown.in_plane(detector) for unknown in unknowns)
        known = known and known.of([in_plane_map(*pair) for pair in zip(unknowns, seen, strict=True)])
        unknowns = seen
    layout = Layout.from_unknowns(kernel, unknowns, known, detector.equation_selection() if detector.planar else None)
    return replace(layout, sensors=declared.sensors, odometry=declared.odometry)


@dataclass(frozen=True, eq=False)
class Variables:
    """The variables of the filter: state = spread variables."""

    # (s, v) orthonormal columns; fewer than s for a planar motion. Pose errors come first, then the momentum
    basis: Array
    scale: Array  # (v,) typical size of each variable
    measured: Array  # (k, 6) combinations of a window's six pose or twist measurements that hold in the plane
    force: Array  # (6, f) from independent numbers of unit variance to a constant force and torque
    # mean, factor: (s,), (s, s) of the prior of the state, as if the unknowns were independent
    mean: Array
    factor: Array
    known: Array  # (e, e) square-root information of the unknowns
    typical_momentum: Array  # (6,) typical sizes
    # (e, w) factor of the unknowns' random walks, per square root of a second; of no columns where there is none
    random_walk: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (e, w) factor of the unknowns' change from one motion to the next
    motion_change: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (e,) s, time constants of the unknowns' Gauss-Markov processes, inf of constants; empty where all are
    time_constants: Array = field(default_factory=lambda: np.zeros(0))
    pushed: bool = False  # whether Gauss-Markov processes change the momentum
    # (e, w) factor of the unknowns' change over a gap in the data
    gap_change: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (v, v + 1) square-root information left by the run before the target changed, and z; else None
    previous_information: Array | None = None
    previous_bias: Array | None = None  # (b, b + 1) bias information of the run before; None without one
    mass_row: Array | None = None  # (v + 1,) the row of the robot's mass, where it was weighed, of unit variance
    sensors: tuple[NamedSensor, ...] = ()  # of the base's motion beside encoders and odometry

    tracked: TrackedTarget | None = None  # where the target was tracked before its capture

    @property
    def has_body_prior(self) -> bool:
        """Whether all of the body has a prior."""
        return bool(self.mean[BODY][4] > 0.0)

    @property
    def is_informed(self) -> bool:
        """Whether the body is known beforehand, by a prior of all of it or by its motion before the capture."""
        return self.has_body_prior or self.tracked is not None

    @property
    def pose_size(self) -> int:
        """Number p of variables of the pose error."""
        return len(self.measured)

    @cached_property
    def of_base(self) -> Array:
        """What all r numbers of the twist and of further sensors are of the base's twist or pose error, (r, 6)."""
        return np.concatenate([np.eye(6), *(sensor.of_base for sensor in self.sensors)])

    @cached_property
    def rate_combinations(self) -> tuple[Array, ...]:
        """Combinations (k, r) of what the twist and each further sensor measures that hold in the plane."""
        seen = [self.measured @ sensor.of_base.T for sensor in self.sensors]
        return (self.measured, *(each[each.any(axis=1)] for each in seen))

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """The sensor of each number that a window may measure: the pose's, the twist's, then those of the others."""
        angular = int(self.measured[:, :3].any(axis=1).sum())
        counts = [angular, self.pose_size - angular] * 2 + [len(each) for each in self.rate_combinations[1:]]
        names = (*BASE_SENSORS, *(sensor.name for sensor in self.sensors))
        return tuple(name for name, count in zip(names, counts, strict=True) for _ in range(count))

    @cached_property
    def moving(self) -> int:
        """Number of variables of pose error and momentum, p of either, which the motion of a window changes."""
        return 2 * self.pose_size

    @property
    def first_unknown(self) -> int:
        """Number of variables of pose error, momentum and body; the others are the unknowns themselves."""
        return self.basis.shape[1] - (len(self.basis) - BODY.stop)

    @property
    def body(self) -> slice:
        """Slice of the b variables of the body."""
        return slice(self.moving, self.first_unknown)

    @property
    def bias(self) -> Array:
        """The (b, b + 1) information of the body by noise in the rows, before the first window."""
        count = self.first_unknown - self.moving
        return np.zeros((count, count + 1)) if self.previous_bias is None else self.previous_bias

    @cached_property
    def gauss_markov(self) -> Integers:
        """Indices of Gauss-Markov processes."""
        return len(self.scale) - len(self.time_constants) + np.flatnonzero(np.isfinite(self.time_constants))

    @cached_property
    def persistent(self) -> Integers | slice:
        """Indices of all others but the pose error, and but a momentum that processes change."""
        if not self.time_constants.size:
            return slice(self.pose_size, None)
        first = self.moving if self.pushed else self.pose_size
        return np.setdiff1d(np.arange(first, len(self.scale)), self.gauss_markov)

    def autocorrelation(self, length: float) -> Array:
        """Return the autocorrelation (f,) of the Gauss-Markov processes after a length in s."""
        return np.exp(-length / self.time_constants[np.isfinite(self.time_constants)])

    @cached_property
    def to_state(self) -> Array:
        """The (s, v) matrix from variables to state."""
        return self.basis * self.scale

    def rows(self, of_state: Array) -> Array:
        """Return (..., s) rows of the state as (..., v) rows of the variables."""
        moving = of_state[..., : BODY.stop] @ self.to_state[: BODY.stop, : self.first_unknown]
        return np.concatenate((moving, of_state[..., BODY.stop :]), axis=-1)

    def state_columns(self, columns: Array) -> Array:
        """Return (v, m) columns of the variables as (s, m) columns of the state."""
        moving = self.to_state[: BODY.stop, : self.first_unknown] @ columns[: self.first_unknown]
        return np.concatenate((moving, columns[self.first_unknown :]))

    @cached_property
    def uninformative_deviation(self) -> Array:
        """Standard deviations of an unknown momentum and body, (s,); zero elsewhere."""
        sizes = _OPEN * np.sqrt(np.add.reduce(self.to_state**2, axis=1))
        return np.where(np.isin(np.arange(len(sizes)), np.r_[MOMENTUM, BODY]), sizes, 0.0)

    @cached_property
    def from_state(self) -> Array:
        """The (v, s) matrix from state to variables."""
        return self.basis.T / self.scale[:, None]

    @cached_property
    def covariance_outside(self) -> Array:
        """The (s, s) covariance of the state outside the variables."""
        outside = np.eye(len(self.basis)) - self.basis @ self.basis.T
        return np.asarray(outside @ self.factor @ self.factor.T @ outside.T)

    def for_new_target(self, root: Array, mean: Array, *, exchanged: bool) -> Variables:
        """Return these for a run with another target, or with the same elsewhere.

        Parameters
        ----------
        root : (w, w + 2) as of `SquareRootInformation`, of the run before; of w > v variables the last are a force's,
            which is eliminated
        mean : (s,) of that
        exchanged : whether the target's mass is unknown
        """
        expected = np.where(np.arange(len(mean)) < BODY.stop, 0.0, mean)
        expected[BODY.start] = 0.0 if exchanged else mean[BODY.start]
        bias = None if exchanged else self.previous_bias  # information of the body that is gone
        return replace(self, mean=expected, previous_information=self.without_force(root), previous_bias=bias)

    def without_force(self, root: Array) -> Array:
        """Return the (v, v + 1) square-root information, and z, of a root as of `for_new_target`."""
        left = np.column_stack((root[:, :-2], root[:, -2] + root[:, -1]))
        count = len(self.scale)
        if len(root) == count:
            return left
        others = np.column_stack((left[:, count:-1], left[:, :count], left[:, -1]))
        force = len(root) - count
        return np.asarray(np.linalg.qr(others, mode='r'))[force : len(root), force:]

    def for_continued_run(self, root: Array, bias: Array) -> Variables:
        """Return these for another run of the same target: a new pose error and momentum, all else as it was left.

        Raises DataError: The run had other unknowns.

        Parameters
        ----------
        root : (v - h, v - h + 1) square-root information of all but pose error and momentum, and z
        bias : (b, b + 1) as of `SquareRootInformation.bias_information`
        """
        count = len(self.scale) - self.moving
        if len(root) != count:
            raise DataError(
                f'the run to continue has {len(root)} unknowns, this one {count}; accepted: one of the same '
                'robot with the same parameters'
            )
        mean = np.linalg.solve(root[:, :-1], root[:, -1])
        left = np.zeros((len(self.scale), len(self.scale) + 1))
        left[: self.moving, : self.moving] = self.prior()[1][: self.moving, : self.moving]
        left[self.moving :, self.moving :] = root
        expected = self.to_state[:, self.moving :] @ mean
        expected[BODY.start + 1 : BODY.stop] = 0.0
        return replace(self, mean=expected, previous_information=left, previous_bias=bias)

    def prior(self, mass: float | None = None, point: Point | None = None) -> tuple[Array, Array, float]:
        """Return the prior's mean (v,) and square-root information (v, v), near a mass in kg if given.

        Third, the log-likelihood of bodies near that mass among all.

        Parameters
        ----------
        point : where the motion of a tracked target is linearised, which does not count without
        """
        mean, factor, likelihood = self.mean, self.factor, 0.0
        before = factor[BODY.start, BODY.start]
        deviation = before if mass is None else min(_NEAR_MASS * mass, before)
        if mass is not None:
            likelihood = float(np.log(deviation / before))
        if self.previous_information is not None:
            held = np.append(self.to_state[BODY.start], mass or 0.0) / deviation
            both = np.vstack((self.previous_information, held)) if mass is not None else self.previous_information
            return *_solved(both), likelihood
        if mass is not None:
            along = factor[:, BODY.start] / before  # a prior of the CoM goes with the mass
            mean, factor = mean + (mass - mean[BODY.start]) * along, factor.copy()
            factor[:, BODY.start] = deviation * along
        first = self.first_unknown
        root = np.asarray(np.linalg.qr((self.from_state[:first] @ factor).T, mode='r'))  # covariance = root^T root
        information = np.eye(len(self.scale))
        information[:first, :first] = np.linalg.qr(np.linalg.inv(root).T, mode='r')
        information[first:, first:] = self.known
        more = [] if self.mass_row is None else [self.mass_row]
        if self.tracked is not None and point is not None:
            more.append(self.tracked.at(point, self))
        if not more:
            return self.from_state @ mean, information, likelihood
        both = np.vstack((np.column_stack((information, information @ (self.from_state @ mean))), *more))
        return *_solved(both), likelihood


def _solved(rows: Array) -> tuple[Array, Array]:
    """Return the mean (v,) and square-root information (v, v) of rows (r, v + 1) of unit variance, values last."""
    root = np.asarray(np.linalg.qr(rows, mode='r'))[: rows.shape[1] - 1]
    return np.linalg.solve(root[:, :-1], root[:, -1]), root[:, :-1]


def variables(layout: Layout, detector: PlaneDetector, declared: Declared) -> Variables:
    """Return the filter's variables for a motion in a plane or in space, with the priors of target and momentum."""
    typical = _typical(layout, declared)
    sizes = np.ones(layout.size)
    sizes[:3], sizes[3:6] = _ANGLE, _LENGTH
    sizes[LINEAR], sizes[ANGULAR], sizes[BODY] = typical[10:13], typical[13:16], typical[:10]
    deviation = sizes.copy()
    deviation[:3], deviation[3:6] = _OPEN_ANGLE, OPEN_LENGTH
    deviation[MOMENTUM.start : BODY.stop] *= _OPEN
    if declared.linear_momentum > 0.0:
        deviation[LINEAR] = declared.linear_momentum
    mean, factor = np.zeros(layout.size), np.diag(deviation)
    if declared.target is not None:
        declared.target.apply(mean[BODY], factor[BODY, BODY])
    mean[BODY.stop :] = layout.known.mean
    basis, measured = _planar(layout, detector) if detector.planar else (np.eye(layout.size), np.eye(6))
    force = detector.equation_selection().T * (_FORCE * typical[10:16] @ np.abs(detector.equation_selection().T))
    scale, known = np.sqrt((basis**2).T @ sizes**2), layout.known.triangle
    unknowns, times = layout.unknowns, layout.time_constants
    constant = ~np.isfinite(times) if times.size else True  # Gauss-Markov processes are drawn anew anyway
    return Variables(
        basis,
        scale,
        measured,
        force,
        mean,
        factor,
        known,
        typical[10:16],
        random_walk=_walks(layout),
        motion_change=_drawn_anew(numbers_of(unknowns, [each.redrawn_per_motion for each in unknowns]) & constant),
        time_constants=times,
        pushed=layout.has_varying_push,
        gap_change=_drawn_anew(numbers_of(unknowns, [each.redrawn_after_gap for each in unknowns])),
        mass_row=None if declared.total_mass is None else _mass_row(layout, declared.total_mass, basis * scale),
        sensors=layout.sensors,
    )


def _mass_row(layout: Layout, total: WeighedMass, spread: Array) -> Array:
    """Return the (v + 1,) row of the robot's mass: that of the known bodies, and of the target if it is weighed too."""
    row = np.zeros(layout.size)
    row[BODY.start] = float(total.with_target)
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        own = unknown.mass_row()
        if own is not None:
            row[place] = own
    value = total.mass - float(np.sum(layout.kernel.known[:, 0]))
    return np.append(row @ spread, value) / total.std


def _walks(layout: Layout) -> Array:
    """Return the (e, w) factor of the random walks of the unknowns' independent numbers."""
    if not any(each.random_walk.shape[1] for each in layout.unknowns):
        return np.zeros((0, 0))
    return np.asarray(block_diag(*(np.linalg.pinv(each.factor) @ each.random_walk for each in layout.unknowns)))


def _drawn_anew(which: Flags) -> Array:
    """Return the (e, w) factor of the change of the unknowns' numbers (e,) of which w are drawn anew."""
    return np.asarray(np.sqrt(2.0) * np.eye(len(which))[:, which])


def _typical(layout: Layout, declared: Declared) -> Array:
    """Return the (16,) typical sizes of body and momentum: those of the target if it is the heavier part."""
    typical = unknown_scale(layout.kernel)
    mean = np.zeros(10)
    if declared.target is not None:
        declared.target.apply(mean, np.eye(10))
    typical *= max(1.0, mean[0] / typical[0])
    return typical


def _planar(layout: Layout, detector: PlaneDetector) -> tuple[Array, Array]:
    """Return the basis and the measured combinations of a planar motion."""
    rows = detector.equation_selection()
    measured = np.zeros((3, 6))
    measured[0, :3] = rows[2, 3:]  # the turn about the normal
    measured[1:, 3:] = rows[:2, :3]  # the displacement in the plane
    plane = detector.plane(layout.kernel.target)
    body = np.eye(10) if plane is None else plane.basis
    basis = np.zeros((layout.size, 6 + body.shape[1] + layout.size - BODY.stop))
    basis[POSE, :3], basis[MOMENTUM, 3:6] = measured.T, rows.T
    columns = slice(6, 6 + body.shape[1])
    basis[BODY, columns] = body
    basis[BODY.stop :, columns.stop :] = np.eye(layout.size - BODY.stop)
    return basis, measured
