"""The known side of a robot as a calibration has left it: one covariance of bodies, joints and mount together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.model_errors import KnownErrors, to_bodies
from mbaid_ros.core.unknowns.catalogue import Uncertainty, of_sensors, pushing, wandering
from mbaid_ros.core.unknowns.priors import UnknownsPrior

_LEAST_STD = 1e-6  # least standard deviation of a number in its unit: exact beside others of the same unknown


@dataclass(frozen=True, eq=False)
class CalibratedSide:
    """What a calibration has found beside the robot description that has its bodies, origins and axes already.

    Attributes
    ----------
    links : k of them
    zeros : (n,) rad or m, what is added to the measured joint positions
    mount : (6,) the base's frame in the one that the odometry locates: rotation vector (rad), position (m)
    covariance : (10 k + 6 n + 6,) squared: standard parameters of the links, each in its own frame; of each joint zero,
        displacement of its frame and tilts of its axis; mount
    """

    links: tuple[Link, ...]
    zeros: Array
    mount: Array
    covariance: Array

    def known_to(self, kernel: MomentumKernel, uncertainty: Uncertainty) -> tuple[MomentumKernel, Uncertainty]:
        """Return a kernel and what is uncertain of its known side, for the catalogue: all of it with its correlations.

        Parameters
        ----------
        kernel : of the robot, with its target
        uncertainty : of what no calibration speaks of
        """
        joints = kernel.model.joints
        bodies, carry = to_bodies(self.links, [link.name for link in kernel.unknown])
        whole = block_diag(carry, np.eye(6 * joints + 6))
        covariance, mount = whole @ self.covariance @ whole.T, self.mount
        if uncertainty.gyro is not None and uncertainty.gyro.alone:
            # No poses are measured: there is nothing that is mounted elsewhere than the base's own frame.
            covariance[-6:] = covariance[:, -6:] = 0.0
            mount = np.zeros(6)
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        of_bodies = deviations[: len(carry)]
        each = deviations[len(carry) : -6].reshape(joints, 6)
        zeros, origins, axes = (_size(part) for part in (each[:, :1], each[:, 1:4], each[:, 4:]))
        orientation, position = _size(deviations[-6:].reshape(2, 3))
        units = np.concatenate(
            (
                of_bodies,
                np.column_stack((zeros, *(origins,) * 3, *(axes,) * 2)).ravel(),
                np.repeat((orientation, position), 3),
            )
        )
        values = np.concatenate((np.zeros(len(carry)), np.zeros(6 * joints), mount))
        values[len(carry) : -6 : 6] = self.zeros
        known = _gaussian(values, covariance, units)
        others = int(np.count_nonzero(uncertainty.spin_inertias)) + pushing(uncertainty).count
        others += wandering(kernel, uncertainty).count
        known = known.beside(others, before=int(np.count_nonzero(units[:-6])))
        sensing = sum(unknown.count for unknown in of_sensors(uncertainty))
        known = known.beside(sensing, before=len(known.mean))
        doubted = kernel.with_uncertainty(KnownErrors(bodies, np.diag(of_bodies)[:, of_bodies > 0.0]))
        return doubted, replace(
            uncertainty,
            zeros=zeros.tolist(),
            origins=origins.tolist(),
            axes=axes.tolist(),
            mount_position=float(position),
            mount_orientation=float(orientation),
            carried=known,
        )


def _size(deviations: Array) -> Array:
    """Return the root mean square of each row."""
    return np.sqrt(np.mean(deviations**2, axis=-1))


def _gaussian(values: Array, covariance: Array, units: Array) -> UnknownsPrior:
    """Return numbers in their units with a factor of their covariance; those without a unit are left out."""
    uncertain = units > 0.0
    own = units[uncertain]
    scaled = covariance[np.ix_(uncertain, uncertain)] / own / own[:, None]
    size = np.maximum(np.sqrt(np.maximum(np.diag(scaled), 0.0)), _LEAST_STD)
    eigenvalues, vectors = np.linalg.eigh(scaled / size / size[:, None])
    return UnknownsPrior(values[uncertain] / own, size[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))
