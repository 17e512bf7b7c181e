"""Robots that are not quite what their URDF says, and what their sensors then read."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from declarations import exact_but
from mbaid_ros.core.clocks import ClockDrift, TimeOffset
from mbaid_ros.core.contracts import Unknown
from mbaid_ros.core.geometry import Array, cross, exp, quaternion_from_rotation, rotate, rotation_from_quaternion
from mbaid_ros.core.joints.model import JointPlacements
from mbaid_ros.core.links import KnownBodies
from mbaid_ros.core.odometry.model import OdometryMount, OdometryScale, TwistBias
from mbaid_ros.core.robot.model import displaced
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.state import Declared
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ModelErrors, with_bodies

LINKS = 0.01  # relative standard deviation of the known bodies


def declared_beside_links(robot: MomentumKernel) -> Declared:
    """Return how uncertain the rest of a robot is."""
    return exact_but(
        robot,
        known_joints__zero_std=1e-3,
        known_joints__origin_std=1e-3,
        known_joints__axis_std=1e-3,
        odometry_mount__position_std=2e-3,
        odometry_mount__orientation_std=2e-3,
        time_offset__prior_std=5e-3,
        time_offset__drift_std=5e-5,
        odometry__scale_std=1e-3,
        odometry__angular_velocity_bias_std=1e-4,
    )


@dataclass(frozen=True)
class Wrong:
    """How a robot differs from what is known of it.

    Attributes
    ----------
    errors : ModelErrors
    delay : s, of the joints' stamps
    drift : s/s, of their clock
    scale : relative, by which lengths are read too long
    bias : (6,) rad/s and m/s, of the twist
    """

    errors: ModelErrors
    delay: float = 0.0
    drift: float = 0.0
    scale: float = 0.0
    bias: Array = field(default_factory=lambda: np.zeros(6))

    @staticmethod
    def by(unknowns: tuple[Unknown, ...], numbers: tuple[Array, ...], joints: int) -> Wrong:
        """Return what the independent numbers (e,) of each of some unknowns stand for."""
        errors, others = ModelErrors.zero(joints), Wrong(ModelErrors.zero(joints))
        for unknown, standard in zip(unknowns, numbers, strict=True):
            value = unknown.factor @ standard
            if isinstance(unknown, KnownBodies):
                errors.bodies[list(unknown.bodies)] = value.reshape(-1, 10)
            elif isinstance(unknown, JointPlacements):
                each = value.reshape(-1, 6)
                errors.zeros[:], errors.origins[:] = each[:, 0], each[:, 1:4]
                errors.tilts[:] = rotate(unknown.across, each[:, 4:])
            elif isinstance(unknown, OdometryMount):
                errors.mount[:] = value
            elif isinstance(unknown, TwistBias):
                others = replace(others, bias=value)
            else:
                name = {TimeOffset: 'delay', ClockDrift: 'drift', OdometryScale: 'scale'}[type(unknown)]
                changed: dict[str, Any] = {name: float(value[0])}
                others = replace(others, **changed)
        return replace(others, errors=errors)

    def robot(self, known: MomentumKernel) -> MomentumKernel:
        """Return the true robot, with the target that is to be identified."""
        target = known.target.name
        elsewhere = displaced(known.model, self.errors.origins, self.errors.tilts)
        return MomentumKernel(with_bodies(elsewhere, self.errors.bodies, (target,)), target)

    def read(self, truth: Truth) -> Truth:
        """Return a motion as encoders that are off and late, and odometry that is mounted elsewhere, read it."""
        turn, place = exp(self.errors.mount[:3]), self.errors.mount[3:]
        rotation = rotation_from_quaternion(truth.base_orientation) @ turn.T
        spin = rotate(turn, truth.base_angular_velocity)
        joints = CubicSpline(truth.time, truth.joint_position - self.errors.zeros)
        larger, moved = 1.0 + self.scale, np.broadcast_to(place, spin.shape)
        return replace(
            truth,
            joint_position=joints(truth.time - self.delay - self.drift * truth.time),
            base_orientation=quaternion_from_rotation(rotation),
            base_position=larger * (truth.base_position - rotation @ place),
            base_angular_velocity=spin + self.bias[:3],
            base_linear_velocity=larger * (rotate(turn, truth.base_linear_velocity) - cross(spin, moved))
            + self.bias[3:],
        )
