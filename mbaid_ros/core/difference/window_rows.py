"""The equations of each window: six in space or three in a plane, their noise, and their consider parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import Plane, PlaneDetector
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.robot.momentum import link_columns, summed_over_bodies
from mbaid_ros.core.robot.sensitivity import sensitivity
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.priors import UnknownsPrior

UNKNOWNS = 16  # ten parameters of the body, and six of the momentum
BODY, LINEAR, ANGULAR = slice(0, 10), slice(10, 13), slice(13, 16)
Counts = npt.NDArray[np.intp]
# Places in a window, from 0 to 1: the mean over both is exact for cubic polynomials.
_GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)

# Samples of a window whose mean stands for that of all, where only the width of intervals depends on it.
_ENOUGH = 50


@dataclass(frozen=True)
class Subspace:
    """A selection of the equations and a basis of the unknowns."""

    rows: Array  # (k, 6) Pi, the equations used are Pi f
    basis: Array  # (u, v) orthonormal B, the unknowns are x = B x'
    plane: Plane | None  # in the target link's frame; None in space

    @property
    def planar(self) -> bool:
        """Whether equations and unknowns out of the plane are left out."""
        return self.plane is not None

    def restricted(self, blocks: Blocks) -> Blocks:
        """Return the blocks' equations in the unknowns of this subspace."""
        return blocks.restrict(self.rows, self.basis) if self.planar else blocks

    def lift(self, covariance: Array, open_variance: Array) -> Array:
        """Return the (u, u) covariance of x from that of x' (v, v), with (u,) variances where x' has none."""
        if not self.planar:
            return covariance
        outside = np.eye(len(self.basis)) - self.basis @ self.basis.T
        return np.asarray(self.basis @ covariance @ self.basis.T + (outside * open_variance) @ outside.T)


def subspace(detector: PlaneDetector, kernel: MomentumKernel) -> Subspace:
    """Return the subspace that the motion has excited.

    In a plane: mass, first moment in the plane, moment of inertia about its normal, linear momentum in the plane and
    angular momentum about its normal.
    """
    rows, plane = detector.equation_selection(), detector.plane(kernel.target)
    if plane is None:
        return Subspace(rows, np.eye(UNKNOWNS), None)
    return Subspace(rows, np.asarray(block_diag(plane.basis, rows.T)), plane)


def window_rows(kernel: MomentumKernel, windows: list[Samples], noise: SensorNoise, origin: Array) -> Blocks:
    """Return one block of six equations f = A x + y for each window (method.md, eq. 3).

    Parameters
    ----------
    windows : K of them, none empty
    noise : of the joints; the samples hold that of the base
    origin : (3,) m, about which L_0 is taken, odometry frame

    Returns
    -------
    Blocks of K windows, 6 equations, 10 unknowns a link and 6, twice 2 n + 12 + c error sources
    """
    samples, counts = concatenated(windows)
    known, target = _mean_rows(kernel, samples, counts)
    position = mean_of_each(samples.base_position - origin, counts)
    equations = np.concatenate((target, -_transport(position)), axis=2)
    # The noise of a window's mean is the mean of its samples' over their number. Two samples at Gauss's points stand
    # for all of them: the mid one alone omits how much the equations change in a window (23 % of the variance of a fast
    # arm's estimate after a minute). Their mean weighs the mean of the errors, their difference the tilt.
    points = [_starts(counts) + np.rint(part * (counts - 1)).astype(np.intp) for part in _GAUSS]
    first, second = zip(*map(np.split, _derivatives(kernel, samples[np.concatenate(points)]), (2, 2)), strict=True)
    mean = _error_factors(samples, counts, noise, kernel.storage.noises)
    tilt = np.sqrt(_tilts(samples, counts))[..., None] * mean
    noise_known, noise_rows = (
        np.concatenate((_by_unit_errors(0.5 * (a + b), mean), _by_unit_errors(0.5 * (a - b), tilt)), axis=2)
        for a, b in zip(first, second, strict=True)
    )
    return Blocks(equations, known, noise_known[..., 0], noise_rows)


def concatenated(windows: Sequence[Samples]) -> tuple[Samples, Counts]:
    """Return the samples of K windows, none empty, and the number in each, (K,)."""
    return Samples.concatenate(windows), np.array([len(window) for window in windows])


def mean_of_each(values: Array, counts: Counts) -> Array:
    """Return the means (K, ...) of values (N, ...) over each window."""
    return np.add.reduceat(values, _starts(counts), axis=0) / counts.reshape(-1, *[1] * (values.ndim - 1))


def _starts(counts: Counts) -> Counts:
    """Return the index of each window's first sample."""
    return np.cumsum(counts) - counts


def _thinned(samples: Samples, counts: Counts) -> tuple[Samples, Counts]:
    """Return at most `_ENOUGH` samples of each window, evenly spread, and the number in each, (K,)."""
    kept = np.minimum(counts, _ENOUGH)
    if np.array_equal(kept, counts):
        return samples, counts
    each = zip(_starts(counts), counts, kept, strict=True)
    places = [first + ((np.arange(few) + 0.5) * count / few).astype(np.intp) for first, count, few in each]
    return samples[np.concatenate(places)], kept


def _mean_rows(kernel: MomentumKernel, samples: Samples, counts: Counts) -> tuple[Array, Array]:
    """Return the means of the known momentum (K, 6) and of the regressors of the k unknown links (K, 6, 10 k)."""
    states = kernel.states(samples)
    # Known thrust is momentum that neither body nor P_0, L_0 explain; about the base's origin like the rest.
    thrust = samples.impulse.copy()
    thrust[:, 3:] -= cross(samples.base_position, thrust[:, :3])
    known = states.known_momentum - thrust
    regressors = np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=2)
    if samples.tide.shape[1]:  # without the momentum that an orbit adds, the rest is constant
        known -= summed_over_bodies(states.tide, kernel.known)
        regressors -= np.concatenate([link_columns(states.tide, link) for link in kernel.unknown], axis=2)
    return mean_of_each(known, counts), mean_of_each(regressors, counts)


def _transport(position: Array) -> Array:
    """Return T with (P, L about p) = T (P_0, L_0): [[1, 0], [-[p]x, 1]], (K, 6, 6)."""
    matrix = np.zeros((len(position), 6, 6))
    matrix[:] = np.eye(6)
    matrix[:, 3:, :3] = -skew(position)
    return matrix


def _derivatives(kernel: MomentumKernel, point: Samples) -> tuple[Array, Array]:
    """Return the derivatives of K samples' equations by each measurement: of y (K, 6, z, 1), of A (K, 6, z, u).

    Order of z: joint positions and velocities, base position and orientation, base velocities, stored momentum.
    """
    states = kernel.states(point)
    derivative = sensitivity(kernel, states)
    joints, stored = kernel.model.joints, kernel.storage.count
    count, sources, bodies = len(point), 2 * joints + 12 + stored, derivative.target.shape[-1]
    known, target = np.zeros((count, 6, sources, 1)), np.zeros((count, 6, sources, bodies + 6))
    place, rest = slice(2 * joints, 2 * joints + 3), slice(2 * joints + 3, 2 * joints + 12)
    for there, here in ((slice(2 * joints), slice(2 * joints)), (rest, slice(2 * joints, None))):
        known[:, :, there, 0] = derivative.known[:, :, here]
        target[:, :, there, :bodies] = derivative.target[:, :, here]
    # Only L_0 - p x P_0 depends on the base's position: d/dp_k of -(L_0 - p x P_0) is e_k x P_0.
    target[:, 3:, place, bodies : bodies + 3] = np.swapaxes(skew(np.eye(3)), 0, 1)
    known[:, 3:, place, 0] = -skew(point.impulse[:, :3])
    if point.tide.shape[1]:  # likewise L - p x P of the momentum that an orbit adds
        known[:, 3:, place, 0] -= skew(summed_over_bodies(states.tide, kernel.known)[:, :3])
        linear = np.concatenate([link_columns(states.tide, link)[:, :3] for link in kernel.unknown], axis=-1)
        target[:, 3:, place, :bodies] -= np.moveaxis(skew(np.moveaxis(linear, 1, -1)), 1, -1)
    known[:, :, rest.stop :, 0] = kernel.storage.jacobian(states.configuration.rotation)
    return known, target


def _by_unit_errors(derivative: Array, factor: Array) -> Array:
    """Return derivatives (K, 6, z, u) by unit errors, from those by measurements with factors (K, z, z)."""
    return np.asarray(np.swapaxes(factor, 1, 2)[:, None] @ derivative)


def _tilts(samples: Samples, counts: Counts) -> Array:
    """Return the variance of the tilt of each window's errors over that of their mean, (K, z)."""
    joints = samples.joint_position.shape[1]
    tilt = np.ones((len(counts), 2 * joints + 12 + samples.stored.shape[1]))
    velocities = [*range(joints, 2 * joints), *range(2 * joints + 6, 2 * joints + 12)]
    tilt[:, velocities] = mean_of_each(samples.rate_tilt, counts)
    return tilt


def _error_factors(samples: Samples, counts: Counts, noise: SensorNoise, stored: Array) -> Array:
    """Return the (K, z, z) factors F with F F^T the covariance of the means of a window's measurements."""
    joints = samples.joint_position.shape[1]
    sources = 2 * joints + 12 + len(stored)
    factor = np.zeros((len(counts), sources, sources))
    diagonal, readings = np.arange(joints), np.arange(2 * joints + 12, sources)
    own = samples.noise[_starts(counts)].T if samples.noise.shape[1] else None
    position, velocity = (noise.joint_position, noise.joint_velocity) if own is None else own[:2, :, None]
    factor[:, diagonal, diagonal] = position
    # Rates derived from positions carry these positions' noise.
    gain = mean_of_each(samples.joint_rate_gain, counts)
    derived = position * np.sqrt(gain)
    factor[:, joints + diagonal, joints + diagonal] = np.where(np.isnan(gain), velocity, derived)
    pose, twist = slice(2 * joints, 2 * joints + 6), slice(2 * joints + 6, 2 * joints + 12)
    factor[:, readings, readings] = stored
    # White noise: the covariance of a mean is the mean covariance over the number of samples.
    factor[:, pose, pose] = np.linalg.cholesky(mean_of_each(samples.pose_covariance, counts))
    factor[:, twist, twist] = np.linalg.cholesky(mean_of_each(samples.twist_covariance, counts))
    return factor / np.sqrt(counts)[:, None, None]


class ConsiderParameters:
    """Unknowns that the equations depend on and that are not solved for (Schmidt 1966): they widen the covariance.

    They add E e to the equations of every window: e independent numbers of variance one, E the columns of the unknowns
    times a factor of their prior covariance, which a calibration may have made dependent.

    Parameters
    ----------
    kernel : of the robot at the prior's mean
    unknowns : those that the equations do not depend on are left out
    prior : joint prior of all unknowns' numbers; None where they are independent

    Attributes
    ----------
    count : number e of independent numbers
    """

    def __init__(self, kernel: MomentumKernel, unknowns: Sequence[Unknown], prior: UnknownsPrior | None = None) -> None:
        self._kernel = kernel
        self._start: Array | None = None  # of the base, about which momentum changes are counted
        self._before: dict[Unknown, tuple[float, Array, Array]] = {}  # time, rates and total at the last sample
        self._unknowns = [unknown for unknown in unknowns if unknown.in_equations]
        factor = block_diag(np.zeros((0, 0)), *(unknown.factor for unknown in self._unknowns))
        self._joint_factor: Array | None = None
        if prior is not None:
            used = np.repeat([unknown.in_equations for unknown in unknowns], [unknown.count for unknown in unknowns])
            joint = prior.factor[used]
            wide = len(joint) < joint.shape[1]
            self._joint_factor = np.asarray(np.linalg.qr(joint.T, mode='r')).T if wide else joint
            factor = factor @ self._joint_factor
        self.count = factor.shape[1]

    def columns(self, windows: Sequence[Samples], body: Array) -> Array:
        """Return the means of E over each of K windows, (K, 6, e), with a target body (10,) (m, h, I_o).

        The windows follow those of the call before.
        """
        if not self.count:
            return np.zeros((len(windows), 6, 0))
        samples, counts = concatenated(windows)
        target = self._kernel.target
        change = np.zeros_like(self._kernel.known)
        change[target.body] = express(body, target.rotation, target.position)
        kernel = self._kernel.with_body_changes(change)
        few, kept = _thinned(samples, counts)
        states = kernel.states(few)
        # What a force or torque adds up to takes every sample.
        thinned = few is not samples and any(unknown.changes_momentum for unknown in self._unknowns)
        whole = np.sum((kernel.states(samples) if thinned else states).known, axis=1)
        means = []
        for unknown in self._unknowns:
            if unknown.changes_momentum:
                means.append(mean_of_each(self._momentum_changes(unknown, samples, whole), counts) @ unknown.factor)
            else:
                means.append(mean_of_each(unknown.equation_columns(kernel, states), kept) @ unknown.factor)
        columns = np.concatenate(means, axis=2)
        return columns if self._joint_factor is None else columns @ self._joint_factor

    def _momentum_changes(self, unknown: Unknown, samples: Samples, robot: Array) -> Array:
        """Return the equations' dependence on a force since the first sample, (N, 6, k).

        `robot` holds the (N, 10) standard parameters of the whole robot about the base.
        """
        if self._start is None:
            self._start = samples.base_position[0].copy()
        place = samples.base_position - self._start
        robot = express(robot, np.broadcast_to(np.eye(3), (len(place), 3, 3)), place)
        rates = unknown.momentum_rates(robot, self._start, samples.time, samples.base_rotation)
        time, rate, total = self._before.get(unknown, (samples.time[0], rates[0], np.zeros_like(rates[0])))
        steps = np.diff(samples.time, prepend=time)[:, None, None]
        totals = total + np.cumsum(0.5 * steps * (rates + np.concatenate((rate[None], rates[:-1]))), axis=0)
        self._before[unknown] = (float(samples.time[-1]), rates[-1], totals[-1])
        columns = -totals
        columns[:, 3:] -= skew(place) @ columns[:, :3]
        return columns
