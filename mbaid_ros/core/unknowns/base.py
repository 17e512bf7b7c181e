"""The base's readings: mount, scale and bias of the odometry, a frame that turns, a late twist, a vibration.

With the mount mu = (mu_R, mu_p), R_true = R Exp(mu_R) and p_true = p + R mu_p. The readings are the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from mbaid_ros.core.geometry import Array, cross, exp, quaternion_from_rotation, skew
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import inertia_matrix
from mbaid_ros.core.robot.orbit import orbit_fixed_frame
from mbaid_ros.core.robot.sensitivity import force_cross, motion_cross
from mbaid_ros.core.unknowns.declaration import (
    Linear,
    NominalModel,
    PlacedFrame,
    Reading,
    Unknown,
    Words,
    diagonal,
    twist_in_plane,
)

SCALE, ANGULAR_BIAS, LINEAR_BIAS = 'odometry scale', 'twist bias', 'twist velocity bias'
TURNING, LATE = 'odometry turning', 'twist late'
OF_TWIST = (LATE, ANGULAR_BIAS, LINEAR_BIAS)  # errors of the twist alone

_MINUTE = 60.0  # s: a unit


@dataclass(frozen=True, eq=False)
class OdometryMount(Unknown):
    """Rotation vector (rad) and position (m) of the base's frame in the one that the odometry locates."""

    words: ClassVar = {
        'mount': Words(
            'position and orientation of the odometry mount',
            'odometry_mount.position_std, .orientation_std',
            'the mount of the odometry: measure it (odometry_mount)',
            lambda _, value: (
                f'the odometry is mounted {1e3 * np.linalg.norm(value[3:]):.3g} mm and '
                f'{1e3 * np.linalg.norm(value[:3]):.3g} mrad off: measure the mount'
            ),
        )
    }
    in_readings = True
    calibrated = True

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the equations of a robot that is measured by its odometry's frame depend on where that is.

        A turn of the base takes everything along but the measured twist (trajectory.md, eq. 2). A base that is
        elsewhere, by a, moves faster by w x a, and the angular momentum about its origin is less by a x P.
        """
        del kernel
        rotation = states.configuration.rotation[:, 0]
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        total, twist = states.known_momentum, states.body_twist[:, 0]
        axes = np.swapaxes(rotation, 1, 2)  # (N, 3, 3), one a row
        turn, faster, away = np.zeros((3, len(rotation), 3, 6))
        turn[..., 3:] = axes
        faster[..., :3] = cross(twist[:, None, 3:], axes)
        away[..., 3:] = cross(axes, total[:, None, :3])
        turned = force_cross(turn, total[:, None]) - motion_cross(turn, twist[:, None]) @ inertia
        return np.swapaxes(np.concatenate((turned, faster @ inertia + away), axis=1), 1, 2)

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return its effect on the pose, and on the velocity: v_read = v_true - w x R mu_p.

        A pose error turns the twist that is read, for that is turned by the pose; the mount's part of it does not.
        """
        pose, twist = np.zeros((2, len(motion.rotation), 6, 6))
        pose[:, :3, :3] = pose[:, 3:, 3:] = -motion.rotation
        twist[:, :3, :3] = twist[:, 3:, 3:] = -motion.turning
        twist[:, 3:, :3] = -motion.sliding
        return pose, twist

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this mount."""
        return replace(side, mount=side.mount + value)

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the turn about the normal and the displacement in the plane."""
        return twist_in_plane(detector)


def odometry_mount(position_std: float, orientation_std: float) -> OdometryMount:
    """Return the mount as an unknown, of these standard deviations (m, rad); 0 is exact."""
    return OdometryMount(diagonal(np.repeat((orientation_std, position_std), 3)), ('mount',) * 6)


def marker_text(mount: Array, marker: PlacedFrame | None) -> str:
    """Return the parameters that declare a mount (6,), rad and m, found on top of the declared marker if there is one.

    With E = Exp(mu_R) the marker that the poses locate has the axes E^T A and the origin E^T (a - mu_p).
    """
    rotation, position = (np.eye(3), np.zeros(3)) if marker is None else (marker.rotation, marker.position)
    back = exp(mount[:3]).T
    position, quaternion = back @ (position - mount[3:]), quaternion_from_rotation(back @ rotation)
    place, turn = (', '.join(f'{x:.5f}' for x in np.round(each, 5) + 0.0) for each in (position, quaternion))
    return f'marker.position: [{place}], marker.orientation: [{turn}]' + (
        '' if marker else ' (of a child_frame_id that is no link)'
    )


@dataclass(frozen=True, eq=False)
class OdometryScale(Linear):
    """Relative scale error s: positions are read (1 + s) times as far as they are."""

    words: ClassVar = {
        SCALE: Words(
            remedy='the scale of the odometry: calibrate it (odometry.scale_std)',
            deviation=lambda _, value: (
                f'the scale of the odometry is off: lengths {1e2 * np.sum(value):+.2g} % too long; calibrate it, or '
                'raise odometry.scale_std'
            ),
        )
    }
    in_equations = True

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum follows from the velocity that is read; the arm of the linear one is left out."""
        del kernel
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        return -inertia[..., :3] @ states.body_twist[:, 0, :3, None]

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the position as far as the base has come, and its velocity."""
        pose, twist = np.zeros((2, len(motion.time), 6, 1))
        pose[:, 3:, 0], twist[:, 3:, 0] = motion.position, motion.twist[:, 3:]
        return pose, twist


def odometry_scale(deviation: float) -> OdometryScale:
    """Return the scale as an unknown, of a relative standard deviation."""
    return OdometryScale(np.array([[deviation]]), (SCALE,))


@dataclass(frozen=True, eq=False)
class TwistBias(Linear):
    """Constant in base axes, angular (rad/s) and linear (m/s)."""

    words: ClassVar = {
        ANGULAR_BIAS: Words(
            remedy='the bias of the angular velocity: more motion determines it (odometry.angular_velocity_bias_std)',
            deviation=lambda _, value: (
                f'the angular velocity of the twist has a bias of {np.linalg.norm(value):.2g} rad/s: leave the twist '
                'out, or raise odometry.angular_velocity_bias_std'
            ),
        ),
        LINEAR_BIAS: Words(
            deviation=lambda _, value: (
                f'the velocity of the twist has a bias of {np.linalg.norm(value):.2g} m/s: leave the twist out'
            )
        ),
    }
    in_equations = True

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum follows from the twist that is read."""
        del kernel
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        rotation = states.configuration.rotation[:, 0]
        return -np.concatenate((inertia[..., 3:] @ rotation, inertia[..., :3] @ rotation), axis=-1)

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the base's axes."""
        pose, twist = np.zeros((2, len(motion.time), 6, 6))
        twist[:, :3, :3] = twist[:, 3:, 3:] = motion.axes
        return pose, twist

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the turn about the normal and the speeds in the plane."""
        return twist_in_plane(detector)


def twist_bias(angular: float, linear: float) -> TwistBias:
    """Return the bias as an unknown, of standard deviations in rad/s and m/s; 0 is exact."""
    return TwistBias(diagonal(np.repeat((angular, linear), 3)), (ANGULAR_BIAS,) * 3 + (LINEAR_BIAS,) * 3)


@dataclass(frozen=True, eq=False)
class OdometryTurning(Linear):
    """Angular velocity of the odometry's frame, rad/s, (3,) in its own axes, such as an orbit's."""

    words: ClassVar = {TURNING: Words(deviation=lambda _, value: orbit_fixed_frame(float(np.linalg.norm(value))))}

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the rotation of such a frame back, about the run's origin."""
        pose, twist = np.zeros((2, len(motion.time), 6, 3))
        arm, time = skew(motion.position), motion.time[:, None, None]
        pose[:, :3], pose[:, 3:] = -time * np.eye(3), time * arm
        twist[:, :3], twist[:, 3:] = -np.eye(3), arm
        return pose, twist


@dataclass(frozen=True, eq=False)
class TwistLate(Linear):
    """By how much the twist is behind the pose, s."""

    words: ClassVar = {
        LATE: Words(
            deviation=lambda _, value: f'the twist is {1e3 * np.sum(value):+.3g} ms late against the pose: leave it out'
        )
    }

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the earlier twist."""
        return np.zeros((len(motion.time), 6, 1)), -motion.slope[..., None]


@dataclass(frozen=True, eq=False)
class Vibration(Linear):
    """The pose vibrates at one frequency: amplitudes (24,) rad and m of sine and cosine, and their growth a minute."""

    frequency: float = 0.0  # Hz

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return each, and how fast it changes."""
        rate, time = 2.0 * np.pi * self.frequency, motion.time[:, None, None]
        axes = np.eye(6)
        sine, cosine = np.sin(rate * time) * axes, np.cos(rate * time) * axes
        late = time / _MINUTE
        pose = np.concatenate((sine, cosine, late * sine, late * cosine), axis=2)
        growing = (rate * late * cosine + sine / _MINUTE, cosine / _MINUTE - rate * late * sine)
        return pose, np.concatenate((rate * cosine, -rate * sine, *growing), axis=2)


def vibration(frequency: float) -> Vibration:
    """Return a vibration of the pose at a frequency, Hz, as an unknown."""
    size = np.tile(np.repeat((1e-3, 1e-2), 3), 4)
    return Vibration(np.diag(size), ('vibration',) * 24, frequency)
