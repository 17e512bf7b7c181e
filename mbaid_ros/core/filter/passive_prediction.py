"""How passive joints swing at midpoints, and the derivatives of that by the parameters (appendages.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.filter.knots import Midpoints
from mbaid_ros.core.filter.state import Layout, Point, mobility_and_joint_momentum, total_momentum
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import momentum
from mbaid_ros.core.robot.orbit import OF_A_THRUSTER, about
from mbaid_ros.core.robot.passive import PassiveInertias, PassiveMotion, inertias_at_zero, spring_constants
from mbaid_ros.core.unknowns.bodies import KnownBodies
from mbaid_ros.core.unknowns.flexible import SpringErrors, StartingSwing, SwingNoise


@dataclass(frozen=True, eq=False)
class PassiveColumns:
    """How the state x = (deflections, s) of f passive joints changes at N instants, linear in x and the parameters."""

    # by_state, by_parameters: (N, 2 f, 2 f), (N, 2 f, u) derivatives of the rates of x
    by_state: Array
    by_parameters: Array
    twist_by_state: Array  # (N, 6, 2 f) derivative of the base's twist by x
    first: Array  # (N, 2 f, u) derivative of x by the parameters where it is the first


def deflections_of(point: Point, middle: Midpoints) -> Array:
    """Return the deflections (N, f) of the passive joints, against the zeros of their springs."""
    joints = list(point.side.kernel.springs.joints)
    return middle.joint_position[:, joints] - point.side.zeros[joints]


def passive_motion_of(
    point: Point, middle: Midpoints, known: Array, states: BodyStates, mobility: Array
) -> PassiveMotion:
    """Return how the passive joints of a robot swing that moves so; `known` (n + 1, 10) are all its bodies."""
    kernel = point.side.kernel
    joints = list(kernel.springs.joints)
    inertias = PassiveInertias.of(kernel, states.known, states.configuration, mobility)
    motion = (states.body_twist, deflections_of(point, middle), middle.joint_velocity[:, joints])
    return PassiveMotion.of(kernel, inertias, states.known, motion, spring_constants(kernel, known))


def passive_motion(
    layout: Layout, middle: Midpoints, point: Point, along: Array | None = None, rates: Array | None = None
) -> tuple[PassiveMotion, Array]:
    """Return how passive joints swing at midpoints, and their rates (N, f), of s or of the rates themselves, (N, f).

    The rates of these joints in `middle` count as zero.
    """
    kernel = point.side.kernel
    joints, known = list(kernel.springs.joints), kernel.with_target(point.parameters[6:16])
    speed = middle.joint_velocity.copy()
    speed[:, joints] = 0.0
    placed = kernel.kinematics.configure(middle.base_rotation, middle.joint_position)
    body_twist = kernel.kinematics.body_twists(placed, speed, np.zeros((len(middle), 6)))
    mobility, moving = mobility_and_joint_momentum(layout, point, middle, known, placed, body_twist)
    brought = about(middle.tide, middle.base_position), about(middle.thrust, middle.base_position, OF_A_THRUSTER)
    total = np.concatenate(total_momentum(middle, point, known, brought), axis=1) - moving
    expressed = express(known, placed.rotation, placed.position)
    inertias = PassiveInertias.of(kernel, expressed, placed, mobility)
    if rates is not None:
        held = total - (np.swapaxes(inertias.gamma, 1, 2) @ rates[..., None])[..., 0]
        twist: Array = (mobility @ held[..., None])[..., 0]
    else:
        carried = kernel.kinematics.ancestors.T[joints] @ momentum(expressed, body_twist)
        left = np.asarray(along) - np.sum(inertias.axes * carried, axis=-1)
        solved, found = inertias.solve(total[..., None], left[..., None])
        twist, rates = solved[..., 0], np.asarray(found[..., 0])
    speed[:, joints] = rates
    body_twist = kernel.kinematics.body_twists(placed, speed, twist)
    motion = (body_twist, deflections_of(point, middle), rates)
    return PassiveMotion.of(kernel, inertias, expressed, motion, spring_constants(kernel, known)), rates


def passive_columns(
    layout: Layout, point: Point, states: BodyStates, motion: PassiveMotion, right: Array, deflection: Array
) -> tuple[Array, PassiveColumns]:
    """Return the derivatives of the twist (N, 6, u + 6) at given swing, and those of the swing.

    `right` (N, 6, u + 6) is minus the change of the momentum at fixed twists; deflections (N, f).
    """
    kernel, inertias = point.side.kernel, motion.inertias
    size, count = kernel.springs.count, len(point.parameters)
    along, turning = np.zeros((len(right), size, right.shape[-1])), np.zeros((len(right), size, count))
    spring = np.zeros((len(right), size, count))
    for place, columns, at_zero in _carried_columns(layout, kernel, states):
        along[..., place] = -np.einsum('nia,niak->nik', inertias.axes, columns)
        turning[..., place] = np.einsum('nia,niak->nik', motion.turned, columns)
        force = kernel.springs.rate**2 * deflection + 2.0 * kernel.springs.ratio * kernel.springs.rate * motion.rates
        spring[..., place] = -force[..., None] * at_zero
    first = np.zeros((len(right), 2 * size, count))
    start, begin = np.zeros((2, size, count)), 16
    for unknown in layout.predicted:
        place = slice(begin, begin + unknown.count)
        begin = place.stop
        if isinstance(unknown, SpringErrors):
            spring[..., place] = _by_springs(kernel, point, deflection, motion.rates) @ unknown.factor
        elif isinstance(unknown, StartingSwing | SwingNoise):
            start[..., place] = np.swapaxes(unknown.factor.reshape(size, 2, -1), 0, 1)
    solved, rates = inertias.solve(right, along)
    by_rates = rates[..., :count]
    forces = motion.by_rate @ by_rates + motion.gyroscopic @ solved[..., :count] + turning + spring
    # At the first instant the rate is given: M dV = right - c d_deflection - Gamma d_rate.
    gamma, swept = inertias.gamma, motion.gyroscopic
    change = np.swapaxes(swept, 1, 2) @ start[0] + np.swapaxes(gamma, 1, 2) @ start[1]
    twist = inertias.mobility @ (right[..., :count] - change)
    held = np.linalg.inv(inertias.free) + gamma @ inertias.mobility @ np.swapaxes(gamma, 1, 2)
    first[:, :size] = start[0]
    first[:, size:] = gamma @ twist + held @ start[1] + motion.along_by @ start[0] - along[..., :count]
    passive = PassiveColumns(motion.by_state, np.concatenate((by_rates, forces), axis=1), motion.twist_by_state, first)
    return solved, passive


def _carried_columns(
    layout: Layout, kernel: MomentumKernel, states: BodyStates
) -> Iterator[tuple[slice, Array, Array]]:
    """Yield, for the target and unknowns of bodies, their place, and the derivatives of the passive joints' loads.

    Those are (N, f, 6, k) of its momentum, and (f, k) of the inertia about each joint's axis at rest.
    """
    joints, ancestors = list(kernel.springs.joints), kernel.kinematics.ancestors
    zero = np.zeros((1, kernel.model.joints))
    still = kernel.states_of(np.eye(3)[None], zero, zero, np.zeros((1, 6)))
    own = np.zeros((len(states.twist), 0, 6, 10))
    moving, resting = [], []
    for joint in joints:
        mask = ancestors[:, joint][:, None]
        moving.append(_with_twists(states, kernel, states.body_twist * mask, own))
        resting.append(_with_twists(still, kernel, still.configuration.joint_twist[:, joint, None] * mask, own[:1]))
    axes = still.configuration.joint_twist[0, joints]

    def both(columns: Callable[[BodyStates], Array]) -> tuple[Array, Array]:
        at_rest = np.stack([columns(each)[0] for each in resting])
        return np.stack([columns(each) for each in moving], axis=1), np.einsum('ia,iak->ik', axes, at_rest)

    if any(ancestors[kernel.target.body, joint] for joint in joints):
        yield slice(6, 16), *both(lambda each: each.regressor)
    begin = 16
    for unknown in layout.predicted:
        if isinstance(unknown, KnownBodies):

            def scaled(each: BodyStates, unknown: KnownBodies = unknown) -> Array:
                return unknown.momentum_columns(kernel, each) @ unknown.factor

            yield slice(begin, begin + unknown.count), *both(scaled)
        begin += unknown.count


def _with_twists(states: BodyStates, kernel: MomentumKernel, twists: Array, tide: Array) -> BodyStates:
    return replace(states, body_twist=twists, twist=twists[:, kernel.target.body], tide=tide)


def _by_springs(kernel: MomentumKernel, point: Point, deflection: Array, rates: Array) -> Array:
    """Return the derivatives (N, f, 2 f) of the springs' forces by relative frequency and damping ratio of each."""
    springs = kernel.springs
    stiffness, damping = spring_constants(kernel, kernel.with_target(point.parameters[6:16]))
    critical = 2.0 * inertias_at_zero(kernel, kernel.with_target(point.parameters[6:16]))
    by = np.zeros((*deflection.shape, springs.count, 2))
    each = np.arange(springs.count)
    by[:, each, each, 0] = -2.0 * stiffness * deflection - damping * rates
    by[:, each, each, 1] = -critical * springs.rate * rates
    return by.reshape(*deflection.shape, -1)
