"""The time update: random walks, Gauss-Markov processes, the effect of a gap; the past is eliminated here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dgeqrf

from mbaid_ros.core.contracts import Axes, Hypothesis
from mbaid_ros.core.filter.gaussian import BiasSeparatedRoot, SquareRootInformation, identity, upper_ones
from mbaid_ros.core.filter.linearise import WhitenedWindow
from mbaid_ros.core.geometry import Array, Integers, cross, skew
from mbaid_ros.core.state import MOMENTUM, POSE, Variables
from mbaid_ros.core.windows import Window


@dataclass(frozen=True)
class MomentumChange:
    """The change of the momentum over some seconds, and of the f Gauss-Markov processes that bring a part of it."""

    by_variables: Array  # (p, v) by the variables at the begin
    process_gain: Array  # (h, f) of the first variables with a process, when that grows by one until the end
    noise: Array  # (p, f) factor, given the processes at both ends
    autocorrelation: Array  # (f,) autocorrelation of the processes that bring momentum; 0 of others


def momentum_change(change: Array, rate_length: float, seconds: float, variables: Variables) -> MomentumChange:
    """Return the change of the momentum over some seconds.

    A process v of unit variance and time constant T with the values v and v' at the ends of D seconds has an integral
    with mean g D (v + v') / 2 and variance D^2 (1 - g) / x, where x = D / (2 T) and g = tanh(x) / x.

    Parameters
    ----------
    change, rate_length : (p, v) change over a length in s by constant variables
    """
    change = change * (seconds / rate_length)
    count = len(variables.gauss_markov)
    steps = np.zeros((variables.moving, count))
    if not count:
        return MomentumChange(change, steps, np.zeros((len(change), 0)), np.zeros(0))
    of_processes = change[:, variables.gauss_markov]
    half = 0.5 * seconds / variables.time_constants[np.isfinite(variables.time_constants)]
    share = np.tanh(half) / half
    change[:, variables.gauss_markov] = share * of_processes
    steps[variables.pose_size :] = 0.5 * share * of_processes
    noise = of_processes * np.sqrt((1.0 - share) / half)
    return MomentumChange(change, steps, noise, variables.autocorrelation(seconds) * of_processes.any(axis=0))


def advance(
    gaussian: SquareRootInformation, window: WhitenedWindow, variables: Variables, hypothesis: Hypothesis
) -> SquareRootInformation:
    """Return the Gaussian at the next window's first knot, under its force and the walks of a hypothesis.

    With an integrated twist c goes along (filter.md, eq. 5).
    """
    link = window.border_noise if gaussian.conditional.augmented else None
    root = gaussian.conditional if link is not None else gaussian.conditional.marginal
    head, columns, count = variables.moving, len(variables.scale), root.augmented // 2
    change = momentum_change(window.momentum_change, window.length, window.length, variables)
    rows = root.rows(2 * count + head)
    above, rows = rows[:, : 2 * count], rows[:, 2 * count :]
    if link is not None:
        # q = back (c' - c - noise w + value - rows x), put into the rows that know of it.
        gain = above[: 2 * count, :count] @ link.inverse_factor
        rows[: 2 * count, :columns] -= gain @ link.integral_rows
        rows[: 2 * count, columns + 1] -= gain @ link.integral_value
    back, noise, rest = _at_next_window(rows, window, change, variables, hypothesis, root.forces)
    known = np.concatenate((back, rest), axis=1)
    if link is not None:
        noise[: 2 * count, : link.process.shape[1]] += gain @ link.process
        of_links = np.zeros((len(rows), 2 * count))  # by c and c'
        of_links[: 2 * count] = np.concatenate((above[: 2 * count, count:] - gain, gain), axis=1)
        known = np.concatenate((of_links, known), axis=1)
    after = root.with_first(_noise_eliminated(known, noise)[count:, count:], 2 * count + head, count)
    if variables.random_walk.shape[1]:
        walked = _with_random_walk(after.rows(), np.sqrt(window.length) * variables.random_walk, count + columns)
        after = BiasSeparatedRoot.from_rows(walked, root.forces, count)
    if variables.time_constants.size:  # there is no c then
        change.process_gain[: variables.pose_size] += window.process_gain
        process = variables.autocorrelation(window.length), change.process_gain, window.process_variance
        rows = _gauss_markov_step(after.rows(), variables.gauss_markov, *process)
        after = BiasSeparatedRoot.from_rows(rows, root.forces)
    return replace(gaussian, conditional=after)


def _at_next_window(
    rows: Array,
    window: WhitenedWindow,
    change: MomentumChange,
    variables: Variables,
    hypothesis: Hypothesis,
    forces: Sequence[Axes],
) -> tuple[Array, Array, Array]:
    """Return rows (r, v + 2 + g) at the next window's first knot: (r, h) of the first variables, noise (r, w) and rest.

    `forces` are the axes of their constant forces.
    """
    head, poses, columns = variables.moving, variables.pose_size, len(variables.scale)
    # x_head = A^-1 (x_head' - B x_rest - drift - noise w), put into the rows that know of it.
    back = rows[:, :head] @ window.inverse_transition
    of_poses, of_momentum = back[:, :poses], back[:, poses:]
    rest = rows[:, head:].copy()
    right = rest[:, columns - head :]
    rest[:, : columns - head] -= of_poses @ window.transition[:, head:] + of_momentum @ change.by_variables[:, head:]
    right[:, 1] += of_poses @ window.drift
    if window.leverage.size:
        rest[:, : columns - head] -= of_momentum @ window.leverage[:, head:-1]
        right[:, 1] += of_momentum @ window.leverage[:, -1]
    if forces:
        right[:, 2:] -= of_momentum @ np.concatenate([window.force_impulse(axes) for axes in forces], axis=1)
    noise = of_poses @ window.process
    if change.noise.any():
        noise = np.concatenate((noise, of_momentum @ change.noise), axis=1)
    if window.thrust_noise.any():
        noise = np.concatenate((noise, of_momentum @ window.thrust_noise), axis=1)
    if hypothesis.random_walk.size:
        walk = variables.from_state[:head, :12] @ hypothesis.random_walk
        noise = np.concatenate((noise, np.sqrt(window.length) * (back @ walk)), axis=1)
    return back, noise, rest


def at_window_start(
    gaussian: SquareRootInformation,
    window: Window,
    white: WhitenedWindow,
    variables: Variables,
    hypothesis: Hypothesis,
) -> SquareRootInformation:
    """Return the Gaussian at the start of a window; with an unknown pose error where the chain was broken before it.

    Constant forces and the walks of a hypothesis act on through a gap. Where poses have been corrected to the frame of
    the first ones, momentum and poses go on in frames that differ by the error of that.
    """
    if not window.after_gap:
        return gaussian
    root, change = gaussian.conditional.marginal, None
    if window.gap and white.momentum_change.any():
        change = momentum_change(white.momentum_change, white.length, window.gap, variables)
    if window.gap and root.forces:
        acting = [white.impulse_in_gap(axes, window) for axes in root.forces]
        right = root.right.copy(order='F')
        right[:, 2:] -= root.triangle[:, variables.pose_size : variables.moving] @ np.concatenate(acting, axis=1)
        gaussian = replace(gaussian, conditional=replace(root, right=right))
    after = pose_reset(gaussian, variables, change)
    if window.frame.any():
        after = with_process_noise(after, _frame_noise(gaussian, window, variables))
    if window.gap and hypothesis.random_walk.size:
        walked = variables.from_state[: variables.moving, :12] @ hypothesis.random_walk
        after = with_process_noise(after, np.sqrt(window.gap) * walked)
    if not (window.gap and variables.random_walk.shape[1]):
        return after
    walk = np.sqrt(window.gap) * variables.random_walk
    return _with_rows(after, _with_random_walk(after.conditional.rows(), walk, len(variables.scale)))


def pose_reset(
    gaussian: SquareRootInformation, variables: Variables, change: MomentumChange | None = None
) -> SquareRootInformation:
    """Return the Gaussian with an unknown pose error: the chain was broken. The rows below its own are the marginal.

    `change` is that of the momentum since. Gauss-Markov processes that bring none of it are drawn anew.
    """
    root, poses = gaussian.conditional.marginal.rows(), variables.pose_size
    root[:poses] = 0.0
    root[:poses, :poses] = variables.prior()[1][:poses, :poses]
    if change is not None:
        head, own = variables.moving, slice(variables.moving, len(variables.scale))
        root[:, own] -= root[:, poses:head] @ change.by_variables[:, own]
        if change.noise.any():
            root[:head] = _noise_eliminated(root[:head], root[:head, poses:head] @ change.noise)
    if variables.gap_change.shape[1]:
        root = _with_random_walk(root, variables.gap_change, len(variables.scale))
    return _with_rows(gaussian, _processes_redrawn(root, variables, change))


def _frame_noise(gaussian: SquareRootInformation, window: Window, variables: Variables) -> Array:
    """Return a factor (h, 6) of the noise of the momentum by a correction of the poses before a window.

    An error (theta, rho) at the base turns P and L_b, and moves the base.
    """
    begin = window.inside.start
    mean = variables.to_state[MOMENTUM] @ gaussian.least_squares[: len(variables.scale)] + window.knots.impulse[begin]
    linear, place = mean[:3], window.knots.base_position[begin]
    change = np.zeros((12, 6))
    of_linear, of_angular = change[MOMENTUM][:3], change[MOMENTUM][3:]
    of_linear[:, :3] = -skew(linear)
    of_angular[:, :3] = -skew(mean[3:] - cross(place, linear)) - skew(place) @ skew(linear)
    of_angular[:, 3:] = -skew(linear)
    return np.asarray(variables.from_state[: variables.moving, :12] @ (change * np.repeat(np.sqrt(window.frame), 3)))


def new_motion(gaussian: SquareRootInformation, variables: Variables) -> SquareRootInformation:
    """Return the Gaussian at the beginning of another motion: pose error, momentum and numbers drawn anew."""
    root, head = gaussian.conditional.marginal.rows(), variables.moving
    root[:head] = 0.0
    root[:head, :head] = variables.prior()[1][:head, :head]
    if variables.motion_change.shape[1]:
        root = _with_random_walk(root, variables.motion_change, len(variables.scale))
    return _with_rows(gaussian, _processes_redrawn(root, variables))


def _with_rows(gaussian: SquareRootInformation, rows: Array) -> SquareRootInformation:
    """Return the Gaussian with other rows (v, v + 2 + g) of the variables."""
    return replace(gaussian, conditional=BiasSeparatedRoot.from_rows(rows, gaussian.conditional.forces))


def momentum_inflation(
    gaussian: SquareRootInformation, window: WhitenedWindow, variables: Variables, sizes: Array
) -> SquareRootInformation:
    """Return the Gaussian with a momentum that may have jumped in the window before, which is much like this one.

    Parameters
    ----------
    gaussian, window : at the first knot of the window in which the jump is noticed
    variables : of the filter
    sizes : (6,) standard deviations of the jump of (P, L)
    """
    change = np.zeros((12, 12))
    change[MOMENTUM, :6] = np.diag(sizes)
    # It came at any time of the window: for half of it, with a standard deviation of the square root of 1/12.
    change[POSE, :6] = 0.5 * window.pose_error_by_momentum * sizes
    change[POSE, 6:] = np.sqrt(1.0 / 12.0) * window.pose_error_by_momentum * sizes
    return with_process_noise(gaussian, variables.from_state[: variables.moving, :12] @ change)


def with_process_noise(gaussian: SquareRootInformation, noise: Array) -> SquareRootInformation:
    """Return the Gaussian with noise (h, w) added to its first h variables."""
    root, head = gaussian.conditional.marginal, len(noise)
    rows = root.rows(head)
    return replace(gaussian, conditional=root.with_first(_noise_eliminated(rows, rows[:, :head] @ noise), head))


def _noise_eliminated(rows: Array, noise: Array) -> Array:
    """Return the triangle of rows (r, c), r <= c, in which noise (r, w) of unit variance has been eliminated."""
    count, (height, width) = noise.shape[1], rows.shape
    wide = np.zeros((count + height, count + width), order='F')
    wide[:count, :count] = identity(count)
    wide[count:, :count], wide[count:, count:] = -noise, rows
    return _triangle(wide, count)


def _triangle(wide: Array, count: int) -> Array:
    """Return the triangle of rows without their first variables, which are eliminated."""
    triangle = np.array(dgeqrf(wide, overwrite_a=True)[0][count:, count:], order='F')
    size = len(triangle)
    triangle[:, :size] *= upper_ones(size)
    return triangle


def _with_random_walk(root: Array, noise: Array, stop: int) -> Array:
    """Return the triangle after noise (e, w) has been added to the last e of the first `stop` variables."""
    return _noise_eliminated(root, root[:, stop - len(noise) : stop] @ noise)


def _processes_redrawn(root: Array, variables: Variables, change: MomentumChange | None = None) -> Array:
    """Return the triangle with the Gauss-Markov processes drawn anew, but for those that change the momentum."""
    if not variables.time_constants.size:
        return root
    zeros = np.zeros(len(variables.gauss_markov))
    if change is None:
        return _gauss_markov_step(root, variables.gauss_markov, zeros, np.zeros((0, len(zeros))), zeros)
    return _gauss_markov_step(root, variables.gauss_markov, change.autocorrelation, change.process_gain, zeros)


def _gauss_markov_step(root: Array, places: Integers, correlation: Array, steps: Array, added: Array) -> Array:
    """Return the triangle after a step of Gauss-Markov processes of unit variance (filter.md, eq. 6).

    v' = correlation v + noise, and the first variables follow: x' = x + steps (v' - v). v is eliminated.

    Parameters
    ----------
    root, places : (v, v + 2 + g), and the (f,) indices of the processes
    correlation, steps : (f,) autocorrelations, below 1; (p, f)
    added : (f,) variance of the noise beside that which keeps the processes stationary
    """
    size, count = len(root), len(places)
    rows, certain = np.arange(count), 1.0 / np.sqrt(1.0 - correlation**2 + added)
    along = root[:, : len(steps)] @ steps
    wide = np.zeros((count + size, count + root.shape[1]), order='F')
    wide[rows, rows], wide[rows, count + places] = -correlation * certain, certain
    wide[count:, count:] = root
    wide[count:, :count] = root[:, places] + along
    wide[count:, count + places] = -along
    return _triangle(wide, count)
