"""The square-root information filter over windows: one update and one step on each, in scaled variables.

Bierman 1977, chapters 5 and 6. Only pose error and momentum change on the way from window to window, and they come
first among the variables: a step reworks the first rows of the triangle, an update adds a window's rows to all of it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.linalg.lapack import dgeqrf, dtpqrt, dtrtrs

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.belief import Belief
from mbaid_ros.core.trajectory.state import MOMENTUM, POSE
from mbaid_ros.core.trajectory.variables import Variables
from mbaid_ros.core.trajectory.whitened import WhitenedWindow
from mbaid_ros.core.unknowns.hypotheses import Hypothesis

_BLOCK = 16  # columns that LAPACK reflects together


def update(belief: Belief, window: WhitenedWindow) -> Belief:
    """Return the belief after a window's measurements."""
    size, (count, columns) = belief.size, window.rows.shape
    triangle = np.zeros((size + 2, size + 2), order='F')
    triangle[:size] = belief.root
    rows = np.zeros((count, size + 2), order='F')
    rows[:, :columns], rows[:, -1] = window.rows, window.value
    triangle, _, _, _ = dtpqrt(0, min(_BLOCK, size + 2), triangle, rows, overwrite_a=True, overwrite_b=True)
    root = triangle[:size]
    # What is left of the values are the innovations, normalised and turned.
    nis = float(triangle[-2, -1] ** 2 + triangle[-1, -1] ** 2)
    score = np.zeros(size)
    score[:columns] = window.shared
    root[:, -2] += dtrtrs(root[:, :size], score, trans=1)[0]
    growth = 2.0 * float(_log_diagonal(root) - _log_diagonal(belief.root))
    return Belief(
        root,
        belief.innovations.after(_normalised(belief, window), window.places),
        belief.nis + nis,
        belief.measured + count,
        nis,
        count,
        belief.log_likelihood - 0.5 * (nis + window.log_noise + growth),
    )


def _normalised(belief: Belief, window: WhitenedWindow) -> Array:
    """Return a window's innovations in units of their standard deviations, each given those before it, (k,)."""
    size, (count, columns) = belief.size, window.rows.shape
    rows = np.zeros((size, count), order='F')
    rows[:columns] = window.rows.T
    gain = dtrtrs(belief.root[:, :size], rows, trans=1, overwrite_b=True)[0]  # R^-T H^T
    innovation = window.value - gain.T @ belief.root[:, -1]
    # Their covariance 1 + gain^T gain is that of a triangle, which may span more than a covariance can hold.
    triangle = dgeqrf(np.concatenate((gain, _identity(count))), overwrite_a=True)[0][:count]
    return np.asarray(dtrtrs(triangle, innovation, trans=1)[0])


def advance(belief: Belief, window: WhitenedWindow, variables: Variables, hypothesis: Hypothesis) -> Belief:
    """Return the belief after an update at the next window's first knot, as a hypothesis has what acts and drifts."""
    size, head, poses = belief.size, variables.head, variables.poses
    columns = len(variables.scale)
    transition = np.zeros((head, size))
    transition[:poses, :columns] = window.transition
    transition[poses:, poses:head] = np.eye(head - poses)
    if hypothesis.force != 'none':
        transition[poses:, columns:] = window.push(hypothesis.force)
    joints, walks = window.process.shape[1], len(hypothesis.walking)
    noise = np.zeros((head, joints + walks))
    noise[:poses, :joints] = window.process
    if walks:
        noise[:, joints:] = np.sqrt(window.length) * _walk(hypothesis, variables)
    drift = np.zeros((head, 2))
    drift[:poses, 1] = window.drift
    advanced = belief.with_root(_propagated(belief.root, transition, noise, drift))
    if variables.walks.shape[1]:
        return advanced.with_root(
            _walked(advanced.root, np.sqrt(window.length) * variables.walks, len(variables.scale))
        )
    return advanced


def pose_reset(belief: Belief, variables: Variables) -> Belief:
    """Return the belief with a pose error about which nothing is known: the chain was broken.

    The rows below those of the pose error hold what is known of the rest, whatever it is.
    """
    root, poses = belief.root.copy(), variables.poses
    root[:poses] = 0.0
    root[:poses, :poses] = variables.prior()[1][:poses, :poses]
    return belief.with_root(root)


def new_motion(belief: Belief, variables: Variables) -> Belief:
    """Return the belief at the begin of another motion: of pose error and momentum nothing is known.

    Their rows go, which leaves what is known of all else whatever they were.
    """
    root, head = belief.root.copy(), variables.head
    root[:head] = 0.0
    root[:head, :head] = variables.prior()[1][:head, :head]
    return belief.with_root(root)


def momentum_inflation(belief: Belief, window: WhitenedWindow, variables: Variables, sizes: Array) -> Belief:
    """Return the belief with a momentum that may have jumped in the window just before.

    Parameters
    ----------
    belief : at the first knot of the window in which it is noticed
    window : that one; the one before is much like it
    variables : of the filter
    sizes : (6,) standard deviations of the jump of (P, L)
    """
    change = np.zeros((12, 12))
    change[MOMENTUM, :6] = np.diag(sizes)
    # It came at any time of the window, and acted for the rest of it: half of it, give or take the square root of 1/12.
    change[POSE, :6] = 0.5 * window.moved * sizes
    change[POSE, 6:] = np.sqrt(1.0 / 12.0) * window.moved * sizes
    return inflated(belief, variables.gather[: variables.head, :12] @ change)


def inflated(belief: Belief, noise: Array) -> Belief:
    """Return the belief with more noise in its first h variables: (h, w), of independent numbers of unit variance."""
    head = len(noise)
    return belief.with_root(_propagated(belief.root, np.eye(head, belief.size), noise, np.zeros((head, 2))))


def _propagated(root: Array, transition: Array, noise: Array, drift: Array) -> Array:
    """Return the triangle of what x_head' = transition x + drift + noise w makes of its first variables.

    Parameters
    ----------
    root : (v, v + 2)
    transition : (h, v) regular in its first h columns
    noise : (h, w) of independent w of unit variance
    drift : (h, 2) of the two means
    """
    head, count = noise.shape
    size = len(root)
    # x_head = A^-1 (x_head' - B x_rest - drift - noise w), put into the rows that know of it; w is eliminated first.
    back = root[:head, :head] @ np.linalg.inv(transition[:, :head])
    wide = np.zeros((count + head, count + size + 2), order='F')
    wide[:count, :count] = _identity(count)
    wide[count:, :count] = -back @ noise
    wide[count:, count : count + head] = back
    wide[count:, count + head :] = root[:head, head:]
    wide[count:, count + head : count + size] -= back @ transition[:, head:]
    wide[count:, count + size :] += back @ drift
    triangle = dgeqrf(wide, overwrite_a=True)[0][count:, count:]
    after = root.copy()
    after[:head] = triangle
    after[:head, :head] *= _upper(head)
    return after


def _walked(root: Array, noise: Array, own: int) -> Array:
    """Return the triangle after noise has been added to some of the variables.

    Parameters
    ----------
    root : (v, v + 2)
    noise : (e, w) of the last e of the first `own` variables, of independent numbers of unit variance
    own : number of variables without those of a force
    """
    size, count = len(root), noise.shape[1]
    wide = np.zeros((count + size, count + size + 2), order='F')
    wide[:count, :count] = _identity(count)
    wide[count:, :count] = -root[:, own - len(noise) : own] @ noise
    wide[count:, count:] = root
    triangle = dgeqrf(wide, overwrite_a=True)[0][count:, count:]
    triangle[:, :size] *= _upper(size)
    return np.asarray(triangle)


def _walk(hypothesis: Hypothesis, variables: Variables) -> Array:
    """Return the factor of the covariance of pose error and momentum that a hypothesis' walks make in a second."""
    return np.asarray(variables.gather[: variables.head, hypothesis.walking] * hypothesis.intensities)


def _log_diagonal(root: Array) -> float:
    return float(np.add.reduce(np.log(np.abs(root.diagonal()))))


@cache
def _identity(size: int) -> Array:
    return np.eye(size)


@cache
def _upper(size: int) -> Array:
    """Return an upper triangle of ones: LAPACK leaves something else below that of a factor."""
    return np.triu(np.ones((size, size)))
