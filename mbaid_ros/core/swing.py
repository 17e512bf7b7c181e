"""How passive joints swing along windows, and their part of the joint noise."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from mbaid_ros.core.contracts import Stack
from mbaid_ros.core.geometry import Array, composed
from mbaid_ros.core.links import KnownBodies
from mbaid_ros.core.passive import SpringErrors, StartingSwing, SwingNoise
from mbaid_ros.core.robot.model import Configuration, Kinematics, express
from mbaid_ros.core.robot.momentum import (
    BodyStates,
    MomentumKernel,
    force_cross,
    inertia_matrix,
    momentum,
    motion_cross,
    regressor,
    sensitivity_to_joints,
)
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.state import BODY, LINEAR, Layout, Point, UnknownsPrior
from mbaid_ros.core.windows import ANGULAR_FIRST, Bodies, Midpoints, Prediction, Swing, Window

BESIDE = 2  # intervals on either side of a window that its steps are interpolated from
_SWEEPS = 8  # of Newton's iteration along the windows, at most: each squares the error
# rad or m, change of deflection, and of its rate over the natural one, by the last sweep: the prediction follows it to
# first order, and the rest is below 1e-7.
_CONVERGED = 1e-3
_LARGEST = 30.0  # rad or m, of such a change: no appendage swings as far
_POINTS, _WINDOWS = 8, 1_000  # linearisation points, and windows, that are remembered
Motions = Sequence[tuple[Midpoints, slice]]
Predict = Callable[[Layout, Midpoints, Point, Array], tuple[Prediction, Bodies]]


@lru_cache(maxsize=32)  # of the robots at the latest linearisation points
def cantilever(kinematics: Kinematics) -> Array:
    """Return derivatives (n, n + 1, 10) of the inertia that each joint carries at zero, by the bodies' parameters."""
    placed = kinematics.configure(np.eye(3)[None], np.zeros((1, kinematics.model.joints)))
    axes = placed.joint_twist[0]
    columns = regressor(placed.rotation, placed.position, axes[:, None])  # (n, n + 1, 6, 10)
    return np.asarray(kinematics.ancestors.T[..., None] * np.einsum('ia,ibak->ibk', axes, columns))


def spring_constants(kernel: MomentumKernel, known: Array) -> tuple[Array, Array]:
    """Return stiffness and damping (f,) of the passive joints, all bodies (n + 1, 10) known; SI units."""
    springs = kernel.springs
    inertia = np.sum(cantilever(kernel.kinematics)[list(springs.joints)] * known, axis=(1, 2))
    return inertia * springs.frequency**2, 2.0 * springs.damping_ratio * inertia * springs.frequency


def moves(kernel: MomentumKernel) -> Array:
    """Return whether each passive joint moves each other one, or is it, (f, f)."""
    joints = list(kernel.springs.joints)
    return np.asarray(kernel.kinematics.ancestors[np.array(joints) + 1][:, joints].T > 0.0)


@dataclass(frozen=True)
class PassiveInertias(ArrayRecord):
    """The f passive joints of a robot in N configurations, about the base's origin, odometry axes."""

    # axes, gamma: (N, f, 6) unit twists X; momentum of unit rates, Gamma
    axes: Array
    gamma: Array
    inertia: Array  # (N, f, 6, 6) of all that each carries
    inverse_inertia: Array  # (N, 6, 6) M^-1, the passive joints held
    mobility_of_joints: Array  # (N, f, f) inverse of H - Gamma^T M^-1 Gamma

    @staticmethod
    def from_bodies(
        kernel: MomentumKernel, known: Array, placed: Configuration, inverse_inertia: Array
    ) -> PassiveInertias:
        """Return the inertias by all bodies `known` (N, n + 1, 10) at the base's origin, odometry axes."""
        joints, up = list(kernel.springs.joints), moves(kernel)
        axes = placed.joint_twist[:, joints]
        inertia = inertia_matrix(kernel.kinematics.ancestors.T[joints] @ known)
        gamma = (inertia @ axes[..., None])[..., 0]
        across = axes @ np.swapaxes(gamma, 1, 2)  # X_i . Gamma_j
        locked = np.where(up, across, np.where(up.T, np.swapaxes(across, 1, 2), 0.0))
        free = np.linalg.inv(locked - gamma @ inverse_inertia @ np.swapaxes(gamma, 1, 2))
        return PassiveInertias(axes, gamma, inertia, inverse_inertia, free)

    def solve(self, total: Array, along: Array) -> tuple[Array, Array]:
        """Return base twists (N, 6, c) and rates (N, f, c) with momenta (N, 6, c) and (N, f, c) along the joints."""
        moved = self.inverse_inertia @ total
        rates = self.mobility_of_joints @ (along - self.gamma @ moved)
        return moved - self.inverse_inertia @ (np.swapaxes(self.gamma, 1, 2) @ rates), rates

    @property
    def free_mobility(self) -> Array:
        """(M - Gamma H^-1 Gamma^T)^-1, (N, 6, 6): from momentum to twist, the momenta along the joints held."""
        across = self.gamma @ self.inverse_inertia
        return np.asarray(self.inverse_inertia + np.swapaxes(across, 1, 2) @ self.mobility_of_joints @ across)


@dataclass(frozen=True, eq=False)
class PassiveMotion:
    """How the state x = (deflections, s) of f passive joints changes at N instants."""

    inertias: PassiveInertias
    constants: tuple[Array, Array]  # stiffness and damping, (f,)
    twist: Array  # (N, 6) of the base
    body_twist: Array  # (N, n + 1, 6) of all bodies
    rates: Array  # (N, f) of the deflections
    forces: Array  # (N, f) rate of s
    gyroscopic: Array  # (N, f, 6) derivative of the rate of s by the base's twist
    force_by_rate: Array  # (N, f, f) derivative of the rate of s by the deflections' rates
    axis_rates: Array  # (N, f, 6) rate of change of the axes, V_p x X
    # along_by, force_by: (N, f, f) derivative of s, and of its rate, by the deflections at fixed twists
    momentum_by_deflection: Array
    force_by_deflection: Array

    @staticmethod
    def from_state(
        kernel: MomentumKernel,
        inertias: PassiveInertias,
        known: Array,
        moving: tuple[Array, Array],
        state: tuple[Array, Array],
        constants: tuple[Array, Array],
    ) -> PassiveMotion:
        """Return the motion of a robot with bodies (N, n + 1, 10) at the base's origin, odometry axes.

        Parameters
        ----------
        kernel, inertias, known : of the robot, its passive joints, its bodies
        moving : twists of the bodies (N, n + 1, 6) by the other joints alone, and the momentum (N, 6) that they leave
        state : deflections and s, (N, f)
        constants : stiffness and damping, (f,)
        """
        body_twist, total = moving
        deflection, along = state
        joints, up = list(kernel.springs.joints), moves(kernel)
        subtrees = kernel.kinematics.ancestors.T[joints]
        strictly = up & ~np.eye(len(joints), dtype=bool)
        axes, gamma, inertia = inertias.axes, inertias.gamma, inertias.inertia
        carried = np.sum(axes * (subtrees @ momentum(known, body_twist)), axis=-1)
        twist, rates = (part[..., 0] for part in inertias.solve(total[..., None], (along - carried)[..., None]))
        body_twist = body_twist + twist[:, None] + subtrees.T @ (axes * rates[..., None])
        h = subtrees @ momentum(known, body_twist)
        turned = motion_cross(body_twist[:, [kernel.model.parents[joint] for joint in joints]], axes)  # W = V_p x X
        swept = force_cross(axes, h) + (inertia @ turned[..., None])[..., 0]  # c = X x* h + I W
        stiffness, damping = constants
        # s and the gyroscopic part W . h of its rate, by deflections at fixed twists.
        along_by = np.where(
            up.T, gamma @ np.swapaxes(turned, 1, 2), np.where(strictly, axes @ np.swapaxes(swept, 1, 2), 0.0)
        )
        across = swept @ np.swapaxes(turned, 1, 2)  # c_i . W_j
        force_by = np.where(up.T, across, np.where(strictly, np.swapaxes(across, 1, 2), 0.0)) - np.diag(stiffness)
        by_rate = np.where(strictly.T, swept @ np.swapaxes(axes, 1, 2), 0.0)
        by_rate += np.where(up, turned @ np.swapaxes(gamma, 1, 2), 0.0) - np.diag(damping)
        forces = np.sum(turned * h, axis=-1) - stiffness * deflection - damping * rates
        parts = (inertias, constants, twist, body_twist, rates, forces, swept, by_rate, turned, along_by, force_by)
        return PassiveMotion(*parts)

    def derivatives(self, total: Array, along: Array, force: Array) -> tuple[Array, Array]:
        """Return derivatives of the base's twist (N, 6, c + 2 f), and of the rates of x, by c numbers and by x.

        Parameters
        ----------
        total, along, force : (N, 6, c), (N, f, c), (N, f, c) what each number adds to the momentum, to s and to the
            rate of s at fixed twists and x
        """
        swept, nothing = np.swapaxes(self.gyroscopic, 1, 2), np.zeros_like(self.force_by_rate)
        total = np.concatenate((total, -swept, np.zeros_like(swept)), axis=-1)
        along = np.concatenate((along, -self.momentum_by_deflection, nothing + np.eye(nothing.shape[-1])), axis=-1)
        force = np.concatenate((force, self.force_by_deflection, nothing), axis=-1)
        twist, rates = self.inertias.solve(total, along)
        return twist, np.concatenate((rates, self.force_by_rate @ rates + self.gyroscopic @ twist + force), axis=1)


def passive_momenta(kernel: MomentumKernel, axes: Array, gamma: Array) -> Array:
    """Return the momenta (N, f, n) along the passive joints of unit rates of all joints, the base at rest.

    `axes` (N, n, 6) are the unit twists of all joints, `gamma` (N, 6, n) the momenta of their unit rates.
    """
    up = kernel.kinematics.ancestors[1:].T > 0.0  # whether a joint moves another one, or is it
    across = axes @ gamma
    locked = np.where(up, across, np.where(up.T, np.swapaxes(across, 1, 2), 0.0))
    return np.asarray(locked[:, list(kernel.springs.joints)])


@dataclass(frozen=True, eq=False)
class PassiveColumns(ArrayRecord):
    """How the state x = (deflections, s) of f passive joints changes at N instants, linear in x and the parameters."""

    inertias: PassiveInertias
    slope: Array  # (N, 2 f) rates of x
    # by_state, by_parameters: (N, 2 f, 2 f), (N, 2 f, u) derivatives of these
    by_state: Array
    by_parameters: Array
    twist_by_state: Array  # (N, 6, 2 f) derivative of the base's twist by x


def passive_columns(
    layout: Layout, point: Point, states: BodyStates, motion: PassiveMotion, right: Array, deflection: Array
) -> tuple[Array, PassiveColumns]:
    """Return the derivatives of the twist (N, 6, u + 6) at given swing, and those of the swing.

    `right` (N, 6, u + 6) is minus the change of the momentum at fixed twists; deflections (N, f).
    """
    kernel, inertias = point.nominal.kernel, motion.inertias
    springs, count = kernel.springs, right.shape[-1] - 6
    along, force = np.zeros((2, len(right), springs.count, right.shape[-1]))
    joints, kinematics, placed = list(springs.joints), kernel.kinematics, states.configuration
    by_inertia = springs.frequency**2 * deflection + 2.0 * springs.damping_ratio * springs.frequency * motion.rates
    for place, bodies, factor in _carried(layout, kernel):
        columns = regressor(placed.rotation[:, bodies], placed.position[:, bodies], states.body_twist[:, bodies])
        carried = kinematics.ancestors[bodies][:, joints].T[..., None]  # (f, b, 1): whether each joint moves it
        loads, turned = (
            (np.einsum('nia,nbak->nibk', vectors, columns) * carried).reshape(len(right), len(joints), -1) @ factor
            for vectors in (inertias.axes, motion.axis_rates)
        )
        at_zero = cantilever(kinematics)[joints][:, bodies].reshape(len(joints), -1) @ factor
        along[..., place], force[..., place] = -loads, turned - by_inertia[..., None] * at_zero
    begin = 16
    for unknown in layout.predicted:
        if isinstance(unknown, SpringErrors):
            force[..., begin : begin + unknown.count] = _by_springs(kernel, motion, deflection) @ unknown.factor
        begin += unknown.count
    twist, rates = motion.derivatives(right, along, force)
    by_parameters, by_state = rates[..., :count], rates[..., count + 6 :]
    slope = np.concatenate((motion.rates, motion.forces), axis=-1)
    return twist[..., : count + 6], PassiveColumns(inertias, slope, by_state, by_parameters, twist[..., count + 6 :])


def starting_columns(layout: Layout, point: Point) -> Array:
    """Return deflections and rates (2, f) of passive joints at a start, and their derivatives, (2, f, 1 + u)."""
    springs = point.nominal.kernel.springs
    columns = np.zeros((2, springs.count, 1 + len(point.parameters)))
    columns[..., 0], begin = springs.initial_state, 17
    for unknown in layout.predicted:
        if isinstance(unknown, StartingSwing | SwingNoise):
            own = np.swapaxes(unknown.factor.reshape(springs.count, 2, -1), 0, 1)
            columns[..., begin : begin + unknown.count] = own
        begin += unknown.count
    return columns


def starting_states(first: Array, by_state: Array, driven: Array) -> Array:
    """Return x (..., 2 f, c) where deflections and rates are given, `first` (2, f, c).

    The rates of x there are by_state x + driven, (..., 2 f, 2 f) and (..., 2 f, c).
    """
    size = by_state.shape[-1] // 2
    deflection, rate = first
    left = rate - driven[..., :size, :] - by_state[..., :size, :size] @ deflection
    along = np.linalg.solve(by_state[..., :size, size:], left)
    return np.concatenate((np.broadcast_to(deflection, along.shape), along), axis=-2)


def _carried(layout: Layout, kernel: MomentumKernel) -> Iterator[tuple[slice, list[int], Array]]:
    """Yield the place of the target and of unknowns of bodies, b bodies, and a factor (10 b, k) of their parameters."""
    target, begin = kernel.target, 16
    if kernel.kinematics.ancestors[target.body, list(kernel.springs.joints)].any():
        yield slice(6, 16), [target.body], express(np.eye(10), target.rotation, target.position).T
    for unknown in layout.predicted:
        if isinstance(unknown, KnownBodies):
            yield slice(begin, begin + unknown.count), list(unknown.bodies), unknown.factor
        begin += unknown.count


def _by_springs(kernel: MomentumKernel, motion: PassiveMotion, deflection: Array) -> Array:
    """Return the derivatives (N, f, 2 f) of the springs' forces by relative frequency and damping ratio of each."""
    springs, (stiffness, damping) = kernel.springs, motion.constants
    by = np.zeros((*deflection.shape, springs.count, 2))
    each = np.arange(springs.count)
    by[:, each, each, 0] = -2.0 * stiffness * deflection - damping * motion.rates
    by[:, each, each, 1] = -2.0 * stiffness / springs.frequency * motion.rates
    return by.reshape(*deflection.shape, -1)


def of_swing(
    layout: Layout, kernel: MomentumKernel, bodies: Bodies, swing: Array, noise: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Return (B, 6, f) motions of the base with each Gauss-Markov process, and (B, f) variances by the joints' noise.

    Third, how that moves the base by the end of the window, (B, 6, f).

    An error of a joint's reading is one of a passive joint's predicted deflection, and its spring pulls accordingly:
    white noise that drives the swing. Each of its two amplitudes takes half.
    """
    deviation, length = noise
    states, springs = bodies.states, kernel.springs
    assert bodies.passive is not None, 'there are passive joints'
    inertias, gamma = bodies.passive.inertias, sensitivity_to_joints(kernel, states)[1]
    # Deflections by constant errors of the joints, and their accelerations, (B, f, n); the base's twist by their rates.
    _, errors = inertias.solve(-gamma, -passive_momenta(kernel, states.configuration.joint_twist, gamma))
    by_joints = inertias.mobility_of_joints @ (spring_constants(kernel, bodies.parameters)[0][:, None] * errors)
    turned = -inertias.inverse_inertia @ np.swapaxes(inertias.gamma, 1, 2)
    processes = np.flatnonzero(np.isfinite(layout.time_constants))
    own = processes < swing.shape[-1] - (BODY.stop - LINEAR.start)
    columns = processes[own] + BODY.stop - LINEAR.start
    steps, variance = np.zeros((len(swing), 6, len(processes))), np.zeros((len(swing), len(processes)))
    growth = np.exp(length / layout.time_constants[processes[own]])
    steps[..., own] = turned[:, ANGULAR_FIRST] @ swing[..., columns] * growth
    rates = np.sqrt(np.sum((length * by_joints * deviation) ** 2, axis=-1))  # (B, f) that a window adds
    begin = 0
    for unknown in layout.unknowns:
        count = int(np.sum(np.isfinite(unknown.time_constants)))
        if unknown.noise_driven:
            variance[:, begin : begin + count] = unknown.process_variances(rates)
        begin += count
    ends = np.minimum(1.0 / (np.sqrt(2.0) * springs.frequency), length[:, 0] / np.sqrt(3.0)) * rates
    return steps, variance, turned[:, ANGULAR_FIRST] * ends[:, None]


def transition_steps(mean: Array, by_state: Array, driven: Array, spacing: float) -> tuple[Array, Array]:
    """Return, from each instant to the next, (2 f, 2 f) and (2 f, c) of x' = onward x + gain.

    Exponential Runge-Kutta method of order 4 (Cox and Matthews 2002): the mean (2 f, 2 f) of the derivatives exactly,
    and slow forces by polynomials. A joint that is pushed slowly stays in equilibrium however stiff its spring.
    """
    rest, size = by_state - mean, len(mean)
    halfway = _exponential(0.5 * spacing, mean)
    half, within, _, _ = np.split(halfway[:size], 4, axis=1)
    whole, once, twice, thrice = np.split((halfway @ halfway)[:size], 4, axis=1)
    twice, thrice = twice / spacing, thrice / spacing**2
    identity: Array = np.zeros((size, 4 * size))  # by x, and by its rates at x = 0 here, midway and at the next instant
    identity[:, :size] = np.eye(size)

    def rate(jacobian: Array, at: Array, instant: int) -> Array:
        slope = jacobian @ at
        slope[..., instant * size : (instant + 1) * size] += np.eye(size)
        return np.asarray(slope)

    between = _midway(rest)
    first = rate(rest[:-1], identity, 1)
    early = half @ identity + within @ first
    second = rate(between, early, 2)
    third = rate(between, half @ identity + within @ second, 2)
    last = rate(rest[1:], half @ early + within @ (2.0 * third - first), 3)
    forces = (once - 3.0 * twice + 4.0 * thrice) @ first + (2.0 * twice - 4.0 * thrice) @ (second + third)
    after = whole @ identity + forces + (4.0 * thrice - twice) @ last
    onward, here, midway, there = np.split(after, 4, axis=-1)
    return onward, here @ driven[:-1] + midway @ _midway(driven) + there @ driven[1:]


def _midway(values: Array) -> Array:
    """Return the values between neighbours along the first axis, cubic; at the ends quadratic."""
    middle = np.empty((len(values) - 1, *values.shape[1:]))
    middle[1:-1] = (9.0 * (values[1:-2] + values[2:-1]) - values[:-3] - values[3:]) / 16.0
    middle[0] = (3.0 * values[0] + 6.0 * values[1] - values[2]) / 8.0
    middle[-1] = (3.0 * values[-1] + 6.0 * values[-2] - values[-3]) / 8.0
    return middle


def _exponential(time: float, matrix: Array) -> Array:
    """Return a matrix (4 n, 4 n) whose first rows are exp(t A), t phi_1(t A), t^2 phi_2(t A), t^3 phi_3(t A), A (n, n).

    phi_k (z) = (phi_(k-1) (z) - 1 / (k - 1)!) / z, and phi_0 the exponential.
    """
    size = len(matrix)
    blocks: Array = np.eye(4 * size, k=size)
    blocks[:size, :size] = matrix
    return np.asarray(expm(time * blocks))


@dataclass(frozen=True)
class _Part:
    """A stack of B windows with m intervals each, among the instants of all stacks."""

    stack: Stack
    inside: slice  # the own intervals
    instants: slice
    intervals: int  # m
    ends: tuple[int, ...]  # of each window: the number of the interval after it

    @property
    def begin(self) -> int:
        """The interval before the own ones, or the first where there is none before."""
        return max(self.inside.start - 1, 0)

    def divided(self, flat: Array) -> Array:
        """Return the part (m, B, ...) of all instants."""
        own = flat[self.instants]
        return own.reshape(self.intervals, -1, *own.shape[1:])


class SwingTrajectory:
    """The swing of the passive joints along the windows of one run.

    Parameters
    ----------
    layout : of the state
    predict : predicts the twist of the base at midpoints, and the swing there, as `twist_prediction.predict`
    """

    def __init__(self, layout: Layout, predict: Predict) -> None:
        self._layout = layout
        self._predict = predict
        self._bare = replace(layout, unknowns=(), known=UnknownsPrior.standard_normal(0))
        # Time constants of the parameters that are Gauss-Markov processes, s; inf of x itself and of all others.
        times = np.concatenate([np.full(17, np.inf), *(each.time_constants for each in layout.predicted)])
        self._decay = 1.0 / times
        # By point, and the interval after a window: x and its derivative by the parameters, (2, 2 f, 1 + u), in the
        # last two intervals of the window.
        self._ends: OrderedDict[Point, OrderedDict[int, Array]] = OrderedDict()
        # By the interval after a window: these in all of it, (m, 2 f, 1 + u), where it was linearised last.
        self._guesses: OrderedDict[int, tuple[Array, Point]] = OrderedDict()
        # By the interval after a window: the least and the highest deflections, (2, f), and whether it was closed.
        self._deflections: OrderedDict[int, tuple[Array, bool]] = OrderedDict()
        self._largest: Array | None = None  # (f,) deflections in the closed ones of these; None where they have changed
        self._forgotten: Array = np.zeros(())  # (f,) largest in closed windows that are not among these any more

    @np.errstate(over='ignore', invalid='ignore')  # a swing without bounds is noticed
    def predict(
        self, stacks: Sequence[Stack], motions: Motions, point: Point
    ) -> tuple[Motions, Prediction, Bodies, Array]:
        """Return motions, (m, B, ...) each, with the swing of the passive joints, and the twist predicted then.

        Last, the derivatives of the deflections at the ends of all windows, (B, f, u), stack by stack.
        """
        springs, parts = point.nominal.kernel.springs, _parts(stacks, motions)
        joints, size = list(springs.joints), springs.count
        flat = Midpoints.concatenate([motion.flat for motion, _ in motions])
        position, velocity = flat.joint_position.copy(), flat.joint_velocity.copy()
        zeros, velocity[:, joints] = position[:, joints], 0.0
        x = np.concatenate([self._guessed(part, point) for part in parts])
        new = not all(end in self._guesses for part in parts for end in part.ends)
        for sweep in range(_SWEEPS):
            # The first sweep of new windows never converges: it needs no derivatives by the unknowns.
            layout = self._bare if new and sweep == 0 else self._layout
            position[:, joints] = zeros + x[:, :size]
            placed = replace(flat, joint_position=position, joint_velocity=velocity)
            prediction, bodies = self._predict(layout, placed, point, x[:, size:])
            assert bodies.passive is not None, 'there are passive joints'
            passive: Swing = bodies.passive
            columns = self._followed(parts, passive, x, point)
            step, x = columns[..., 0] - x, columns[..., 0]
            faster = (passive.by_state @ step[..., None])[:, :size, 0]
            if _largest(step[:, :size], faster / springs.frequency) < _CONVERGED and layout is self._layout:
                break
        prediction.twist[...] += (passive.twist_by_state @ step[..., None])[..., 0]
        prediction.by_parameters[...] += passive.twist_by_state @ columns[..., 1:]
        position[:, joints], velocity[:, joints] = zeros + x[:, :size], passive.slope[:, :size] + faster
        moved: list[tuple[Midpoints, slice]] = []
        for part, (motion, inside) in zip(parts, motions, strict=True):
            self._remember(part, part.divided(columns), point)
            places, rates = part.divided(position), part.divided(velocity)
            moved.append((replace(motion, joint_position=places, joint_velocity=rates), inside))
        ends = [_at_the_end(part.divided(columns)[..., :size, 1:], part.inside) for part in parts]
        return moved, prediction, bodies, np.concatenate(ends)

    def deflections(self, window: Window) -> Array:
        """Return the largest deflections in all windows, and the least and the highest in one, (3, f) rad or m.

        A window that is still open is linearised once, maybe far from the solution: only its latest state counts.
        """
        own, _ = self._deflections[_end(window)]
        if self._largest is None:
            closed = [each for each, whole in self._deflections.values() if whole]
            self._largest = np.abs([np.zeros_like(own) + self._forgotten, *closed]).max(axis=(0, 1))
        return np.vstack((np.maximum(self._largest, np.abs(own).max(axis=0)), own))

    def _guessed(self, part: _Part, point: Point) -> Array:
        """Return the states (m B, 2 f) near those of the point before, or else zero."""
        states = np.zeros((part.intervals, len(part.ends), 2 * self._layout.kernel.springs.count))
        for window, end in enumerate(part.ends):
            columns, before = self._guesses.get(end, (states[:0], point))
            if len(columns) == part.intervals:
                states[:, window] = _columns_at(columns, before, point)[..., 0]
        return states.reshape(-1, states.shape[-1])

    def _followed(self, parts: Sequence[_Part], passive: Swing, x: Array, point: Point) -> Array:
        """Return x and its derivatives at all instants, (N, 2 f, 1 + u), along windows in order.

        `passive` are their rates, linear about x (N, 2 f) and in the first u parameters.
        """
        by_state = passive.by_state
        rest = passive.slope[..., None] - by_state @ x[..., None]
        driven = np.concatenate((rest, passive.by_parameters), axis=-1)
        mean, size, columns = np.mean(by_state, axis=0), by_state.shape[-1], driven.shape[-1]
        results, first = np.zeros_like(driven), starting_columns(self._layout, point)[..., :columns]
        steps = []  # by part, linear in x one interval before the own ones
        for part in parts:
            onward = transition_steps(mean, part.divided(by_state), part.divided(driven), part.stack.windows[0].spacing)
            steps.append(composed(*(step[part.begin :] for step in onward)))
        ends: dict[int, Array] = {}
        places = [
            (place, number, index) for number, part in enumerate(parts) for index, place in enumerate(part.stack.places)
        ]
        for _, number, index in sorted(places):
            part = parts[number]
            begin, stop = part.begin, part.inside.stop
            window, step, result = part.stack.windows[index], steps[number][:, index], part.divided(results)[:, index]
            before = None if window.after_gap else self._before(window, ends, point)
            if before is None:
                instant = part.instants.start + begin * len(part.ends) + index
                start = result[:begin] = starting_states(first, by_state[instant], driven[instant])
            else:
                start, result[:begin] = before[1, :, :columns], before[:begin, :, :columns]
            result[begin:] = step[..., :size] @ start + step[..., size:]
            ends[part.ends[index]] = result[stop - 2 : stop]
        return results

    def _before(self, window: Window, ends: dict[int, Array], point: Point) -> Array | None:
        """Return x and its derivatives (2, 2 f, 1 + u) before a window, of these, of this point or another one near."""
        number = round(window.start / window.spacing)
        found = ends.get(number)
        if found is None:
            others = [other for other, each in self._ends.items() if number in each]
            if not others:
                return None
            near = point if point in others else min(others, key=lambda other: _distance(other, point))
            found = _columns_at(self._ends[near][number], near, point)
        # A window's amplitudes of decaying terms are those at its own begin.
        return np.asarray(found * np.exp(self._decay[: found.shape[-1]] * window.length))

    def _remember(self, part: _Part, columns: Array, point: Point) -> None:
        """Remember windows, (m, B, 2 f, 1 + u)."""
        ends = self._ends.setdefault(point, OrderedDict())
        self._ends.move_to_end(point)
        deflections = columns[part.inside, :, : self._layout.kernel.springs.count, 0]
        extremes = np.stack((deflections.min(axis=0), deflections.max(axis=0)), axis=1)
        closed, self._largest = part.inside.stop < part.intervals, None  # closed: there are knots after it
        self._deflections.update((end, (each, closed)) for end, each in zip(part.ends, extremes, strict=True))
        for window, end in enumerate(part.ends):
            own = columns[:, window].copy()
            ends[end], self._guesses[end] = own[part.inside.stop - 2 : part.inside.stop], (own, point)
        for kept, most in (
            (ends, _WINDOWS),
            (self._guesses, _WINDOWS),
            (self._ends, _POINTS),
        ):
            while len(kept) > most:
                kept.popitem(last=False)
        while len(self._deflections) > 2 * _WINDOWS:  # open and closed
            _, (each, whole) = self._deflections.popitem(last=False)
            self._forgotten = np.maximum(self._forgotten, np.abs(each).max(axis=0) if whole else 0.0)


def _largest(step: Array, rates: Array) -> float:
    """Return the largest change of a deflection, or of a rate over the natural one, rad or m."""
    largest = float(np.max(np.abs((step, rates))))
    if not largest < _LARGEST:  # nor where it is NaN
        raise np.linalg.LinAlgError('the passive joints swing without bounds')
    return largest


def _parts(stacks: Sequence[Stack], motions: Motions) -> list[_Part]:
    """Return the stacks, (m, B, ...) each, among all instants."""
    shapes = [motion.turn.shape[:2] for motion, _ in motions]
    bounds = np.cumsum([0, *(rows * windows for rows, windows in shapes)]).tolist()
    return [
        _Part(
            *(stack, inside, slice(*own), shape[0]),
            tuple(map(_end, stack.windows)),
        )
        for stack, (_, inside), shape, own in zip(stacks, motions, shapes, pairwise(bounds), strict=True)
    ]


def _end(window: Window) -> int:
    """Return the number of the interval after a window."""
    return round((window.start + window.length) / window.spacing)


def _columns_at(columns: Array, before: Point, point: Point) -> Array:
    """Return x and its derivatives (..., 2 f, 1 + u) of one point at another."""
    moved = columns.copy()
    moved[..., 0] += columns[..., 1:] @ (point.parameters - before.parameters)
    return moved


def _distance(one: Point, other: Point) -> float:
    """Return how far two points are apart, squared, in units of their priors; the mass in units of itself."""
    step = one.parameters - other.parameters
    return float(np.sum(step[16:] ** 2) + (step[6] / (abs(one.parameters[6]) + 1e-9)) ** 2)


def _at_the_end(values: Array, inside: slice) -> Array:
    """Return (B, ...) at the end of the own part of (m, B, ...) midpoints."""
    last = values[inside.stop - 1]
    step = values[inside.stop] - last if inside.stop < len(values) else last - values[inside.stop - 2]
    return np.asarray(last + 0.5 * step)
