"""The joints: zero, origin and axis of each may be off; its reading may be off at random, or by its gear.

A displaced joint frame takes all that it carries along: trajectory.md, eq. 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.geometry import Array, cross, rotate, skew
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.kinematics import Kinematics, PlaneDetector
from mbaid_ros.core.robot.momentum import inertia_matrix
from mbaid_ros.core.unknowns.declaration import Linear, NominalModel, Unknown, Words, diagonal

_PLACEMENT_NUMBERS = 6  # numbers a joint: zero (1), origin (3), tilt of the axis (2)


@dataclass(frozen=True, eq=False)
class JointPlacements(Unknown):
    """Of each joint: true less measured position (rad or m), displacement of its frame (m) and tilt of its axis (rad).

    Displacement and tilt are in the joint's own axes, the tilt about two directions normal to the joint's axis.
    """

    across: Array  # (n, 3, 2) these directions

    words: ClassVar = {
        'zero': Words(
            "the joints' zeros",
            'known_joints.zero_std',
            'the zero of {}: calibrate it (known_joints)',
            lambda name, value: f'the zero of {name} is off by {1e3 * np.sum(value):+.3g} mrad (mm): measure it',
        ),
        'origin': Words(
            "the joints' origins",
            'known_joints.origin_std',
            'the origin of {}: measure or calibrate it (known_joints)',
            lambda name, value: f'the origin of {name} is off by {1e3 * np.linalg.norm(value):.3g} mm: check the URDF',
        ),
        'axis': Words(
            "the joints' axes",
            'known_joints.axis_std',
            'the axis of {}: measure or calibrate it (known_joints)',
            lambda name, value: f'the axis of {name} is off by {1e3 * np.linalg.norm(value):.3g} mrad: check the URDF',
        ),
    }
    calibrated = True

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the change of the momentum by a displaced load of a joint."""
        model, configuration = kernel.model, states.configuration
        parents = list(model.parents)
        count, joints = configuration.joint_twist.shape[:2]
        frames = configuration.rotation[:, parents] @ model.rotations
        displacement = np.zeros((count, joints, _PLACEMENT_NUMBERS, 6))  # twists X (u, w), one a row
        displacement[:, :, 0] = configuration.joint_twist
        displacement[:, :, 1:4, :3] = np.swapaxes(frames, -1, -2)
        turn = np.swapaxes(frames @ self.across, -1, -2)
        # The joint's own frame: the load of a prismatic joint has slid away from it.
        place = configuration.position[:, parents] + rotate(configuration.rotation[:, parents], model.positions)
        displacement[:, :, 4:, :3] = cross(np.broadcast_to(place[:, :, None], turn.shape), turn)
        displacement[:, :, 4:, 3:] = turn
        return momentum_displaced(kernel, states, displacement)

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these placements."""
        each = value.reshape(-1, _PLACEMENT_NUMBERS)
        tilts = (self.across @ each[:, 4:, None])[..., 0]
        kernel = side.kernel.with_displaced_joints(each[:, 1:4], tilts)
        return replace(side, kernel=kernel, zeros=side.zeros + each[:, 0])

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the zeros, the displacements in the plane, and the tilts of the axes that slide within it."""
        blocks = []
        for joint, slides in enumerate(detector.model.prismatic):
            plane = detector.plane_of_body(joint + 1)
            block = np.zeros((_PLACEMENT_NUMBERS, 4))
            block[0, 0] = 1.0
            block[1:4, 1:3] = plane.axes.T
            block[4:, 3] = self.across[joint].T @ plane.normal
            blocks.append(block if slides else block[:, :3])
        return np.asarray(block_diag(*blocks))


def joint_placements(
    kernel: MomentumKernel, zeros: Sequence[float], origins: Sequence[float], axes: Sequence[float]
) -> JointPlacements:
    """Return the placements as an unknown; (n,) standard deviations: rad (m for a prismatic one), m, rad; 0: exact."""
    factor = diagonal(np.column_stack((zeros, *(origins,) * 3, *(axes,) * 2)).ravel())
    parts = ('zero', *('origin',) * 3, *('axis',) * 2)
    labels = tuple(f'{part}:{name}' for name in kernel.model.joint_names for part in parts)
    return JointPlacements(factor, labels, Kinematics(kernel.model).across)


def momentum_displaced(kernel: MomentumKernel, states: BodyStates, displacement: Array) -> Array:
    """Return the change of the momentum, (N, 6, n d), by d small motions (N, n, d, 6) of each joint's load."""
    change = _displacement_matrices(kernel, states)
    columns = displacement @ np.swapaxes(change, -1, -2)  # (N, n, d numbers, 6 of the momentum)
    return np.swapaxes(columns.reshape(len(columns), -1, 6), 1, 2)


def _displacement_matrices(kernel: MomentumKernel, states: BodyStates) -> Array:
    """Return the (N, n, 6, 6) matrices that make X x* h_S - I_S (X x V_p) of X, for each joint: eq. 2."""
    carried = kernel.kinematics.ancestors.T
    inertia = inertia_matrix(carried @ states.known)
    whole = carried @ states.momenta
    parent = states.body_twist[:, list(kernel.model.parents)]
    # X x* h and X x V are linear in X: -[h] and -[V] in brackets.
    force = np.zeros((*whole.shape, 6))
    force[..., :3, 3:] = force[..., 3:, :3] = -skew(whole[..., :3])
    force[..., 3:, 3:] = -skew(whole[..., 3:])
    motion = np.zeros((*parent.shape, 6))
    motion[..., :3, :3] = motion[..., 3:, 3:] = -skew(parent[..., 3:])
    motion[..., :3, 3:] = -skew(parent[..., :3])
    return np.asarray(force - inertia @ motion)


TRACKING = 'tracking'


@dataclass(frozen=True, eq=False)
class JointTracking(Linear):
    """Of each joint: true less read position (rad or m), in every motion another one."""

    correlation: Array  # (e,) s, time constant of each independent number

    words: ClassVar = {
        TRACKING: Words(
            'the deviations of joints from their readings',
            'known_joints.tracking_std',
            deviation=lambda name, value: (
                f'{name} deviates by {1e3 * np.sum(value):+.3g} mrad (mm) from its reading: log encoder positions, not '
                'commands, or raise known_joints.tracking_std'
            ),
        )
    }
    in_readings = False
    in_equations = True
    redrawn_per_motion = True

    @property
    def time_constants(self) -> Array:
        """Time constants of the errors."""
        return self.correlation

    @property
    def joint_columns(self) -> Array:
        """Each joint is further on by its own number."""
        return self.factor

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the change of the momentum by a load that has moved on along its joint."""
        return momentum_displaced(kernel, states, states.configuration.joint_twist[:, :, None])

    def in_plane(self, detector: PlaneDetector) -> JointTracking:
        """Return it as it is: joints only move in the plane."""
        del detector
        return self


def joint_tracking(names: Sequence[str], deviations: Sequence[float], times: Sequence[float]) -> JointTracking:
    """Return it as an unknown of n joints: stationary standard deviations, rad or m; time constants, s; empty: none."""
    each = np.asarray(deviations if len(deviations) else np.zeros(len(names)), dtype=float)
    correlation = np.asarray(times if len(times) else np.ones(len(names)), dtype=float)[each > 0.0]
    return JointTracking(diagonal(each), tuple(f'{TRACKING}:{name}' for name in names), correlation)


GEARED = 'geared'
# Standard deviation, rad or m: far below that of drives; a thousand times as much is plausible.
_GEARED_STD = 1e-5


@dataclass(frozen=True, eq=False)
class GearedJoints(Linear):
    """Of each joint: how it deviates from its reading with its own angle, by sine and cosine of that (rad or m)."""

    words: ClassVar = {
        GEARED: Words(
            deviation=lambda name, value: (
                f'{name} is flexible or geared: it deviates by {1e3 * np.linalg.norm(value):.2g} mrad (mm) from its '
                'encoder with its angle'
            )
        )
    }
    in_readings = False
    moves_joints = True

    def deflections(self, position: Array, rate: Array) -> tuple[Array, Array]:
        """Return the contribution of each number to the position of its own joint, and to its rate."""
        sine, cosine = np.sin(position), np.cos(position)
        joints = np.eye(position.shape[1])[:, :, None]
        places, rates = (
            (joints * np.stack(part, axis=-1)[:, :, None, :]).reshape(*position.shape, -1)
            for part in ((sine, cosine), (cosine * rate, -sine * rate))
        )
        return places, rates


def geared_joints(names: Sequence[str]) -> GearedJoints:
    """Return them as nearly exact, for joints of these names."""
    labels = tuple(f'{GEARED}:{name}' for name in names for _ in range(2))
    return GearedJoints(_GEARED_STD * np.eye(len(labels)), labels)
