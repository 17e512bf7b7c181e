"""The base at the joints' stamps (a cubic with the velocities at both ends), frames on it, and its covariances.

Its streams come from `session/intake.py`; `synchroniser.py` joins them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mbaid_ros.core.geometry import Array, cross, exp, log, rotate, rotate_back, skew
from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream, Samples, Stamps


def hermite(
    joints: JointStream, base: BaseStream, ends: tuple[Stamps, Stamps], maximum_gap: int, time: Array, weight: Array
) -> Samples:
    """Interpolate pose by cubics with the velocities at both ends, and velocities linearly.

    The derivative of the pose's cubic would be smoother, but turns position noise into velocity noise. Without a
    velocity the pose follows a parabola through the one before: a straight line has a systematic error.
    """
    left, right = ends
    length = (base.stamp[right] - base.stamp[left]) * 1e-9
    fraction = (joints.stamp - base.stamp[left]) * 1e-9 / np.where(length > 0.0, length, 1.0)
    s, h = fraction[:, None], length[:, None]
    to_end = s * s * (3.0 - 2.0 * s)
    from_start = s * (1.0 - s) ** 2 * h
    from_end = -s * s * (1.0 - s) * h
    start, step = base.position[left], base.position[right] - base.position[left]
    # Orientation: the same cubic in the rotation vector from the left sample, in its axes.
    rotation = base.rotation[left]
    turn = log(np.swapaxes(rotation, -1, -2) @ base.rotation[right])
    velocity, rate = _slopes(base, ends, step, turn, maximum_gap)
    position = start + to_end * step + from_start * velocity[0] + from_end * velocity[1]
    turned = rotation @ exp(to_end * turn + from_start * rate[0] + from_end * rate[1])
    linear, angular = (
        part[left] + s * (part[right] - part[left]) for part in (base.linear_velocity, base.angular_velocity)
    )
    return Samples(
        time=time,
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        base_position=position,
        base_rotation=np.where(length[:, None, None] == 0.0, rotation, turned),
        base_linear_velocity=linear,
        base_angular_velocity=angular,
        pose_covariance=_blended(base.pose_covariance, ends, s, weight),
        twist_covariance=_blended(base.twist_covariance, ends, s, weight),
        stored=joints.stored,
    )


def _slopes(
    base: BaseStream, ends: tuple[Stamps, Stamps], step: Array, turn: Array, maximum_gap: int
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the slopes at both ends of the positions and of the rotation vectors from the left sample.

    `step` and `turn` (N, 3) lead from the left sample to the right one.
    """
    left, right = ends
    back = np.swapaxes(base.rotation[left], -1, -2)
    velocity = base.linear_velocity[left], base.linear_velocity[right]
    rate = (
        rotate_back(base.rotation[left], base.angular_velocity[left]),
        rotate_back(base.rotation[left], base.angular_velocity[right]),
    )
    rate = rate[0], rate[1] - 0.5 * cross(turn, rate[1])  # derivative of the rotation vector, to first order in it
    if np.all(np.isfinite(np.concatenate((*velocity, *rate)))):
        return velocity, rate
    before = np.maximum(left - 1, 0)
    length, earlier = base.stamp[right] - base.stamp[left], base.stamp[left] - base.stamp[before]
    times = length * 1e-9, np.where(earlier <= maximum_gap, earlier * 1e-9, 0.0)
    steps = _parabola(step, base.position[left] - base.position[before], *times)
    turns = _parabola(turn, -log(back @ base.rotation[before]), *times)
    return _finite_or(velocity, steps), _finite_or(rate, turns)


def _parabola(step: Array, before: Array, length: Array, earlier: Array) -> tuple[Array, Array]:
    """Return the slopes (N, 3) at both ends of steps (N, 3) after earlier ones; durations (N,) s, 0 for none."""
    h, h_before = length[:, None], earlier[:, None]
    mean = step / np.where(h > 0.0, h, np.inf)
    bend = np.where(h_before > 0.0, mean - before / np.where(h_before > 0.0, h_before, np.inf), 0.0)
    half = np.where(h > 0.0, h / np.maximum(h + h_before, 1e-9), 0.0) * bend
    return mean - half, mean + half


def _finite_or(slopes: tuple[Array, Array], others: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return slopes, and others in their place where they are not finite."""
    start, end = (np.where(np.isfinite(one), one, other) for one, other in zip(slopes, others, strict=True))
    return start, end


def _blended(covariance: Array, ends: tuple[Stamps, Stamps], fraction: Array, weight: Array) -> Array:
    """Return (N, 6, 6) covariances at fractions (N, 1) between the base's, weighted (N,); in place, they are large."""
    blend = fraction[..., None]
    start, end = (np.take(covariance, places, axis=0) for places in ends)
    start *= 1.0 - blend
    end *= blend
    start += end
    start *= weight[:, None, None]
    return start


@dataclass(frozen=True, eq=False)
class AttachedFrame:
    """A frame on the base (a marker, a sensor): rotation (3, 3) and origin (3,) m in the base link's frame."""

    rotation: Array
    position: Array

    @property
    def is_base(self) -> bool:
        """Whether it is the base link's own frame."""
        return bool(np.array_equal(self.rotation, np.eye(3)) and not np.any(self.position))

    def to_base(self, measured: BaseStream) -> BaseStream:
        """Return the base link's stream from that of this frame, whose twist covariance is in its own axes."""
        # In products of matrices, batch sizes show in the last bit: here sums over axes do the work.
        rotation = np.einsum('nij,kj->nik', measured.rotation, self.rotation)
        lever = rotate(rotation, self.position)  # from the base's origin to the frame's, odometry axes
        pose = np.zeros((len(rotation), 6, 6))
        pose[:] = np.eye(6)
        pose[:, :3, 3:] = skew(lever)  # p = p_frame - lever: an error of orientation turns the lever
        twist = np.zeros((6, 6))
        twist[:3, :3] = twist[3:, 3:] = self.rotation
        twist[:3, 3:] = skew(self.position) @ self.rotation  # v = v_frame - w x lever
        return replace(
            measured,
            position=measured.position - lever,
            rotation=rotation,
            linear_velocity=measured.linear_velocity - cross(measured.angular_velocity, lever),
            pose_covariance=pose @ measured.pose_covariance @ np.swapaxes(pose, -1, -2),
            twist_covariance=twist @ measured.twist_covariance @ twist.T,
        )


def orientation_only(stamp: Stamps, rotation: Array, covariance: Array | None = None) -> BaseStream:
    """Return N orientations (N, 3, 3) as those of a base in a frame that stays with the common centre of mass.

    `covariance` (N, 3, 3) rad^2 is in odometry axes; None if the orientation is no measurement either.
    """
    count = len(stamp)
    unknown, pose = np.full((count, 3), np.nan), np.full((count, 6, 6), np.nan)
    if covariance is not None:
        pose[:, 3:, 3:] = covariance
    return BaseStream(stamp, np.zeros((count, 3)), rotation, unknown, unknown, pose, np.tile(np.eye(6), (count, 1, 1)))


def measured_orientation(imu: ImuStream | None) -> BaseStream | None:
    """Return the orientations of the base that an IMU measures; None if it measures none."""
    if imu is None:
        return None
    measured = np.isfinite(imu.rotation).all(axis=(1, 2))
    if not np.any(measured):
        return None
    base = orientation_only(imu.stamp[measured], imu.rotation[measured], imu.rotation_covariance[measured])
    declared = base.declared.copy()
    declared[:, 1] = imu.declared[measured]
    return replace(base, declared=declared)


def block_std(covariance: Array) -> Array:
    """Return the mean standard deviations (N, 2) of the linear and the angular block of covariances (N, 6, 6)."""
    variance = np.diagonal(covariance, axis1=1, axis2=2).reshape(-1, 2, 3)
    return np.asarray(np.sqrt(np.mean(variance, axis=2)))


# Variances that a sensor may declare, SI units: none is as small or large, and products keep their digits.
_SMALLEST, _LARGEST = 1e-24, 1e12


class UsableCovariance(NamedTuple):
    """A covariance (6, 6) that can weight data."""

    matrix: Array
    is_given: tuple[bool, bool]  # whether its linear and its angular block are as given
    wrong: bool  # whether a given block was not used; zeros mean not set


def usable_covariance(given: Array, default: Array) -> UsableCovariance:
    """Return a covariance that can weight data from one (6, 6) that may be unset.

    A block (linear or angular) that is not finite, symmetric, of a possible size and positive definite is replaced by
    the default's, without correlation between the two.
    """
    if _is_covariance(given):
        return UsableCovariance(given, (True, True), wrong=False)
    used, kept = default.copy(), np.zeros((6, 6))
    blocks = slice(0, 3), slice(3, 6)
    linear, angular = (_is_covariance(given[block, block]) for block in blocks)
    for block, good in zip(blocks, (linear, angular), strict=True):
        if good:
            used[block, block] = kept[block, block] = given[block, block]
    return UsableCovariance(used, (linear, angular), wrong=not np.array_equal(kept, given))


def _is_covariance(matrix: Array) -> bool:
    if not np.all(np.isfinite(matrix)) or np.max(np.abs(matrix)) > _LARGEST:
        return False
    scale = np.sqrt(np.abs(np.diag(matrix)))
    if np.any(np.diag(matrix) < _SMALLEST):
        return False
    correlation = matrix / scale / scale[:, None]
    if np.max(np.abs(correlation - correlation.T)) > 1e-6:
        return False
    return bool(np.linalg.eigvalsh(correlation)[0] > 1e-9)
