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
from mbaid_ros.core.trajectory.belief import Belief, Coordinates
from mbaid_ros.core.trajectory.chain import ANGULAR, FORCE, LINEAR, WindowModel
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

    @cached_property
    def drifts(self) -> bool:
        """Whether there is a random walk."""
        return any((self.momentum, self.position, self.orientation))


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
    unexplained = -(rows @ belief.means)
    unexplained[:, 0] += step.value
    both, _ = dtrtrs(root, unexplained, trans=1)
    normalised = both[:, 0]
    surprise = float(normalised @ normalised)
    likelihood = surprise + step.log_noise + 2.0 * float(np.log(np.abs(root.diagonal())).sum())
    left = triangle[count : count + size, count:].T * _lower(size)
    means = belief.means + triangle[:count, count:].T @ both
    means[:, 1] += left @ (left.T @ step.shared)
    return Belief(
        means=means,
        factor=left,
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
    means = transition @ belief.means
    means[:, 0] += step.drift
    return replace(belief, means=means, factor=factor)


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
