"""The unknowns of a calibration, as one vector with one covariance: links, joints, mount of the odometry.

All of it is linear in independent normal numbers: those of the target link's prior, then those of the unknowns. The
filter sees combinations of them (in a plane, fewer than there are); the rest stays at its prior exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.calibration.iteration import CalibrationIteration
from mbaid_ros.core.contracts import Unknown
from mbaid_ros.core.filter.posterior import VarianceComponents
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.model import JointPlacements
from mbaid_ros.core.links import links_to_bodies, masses
from mbaid_ros.core.method import estimates_of
from mbaid_ros.core.odometry.model import OdometryMount
from mbaid_ros.core.passive import SpringErrors, passive_joints, resolved
from mbaid_ros.core.results.estimate import PassiveJoint
from mbaid_ros.core.robot.body import body_sizes, physical, pseudo_inertia
from mbaid_ros.core.robot.model import Link, PlaneDetector
from mbaid_ros.core.robot.momentum import KnownErrors, MomentumKernel, unknown_scale
from mbaid_ros.core.state import BODY, UnknownsPrior, Variables, in_plane_map
from mbaid_ros.errors import ModelError

U = TypeVar('U', bound=Unknown)

LINK_UNKNOWNS = ('m', 'hx', 'hy', 'hz', 'Ixx', 'Ixy', 'Ixz', 'Iyy', 'Iyz', 'Izz')
JOINT_UNKNOWNS = ('zero', 'origin_x', 'origin_y', 'origin_z', 'tilt_1', 'tilt_2')
MOUNT_UNKNOWNS = ('turn_x', 'turn_y', 'turn_z', 'x', 'y', 'z')


@dataclass(frozen=True, eq=False)
class StandardNormals:
    """A Gaussian of the independent normal numbers that the prior is made of."""

    prior: Prior  # of the links, the target link first
    joints: int  # number n
    unknowns: tuple[Unknown, ...]  # all there are, in the order of the catalogue: the other links first
    # of ten numbers for the target link, then of the unknowns'; the first columns of its factor, as many as there are
    # numbers, are what no window sees
    gaussian: UnknownsPrior

    @staticmethod
    def from_prior(prior: Prior, kernel: MomentumKernel, unknowns: tuple[Unknown, ...]) -> StandardNormals:
        """Return the prior."""
        numbers = 10 + sum(unknown.count for unknown in unknowns)
        return StandardNormals(prior, kernel.model.joints, unknowns, UnknownsPrior.standard_normal(numbers))

    def conditioned(self, iteration: CalibrationIteration, own: Variables, detector: PlaneDetector) -> StandardNormals:
        """Return the posterior after an iteration over all data.

        Parameters
        ----------
        iteration : with the mean and factor of the numbers that the motions share
        own : variables of a motion
        """
        body = own.from_state[own.moving : own.first_unknown, BODY]
        seen = (
            in_plane_map(unknown, unknown.in_plane(detector)) if detector.planar else np.eye(unknown.count)
            for unknown in self.unknowns
        )
        combined = block_diag(body @ self.prior.roots[0], *seen)
        back = np.linalg.pinv(combined, rcond=1e-12)
        before = np.concatenate((body @ self.prior.mean[:10], np.zeros(len(combined) - len(body))))
        rest = np.eye(combined.shape[1]) - back @ combined if detector.planar else np.zeros((combined.shape[1],) * 2)
        factor = np.concatenate((rest, back @ iteration.factor), axis=1)
        return replace(self, gaussian=UnknownsPrior(back @ (iteration.mean - before), factor))

    @cached_property
    def prior_scales(self) -> VarianceComponents:
        """Prior scale factors of the numbers, kind by kind."""
        first = self.prior.links[0].name
        causes = [f'link:{first}'] * 10
        causes += [cause for unknown in self.unknowns for cause in unknown.causes]
        parts = [*masses([first], self.prior.roots[0]), *(part for unknown in self.unknowns for part in unknown.parts)]
        factor = self.gaussian.factor
        return VarianceComponents.from_posterior(self.gaussian.mean, factor @ factor.T, causes, parts)

    def with_scaled_prior(self) -> StandardNormals:
        """Return the Gaussian with a scaled prior (intervals.md, eq. 4); unobserved directions stay."""
        mean, factor = self.gaussian.mean, self.gaussian.factor
        seen = factor[:, len(mean) :]
        return replace(
            self,
            gaussian=UnknownsPrior(mean, np.hstack((factor, self.prior_scales.added_columns(seen @ seen.T)))),
        )

    @property
    def of_the_robot(self) -> UnknownsPrior:
        """Mean and covariance of links, joints, mount, wheels and thrusters: all but the sensors."""
        of_the_run = (each for each in self.unknowns if each.of_measurement and not each.calibrated)
        count = len(self.gaussian.mean) - sum(unknown.count for unknown in of_the_run)
        return UnknownsPrior(self.gaussian.mean[:count], self.gaussian.factor[:count])

    def values_of(self, kind: type[U]) -> Iterator[tuple[U, Array, Array]]:
        """Yield the unknowns of a kind, with their (k,) values and standard deviations."""
        return estimates_of(kind, self._numbers(), self.gaussian.mean, np.linalg.norm(self.gaussian.factor, axis=1))

    def _numbers(self) -> Iterator[tuple[Unknown, slice]]:
        """Yield each unknown, and the place of its independent numbers."""
        ends = 10 + np.cumsum([unknown.count for unknown in self.unknowns], dtype=int)
        for unknown, end in zip(self.unknowns, ends.tolist(), strict=True):
            yield unknown, slice(end - unknown.count, end)

    def passive_joints(self, kernel: MomentumKernel, seconds: float) -> tuple[PassiveJoint, ...]:
        """Return the passive joints of a kernel as estimated from motions so long; how far they swing is not asked."""
        springs, estimated = kernel.springs, list(self.values_of(SpringErrors))
        relative = estimated[0][2][::2] if estimated else np.zeros(springs.count)
        found = resolved(springs.frequency, springs.damping_ratio, relative, seconds)
        return passive_joints(estimated, kernel, np.full((3, springs.count), np.nan), found)

    def blocks(self) -> tuple[Array, Array]:
        """Return values (10 k + 6 n + 6,) and covariance of the links' standard parameters, joints and mount.

        A joint has zero (rad or m), displacement of its frame (m) and two tilts of its axis (rad), in its own axes; the
        mount a rotation vector (rad) and a position (m): all of them beside the robot description.
        """
        size = len(self.prior.mean)
        rows = np.zeros((size + 6 * self.joints + 6, len(self.gaussian.mean)))
        rows[:size, :size] = block_diag(*self.prior.roots)
        for unknown, columns in self._numbers():
            if isinstance(unknown, JointPlacements):
                rows[size:-6, columns] = unknown.factor
            elif isinstance(unknown, OdometryMount):
                rows[-6:, columns] = unknown.factor
        values, factor = rows @ self.gaussian.mean, rows @ self.gaussian.factor
        values[:size] += self.prior.mean
        return values, factor @ factor.T


# Standard deviation, in typical sizes, of an unknown without a prior (as in difference).
NO_PRIOR = 100.0
_EXACT = 1e-6  # relative standard deviation of numbers specified exact: a covariance has to be regular
# Smallest eigenvalue of a pseudo-inertia, relative to the largest, that still counts as a body: flat ones are common.
_FLAT = -1e-9


@dataclass(frozen=True)
class Prior:
    """The Gaussian prior of k links."""

    links: tuple[Link, ...]  # the unknown links
    mean: Array  # (10 k,) standard parameters
    covariance: Array  # (10 k, 10 k), block diagonal
    given: tuple[bool, ...]  # k, whether anything is known of each

    @cached_property
    def roots(self) -> tuple[Array, ...]:
        """Of each link, the (10, 10) lower triangular factor of its covariance."""
        blocks = (self.covariance[start : start + 10, start : start + 10] for start in range(0, len(self.mean), 10))
        return tuple(map(_root, blocks))

    def errors(self, but: int) -> KnownErrors:
        """Return the prior of the moving bodies from all links but the first few: ten numbers a link."""
        bodies, carry = links_to_bodies(self.links[but:])
        return KnownErrors(bodies, carry @ block_diag(*self.roots[but:]) if bodies else np.zeros((0, 0)))


def make_prior(kernel: MomentumKernel, factors: Sequence[Array | None]) -> Prior:
    """Return the prior of a kernel's unknown links.

    Raises ModelError: The robot description gives a link an inertia that no body has.

    Parameters
    ----------
    factors : (10, e) of the covariance of each link's standard parameters; None where nothing is known
    """
    blocks = [
        np.diag((NO_PRIOR * unknown_scale(kernel)[:10]) ** 2) if factor is None else _covariance(link, factor)
        for link, factor in zip(kernel.unknown, factors, strict=True)
    ]
    mean = np.concatenate([link.parameters for link in kernel.unknown])
    return Prior(kernel.unknown, mean, block_diag(*blocks), tuple(factor is not None for factor in factors))


def _covariance(link: Link, factor: Array) -> Array:
    """Return the (10, 10) covariance of a link's standard parameters, regular also where they are exact."""
    _require_a_body(link)
    return np.asarray(factor @ factor.T + np.diag((_EXACT * body_sizes(link.parameters)) ** 2))


def _root(covariance: Array) -> Array:
    """Return the lower triangular factor of a covariance whose entries differ widely in size."""
    size = np.sqrt(np.diag(covariance))
    return np.asarray(size[:, None] * np.linalg.cholesky(covariance / size / size[:, None]))


def _require_a_body(link: Link) -> None:
    """Refuse an <inertial> that no distribution of mass has: there is nothing to be near to.

    Raises ModelError: It is none.
    """
    values = physical(link.parameters)
    about_com = np.concatenate((values[:1], np.zeros(3), values[4:]))
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(about_com)[:3, :3])
    if eigenvalues[0] < _FLAT * max(eigenvalues[-1], 0.0) or eigenvalues[-1] <= 0.0:
        shown = ', '.join(f'{name} {value:g}' for name, value in zip(_NAMES, values[4:], strict=True))
        raise ModelError(
            f"link '{link.name}' has an inertia that no body has ({shown} kg m^2 about its centre of mass): no prior; "
            'accepted: principal moments that are positive and none larger than the sum of the other two'
        )


_NAMES = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
