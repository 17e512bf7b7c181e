"""Hypotheses of a force or drift, and the Gaussian's step from window to window under them (Bierman 1977, chapter 6).

From window to window pose error, momentum and walking unknowns change. The first two come first among the variables,
so that a step reworks few rows of the triangle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dgeqrf

from mbaid_ros.core.filter.integrated_twist import TwistLink
from mbaid_ros.core.filter.pushing import MomentumChange, momentum_change
from mbaid_ros.core.filter.square_root import SquareRootInformation, identity, upper_ones
from mbaid_ros.core.filter.state import MOMENTUM, POSE
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import Axes, WhitenedWindow
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array, Integers

# N s / sqrt(s) / kg of the known bodies: random walk of the momentum that stands for a force which is not constant.
_CHANGING_FORCE = 5e-5


@dataclass(frozen=True)
class Hypothesis:
    """A disturbance or drift: a constant force, and random walks with intensities a square root of a second."""

    name: str  # in words
    cause: str = ''  # the likely source, and the remedy
    momentum: float = 0.0  # N s and N m s: an external force
    position: float = 0.0  # m: the odometry's own drift
    # axes of a constant force and torque: of the base, on its origin, or inertial, at the common centre of mass
    force: Axes = 'none'
    physical: bool = True  # whether it has a mechanism; a random walk follows anything

    @property
    def disturbed(self) -> bool:
        """Whether anything acts or drifts at all."""
        return self.force != 'none' or len(self.walking) > 0

    @cached_property
    def walking(self) -> Integers:
        """Which of pose error and momentum (12) walk."""
        return np.flatnonzero(self._intensities)

    @cached_property
    def intensities(self) -> Array:
        """Of these."""
        return self._intensities[self.walking]

    @cached_property
    def _intensities(self) -> Array:
        return np.repeat((0.0, self.position, self.momentum), (3, 3, 6))


UNDISTURBED = Hypothesis('nothing drifts')


def _constant_force(axes: Axes, where: str, what: str) -> Hypothesis:
    name = f'a constant force or torque acts, in {where}'
    declared = 'body' if axes == 'body' else 'inertial'
    return Hypothesis(name, f'{name}: {what}; set disturbance.constant to {declared}', force=axes)


_INERTIAL_FORCES = (
    _constant_force('inertial', 'inertial axes, at the common centre of mass', 'a tilted table, or drag'),
    _constant_force('inertial on the base', 'inertial axes, on the base', 'a cable, or a leak'),
)
_BODY_FORCE = _constant_force('body', 'base axes', 'a leak or thrust, or unreported wheels spin up')


def hypotheses(known_mass: float, position_std: float, constant: Axes, *, adapt: bool) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of a run; the first is the one to beat.

    Parameters
    ----------
    known_mass : kg, of the known bodies
    position_std : m, of one reading of the base's position
    constant : axes of a force that is taken to act, wherever; there are no other hypotheses then
    adapt : whether others than the first are followed
    """
    if constant != 'none':
        return (_BODY_FORCE,) if constant == 'body' else _INERTIAL_FORCES
    if not adapt:
        return (UNDISTURBED,)
    return (
        UNDISTURBED,
        *_INERTIAL_FORCES,
        _BODY_FORCE,
        Hypothesis(
            'the momentum drifts',
            'an unreported part moves (wheels, an arm, fuel), or a changing force acts: the momentum drifts',
            momentum=_CHANGING_FORCE * known_mass,
            physical=False,
        ),
        Hypothesis(
            'the odometry position drifts',
            'the odometry position drifts: check the sensor, or set noise.base_correlation_time',
            position=position_std,
            physical=False,
        ),
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
        walk = variables.gather[:head, hypothesis.walking] * hypothesis.intensities
        noise = np.concatenate((noise, np.sqrt(window.length) * (back @ walk)), axis=1)
    return back, noise, rest


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
    wide[:walks, :walks] = identity(walks)
    known = wide[walks:]
    known[:, :walks], known[:, walks + 2 * count : -rest.shape[1]], known[:, -rest.shape[1] :] = -noise, back, rest
    known[: len(rows), walks : walks + count] = rows[:, count : 2 * count] - gain
    known[: len(rows), walks + count : walks + 2 * count] = gain
    gone, ahead = walks + count, count + head
    triangle = dgeqrf(wide, overwrite_a=True)[0][gone:, gone:]
    whole: Array = np.zeros((count + len(root), count + len(root) + 2), order='F')
    whole[:ahead, :ahead], whole[:ahead, ahead:] = triangle[:, :ahead] * upper_ones(ahead), triangle[:, ahead:]
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
    wide[:count, :count] = identity(count)
    wide[count:, :count], wide[count:, count : count + head], wide[count:, count + head :] = -noise, back, rest
    triangle = dgeqrf(wide, overwrite_a=True)[0][count:, count:]
    after = root.copy(order='F')
    after[:head, :head], after[:head, head:] = triangle[:, :head] * upper_ones(head), triangle[:, head:]
    return after


def _walked(root: Array, noise: Array, stop: int) -> Array:
    """Return the triangle after noise (e, w) has been added to the last e of the first `stop` variables."""
    size, count = len(root), noise.shape[1]
    wide = np.zeros((count + size, count + size + 2), order='F')
    wide[:count, :count] = identity(count)
    wide[count:, :count] = -root[:, stop - len(noise) : stop] @ noise
    wide[count:, count:] = root
    triangle = np.array(dgeqrf(wide, overwrite_a=True)[0][count:, count:], order='F')
    triangle[:, :size] *= upper_ones(size)
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
    triangle[:, :size] *= upper_ones(size)
    return triangle
