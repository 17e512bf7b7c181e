"""The base twist by conserved momentum, V = M^-1 (h_b - b), and its derivatives (trajectory.md, eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from mbaid_ros.core.filter.knots import Midpoints
from mbaid_ros.core.filter.passive_prediction import PassiveColumns, passive_columns
from mbaid_ros.core.filter.state import (
    ANGULAR_FIRST,
    Layout,
    Point,
    in_plane,
    mobility_and_joint_momentum,
    total_momentum,
)
from mbaid_ros.core.geometry import Array, Integers, skew
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS, about_points, link_columns
from mbaid_ros.core.robot.passive import PassiveInertias, PassiveMotion, passive_momenta, spring_constants
from mbaid_ros.core.robot.sensitivity import sensitivity_to_joints
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.unknowns.declaration import Unknown


def by_deflections(unknown: Unknown, kernel: MomentumKernel, motion: Midpoints, bodies: Bodies) -> Array:
    """Return the derivative (N, 6, e) of the predicted twist (v, w) by an unknown that adds to the joints' motion.

    Parameters
    ----------
    unknown, kernel : of the joints; of the robot where it is linearised
    motion, bodies : at N instants
    """
    position, rate = unknown.deflections(motion.joint_position, motion.joint_velocity)
    by_rate, by_position = joint_gains(kernel, bodies)
    return np.asarray((by_position @ position + by_rate @ rate) @ unknown.factor)


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


class SwingInertias(Protocol):
    """The inertias of f passive joints at N instants, as `PassiveInertias`."""

    @property
    def gamma(self) -> Array:
        """Momentum of unit rates, Gamma, (N, f, 6)."""

    @property
    def mobility(self) -> Array:
        """M^-1, the passive joints held, (N, 6, 6)."""

    @property
    def mobility_of_joints(self) -> Array:
        """Inverse of H - Gamma^T M^-1 Gamma, (N, f, f)."""

    def solve(self, total: Array, along: Array) -> tuple[Array, Array]:
        """Return base twists (N, 6, c) and rates (N, f, c) with momenta (N, 6, c) and (N, f, c) along the joints."""


class Swing(Protocol):
    """How the state x = (deflections, s) of f passive joints changes at N instants, as `PassiveColumns`."""

    @property
    def inertias(self) -> SwingInertias:
        """Of the passive joints."""

    @property
    def slope(self) -> Array:
        """Rates of x, (N, 2 f)."""

    @property
    def by_state(self) -> Array:
        """Derivatives of these by x, (N, 2 f, 2 f)."""

    @property
    def by_parameters(self) -> Array:
        """Derivatives of these by the parameters, (N, 2 f, u)."""

    @property
    def twist_by_state(self) -> Array:
        """Derivative of the base's twist by x, (N, 6, 2 f)."""

    def __getitem__(self, index: Integers) -> Swing:
        """Return that of some instants."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies of a robot that moves as predicted, at N instants."""

    parameters: Array  # (n + 1, 10) standard parameters of each, in its own frame
    mobility: Array  # (N, 6, 6) M^-1; with passive joints (M - Gamma H^-1 Gamma^T)^-1
    states: BodyStates  # as the momentum equations need them
    passive: Swing | None = None  # how passive joints swing; None without any

    def __getitem__(self, index: Integers) -> Bodies:
        """Return those of some instants."""
        passive = None if self.passive is None else self.passive[index]
        return Bodies(self.parameters, self.mobility[index], self.states[index], passive)


def predict(layout: Layout, middle: Midpoints, point: Point, along: Array | None = None) -> tuple[Prediction, Bodies]:
    """Return the twist that conservation predicts at midpoints, and the bodies of a robot that moves so.

    Parameters
    ----------
    layout : of the state
    middle : Midpoints of N intervals, as the point's nominal model corrects them
    point : its momentum is that before any known thrust or orbit, L about the run's origin
    along : (N, f) s of passive joints, whose rates follow and are zero in `middle`; None without any
    """
    parameters, kernel = point.parameters, point.side.kernel
    target, kinematics = kernel.target, kernel.kinematics
    known = kernel.body_parameters(parameters[6:16])
    placed = kinematics.configure(middle.base_rotation, middle.joint_position)
    body_twist = kinematics.body_twists(placed, middle.joint_velocity, np.zeros((len(middle), 6)))
    expressed = express(known, placed.rotation, placed.position)
    mobility, moving = mobility_and_joint_momentum(kernel, middle.stored, expressed, placed, body_twist)
    if layout.plane is not None:
        mobility = in_plane(mobility, layout.plane)
    tide = about_points(middle.tide, middle.base_position)
    thrust = about_points(middle.thrust, middle.base_position, THRUSTER_ERRORS)
    linear, about_base = total_momentum(middle, point, known, (tide, thrust))
    total = np.concatenate((linear, about_base), axis=1) - moving
    motion: PassiveMotion | None = None
    if along is None:
        twist: Array = (mobility @ total[..., None])[..., 0]
        body_twist += twist[:, None]
    else:
        joints = list(kernel.springs.joints)
        deflection = middle.joint_position[:, joints] - point.side.zeros[joints]
        inertias = PassiveInertias.from_bodies(kernel, expressed, placed, mobility)
        state, constants = (deflection, along), spring_constants(kernel, known)
        motion = PassiveMotion.from_state(kernel, inertias, expressed, (body_twist, total), state, constants)
        twist, body_twist = motion.twist, motion.body_twist
    states = BodyStates(
        placed,
        body_twist,
        expressed,
        *placed.link_pose(target),
        body_twist[:, target.body],
        kernel.storage,
        middle.stored,
        tide,
        thrust,
    )
    right = _right_hand_sides(layout, kernel, states, middle.base_position, (linear, about_base))
    passive: PassiveColumns | None = None
    if motion is None:
        solved: Array = mobility @ right
    else:
        solved, passive = passive_columns(layout, point, states, motion, right, deflection)
        mobility = motion.inertias.free_mobility
    return Prediction(twist, solved[..., :-6], solved[..., -6:]), Bodies(known, mobility, states, passive)


def _right_hand_sides(
    layout: Layout, kernel: MomentumKernel, states: BodyStates, position: Array, total: tuple[Array, Array]
) -> Array:
    """Return minus the change of the momentum at fixed twists, (N, 6, u + 6), by parameters and the base's pose error.

    `position` (N, 3) of the base, `total` (P, L_b), (N, 3) each.
    """
    linear, about_base = total
    # M V + b = h_b, so M dV = dh - (dM V + db): the latter is the change of the predicted motion's momentum.
    count = 16 + sum(each.count for each in layout.predicted)
    right = np.zeros((len(position), 6, count + 6))
    right[..., :6] = np.eye(6)
    right[:, 3:, :3] = -skew(position)
    right[..., 6:16] = -states.regressor
    if states.tide.shape[1]:
        right[..., 6:16] += link_columns(states.tide, kernel.target)
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
    return right


def joint_gains(kernel: MomentumKernel, bodies: Bodies) -> tuple[Array, Array]:
    """Return the derivatives (N, 6, n) of the predicted twist by the joint rates, and by the joint positions."""
    by_position, by_rate = sensitivity_to_joints(kernel, bodies.states)
    back = -bodies.mobility
    if bodies.passive is None:
        return back @ by_rate, back @ by_position
    along = passive_momenta(kernel, bodies.states.configuration.joint_twist, by_rate)
    return bodies.passive.inertias.solve(-by_rate, -along)[0], back @ by_position


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
