"""The square-root information filter over windows (Bierman 1977, chapters 5 and 6), in scaled variables.

R x = z with unit covariance. From window to window pose error, momentum and walking unknowns change. The first two come
first among the variables, so that a step reworks few rows of the triangle; an update adds a window's rows to all of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg.lapack import dgeqrf, dtpqrt, dtrtri, dtrtrs

from mbaid_ros.core.filter.integrated_twist import TwistLink
from mbaid_ros.core.filter.joint_noise import no_bias
from mbaid_ros.core.filter.pushing import MomentumChange, momentum_change
from mbaid_ros.core.filter.state import MOMENTUM, POSE
from mbaid_ros.core.filter.variables import OPEN_LENGTH, Variables
from mbaid_ros.core.filter.whitened import WhitenedWindow
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.results.evidence import Innovations
from mbaid_ros.core.unknowns.environment import Hypothesis

_BLOCK = 12  # columns that LAPACK reflects together: as many as a window has rows


@dataclass(frozen=True, eq=False)
class SquareRootInformation:
    """A Gaussian of the scaled variables: those of `Variables`, then those of a constant force where there is one."""

    # (v, v + 2), Fortran order: the triangle R, beside it z of the correction for noise that rows and values share, and
    # z of the least-squares mean: x = R^-1 (their sum)
    root: Array
    innovations: Innovations  # sensor by sensor
    bias_information: Array  # (b, b + 1) as of `WhitenedWindow`, summed over all windows
    # nis, measured: sum of the normalised innovations squared over all windows, and their number
    nis: float = 0.0
    measured: int = 0
    last_nis: float = 0.0  # the same of the last update
    last_measured: int = 0  # the same of the last update
    log_likelihood: float = 0.0  # of all measurements, up to a constant
    # (c, c + v + 2) rows above those of the root, of c numbers that the next window's twist is linked by (`TwistLink`),
    # or between an update and the step after it of its noise and these; None where nothing links it
    carried: Array | None = None

    @staticmethod
    def prior(variables: Variables, extra: int = 0, mass: float | None = None) -> SquareRootInformation:
        """Return the prior, with `extra` numbers of unit variance beside the variables, near a mass in kg if given."""
        mean, triangle, likelihood = variables.prior(mass)
        size = len(mean) + extra
        root = np.zeros((size, size + 2), order='F')
        root[: len(mean), : len(mean)] = triangle
        root[: len(mean), -1] = triangle @ mean
        root[len(mean) :, len(mean) : -2] = np.eye(extra)
        nothing = Innovations.none(variables.poses), no_bias(variables)
        return SquareRootInformation(root, *nothing, log_likelihood=likelihood)

    @property
    def misfit(self) -> float:
        """Log-likelihood lost by innovations larger than expected."""
        return 0.5 * (self.nis - self.measured)

    @property
    def size(self) -> int:
        """Number v of variables."""
        return len(self.root)

    def moments(self) -> tuple[Array, Array]:
        """Return the mean (v,), and the part of it that corrects for shared noise (v,).

        Raises LinAlgError: The information has a direction without any.
        """
        both, info = dtrtrs(self.root[:, :-2], self.root[:, -2:])
        if info:
            raise np.linalg.LinAlgError('a direction of the state has no information')
        return both[:, 0] + both[:, 1], both[:, 0]

    @property
    def factor(self) -> Array:
        """A factor of the covariance, (v, v)."""
        return np.asarray(dtrtri(self.root[:, :-2])[0])

    @property
    def least_squares(self) -> Array:
        """The mean without the correction for shared noise, (v,)."""
        return np.asarray(dtrtrs(self.root[:, :-2], self.root[:, -1])[0])

    def with_root(self, root: Array, carried: Array | None = None) -> SquareRootInformation:
        """Return the same measurements with another root (v, v + 2), and the carried rows."""
        return replace(self, root=root, carried=carried)


def update(gaussian: SquareRootInformation, window: WhitenedWindow) -> SquareRootInformation:
    """Return the Gaussian after a window's measurements.

    One factorisation of R above the rows H, beside 0 above 1, beside z above the values. It turns the 1 into a triangle
    U, U^T U the inverse of the innovations' covariance, and the values into U times the innovations: normalised, each
    given those after it. So the rows are taken in reverse.
    """
    before = gaussian.root if window.carried is None else _linked_before(gaussian, window.carried)
    size, (count, columns), link = len(before), window.rows.shape, len(before) - gaussian.size
    inner = size + count
    triangle = np.zeros((inner + 2, inner + 2), order='F')
    triangle[:size, :size], triangle[:size, inner:] = before[:, :size], before[:, size:]
    rows = np.zeros((count, inner + 2), order='F')
    rows[:, link : link + columns], rows[:, size:inner] = window.rows[::-1], _identity(count)
    rows[:, -1] = window.value[::-1]
    if window.carried is not None:
        rows[:, :link] = np.concatenate((window.carried.by_noise, window.carried.by_carried), axis=1)[::-1]
    triangle = dtpqrt(0, _BLOCK, triangle, rows, overwrite_a=True, overwrite_b=True)[0]
    root = np.empty((gaussian.size, gaussian.size + 2), order='F')
    root[:, :-2], root[:, -2:] = triangle[link:size, link:size], triangle[link:size, inner:]
    carried = None
    if window.carried is not None:
        carried = np.concatenate((triangle[:link, :size], triangle[:link, inner:]), axis=1)
    score = np.zeros(gaussian.size)
    score[:columns] = window.shared
    root[:, -2] += dtrtrs(root[:, :-2], score, trans=1)[0]
    left, diagonal = triangle[-count - 2 : -2, -1], triangle.diagonal()[-count - 2 : -2]
    nis = float(left @ left)
    growth = -2.0 * float(np.add.reduce(np.log(np.abs(diagonal))))
    return SquareRootInformation(
        root,
        gaussian.innovations.after((left * np.sign(diagonal))[::-1], window.places),
        gaussian.bias_information + window.bias_information,
        gaussian.nis + nis,
        gaussian.measured + count,
        nis,
        count,
        gaussian.log_likelihood - 0.5 * (nis + window.log_noise + growth),  # trajectory.md, eq. 5
        carried,
    )


def advance(
    gaussian: SquareRootInformation, window: WhitenedWindow, variables: Variables, hypothesis: Hypothesis
) -> SquareRootInformation:
    """Return the Gaussian at the next window's first knot, under a hypothesis of forces and drifts."""
    if window.carried is not None and gaussian.carried is not None:
        return _advanced_with_link(gaussian, gaussian.carried, window, window.carried, variables, hypothesis)
    root, change = gaussian.root, momentum_change(window.brought, window.length, window.length, variables)
    steps = _stepped(root[: variables.head], window, change, variables, hypothesis)
    advanced = gaussian.with_root(_eliminated(root, *steps))
    if variables.walks.shape[1]:
        walk = np.sqrt(window.length) * variables.walks
        advanced = advanced.with_root(_walked(advanced.root, walk, len(variables.scale)))
    if variables.times.size:
        stepped = change.stepped
        stepped[: variables.poses] += window.stepped
        kept = variables.kept(window.length)
        after = _wandered(advanced.root, variables.wandering, kept, stepped, window.gained)
        return advanced.with_root(after)
    return advanced


def _stepped(
    rows: Array, window: WhitenedWindow, change: MomentumChange, variables: Variables, hypothesis: Hypothesis
) -> tuple[Array, Array, Array]:
    """Return rows (r, v + 2) at the next window's first knot, as `_eliminated` takes them: back, noise and rest."""
    head, poses, columns = variables.head, variables.poses, len(variables.scale)
    # x_head = A^-1 (x_head' - B x_rest - drift - noise w), put into the rows that know of it.
    back = rows[:, :head] @ window.back
    of_poses = back[:, :poses]
    rest = rows[:, head:].copy()
    rest[:, : columns - head] -= of_poses @ window.transition[:, head:] + back[:, poses:] @ change.brought[:, head:]
    if hypothesis.force != 'none':
        rest[:, columns - head : -2] -= back[:, poses:] @ window.push(hypothesis.force)
    rest[:, -1] += of_poses @ window.drift
    noise = of_poses @ window.process
    if change.noise.any():
        noise = np.concatenate((noise, back[:, poses:] @ change.noise), axis=1)
    if hypothesis.walking.size:
        noise = np.concatenate((noise, np.sqrt(window.length) * (back @ _walk(hypothesis, variables))), axis=1)
    return back, noise, rest


def _linked_before(gaussian: SquareRootInformation, carried: TwistLink) -> Array:
    """Return the root (2 k + v, 2 k + v + 2) before a window, with the noise q and c of the integrated twist on top.

    Where no c has been carried to it, that is as uncertain as a first pose.
    """
    count, size = carried.by_carried.shape[1], gaussian.size
    root = np.zeros((2 * count + size, 2 * count + size + 2), order='F')
    root[:count, :count] = _identity(count)
    own = slice(count, 2 * count)
    if gaussian.carried is None:
        root[own, own] = _identity(count) / OPEN_LENGTH
    else:
        root[own, count:] = gaussian.carried
    root[2 * count :, 2 * count :] = gaussian.root
    return root


def _advanced_with_link(
    gaussian: SquareRootInformation,
    rows: Array,
    window: WhitenedWindow,
    carried: TwistLink,
    variables: Variables,
    hypothesis: Hypothesis,
) -> SquareRootInformation:
    """Return the Gaussian and c at the next window's first knot (trajectory.md, eq. 10).

    `rows` (2 k, 2 k + v + 2) are those of q and c after the update; the rest is as for `advance`.
    """
    root, head, columns, count = gaussian.root, variables.head, len(variables.scale), len(carried.way_value)
    # q = back (c' - c - noise w + value - rows x), put into the rows that know of it.
    gain = rows[:, :count] @ carried.back
    state = np.concatenate((rows[:, 2 * count :], root[:head]))
    state[: len(rows), :columns] -= gain @ carried.way_rows
    state[: len(rows), -1] -= gain @ carried.way_value
    change = momentum_change(window.brought, window.length, window.length, variables)
    back, noise, rest = _stepped(state, window, change, variables, hypothesis)
    noise[: len(rows), : carried.process.shape[1]] += gain @ carried.process
    walks = noise.shape[1]
    wide = np.zeros((walks + len(state), walks + 2 * count + head + rest.shape[1]), order='F')
    wide[:walks, :walks] = _identity(walks)
    known = wide[walks:]
    known[:, :walks], known[:, walks + 2 * count : -rest.shape[1]], known[:, -rest.shape[1] :] = -noise, back, rest
    known[: len(rows), walks : walks + count] = rows[:, count : 2 * count] - gain
    known[: len(rows), walks + count : walks + 2 * count] = gain
    gone, ahead = walks + count, count + head
    triangle = dgeqrf(wide, overwrite_a=True)[0][gone:, gone:]
    whole: Array = np.zeros((count + len(root), count + len(root) + 2), order='F')
    whole[:ahead, :ahead], whole[:ahead, ahead:] = triangle[:, :ahead] * _upper(ahead), triangle[:, ahead:]
    whole[ahead:, ahead:] = root[head:, head:]
    if variables.walks.shape[1]:
        whole = _walked(whole, np.sqrt(window.length) * variables.walks, count + columns)
    return gaussian.with_root(np.array(whole[count:, count:], order='F'), whole[:count].copy())


def entered(
    gaussian: SquareRootInformation, window: Window, white: WhitenedWindow, variables: Variables
) -> SquareRootInformation:
    """Return the Gaussian at the start of a window; with an unknown pose error where the chain was broken before it."""
    if not window.fresh:
        return gaussian
    if not window.gap or not white.brought.any():
        return pose_reset(gaussian, variables)
    return pose_reset(gaussian, variables, momentum_change(white.brought, white.length, window.gap, variables))


def pose_reset(
    gaussian: SquareRootInformation, variables: Variables, change: MomentumChange | None = None
) -> SquareRootInformation:
    """Return the Gaussian with an unknown pose error: the chain was broken. The rows below its own are the marginal.

    `change` is that of the momentum since. Gauss-Markov processes that bring none of it are drawn anew.
    """
    root, poses = gaussian.root.copy(), variables.poses
    root[:poses] = 0.0
    root[:poses, :poses] = variables.prior()[1][:poses, :poses]
    if change is not None:
        head, own = variables.head, slice(variables.head, len(variables.scale))
        root[:, own] -= root[:, poses:head] @ change.brought[:, own]
        if change.noise.any():
            root = _eliminated(root, root[:head, :head], root[:head, poses:head] @ change.noise, root[:head, head:])
    if variables.broken.shape[1]:
        root = _walked(root, variables.broken, len(variables.scale))
    return gaussian.with_root(_forgotten(root, variables, change))


def new_motion(gaussian: SquareRootInformation, variables: Variables) -> SquareRootInformation:
    """Return the Gaussian at the beginning of another motion: pose error, momentum and numbers drawn anew."""
    root, head = gaussian.root.copy(), variables.head
    root[:head] = 0.0
    root[:head, :head] = variables.prior()[1][:head, :head]
    if variables.renewed.shape[1]:
        root = _walked(root, variables.renewed, len(variables.scale))
    return gaussian.with_root(_forgotten(root, variables))


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
    change[POSE, :6] = 0.5 * window.moved * sizes
    change[POSE, 6:] = np.sqrt(1.0 / 12.0) * window.moved * sizes
    return inflated(gaussian, variables.gather[: variables.head, :12] @ change)


def inflated(gaussian: SquareRootInformation, noise: Array) -> SquareRootInformation:
    """Return the Gaussian with noise (h, w) added to its first h variables."""
    root, head = gaussian.root, len(noise)
    back = root[:head, :head]
    return gaussian.with_root(_eliminated(root, back, back @ noise, root[:head, head:]))


def _eliminated(root: Array, back: Array, noise: Array, rest: Array) -> Array:
    """Return the triangle after noise w of unit variance in its first h rows has been eliminated.

    Those are back (h, h) of the first variables, -noise (h, w), and rest (h, v - h + 2) of the others and the values.
    """
    head, count = noise.shape
    wide = np.zeros((count + head, count + head + rest.shape[1]), order='F')
    wide[:count, :count] = _identity(count)
    wide[count:, :count], wide[count:, count : count + head], wide[count:, count + head :] = -noise, back, rest
    triangle = dgeqrf(wide, overwrite_a=True)[0][count:, count:]
    after = root.copy(order='F')
    after[:head, :head], after[:head, head:] = triangle[:, :head] * _upper(head), triangle[:, head:]
    return after


def _walked(root: Array, noise: Array, stop: int) -> Array:
    """Return the triangle after noise (e, w) has been added to the last e of the first `stop` variables."""
    size, count = len(root), noise.shape[1]
    wide = np.zeros((count + size, count + size + 2), order='F')
    wide[:count, :count] = _identity(count)
    wide[count:, :count] = -root[:, stop - len(noise) : stop] @ noise
    wide[count:, count:] = root
    triangle = np.array(dgeqrf(wide, overwrite_a=True)[0][count:, count:], order='F')
    triangle[:, :size] *= _upper(size)
    return triangle


def _forgotten(root: Array, variables: Variables, change: MomentumChange | None = None) -> Array:
    """Return the triangle with the Gauss-Markov processes drawn anew, but for those that have brought momentum."""
    if not variables.times.size:
        return root
    nothing = np.zeros(len(variables.wandering))
    kept, stepped = (nothing, np.zeros((0, len(nothing)))) if change is None else (change.kept, change.stepped)
    return _wandered(root, variables.wandering, kept, stepped, nothing)


def _wandered(root: Array, places: Integers, kept: Array, stepped: Array, gained: Array) -> Array:
    """Return the triangle after a step of Gauss-Markov processes of unit variance (trajectory.md, eq. 11).

    v' = kept v + noise, and the first variables go along: x' = x + stepped (v' - v). v is eliminated.

    Parameters
    ----------
    root, places : (v, v + 2), and the (f,) indices of the processes
    kept, stepped : (f,) autocorrelations, below 1; (p, f)
    gained : (f,) variance of the noise beside that which keeps the processes stationary
    """
    size, count = len(root), len(places)
    rows, certain = np.arange(count), 1.0 / np.sqrt(1.0 - kept**2 + gained)
    along = root[:, : len(stepped)] @ stepped
    wide = np.zeros((count + size, count + size + 2), order='F')
    wide[rows, rows], wide[rows, count + places] = -kept * certain, certain
    wide[count:, count:] = root
    wide[count:, :count] = root[:, places] + along
    wide[count:, count + places] = -along
    triangle = np.array(dgeqrf(wide, overwrite_a=True)[0][count:, count:], order='F')
    triangle[:, :size] *= _upper(size)
    return triangle


def _walk(hypothesis: Hypothesis, variables: Variables) -> Array:
    """Return the factor of a hypothesis' random walks of pose error and momentum, per square root of a second."""
    return np.asarray(variables.gather[: variables.head, hypothesis.walking] * hypothesis.intensities)


@cache
def _identity(size: int) -> Array:
    return np.eye(size)


@cache
def _upper(size: int) -> Array:
    """Return an upper triangle of ones: LAPACK leaves other numbers below that of a factor."""
    return np.triu(np.ones((size, size)))
