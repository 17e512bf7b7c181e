"""How passive joints swing at midpoints, and the derivatives of that by the parameters (appendages.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import regressor
from mbaid_ros.core.robot.passive import PassiveInertias, PassiveMotion, cantilever
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.unknowns.bodies import KnownBodies
from mbaid_ros.core.unknowns.flexible import SpringErrors, StartingSwing, SwingNoise


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
    kernel, inertias = point.side.kernel, motion.inertias
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
    springs = point.side.kernel.springs
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
