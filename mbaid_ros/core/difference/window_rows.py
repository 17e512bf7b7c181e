"""The standard form, averaged over windows: six momentum equations a window, with the noise in each of their terms.

    P_0 - P_k = m v + [w]x R h
    L_0 - L_k = m p x v + ([p]x [w]x R - [v]x R) h + R bracket(R^T w) vec(I_o)

The unknowns are x = (m, h, I_o, P_0, L_0): ten standard parameters of the target link (of each unknown link, where
there are several) and the total momentum about a fixed origin near the base. The equations are written about the base
link's origin at p, where L is L_0 - p x P_0.
The rows are averaged, not the states: they are linear in x, and a state fitted over a window would be biased.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.rows import momentum_rows
from mbaid_ros.core.robot.sensitivity import sensitivity
from mbaid_ros.core.samples import Samples, SensorNoise

UNKNOWNS = 16
BODY = slice(0, 10)
LINEAR = slice(10, 13)
ANGULAR = slice(13, 16)
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
    Blocks of K windows, 6 equations, 10 unknowns a link and 6, twice 2 n + 12 error sources
    """
    known, target = mean_rows(kernel, windows)
    position = np.array([np.mean(window.base_position - origin, axis=0) for window in windows])
    rows = np.concatenate((target, -_transport(position)), axis=2)
    # The noise of a window's mean is the mean of its samples' over their number. Two samples stand for all of them, at
    # Gauss's points: the mid one alone leaves out how much the equations change in a window (23 % of the variance of a
    # fast arm's estimate after a minute).
    points = [Samples.concatenate([window[_at(part * (len(window) - 1))] for window in windows]) for part in _GAUSS]
    halves = [_noise(kernel, kernel.states(samples), samples.impulse[:, :3], (windows, noise)) for samples in points]
    noise_known, noise_rows = (
        np.concatenate(parts, axis=2) / np.sqrt(len(_GAUSS)) for parts in zip(*halves, strict=True)
    )
    return Blocks(rows, known, noise_known, noise_rows)


def mean_rows(kernel: MomentumKernel, windows: list[Samples]) -> tuple[Array, Array]:
    """Return the means of the known momentum (K, 6) and of the regressors of the k unknown links (K, 6, 10 k)."""
    samples = Samples.concatenate(windows)
    rows = momentum_rows(kernel, samples)
    # Known thrust is momentum that the body and P_0, L_0 need not explain; about the base's origin like the rest.
    thrust = samples.impulse.copy()
    thrust[:, 3:] -= cross(samples.base_position, thrust[:, :3])
    counts = np.array([len(window) for window in windows])
    starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
    means = (np.add.reduceat(values, starts, axis=-1) / counts for values in (rows.known - thrust.T, *rows.regressors))
    known, *regressors = (np.moveaxis(mean, -1, 0) for mean in means)
    return known, np.concatenate(regressors, axis=2)


def _at(place: float) -> slice:
    """Return the slice of one sample."""
    return slice(round(place), round(place) + 1)


def _transport(position: Array) -> Array:
    """Return T with (P, L about p) = T (P_0, L_0): [[1, 0], [-[p]x, 1]], (K, 6, 6)."""
    matrix = np.zeros((len(position), 6, 6))
    matrix[:] = np.eye(6)
    matrix[:, 3:, :3] = -skew(position)
    return matrix


def _noise(
    kernel: MomentumKernel, states: BodyStates, brought: Array, data: tuple[list[Samples], SensorNoise]
) -> tuple[Array, Array]:
    """Return G0 (K, 6, z) and G1 (K, 6, z, u): derivatives at one sample of each window by unit errors of its means.

    `brought` is the linear momentum (K, 3) by known thrust there.
    """
    windows, noise = data
    derivative = sensitivity(kernel, states)
    joints = kernel.model.joints
    count = len(windows)
    sources = 2 * joints + 12
    bodies = derivative.target.shape[-1]
    # Order of the errors: joint positions, joint velocities, base position, orientation, linear, angular velocity.
    place = np.concatenate((np.arange(2 * joints), np.arange(2 * joints + 3, sources)))
    known = np.zeros((count, 6, sources))
    target = np.zeros((count, 6, sources, bodies + 6))
    known[..., place] = derivative.known
    target[:, :, place, :bodies] = derivative.target
    # Only L_0 - p x P_0 depends on the base's position: d/dp_k of -(L_0 - p x P_0) is e_k x P_0.
    target[:, 3:, 2 * joints : 2 * joints + 3, bodies : bodies + 3] = np.swapaxes(skew(np.eye(3)), 0, 1)
    known[:, 3:, 2 * joints : 2 * joints + 3] = -skew(brought)
    factor = _error_factors(windows, joints, noise)
    # In the order that the solver goes through them, thousands of times.
    return known @ factor, np.ascontiguousarray(np.swapaxes(np.swapaxes(target, 2, 3) @ factor[:, None], 2, 3))


def _error_factors(windows: list[Samples], joints: int, noise: SensorNoise) -> Array:
    """Return the (K, z, z) factors F with F F^T the covariance of the means of a window's measurements."""
    count = len(windows)
    sources = 2 * joints + 12
    factor = np.zeros((count, sources, sources))
    diagonal = np.arange(joints)
    factor[:, diagonal, diagonal] = noise.joint_position
    # Rates taken from positions carry these positions' noise.
    gain = np.array([np.mean(window.joint_rate_gain, axis=0) for window in windows]).reshape(count, joints)
    derived = noise.joint_position * np.sqrt(gain)
    factor[:, joints + diagonal, joints + diagonal] = np.where(np.isnan(gain), noise.joint_velocity, derived)
    pose, twist = slice(2 * joints, 2 * joints + 6), slice(2 * joints + 6, sources)
    # White noise: the covariance of a mean is the mean covariance over the number of samples.
    pose_covariance = np.array([np.mean(window.pose_covariance, axis=0) for window in windows])
    twist_covariance = np.array([np.mean(window.twist_covariance, axis=0) for window in windows])
    factor[:, pose, pose] = np.linalg.cholesky(pose_covariance)
    factor[:, twist, twist] = np.linalg.cholesky(twist_covariance)
    counts = np.array([len(window) for window in windows])
    return factor / np.sqrt(counts)[:, None, None]
