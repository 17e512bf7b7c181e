"""How passive joints swing at midpoints, and the derivatives of that by the parameters (appendages.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.passive import PassiveMotion
from mbaid_ros.core.unknowns.bodies import KnownBodies
from mbaid_ros.core.unknowns.flexible import SpringErrors, StartingSwing, SwingNoise


@dataclass(frozen=True, eq=False)
class PassiveColumns:
    """How the state x = (deflections, s) of f passive joints changes at N instants, linear in x and the parameters."""

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
    kernel, inertias = point.side.kernel, motion.inertias
    springs, count = kernel.springs, right.shape[-1] - 6
    along, force = np.zeros((2, len(right), springs.count, right.shape[-1]))
    for place, columns, at_zero in _carried_columns(layout, kernel, states):
        along[..., place] = -np.einsum('nia,niak->nik', inertias.axes, columns)
        by_inertia = springs.rate**2 * deflection + 2.0 * springs.ratio * springs.rate * motion.rates
        force[..., place] = np.einsum('nia,niak->nik', motion.turned, columns) - by_inertia[..., None] * at_zero
    begin = 16
    for unknown in layout.predicted:
        if isinstance(unknown, SpringErrors):
            force[..., begin : begin + unknown.count] = _by_springs(kernel, motion, deflection) @ unknown.factor
        begin += unknown.count
    twist, rates = motion.derivatives(right, along, force)
    by_parameters, by_state = rates[..., :count], rates[..., count + 6 :]
    slope = np.concatenate((motion.rates, motion.forces), axis=-1)
    return twist[..., : count + 6], PassiveColumns(slope, by_state, by_parameters, twist[..., count + 6 :])


def starting_columns(layout: Layout, point: Point) -> Array:
    """Return deflections and rates (2, f) of passive joints at a start, and their derivatives, (2, f, 1 + u)."""
    springs = point.side.kernel.springs
    columns = np.zeros((2, springs.count, 1 + len(point.parameters)))
    columns[..., 0], begin = springs.start, 17
    for unknown in layout.predicted:
        if isinstance(unknown, StartingSwing | SwingNoise):
            own = np.swapaxes(unknown.factor.reshape(springs.count, 2, -1), 0, 1)
            columns[..., begin : begin + unknown.count] = own
        begin += unknown.count
    return columns


def started(first: Array, by_state: Array, driven: Array) -> Array:
    """Return x (..., 2 f, c) where deflections and rates are given, `first` (2, f, c).

    The rates of x there are by_state x + driven, (..., 2 f, 2 f) and (..., 2 f, c).
    """
    size = by_state.shape[-1] // 2
    deflection, rate = first
    left = rate - driven[..., :size, :] - by_state[..., :size, :size] @ deflection
    along = np.linalg.solve(by_state[..., :size, size:], left)
    return np.concatenate((np.broadcast_to(deflection, along.shape), along), axis=-2)


def _carried_columns(
    layout: Layout, kernel: MomentumKernel, states: BodyStates
) -> Iterator[tuple[slice, Array, Array]]:
    """Yield, for the target and unknowns of bodies, their place, and the derivatives of the passive joints' loads.

    Those are (N, f, 6, k) of its momentum, and (f, k) of the inertia about each joint's axis at rest.
    """
    joints, ancestors = list(kernel.springs.joints), kernel.kinematics.ancestors
    columns: list[tuple[slice, Callable[[BodyStates], Array]]] = []
    if ancestors[kernel.target.body, joints].any():
        columns.append((slice(6, 16), lambda each: each.regressor))
    begin = 16
    for unknown in layout.predicted:
        if isinstance(unknown, KnownBodies):
            columns.append((slice(begin, begin + unknown.count), partial(_scaled_columns, unknown, kernel)))
        begin += unknown.count
    if not columns:
        return
    zero = np.zeros((1, kernel.model.joints))
    still = kernel.states_of(np.eye(3)[None], zero, zero, np.zeros((1, 6)))
    own = np.zeros((len(states.twist), 0, 6, 10))
    moving, resting = [], []
    for joint in joints:
        mask = ancestors[:, joint][:, None]
        moving.append(_with_twists(states, kernel, states.body_twist * mask, own))
        resting.append(_with_twists(still, kernel, still.configuration.joint_twist[:, joint, None] * mask, own[:1]))
    axes = still.configuration.joint_twist[0, joints]
    for place, of_states in columns:
        at_rest = np.einsum('ia,iak->ik', axes, np.stack([of_states(each)[0] for each in resting]))
        yield place, np.stack([of_states(each) for each in moving], axis=1), at_rest


def _scaled_columns(unknown: KnownBodies, kernel: MomentumKernel, states: BodyStates) -> Array:
    return unknown.momentum_columns(kernel, states) @ unknown.factor


def _with_twists(states: BodyStates, kernel: MomentumKernel, twists: Array, tide: Array) -> BodyStates:
    return replace(states, body_twist=twists, twist=twists[:, kernel.target.body], tide=tide)


def _by_springs(kernel: MomentumKernel, motion: PassiveMotion, deflection: Array) -> Array:
    """Return the derivatives (N, f, 2 f) of the springs' forces by relative frequency and damping ratio of each."""
    springs, (stiffness, damping) = kernel.springs, motion.constants
    by = np.zeros((*deflection.shape, springs.count, 2))
    each = np.arange(springs.count)
    by[:, each, each, 0] = -2.0 * stiffness * deflection - damping * motion.rates
    by[:, each, each, 1] = -2.0 * stiffness / springs.rate * motion.rates
    return by.reshape(*deflection.shape, -1)
