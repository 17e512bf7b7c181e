"""Which equations hold and which unknowns they can tell: everything in space, seven numbers in a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum_rows import MomentumRows, momentum_rows
from mbaid_ros.core.robot.orbit import of_bodies, of_link
from mbaid_ros.core.robot.planar import Plane, PlaneDetector
from mbaid_ros.core.robot.sensitivity import sensitivity
from mbaid_ros.core.samples import Samples, SensorNoise


@dataclass(frozen=True)
class Subspace:
    """A selection of the equations and a basis of the unknowns.

    Attributes
    ----------
    rows : (k, 6) Pi, the equations used are Pi f
    basis : (u, v) orthonormal B, the unknowns are x = B x'
    plane : in the target link's frame; None in space
    """

    rows: Array
    basis: Array
    plane: Plane | None

    @property
    def planar(self) -> bool:
        """Whether equations and unknowns out of the plane are left out."""
        return self.plane is not None

    def of(self, blocks: Blocks) -> Blocks:
        """Return the blocks' equations in the unknowns of this subspace."""
        return blocks.restrict(self.rows, self.basis) if self.planar else blocks

    def lift(self, covariance: Array, open_variance: Array) -> Array:
        """Return the (..., u, u) covariance of all unknowns, with a given variance where nothing is known.

        Parameters
        ----------
        covariance : (..., v, v) of x'
        open_variance : (u,)
        """
        if not self.planar:
            return covariance
        outside = np.eye(len(self.basis)) - self.basis @ self.basis.T
        return np.asarray(self.basis @ covariance @ self.basis.T + (outside * open_variance) @ outside.T)


def subspace(detector: PlaneDetector, kernel: MomentumKernel) -> Subspace:
    """Return the subspace that the motion seen so far allows.

    In a plane: mass, first moment in the plane, moment of inertia about its normal, linear momentum in the plane and
    angular momentum about its normal.

    Parameters
    ----------
    detector : PlaneDetector
    kernel : MomentumKernel
    """
    rows, plane = detector.rows(), detector.plane(kernel.target)
    if plane is None:
        return Subspace(rows, np.eye(UNKNOWNS), None)
    return Subspace(rows, np.asarray(block_diag(plane.basis, rows.T)), plane)


UNKNOWNS = 16  # ten parameters of the body, and six of the momentum
BODY = slice(0, 10)
LINEAR = slice(10, 13)
ANGULAR = slice(13, 16)
Counts = npt.NDArray[np.intp]
# Places in a window, from 0 to 1: the mean over both is exact for cubic polynomials.
_GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)


def window_rows(kernel: MomentumKernel, windows: list[Samples], noise: SensorNoise, origin: Array) -> Blocks:
    """Return one block of six equations a window.

    Parameters
    ----------
    kernel : MomentumKernel
    windows : list of K Samples, none empty
    noise : of the joints; the base's stands in the samples
    origin : (3,) m, about which L_0 is taken, odometry frame

    Returns
    -------
    Blocks of K windows, 6 equations, 10 unknowns a link and 6, twice 2 n + 12 + c error sources
    """
    samples, counts = joined(windows)
    rows = momentum_rows(kernel, samples)
    known, target = _mean_rows(rows, samples, counts)
    position = mean_of_each(samples.base_position - origin, counts)
    equations = np.concatenate((target, -_transport(position)), axis=2)  # f = A x + y (docs/method.md, eq. 3)
    # The noise of a window's mean is the mean of its samples' over their number. Two samples stand for all of them, at
    # Gauss's points: the mid one alone leaves out how much the equations change in a window (23 % of the variance of a
    # fast arm's estimate after a minute). What they have in common weighs the errors' mean, their difference the tilt.
    points = [starts_of(counts) + np.rint(part * (counts - 1)).astype(np.intp) for part in _GAUSS]
    first, second = zip(*map(np.split, _derivatives(kernel, samples[np.concatenate(points)]), (2, 2)), strict=True)
    mean = _error_factors(samples, counts, noise, kernel.storage.noises)
    tilt = np.sqrt(_tilts(samples, counts))[..., None] * mean
    noise_known, noise_rows = (
        np.concatenate((_by_errors(0.5 * (one + other), mean), _by_errors(0.5 * (one - other), tilt)), axis=2)
        for one, other in zip(first, second, strict=True)
    )
    return Blocks(equations, known, noise_known[..., 0], noise_rows)


def joined(windows: Sequence[Samples]) -> tuple[Samples, Counts]:
    """Return the samples of K windows, none empty, and how many each has, (K,)."""
    return Samples.concatenate(windows), np.array([len(window) for window in windows])


def mean_of_each(values: Array, counts: Counts) -> Array:
    """Return the means (K, ...) of values (N, ...) over each window."""
    return sum_of_each(values, counts) / counts.reshape(-1, *[1] * (values.ndim - 1))


def sum_of_each(values: Array, counts: Counts) -> Array:
    """Return the sums (K, ...) of values (N, ...) over each window."""
    return np.add.reduceat(values, starts_of(counts), axis=0)


def starts_of(counts: Counts) -> Counts:
    """Return the place of each window's first sample."""
    return np.cumsum(counts) - counts


def _mean_rows(rows: MomentumRows, samples: Samples, counts: Counts) -> tuple[Array, Array]:
    """Return the means of the known momentum (K, 6) and of the regressors of the k unknown links (K, 6, 10 k).

    Parameters
    ----------
    rows : of the samples
    samples, counts : of K windows, as `joined` has them
    """
    # Known thrust is momentum that the body and P_0, L_0 need not explain; about the base's origin like the rest.
    thrust = samples.impulse.copy()
    thrust[:, 3:] -= cross(samples.base_position, thrust[:, :3])
    starts = starts_of(counts)
    means = (np.add.reduceat(values, starts, axis=-1) / counts for values in (rows.known - thrust.T, *rows.regressors))
    known, *regressors = (np.moveaxis(mean, -1, 0) for mean in means)
    return known, np.concatenate(regressors, axis=2)


def _transport(position: Array) -> Array:
    """Return T with (P, L about p) = T (P_0, L_0): [[1, 0], [-[p]x, 1]], (K, 6, 6)."""
    matrix = np.zeros((len(position), 6, 6))
    matrix[:] = np.eye(6)
    matrix[:, 3:, :3] = -skew(position)
    return matrix


def _derivatives(kernel: MomentumKernel, point: Samples) -> tuple[Array, Array]:
    """Return how K samples' equations change with each measured quantity: y (K, 6, z, 1) and A (K, 6, z, u).

    Their order: joint positions, joint velocities, base position, orientation, linear, angular velocity, what is read
    of what stores momentum.
    """
    states = kernel.states(point)
    derivative = sensitivity(kernel, states)
    joints, stored = kernel.model.joints, kernel.storage.count
    count, sources, bodies = len(point), 2 * joints + 12 + stored, derivative.target.shape[-1]
    known = np.zeros((count, 6, sources, 1))
    target = np.zeros((count, 6, sources, bodies + 6))
    # The base's position comes between the joints and the rest.
    rest = slice(2 * joints + 3, 2 * joints + 12)
    for there, here in ((slice(2 * joints), slice(2 * joints)), (rest, slice(2 * joints, None))):
        known[:, :, there, 0] = derivative.known[:, :, here]
        target[:, :, there, :bodies] = derivative.target[:, :, here]
    # Only L_0 - p x P_0 depends on the base's position: d/dp_k of -(L_0 - p x P_0) is e_k x P_0.
    target[:, 3:, 2 * joints : 2 * joints + 3, bodies : bodies + 3] = np.swapaxes(skew(np.eye(3)), 0, 1)
    known[:, 3:, 2 * joints : 2 * joints + 3, 0] = -skew(point.impulse[:, :3])
    if point.tide.shape[1]:
        # Likewise L - p x P of what an orbit has brought.
        place = slice(2 * joints, 2 * joints + 3)
        known[:, 3:, place, 0] -= skew(of_bodies(states.tide, kernel.known)[:, :3])
        linear = np.concatenate([of_link(states.tide, link)[:, :3] for link in kernel.unknown], axis=-1)
        target[:, 3:, place, :bodies] -= np.moveaxis(skew(np.moveaxis(linear, 1, -1)), 1, -1)
    known[:, :, rest.stop :, 0] = kernel.storage.columns(states.configuration.rotation)
    return known, target


def _by_errors(derivative: Array, factor: Array) -> Array:
    """Return derivatives (K, 6, z, u) by unit errors, from those by what they are factors (K, z, z) of."""
    return np.asarray(np.swapaxes(factor, 1, 2)[:, None] @ derivative)


def _tilts(samples: Samples, counts: Counts) -> Array:
    """Return the variance of the tilt of each window's errors over that of their mean, (K, z)."""
    joints = samples.joint_position.shape[1]
    tilt = np.ones((len(counts), 2 * joints + 12 + samples.stored.shape[1]))
    tilt[:, [*range(joints, 2 * joints), *range(2 * joints + 6, 2 * joints + 12)]] = mean_of_each(
        samples.rate_tilt, counts
    )
    return tilt


def _error_factors(samples: Samples, counts: Counts, noise: SensorNoise, stored: Array) -> Array:
    """Return the (K, z, z) factors F with F F^T the covariance of the means of a window's measurements."""
    joints = samples.joint_position.shape[1]
    sources = 2 * joints + 12 + len(stored)
    factor = np.zeros((len(counts), sources, sources))
    diagonal = np.arange(joints)
    own = samples.noise[starts_of(counts)].T if samples.noise.shape[1] else None
    position, velocity = (noise.joint_position, noise.joint_velocity) if own is None else own[:2, :, None]
    factor[:, diagonal, diagonal] = position
    # Rates taken from positions carry these positions' noise.
    gain = mean_of_each(samples.joint_rate_gain, counts)
    derived = position * np.sqrt(gain)
    factor[:, joints + diagonal, joints + diagonal] = np.where(np.isnan(gain), velocity, derived)
    pose, twist = slice(2 * joints, 2 * joints + 6), slice(2 * joints + 6, 2 * joints + 12)
    readings = np.arange(twist.stop, sources)
    factor[:, readings, readings] = stored
    # White noise: the covariance of a mean is the mean covariance over the number of samples.
    factor[:, pose, pose] = np.linalg.cholesky(mean_of_each(samples.pose_covariance, counts))
    factor[:, twist, twist] = np.linalg.cholesky(mean_of_each(samples.twist_covariance, counts))
    return factor / np.sqrt(counts)[:, None, None]
