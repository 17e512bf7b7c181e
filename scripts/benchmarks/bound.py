"""The Cramér-Rao bound of the per-sample model: the accuracy that no unbiased estimator of its kind can surpass.

Every sample is taken as six (in a plane three) momentum equations of its own, with the noise of its own sensors in each
of their terms; unknown are the body and the total momentum. The bound is the inverse of the information of all samples
at the truth. An estimator that links the samples, by integrating velocities into poses, knows more and may lie below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.data import Case, exact_samples, kernel, momentum_of
from mbaid_ros.core.difference.errors_in_variables import maximum_likelihood
from mbaid_ros.core.difference.window_rows import Subspace, subspace, window_rows
from mbaid_ros.core.geometry import Array, Flags, cross
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import physical_jacobian
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.simulation import Truth

_BATCH = 500


@dataclass(frozen=True)
class Told:
    """What a motion can tell.

    Attributes
    ----------
    samples : without noise, with the covariances of noisy ones
    momentum : (6,) true total, about the first position of the base, as in the rows
    space : equations that hold, and a basis of body and momentum
    jacobian : (10, v) of the physical parameters by the basis's coordinates
    known : (10,) True for what depends on nothing that the motion leaves open
    """

    samples: Samples
    momentum: Array
    space: Subspace
    jacobian: Array
    known: Flags


def told_by(case: Case, truth: Truth) -> Told:
    """Return what a motion can tell.

    Parameters
    ----------
    case : robot and noise
    truth : its motion
    """
    robot = kernel(case.robot)
    samples = exact_samples(truth, case.noise)
    detector = PlaneDetector(robot.model)
    detector.update(samples)
    space = subspace(detector, robot)
    momentum = momentum_of(case.robot, truth)
    momentum[3:] -= cross(truth.base_position[0], momentum[:3])
    full = physical_jacobian(robot.target.parameters)
    jacobian = full @ space.basis[:10]
    known = np.all(np.abs(full - jacobian @ space.basis[:10].T) < 1e-9, axis=1)
    return Told(samples, momentum, space, jacobian, known)


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
    told = told_by(case, truth)
    samples, origin = told.samples, truth.base_position[0]
    unknowns = told.space.basis.T @ np.concatenate((robot.target.parameters, told.momentum))

    result = np.full((len(times), 10), np.nan)
    information: Array = np.zeros((len(unknowns), len(unknowns)))
    done = 0
    for row, time in enumerate(times):
        end = int(np.searchsorted(samples.time, time - 1e-9))
        for start in range(done, end, _BATCH):
            chosen = range(start, min(start + _BATCH, end))
            blocks = window_rows(robot, [samples[k : k + 1] for k in chosen], case.noise, origin)
            information = information + maximum_likelihood(told.space.of(blocks), unknowns).information
        done = end
        size = 1.0 / np.sqrt(np.diag(information))
        covariance = np.linalg.inv(information * size * size[:, None]) * size * size[:, None]
        result[row] = np.where(told.known, np.sqrt(np.diag(told.jacobian @ covariance @ told.jacobian.T)), np.nan)
    return result
