"""The Kalman filter over windows: one update and one step on each, in scaled variables.

Covariances are kept as factors and moved by orthogonal transformations (square-root form, Bierman 1977, chapter 5):
from a prior that says nothing to accurate odometry after minutes they shrink by more than double precision can hold as
covariances, and a factor's square is never negative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Literal

import numpy as np
from scipy.linalg.lapack import dgeqrf, dtrtrs

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.belief import Belief, Beliefs, Coordinates
from mbaid_ros.core.trajectory.chain import ANGULAR, LINEAR
from mbaid_ros.core.trajectory.nodes import Integers
from mbaid_ros.core.trajectory.steps import Step

_POSE = slice(0, 6)
_MOMENTUM = slice(LINEAR.start, ANGULAR.stop)


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

    @property
    def drifts(self) -> bool:
        """Whether there is a random walk."""
        return len(self.rates) > 0

    @cached_property
    def drifting(self) -> Integers:
        """The numbers of the state that walk."""
        return np.flatnonzero(self._intensities)

    @cached_property
    def rates(self) -> Array:
        """Their intensities."""
        return self._intensities[self.drifting]

    @cached_property
    def _intensities(self) -> Array:
        """Of pose error and momentum, (12,)."""
        return np.repeat((self.orientation, self.position, self.momentum), (3, 3, 6))


def update(beliefs: Beliefs, step: Step) -> Beliefs:
    """Return the beliefs of several hypotheses after a window's measurements."""
    rows, before, hypotheses = step.rows, beliefs.columns, len(beliefs)
    count, size = rows.shape
    predicted = rows @ before
    # The square of `stacked` holds the covariances of measurements and state, prior to the update; that of its
    # triangular factor the same, ordered so that the state's last block is what the measurements leave of it.
    stacked = np.zeros((hypotheses, count + size, count + before.shape[2] - 2))
    stacked[:, :count, :count] = _identity(count)
    stacked[:, :count, count:] = predicted[..., 2:]
    stacked[:, count:, count:] = before[..., 2:]
    triangles = np.zeros((hypotheses, count + size, count + size))
    normalised = step.value - predicted[..., :2]
    for place, free in enumerate(beliefs.free):
        used = count + free
        # LAPACK itself, for so small a matrix: numpy's own call takes twice the time.
        triangle = dgeqrf(stacked[place, :used].T, overwrite_a=True)[0]
        triangles[place, :used, :used] = triangle[:used].T
        normalised[place] = dtrtrs(triangle[:count, :count], normalised[place], trans=1)[0]
    after = np.empty((hypotheses, size, 2 + size))
    means, left = after[..., :2], after[..., 2:]
    np.multiply(triangles[:, count:, count:], _lower(size), out=left)
    np.add(before[..., :2], triangles[:, count:, :count] @ normalised, out=means)
    means[..., 1] += (left @ (step.shared @ left)[..., None])[..., 0]
    surprises = np.add.reduce(normalised[..., 0] ** 2, axis=1)
    roots = np.abs(triangles.diagonal(axis1=1, axis2=2)[:, :count])
    likelihoods = surprises + (step.log_noise + 2.0 * np.add.reduce(np.log(roots), axis=1))
    return Beliefs(
        after,
        beliefs.free,
        beliefs.surprises + surprises,
        beliefs.measured + count,
        surprises,
        count,
        beliefs.evidences - 0.5 * likelihoods,
    )


def advance(beliefs: Beliefs, step: Step, coordinates: Coordinates, walks: Sequence[Walk]) -> Beliefs:
    """Return the beliefs after an update, each under its walk, at the next window's first node.

    Their factors are made square again by the next update.
    """
    before, (poses, joints) = beliefs.columns, step.process.shape
    hypotheses, size, width = before.shape
    ends = [2 + free + len(walk.rates) for free, walk in zip(beliefs.free, walks, strict=True)]
    most = max(width, *ends)
    after = np.zeros((hypotheses, size, most + joints))
    after[..., :width] = before
    moved = after[:, :poses]
    np.matmul(step.transition, before, out=moved[..., :width])
    moved[..., :2] += step.drift
    moved[..., most:] = step.process
    for place, (walk, end) in enumerate(zip(walks, ends, strict=True)):
        if walk.force != 'none':
            after[place, :, :width] += (step.in_base_axes if walk.force == 'body' else step.inertial) @ before[place]
        if walk.drifts:
            # Where the factor of other hypotheses goes on.
            after[place, :, end - len(walk.rates) : end] = np.sqrt(step.length) * _drift(walk, coordinates)
    return beliefs.moved(after)


@lru_cache(maxsize=64)
def _drift(walk: Walk, coordinates: Coordinates) -> Array:
    """Return the factor of the covariance of the variables that a walk makes in a second."""
    return np.asarray(coordinates.gather[:, walk.drifting] * walk.rates)


def unlinked(belief: Belief, coordinates: Coordinates) -> Belief:
    """Return the belief with a pose error about which nothing is known: the chain was broken."""
    poses = len(coordinates.measured)
    means, factor = belief.means.copy(), belief.factor.copy()
    means[:poses], factor[:poses] = 0.0, 0.0
    start = coordinates.open().factor[:, :poses]
    return replace(belief, means=means, factor=np.concatenate((start, factor), axis=1))


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
    change[_POSE, :6] = 0.5 * step.moved * sizes
    change[_POSE, 6:] = np.sqrt(1.0 / 12.0) * step.moved * sizes
    moved = coordinates.gather @ change
    return replace(belief, factor=np.concatenate((belief.factor, moved), axis=1))


@cache
def _identity(size: int) -> Array:
    return np.eye(size)


@cache
def _lower(size: int) -> Array:
    """Return a lower triangle of ones: LAPACK leaves something else above that of a factor."""
    return np.tri(size)
