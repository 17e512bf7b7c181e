"""The scaled variables of the filter: the whole state in space, its part in the plane for a planar motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.errors import DataError
from mbaid_ros.core.filter.state import ANGULAR, BODY, LINEAR, MOMENTUM, POSE, Declared, Layout, WeighedMass, numbers_of
from mbaid_ros.core.geometry import Array, Flags, Integers
from mbaid_ros.core.robot.kernel import unknown_scale
from mbaid_ros.core.robot.kinematics import PlaneDetector

_ANGLE, _LENGTH = 1e-3, 1e-2  # rad, m: typical pose errors, which only scale
_OPEN_ANGLE, OPEN_LENGTH = 1e-2, 0.1  # rad, m: standard deviations of the first pose error: no prior, in effect
_OPEN = 30.0  # typical sizes: standard deviation of momentum and body: no prior, in effect
_FORCE = 1e-3  # typical momenta: standard deviation of a constant force (N) and torque (N m), far above a leak's
_NEAR = 0.1  # relative standard deviation of a mass that is held


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
    # (e, w) factor of the unknowns' change over a gap in the data
    gap_change: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (v, v + 1) square-root information left by the run before the target changed, and z; else None
    previous_information: Array | None = None
    previous_bias: Array | None = None  # (b, b + 1) bias information of the run before; None without one
    mass_row: Array | None = None  # (v + 1,) the row of the robot's mass, where it was weighed, of unit variance

    @property
    def has_body_prior(self) -> bool:
        """Whether all of the body has a prior."""
        return bool(self.mean[BODY][4] > 0.0)

    @property
    def poses(self) -> int:
        """Number p of variables of the pose error."""
        return len(self.measured)

    @cached_property
    def head(self) -> int:
        """Number of variables of pose error and momentum, p of either."""
        return 2 * self.poses

    @property
    def first_unknown(self) -> int:
        """Number of variables of pose error, momentum and body; the others are the unknowns themselves."""
        return self.basis.shape[1] - (len(self.basis) - BODY.stop)

    @property
    def body(self) -> slice:
        """Slice of the b variables of the body."""
        return slice(self.head, self.first_unknown)

    @property
    def bias(self) -> Array:
        """The (b, b + 1) information of the body by noise in the rows, before the first window."""
        count = self.first_unknown - self.head
        return np.zeros((count, count + 1)) if self.previous_bias is None else self.previous_bias

    @cached_property
    def gauss_markov(self) -> Integers:
        """Indices of Gauss-Markov processes."""
        return len(self.scale) - len(self.time_constants) + np.flatnonzero(np.isfinite(self.time_constants))

    @cached_property
    def persistent(self) -> Integers | slice:
        """Indices of all others but the pose error."""
        if not self.time_constants.size:
            return slice(self.poses, None)
        return np.setdiff1d(np.arange(self.poses, len(self.scale)), self.gauss_markov)

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
        return replace(self, mean=expected, previous_information=self.without_force(root))

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
        count = len(self.scale) - self.head
        if len(root) != count:
            raise DataError(
                f'the run to continue has {len(root)} unknowns, this one {count}; accepted: one of the same '
                'robot with the same parameters'
            )
        mean = np.linalg.solve(root[:, :-1], root[:, -1])
        left = np.zeros((len(self.scale), len(self.scale) + 1))
        left[: self.head, : self.head] = self.prior()[1][: self.head, : self.head]
        left[self.head :, self.head :] = root
        expected = self.to_state[:, self.head :] @ mean
        expected[BODY.start + 1 : BODY.stop] = 0.0
        return replace(self, mean=expected, previous_information=left, previous_bias=bias)

    def prior(self, mass: float | None = None) -> tuple[Array, Array, float]:
        """Return the prior's mean (v,) and square-root information (v, v), near a mass in kg if given.

        Third, the log-likelihood of bodies near that mass among all.
        """
        mean, factor, likelihood = self.mean, self.factor, 0.0
        before = factor[BODY.start, BODY.start]
        deviation = before if mass is None else min(_NEAR * mass, before)
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
        if self.mass_row is None:
            return self.from_state @ mean, information, likelihood
        both = np.vstack((np.column_stack((information, information @ (self.from_state @ mean))), self.mass_row))
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
        gap_change=_drawn_anew(numbers_of(unknowns, [each.redrawn_after_gap for each in unknowns])),
        mass_row=None if declared.total_mass is None else _mass_row(layout, declared.total_mass, basis * scale),
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
