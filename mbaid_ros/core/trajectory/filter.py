"""The Kalman filter over windows: one update and one step on each, in scaled variables.

Covariances are kept as factors and moved by orthogonal transformations (square-root form, Bierman 1977, chapter 5):
from a prior that says nothing to accurate odometry after minutes they shrink by more than double precision can hold as
covariances, and a factor's square is never negative.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Literal

import numpy as np
from scipy.linalg.lapack import dgeqrf, dtrtrs

from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.trajectory.chain import ANGULAR, FORCE, LINEAR, WindowModel

_POSE = slice(0, 6)
_MOMENTUM = slice(LINEAR.start, ANGULAR.stop)


@dataclass(frozen=True)
class Coordinates:
    """The variables of the filter: state = basis (scale * variables).

    Attributes
    ----------
    basis : (s, v) orthonormal columns; fewer than s for a planar motion
    scale : (v,) typical size of each variable
    measured : (k, 6) the combinations of a window's six pose or twist measurements that hold
    open_factor : (s, f) of the covariance of the state when nothing has been measured
    """

    basis: Array
    scale: Array
    measured: Array
    open_factor: Array

    @cached_property
    def open_variance(self) -> Array:
        """Of the state when nothing has been measured, (s,)."""
        return np.asarray(np.sum(self.open_factor**2, axis=1))

    @cached_property
    def spread(self) -> Array:
        """The (s, v) matrix from variables to state."""
        return self.basis * self.scale

    @cached_property
    def gather(self) -> Array:
        """The (v, s) matrix from state to variables."""
        return self.basis.T / self.scale[:, None]

    def state(self, belief: Belief) -> tuple[Array, Array]:
        """Return the mean (s,) and covariance (s, s) in SI units, open in what the variables leave out."""
        factor = self.spread @ belief.factor
        return self.spread @ belief.mean, factor @ factor.T + self._outside

    @cached_property
    def _outside(self) -> Array:
        """The (s, s) covariance of what the variables leave out."""
        outside = np.eye(len(self.basis)) - self.basis @ self.basis.T
        return np.asarray((outside * self.open_variance) @ outside.T)

    def moments(self, belief: Belief) -> tuple[Array, Array]:
        """Return the mean (s,) and the standard deviations (s,) in SI units."""
        variance = np.sum((self.spread @ belief.factor) ** 2, axis=1) + np.diag(self._outside)
        return self.spread @ belief.mean, np.sqrt(variance)

    def open(self, *, force: bool = False) -> Belief:
        """Return the belief before the first measurement, with or without a force that may act."""
        factor = self.open_factor.copy()
        if not force:
            factor[FORCE] = 0.0
        return Belief(np.zeros(len(self.scale)), _compressed(self.gather @ factor))


@dataclass(frozen=True)
class Walk:
    """What may act or drift: a constant force, and random walks with intensities a square root of a second.

    Attributes
    ----------
    name : what it stands for
    momentum : N s and N m s: an external force
    position, orientation : m, rad: the odometry's own drift
    force : axes of a constant force and torque, which act on the base's origin, or, inertial ones, at the run's
    """

    name: str
    momentum: float = 0.0
    position: float = 0.0
    orientation: float = 0.0
    force: Literal['none', 'inertial', 'body'] = 'none'

    @property
    def disturbed(self) -> bool:
        """Whether anything acts or drifts at all."""
        return self.force != 'none' or self.drifts

    @cached_property
    def drifts(self) -> bool:
        """Whether there is a random walk."""
        return any((self.momentum, self.position, self.orientation))


@dataclass(frozen=True)
class Belief:
    """Mean and covariance of the state, in scaled variables, and how well the measurements have agreed with it.

    Attributes
    ----------
    mean : (v,)
    factor : (v, c) of the covariance, which is factor factor^T; c is v after an update, and more after a step
    surprise, measured : sum of the normalised innovations squared, and how many there were
    last_surprise, last_measured : the same of the last update
    evidence : log-likelihood of all measurements, up to a constant
    """

    mean: Array
    factor: Array
    surprise: float = 0.0
    measured: int = 0
    last_surprise: float = 0.0
    last_measured: int = 0
    evidence: float = 0.0

    @property
    def covariance(self) -> Array:
        """The (v, v) covariance."""
        return np.asarray(self.factor @ self.factor.T)


@dataclass(frozen=True)
class Step:
    """A window in the filter's variables, measurements in units of their noise.

    Attributes
    ----------
    value, rows : (k,), (k, v): value = rows variables + white noise of variance 1
    log_noise : logarithm of the determinant of the noise's covariance
    transition, drift, process : (v, v), (v,), (v, n): to the next window's first node, without force; a factor of the
        covariance of what joint noise adds on the way
    window : what it was made of
    """

    value: Array
    rows: Array
    log_noise: float
    transition: Array
    drift: Array
    process: Array
    window: WindowModel


def prepare(window: WindowModel, coordinates: Coordinates) -> Step:
    """Return one window's step of the filter (see `prepared`)."""
    several = WindowModel(*(np.asarray(part)[None] for part in vars(window).values()))
    return prepared(several, coordinates)[0]


def prepared(windows: WindowModel, coordinates: Coordinates) -> list[Step]:
    """Return the steps of the filter for B windows."""
    pose = _whitened(windows.pose_value, windows.pose_rows, windows.pose_covariance, coordinates)
    moving = np.flatnonzero(np.all(np.isfinite(windows.twist_value), axis=-1))
    own = windows[moving]
    twist = _whitened(own.twist_value, own.twist_rows, own.twist_covariance, coordinates)
    measured = list(zip(*pose, strict=True))
    both = [np.concatenate((part[moving], more), axis=1) for part, more in zip(pose, twist, strict=True)]
    for index, parts in zip(moving.tolist(), zip(*both, strict=True), strict=True):
        measured[index] = parts
    gather, spread = coordinates.gather, coordinates.spread
    # The whole state's transition is that of the pose error beside 1: 1 + turn (transition - (1, 0)) spread.
    turn = gather[:, _POSE]
    change = windows.transition - np.eye(6, len(spread))
    transition = np.eye(len(gather)) + turn @ (change @ spread)
    drift, process = (turn @ windows.drift[..., None])[..., 0], turn @ windows.process
    steps = []
    for index, (value, rows, deviation) in enumerate(measured):
        step = Step(
            value=value,
            rows=rows,
            log_noise=2.0 * float(np.sum(np.log(deviation))),
            transition=transition[index],
            drift=drift[index],
            process=process[index],
            window=windows[index],
        )
        steps.append(step)
    return steps


def _whitened(value: Array, rows: Array, covariance: Array, coordinates: Coordinates) -> tuple[Array, Array, Array]:
    """Return (B, k) values and (B, k, v) rows in units of their noise, and the diagonal of its Cholesky factor."""
    select = coordinates.measured
    factor = np.linalg.cholesky(select @ covariance @ select.T)
    both = np.concatenate((select @ rows @ coordinates.spread, select @ value[..., None]), axis=-1)
    white = np.linalg.solve(factor, both)
    return white[..., -1], white[..., :-1], np.diagonal(factor, axis1=-2, axis2=-1)


def update(belief: Belief, step: Step) -> Belief:
    """Return the belief after a window's measurements."""
    rows, factor = step.rows, belief.factor
    (count, size), columns = rows.shape, factor.shape[1]
    # The square of `stacked` holds the covariances of measurements and state, prior to the update; that of its
    # triangular factor the same, ordered so that the state's last block is what the measurements leave of it.
    stacked = np.zeros((columns + count, count + size), order='F')
    stacked[:columns, :count] = (rows @ factor).T
    stacked[:columns, count:] = factor.T
    stacked[columns:, :count] = _identity(count)
    # LAPACK itself, for so small a matrix: numpy's own call takes twice the time.
    triangle = dgeqrf(stacked, overwrite_a=True)[0]
    root = triangle[:count, :count]
    normalised, _ = dtrtrs(root, step.value - rows @ belief.mean, trans=1)
    surprise = float(normalised @ normalised)
    likelihood = surprise + step.log_noise + 2.0 * float(np.log(np.abs(root.diagonal())).sum())
    return Belief(
        mean=belief.mean + triangle[:count, count:].T @ normalised,
        factor=triangle[count : count + size, count:].T * _lower(size),
        surprise=belief.surprise + surprise,
        measured=belief.measured + count,
        last_surprise=surprise,
        last_measured=count,
        evidence=belief.evidence - 0.5 * likelihood,
    )


def advance(belief: Belief, step: Step, coordinates: Coordinates, walk: Walk) -> Belief:
    """Return the belief at the next window's first node; its factor is made square again by the next update."""
    transition, noise = step.transition, [step.process]
    gather, length = coordinates.gather, float(step.window.length)
    if walk.force != 'none':
        push = length * _push(step.window, walk)
        transition = transition + gather[:, _MOMENTUM] @ (push @ coordinates.spread[FORCE])
    if walk.drifts:
        rates = np.repeat((walk.orientation, walk.position, walk.momentum), (3, 3, 6))
        noise.append((gather[:, : _MOMENTUM.stop] * (rates * np.sqrt(length)))[:, rates > 0.0])
    factor = np.concatenate((transition @ belief.factor, *noise), axis=1)
    return replace(belief, mean=transition @ belief.mean + step.drift, factor=factor)


def _push(window: WindowModel, walk: Walk) -> Array:
    """Return the (6, 6) change of (P, L) a second by a force and torque: on the base's origin, or inertial ones.

    Inertial ones act at the run's origin (`difference.effects` has the reason). A window's momentum is that of its
    middle, so that the change within it cancels in the pose. The force acts from there to the middle of the next
    window, on a base that is on average where the two meet.
    """
    push = np.eye(6)
    if walk.force == 'body':
        push[:3, :3] = push[3:, 3:] = window.rotation
        push[3:, :3] = skew(window.position) @ window.rotation
    return push


def unlinked(belief: Belief, coordinates: Coordinates) -> Belief:
    """Return the belief with a pose error about which nothing is known: the chain was broken."""
    poses = len(coordinates.measured)
    mean, factor = belief.mean.copy(), belief.factor.copy()
    mean[:poses] = factor[:poses] = 0.0
    start = coordinates.open().factor[:, :poses]
    return replace(belief, mean=mean, factor=np.concatenate((start, factor), axis=1))


def jolted(belief: Belief, step: Step, coordinates: Coordinates, sizes: Array) -> Belief:
    """Return the belief with a momentum that may have jumped in the window just before.

    Parameters
    ----------
    belief : at the first node of the window in which it is noticed
    step : of that window; the one before is much like it
    coordinates : Coordinates
    sizes : (6,) standard deviations of the jump of (P, L)
    """
    change = np.zeros((len(coordinates.basis), 12))
    change[_MOMENTUM, :6] = np.diag(sizes)
    # It came at any time of the window, and acted for the rest of it: half of it, give or take the square root of 1/12.
    change[_POSE, :6] = 0.5 * step.window.transition[:, _MOMENTUM] * sizes
    change[_POSE, 6:] = np.sqrt(1.0 / 12.0) * step.window.transition[:, _MOMENTUM] * sizes
    moved = coordinates.gather @ change
    return replace(belief, factor=np.concatenate((belief.factor, moved), axis=1))


@cache
def _identity(size: int) -> Array:
    return np.eye(size)


@cache
def _lower(size: int) -> Array:
    """Return a lower triangle of ones: LAPACK leaves something else above that of a factor."""
    return np.tri(size)


def _compressed(columns: Array) -> Array:
    """Return a square factor of the covariance columns columns^T."""
    return np.asarray(np.linalg.qr(columns.T, mode='r')).T
