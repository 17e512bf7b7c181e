"""The base twist by conserved momentum, V = M^-1 (h_b - b), and its derivatives (trajectory.md, eq. 1)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mbaid_ros.core.filter.knots import Midpoints, gradient
from mbaid_ros.core.filter.state import ANGULAR_FIRST, Layout, Point
from mbaid_ros.core.geometry import Array, Integers, cross, skew
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel, cantilever_inertias
from mbaid_ros.core.robot.kinematics import Configuration
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import momentum
from mbaid_ros.core.robot.orbit import OF_A_THRUSTER, about, of_bodies, of_link
from mbaid_ros.core.robot.passive import PassiveInertias, PassiveMotion, spring_constants, through_springs
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum, sensitivity_to_joints
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.unknowns.bodies import KnownBodies
from mbaid_ros.core.unknowns.declaration import JointMotion, Unknown
from mbaid_ros.core.unknowns.flexible import SpringErrors, StartingSwing, SwingNoise


def by_deflections(
    unknown: Unknown, kernel: MomentumKernel, motions: Sequence[Midpoints], spacings: Sequence[float], bodies: Bodies
) -> Array:
    """Return the derivative (N, 6, e) of the predicted twist (v, w) by an unknown that adds to the joints' motion.

    Parameters
    ----------
    unknown, kernel : of the joints; of the robot where it is linearised
    motions, spacings : of each stack of windows, and s between its instants
    bodies : of all instants, one after the other
    """
    # Momentum about the base's origin of all that a joint moves, (N, n, 6).
    states = bodies.states
    carried = kernel.kinematics.ancestors.T @ states.momenta
    origin, axes = states.body_twist[:, 0, :3], states.configuration.joint_twist
    ends = np.cumsum([0, *(motion.turn[..., 0].size for motion in motions)])
    parts = [
        _joint_motion(motion, spacing, *(part[begin:end] for part in (carried, origin, axes)))
        for (begin, end), motion, spacing in zip(pairwise(ends), motions, spacings, strict=True)
    ]
    position, rate = unknown.deflections(JointMotion.concatenate(parts))
    by_rate, by_position = joint_gains(kernel, bodies)
    return np.asarray((by_position @ position + by_rate @ rate) @ unknown.factor)


def _joint_motion(motion: Midpoints, spacing: float, carried: Array, origin: Array, axes: Array) -> JointMotion:
    """Return the joints' motion and load in a stack, one instant after the other."""
    shape = motion.turn.shape[:2]
    momenta, velocity, axis = (part.reshape(*shape, *part.shape[1:]) for part in (carried, origin, axes))
    # Force and moment are the rate of the momentum about the base's origin, which moves.
    force = gradient(momenta) / spacing
    force[..., 3:] += cross(np.broadcast_to(velocity[..., None, :], momenta[..., :3].shape), momenta[..., :3])
    torque = np.sum(axis * force, axis=-1)
    rate = motion.joint_velocity
    values = (motion.joint_position, rate, gradient(rate) / spacing, torque, gradient(torque) / spacing)
    return JointMotion(*(value.reshape(-1, value.shape[-1]) for value in values))


@dataclass(frozen=True)
class Prediction(ArrayRecord):
    """The predicted twist (v, w) of the base at N instants, odometry axes."""

    twist: Array  # (N, 6)
    by_parameters: Array  # (N, 6, u) derivative by the parameters
    # (N, 6, 6) F, derivative of (v, w) by an error (theta, rho) of the base's pose, at fixed axes of V
    by_pose_error: Array

    @property
    def error_slope(self) -> Array:
        """F~ (..., 6, 6), the rate of a pose error xi = (theta, rho): F~ xi = (F_w xi, F_v xi - v x theta)."""
        slope = self.by_pose_error[..., ANGULAR_FIRST, :]
        slope[..., 3:, :3] -= skew(self.twist[..., :3])  # the predicted velocity turns with the true base
        return slope

    def divided(self, shapes: Sequence[tuple[int, ...]]) -> list[Prediction]:
        """Return parts of the instants, each with several leading axes instead of one."""
        ends = np.cumsum([np.prod(shape) for shape in shapes])
        parts = [self[int(end - np.prod(shape)) : int(end)] for shape, end in zip(shapes, ends, strict=True)]
        return [
            Prediction(*(values.reshape(*shape, *values.shape[1:]) for values in vars(part).values()))
            for part, shape in zip(parts, shapes, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class PassiveColumns:
    """How the state x = (deflections, s) of f passive joints changes at N instants, linear in x and the parameters."""

    # by_state, by_parameters: (N, 2 f, 2 f), (N, 2 f, u) derivatives of the rates of x
    by_state: Array
    by_parameters: Array
    twist_by_state: Array  # (N, 6, 2 f) derivative of the base's twist by x
    first: Array  # (N, 2 f, u) derivative of x by the parameters where it is the first


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies of a robot that moves as predicted, at N instants."""

    parameters: Array  # (n + 1, 10) standard parameters of each, in its own frame
    mobility: Array  # (N, 6, 6) M^-1; with passive joints (M - Gamma H^-1 Gamma^T)^-1
    states: BodyStates  # as the momentum equations need them
    passive: PassiveColumns | None = None  # how passive joints swing; None without any

    def __getitem__(self, index: Integers) -> Bodies:
        """Return those of some instants."""
        return Bodies(self.parameters, self.mobility[index], self.states[index])


def predict(layout: Layout, middle: Midpoints, point: Point) -> tuple[Prediction, Bodies]:
    """Return the twist that conservation predicts at midpoints, and the bodies of a robot that moves so.

    Parameters
    ----------
    layout : of the state
    middle : Midpoints of N intervals, as the point's nominal model corrects them
    point : its momentum is that before any known thrust or orbit, L about the run's origin
    """
    parameters, kernel = point.parameters, point.side.kernel
    target, kinematics = kernel.target, kernel.kinematics
    known = kernel.with_target(parameters[6:16])
    placed = kinematics.configure(middle.base_rotation, middle.joint_position)
    body_twist = kinematics.body_twists(placed, middle.joint_velocity, np.zeros((len(middle), 6)))
    mobility, moving = _mobility_and_momentum(layout, point, middle, known, placed, body_twist)
    tide = about(middle.tide, middle.base_position)
    thrust = about(middle.thrust, middle.base_position, OF_A_THRUSTER)
    linear, about_base = _momentum(middle, point, known, (tide, thrust))
    total = np.concatenate((linear, about_base), axis=1)
    twist = (mobility @ (total - moving)[..., None])[..., 0]
    body_twist += twist[:, None]
    states = BodyStates(
        placed,
        body_twist,
        express(known, placed.rotation, placed.position),
        *placed.link(target),
        body_twist[:, target.body],
        kernel.storage,
        middle.stored,
        tide,
        thrust,
    )
    # M V + b = h_b, so M dV = dh - (dM V + db): the latter is the change of the predicted motion's momentum.
    count = len(parameters)
    right = np.zeros((len(twist), 6, count + 6))
    right[..., :6] = np.eye(6)
    right[:, 3:, :3] = -skew(middle.base_position)
    right[..., 6:16] = -states.regressor
    if tide.shape[1]:
        right[..., 6:16] += of_link(tide, target)
    column = 16
    for unknown in layout.predicted:
        columns = unknown.momentum_columns(kernel, states)
        if columns is not None:
            right[..., column : column + unknown.count] = -columns @ unknown.factor
        column += unknown.count
    # A turn theta of the base turns M and b, and the momentum stays: M^-1 (P x theta, L_b x theta + P x rho).
    turned = skew(linear)
    right[:, :3, count : count + 3] = turned
    right[:, 3:, count : count + 3] = skew(about_base)
    right[:, 3:, count + 3 :] = turned
    passive = None
    if kernel.springs.count:
        motion = _passive_motion_of(point, middle, known, states, mobility)
        solved, passive = passive_columns(layout, point, states, motion, right, _deflection(point, middle))
        mobility = motion.inertias.free_mobility
    else:
        solved = mobility @ right
    return Prediction(twist, solved[..., :count], solved[..., count:]), Bodies(known, mobility, states, passive)


def _mobility_and_momentum(
    layout: Layout, point: Point, middle: Midpoints, known: Array, placed: Configuration, body_twist: Array
) -> tuple[Array, Array]:
    """Return M^-1 and the momentum of the joint motion at a resting base, that stored inside bodies included."""
    storage = point.side.kernel.storage
    mobility, moving = mobility_and_momentum(known, placed, body_twist)
    if storage.count:
        moving[:, 3:] += np.sum(storage.momenta(placed.rotation, middle.stored), axis=1)
    if layout.plane is not None:
        mobility = in_plane(mobility, layout.plane)
    return mobility, moving


def _deflection(point: Point, middle: Midpoints) -> Array:
    """Return the deflections (N, f) of the passive joints, against the zeros of their springs."""
    joints = list(point.side.kernel.springs.joints)
    return middle.joint_position[:, joints] - point.side.zeros[joints]


def _passive_motion_of(
    point: Point, middle: Midpoints, known: Array, states: BodyStates, mobility: Array
) -> PassiveMotion:
    """Return how the passive joints of a robot swing that moves so; `known` (n + 1, 10) are all its bodies."""
    kernel = point.side.kernel
    joints = list(kernel.springs.joints)
    inertias = PassiveInertias.of(kernel, states.known, states.configuration, mobility)
    motion = (states.body_twist, _deflection(point, middle), middle.joint_velocity[:, joints])
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
    mobility, moving = _mobility_and_momentum(layout, point, middle, known, placed, body_twist)
    brought = about(middle.tide, middle.base_position), about(middle.thrust, middle.base_position, OF_A_THRUSTER)
    total = np.concatenate(_momentum(middle, point, known, brought), axis=1) - moving
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
    motion = (body_twist, _deflection(point, middle), rates)
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
    critical = 2.0 * cantilever_inertias(kernel.model, kernel.with_target(point.parameters[6:16]))[list(springs.joints)]
    by = np.zeros((*deflection.shape, springs.count, 2))
    each = np.arange(springs.count)
    by[:, each, each, 0] = -2.0 * stiffness * deflection - damping * rates
    by[:, each, each, 1] = -critical * springs.rate * rates
    return by.reshape(*deflection.shape, -1)


def _momentum(middle: Midpoints, point: Point, known: Array, brought: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the total (P, L_b) at N instants, (N, 3) each: that of the point, thrust and orbit included.

    Parameters
    ----------
    middle, point : Midpoints, Point
    known : (n + 1, 10) standard parameters of all bodies
    brought : columns of tide and of thrusters that deviate from their commands
    """
    parameters, (tide, thrust) = point.parameters, brought
    linear, angular = parameters[:3] + middle.impulse[:, :3], parameters[3:6] + middle.impulse[:, 3:]
    about_base = angular - cross(middle.base_position, linear)
    parts = [(tide, known)] if tide.shape[1] else []
    if thrust.shape[1] and point.side.thrust.any():
        parts.append((thrust, point.side.thrust.reshape(-1, OF_A_THRUSTER)))
    for columns, numbers in parts:
        more = of_bodies(columns, numbers)
        linear, about_base = linear + more[:, :3], about_base + more[:, 3:]
    return linear, about_base


def in_plane(mobility: Array, plane: Array) -> Array:
    """Return the (N, 6, 6) matrices from momentum to twist of a robot kept in a plane with (3, 6) rows.

    The constraint takes up all momentum out of the plane.
    """
    return np.asarray(plane.T @ np.linalg.inv(plane @ np.linalg.inv(mobility) @ plane.T) @ plane)


def joint_gains(kernel: MomentumKernel, bodies: Bodies) -> tuple[Array, Array]:
    """Return the derivatives (N, 6, n) of the predicted twist by the joint rates, and by the joint positions."""
    by_position, by_rate = sensitivity_to_joints(kernel, bodies.states)
    back = -bodies.mobility
    if kernel.springs.count:
        by_rate = by_rate - through_springs(kernel, bodies.states.configuration.joint_twist, by_rate)
    return back @ by_rate, back @ by_position


def gains_by_unknowns(layout: Layout, kernel: MomentumKernel, bodies: Bodies, by_rate: Array) -> Array:
    """Return the derivative (N, 6, 10 + e, n), by the body and the prediction's unknowns, of A (N, 6, n), `by_rate`.

    A is the derivative of the twist by the joint rates: the motion of one joint at unit rate without momentum. M dA is
    minus the change of the momentum of that motion by an unknown.
    """
    count, joints = len(by_rate), by_rate.shape[-1]
    each = bodies.states[np.repeat(np.arange(count), joints)]  # once for every joint
    alone = np.tile(np.arange(joints), count)
    added = kernel.kinematics.ancestors.T[alone][..., None] * _of(each.configuration.joint_twist, alone)[:, None]
    twist = np.swapaxes(by_rate, 1, 2).reshape(-1, 1, 6) + added
    readings, thrust = np.zeros_like(each.readings), np.zeros_like(each.thrust)
    of_target = twist[:, kernel.target.body]
    motion = replace(each, body_twist=twist, twist=of_target, readings=readings, tide=each.tide[:, :0], thrust=thrust)
    columns = [motion.regressor]
    for unknown in layout.predicted:
        of_momentum = unknown.momentum_columns(kernel, motion)
        nothing = np.zeros((len(alone), 6, unknown.count))
        columns.append(nothing if of_momentum is None else of_momentum @ unknown.factor)
    both = np.concatenate(columns, axis=-1)
    right = -both.reshape(count, joints, 6, both.shape[-1]).transpose(0, 2, 3, 1)
    return (bodies.mobility @ right.reshape(count, 6, -1)).reshape(right.shape)


def _of(joint_twist: Array, joints: Integers) -> Array:
    """Return the (N, 6) twist of one joint at each instant."""
    return joint_twist[np.arange(len(joints)), joints]
