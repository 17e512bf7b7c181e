"""How the base moves when the joints do: its pose integrated from the conserved momentum, for many motions at once.

Passive joints do not move the base here. They swing along with it from rest, to first order in their deflections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.filter.linearise import predict
from mbaid_ros.core.geometry import Array, composed, cross, log, rotate, rotate_back
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import inverse_inertia_and_momentum
from mbaid_ros.core.samples import ArrayRecord
from mbaid_ros.core.state import Layout, Point
from mbaid_ros.core.swing import starting_states, transition_steps
from mbaid_ros.core.windows import Midpoints


@dataclass(frozen=True)
class BaseMotion(ArrayRecord):
    """The base at T instants, B motions side by side, odometry axes, positions from the run's origin."""

    rotation: Array  # (T, B, 3, 3)
    position: Array  # (T, B, 3) m
    twist: Array  # (T, B, 6) (v, w)
    deflection: Array  # (T, B, f) rad or m, of passive joints

    def deviation_from(self, other: BaseMotion) -> Array:
        """Return how far this is from another motion: (T, B, 4) rad, m, rad/s, and rad or m of passive joints."""
        turned = np.linalg.norm(log(self.rotation @ np.swapaxes(other.rotation, -1, -2)), axis=-1)
        moved = np.linalg.norm(self.position - other.position, axis=-1)
        faster = np.linalg.norm(self.twist[..., 3:] - other.twist[..., 3:], axis=-1)
        swung = np.zeros_like(turned)
        if self.deflection.shape[-1]:
            swung = np.max(np.abs(self.deflection - other.deflection), axis=-1)
        return np.stack((turned, moved, faster, swung), axis=-1)


@dataclass(frozen=True, eq=False)
class FloatingRobot:
    """A floating robot: its parameters, its momentum, and its start."""

    point: Point  # bodies, momentum (about the run's origin) and estimates of the joints
    stored: Array  # (c,) readings of the momentum stored inside bodies, which stay constant
    rotation: Array  # (3, 3) of the base at the begin
    position: Array  # (3,) m, of the base at the begin
    plane: Array | None  # (3, 6) the equations that hold for a planar motion, odometry axes; None in space

    def base_motion(self, joint_position: Array, joint_velocity: Array, step: float) -> BaseMotion:
        """Return the motion of the base at T instants, from the begin on.

        Parameters
        ----------
        joint_position, joint_velocity : (2 T - 1, B, n) of all joints, as read, at every half step
        step : s
        """
        parts = self.inverse_inertia_and_momentum(joint_position, joint_velocity)
        momentum = np.tile(self.point.parameters[:6], (joint_position.shape[1], 1))
        return _integrated(*parts, momentum, (self.rotation, self.position), step)

    def deflected(self, base: BaseMotion, joint_position: Array, joint_velocity: Array, step: float) -> BaseMotion:
        """Return motions with the deflections of passive joints from rest; of joints (T, B, n) at their instants."""
        kernel, count = self.point.nominal.kernel, base.twist[..., 0].size
        if not kernel.springs.count:
            return base
        shape, size = base.twist.shape[:2], kernel.springs.count
        motion = (joint_position + self.point.nominal.zeros, joint_velocity, base.rotation, base.position, base.twist)
        flat = [each.reshape(count, *each.shape[2:]) for each in motion]
        none, stored = np.zeros((count, 3)), np.tile(self.stored, (count, 1))
        middle = Midpoints(*(*flat, none, none, np.zeros((count, 6)), stored))
        layout = Layout.from_unknowns(kernel, (), plane=self.plane)
        passive = predict(layout, middle, self.point, np.zeros((count, size)))[1].passive
        assert passive is not None, 'there are passive joints'
        by_state, slope = passive.by_state.reshape(*shape, 2 * size, -1), passive.slope.reshape(*shape, -1, 1)
        x = composed(*transition_steps(np.mean(passive.by_state, axis=0), by_state, slope, step))
        begin = starting_states(np.zeros((2, size, 1)), by_state[0], slope[0])
        return replace(base, deflection=(x[..., : 2 * size] @ begin + x[..., 2 * size :])[..., :size, 0])

    def inverse_inertia_and_momentum(self, joint_position: Array, joint_velocity: Array) -> tuple[Array, Array]:
        """Return M^-1 (..., 6, 6) and the momentum (..., 6) of the joints' motion at a resting base, base axes."""
        nominal = self.point.nominal
        kernel = nominal.kernel
        shape = joint_position.shape[:2]
        position = joint_position.reshape(-1, joint_position.shape[-1]) + nominal.zeros
        upright = np.broadcast_to(np.eye(3), (len(position), 3, 3))
        placed = kernel.kinematics.configure(upright, position)
        still = np.zeros((len(position), 6))
        twists = kernel.kinematics.body_twists(placed, joint_velocity.reshape(position.shape), still)
        bodies = express(kernel.body_parameters(self.point.body), placed.rotation, placed.position)
        inverse_inertia, moving = inverse_inertia_and_momentum(bodies, twists, self._plane_of_base)
        if kernel.storage.count:
            readings = np.broadcast_to(self.stored, (len(position), len(self.stored)))
            moving[:, 3:] += np.sum(kernel.storage.momenta(placed.rotation, readings), axis=1)
        return inverse_inertia.reshape(*shape, 6, 6), moving.reshape(*shape, 6)

    @property
    def _plane_of_base(self) -> Array | None:
        """The equations of a planar motion in base axes: a turn about the normal only mixes them; None in space."""
        return None if self.plane is None else (self.plane.reshape(3, 2, 3) @ self.rotation).reshape(3, 6)


def base_motions(
    robots: Sequence[FloatingRobot], joint_position: Array, joint_velocity: Array, step: float
) -> BaseMotion:
    """Return the base motions of R robots with the same start and the same joint motion.

    Parameters
    ----------
    robots : R of them
    joint_position, joint_velocity : (2 T - 1, n) as in `FloatingRobot.base_motion`
    step : s
    """
    parts = [robot.inverse_inertia_and_momentum(joint_position[:, None], joint_velocity[:, None]) for robot in robots]
    inverse_inertia, moving = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
    momentum = np.stack([robot.point.parameters[:6] for robot in robots])
    base = _integrated(inverse_inertia, moving, momentum, (robots[0].rotation, robots[0].position), step)
    if not robots[0].point.nominal.kernel.springs.count:
        return base
    each = [BaseMotion(*(part[:, [place]] for part in vars(base).values())) for place in range(len(robots))]
    joints = joint_position[::2, None], joint_velocity[::2, None]
    swung = [robot.deflected(own, *joints, step).deflection for robot, own in zip(robots, each, strict=True)]
    return replace(base, deflection=np.concatenate(swung, axis=1))


def _integrated(
    inverse_inertia: Array, moving: Array, momentum: Array, begin: tuple[Array, Array], step: float
) -> BaseMotion:
    """Return the motions of B bases by Runge and Kutta's method of fourth order.

    Parameters
    ----------
    inverse_inertia, moving : (2 T - 1, B, 6, 6), (2 T - 1, B, 6) at every half step, base axes
    momentum : (B, 6) (P, L) about the run's origin
    begin : (3, 3), (3,) orientation and position
    step : s
    """
    count, batch = (len(moving) + 1) // 2, len(momentum)
    rotation, position, twist = np.empty((count, batch, 3, 3)), np.empty((count, batch, 3)), np.empty((count, batch, 6))
    turned, place = np.tile(begin[0], (batch, 1, 1)), np.tile(begin[1], (batch, 1))
    for index in range(count):
        rotation[index], position[index] = turned, place
        here = 2 * index
        first = _rates(inverse_inertia[here], moving[here], momentum, turned, place)
        twist[index, :, :3], twist[index, :, 3:] = first[1], rotate(turned, first[2])
        if index + 1 < count:
            slopes = [first]
            for part, ahead in ((0.5, 1), (0.5, 1), (1.0, 2)):
                reached = turned + part * step * slopes[-1][0], place + part * step * slopes[-1][1]
                slopes.append(_rates(inverse_inertia[here + ahead], moving[here + ahead], momentum, *reached))
            turned = turned + step / 6.0 * _simpson([slope[0] for slope in slopes])
            place = place + step / 6.0 * _simpson([slope[1] for slope in slopes])
            # One of Newton's steps to the nearest rotation, from which a step of fourth order is hardly away.
            turned = turned @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(turned, 1, 2) @ turned)
    return BaseMotion(rotation, position, twist, np.zeros((count, batch, 0)))


def _rates(
    inverse_inertia: Array, moving: Array, momentum: Array, rotation: Array, position: Array
) -> tuple[Array, Array, Array]:
    """Return R', p' (odometry axes) and the angular velocity (base axes) of B bases."""
    linear, about_base = momentum[:, :3], momentum[:, 3:] - cross(position, momentum[:, :3])
    total = np.concatenate((rotate_back(rotation, linear), rotate_back(rotation, about_base)), axis=1)
    twist = (inverse_inertia @ (total - moving)[..., None])[..., 0]
    spin = twist[:, 3:]
    # Row by row: R' = R [w]x.
    return cross(rotation, spin[:, None]), rotate(rotation, twist[:, :3]), spin


def _simpson(slopes: list[Array]) -> Array:
    first, second, third, last = slopes
    return first + 2.0 * (second + third) + last
