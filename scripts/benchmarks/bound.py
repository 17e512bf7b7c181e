"""The Cramér-Rao bound of the per-sample model: the accuracy that no unbiased estimator of its kind can surpass.

Every sample is taken as six (in a plane three) momentum equations of its own, with the noise of its own sensors in each
of their terms; unknown are the body and the total momentum. The bound is the inverse of the information of all samples
at the truth. An estimator that links the samples, by integrating velocities into poses, knows more and may lie below.
"""

from __future__ import annotations

import numpy as np

from benchmarks.data import Case, exact_samples, kernel, momentum_of
from mbaid_ros.core.difference.errors_in_variables import maximum_likelihood
from mbaid_ros.core.difference.subspace import subspace
from mbaid_ros.core.difference.window_rows import window_rows
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.robot.inertia import physical_jacobian
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.simulation.run import Truth

_BATCH = 500


def bound(case: Case, truth: Truth, times: tuple[float, ...]) -> Array:
    """Return the smallest standard deviation of the ten physical parameters after each of some times.

    Parameters
    ----------
    case : robot and noise
    truth : its motion
    times : s

    Returns
    -------
    (len(times), 10) array; NaN for what the motion leaves open
    """
    robot = kernel(case.robot)
    samples = exact_samples(truth, case.noise)
    detector = PlaneDetector(robot.model)
    detector.update(samples)
    space = subspace(detector, robot)
    # Angular momentum about the first position of the base, as in the rows.
    momentum = momentum_of(case.robot, truth)
    origin = truth.base_position[0]
    momentum[3:] -= cross(origin, momentum[:3])
    unknowns = space.basis.T @ np.concatenate((robot.target.parameters, momentum))
    full = physical_jacobian(robot.target.parameters)
    jacobian = full @ space.basis[:10]
    # Known is what depends on nothing that the motion leaves open.
    known = np.all(np.abs(full - jacobian @ space.basis[:10].T) < 1e-9, axis=1)

    result = np.full((len(times), 10), np.nan)
    information: Array = np.zeros((len(unknowns), len(unknowns)))
    done = 0
    for row, time in enumerate(times):
        end = int(np.searchsorted(samples.time, time - 1e-9))
        for start in range(done, end, _BATCH):
            chosen = range(start, min(start + _BATCH, end))
            blocks = window_rows(robot, [samples[k : k + 1] for k in chosen], case.noise, origin)
            information = information + maximum_likelihood(space.of(blocks), unknowns).information
        done = end
        size = 1.0 / np.sqrt(np.diag(information))
        covariance = np.linalg.inv(information * size * size[:, None]) * size * size[:, None]
        result[row] = np.where(known, np.sqrt(np.diag(jacobian @ covariance @ jacobian.T)), np.nan)
    return result
