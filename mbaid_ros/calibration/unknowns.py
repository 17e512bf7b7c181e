"""The unknowns of a calibration, as one vector with one covariance: links, joints, mount of the odometry.

All of it is linear in independent normal numbers: those of the target link's prior, then those of the catalogue. The
filter sees combinations of them (in a plane, fewer than there are); the rest stays at its prior exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.calibration.iteration import CalibrationIteration
from mbaid_ros.core.errors import ModelError, ParameterError
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.state import BODY
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.estimate import PassiveJoint, Thruster
from mbaid_ros.core.robot.kernel import MomentumKernel, unknown_scale
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.model_errors import KnownErrors, to_bodies
from mbaid_ros.core.robot.momentum import body_sizes, physical, physical_jacobian, pseudo_inertia
from mbaid_ros.core.unknowns.base import OdometryMount
from mbaid_ros.core.unknowns.bodies import masses
from mbaid_ros.core.unknowns.catalogue import Uncertainty, catalogue
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.environment import Thrusters
from mbaid_ros.core.unknowns.flexible import SpringErrors, resolved
from mbaid_ros.core.unknowns.joints import JointPlacements
from mbaid_ros.core.unknowns.priors import UnknownsPrior, in_plane_map

OF_A_JOINT = ('zero', 'origin_x', 'origin_y', 'origin_z', 'tilt_1', 'tilt_2')
OF_THE_MOUNT = ('turn_x', 'turn_y', 'turn_z', 'x', 'y', 'z')


@dataclass(frozen=True, eq=False)
class Normals:
    """A Gaussian of the independent normal numbers that the prior is made of."""

    prior: Prior  # of the links, the target link first
    joints: int  # number n
    unknowns: tuple[Unknown, ...]  # all there are, as the catalogue has them: the other links first
    # of ten numbers for the target link, then of the unknowns'; the first columns of its factor, as many as there are
    # numbers, are what no window sees
    gaussian: UnknownsPrior

    @staticmethod
    def before(prior: Prior, kernel: MomentumKernel, uncertainty: Uncertainty) -> Normals:
        """Return the prior."""
        unknowns = catalogue(kernel, uncertainty)
        numbers = 10 + sum(unknown.count for unknown in unknowns)
        return Normals(prior, kernel.model.joints, unknowns, UnknownsPrior.nothing(numbers))

    def after(self, passed: CalibrationIteration, own: Variables, detector: PlaneDetector) -> Normals:
        """Return the posterior after a pass over all data.

        Parameters
        ----------
        passed : with the mean and factor of the numbers that the motions share
        own : variables of a motion
        """
        body = own.gather[own.head : own.own, BODY]
        seen = (
            in_plane_map(unknown, unknown.in_plane(detector)) if detector.planar else np.eye(unknown.count)
            for unknown in self.unknowns
        )
        combined = block_diag(body @ self.prior.roots[0], *seen)
        back = np.linalg.pinv(combined, rcond=1e-12)
        before = np.concatenate((body @ self.prior.mean[:10], np.zeros(len(combined) - len(body))))
        rest = np.eye(combined.shape[1]) - back @ combined if detector.planar else np.zeros((combined.shape[1],) * 2)
        factor = np.concatenate((rest, back @ passed.factor), axis=1)
        return Normals(self.prior, self.joints, self.unknowns, UnknownsPrior(back @ (passed.mean - before), factor))

    @cached_property
    def prior_scales(self) -> PriorScaleFactors:
        """How many times as far off as declared the numbers look, kind by kind."""
        first = self.prior.links[0].name
        causes = [f'link:{first}'] * 10
        causes += [cause for unknown in self.unknowns for cause in unknown.causes]
        parts = [*masses([first], self.prior.roots[0]), *(part for unknown in self.unknowns for part in unknown.parts)]
        factor = self.gaussian.factor
        return PriorScaleFactors.of(self.gaussian.mean, factor @ factor.T, causes, parts)

    def as_far_off(self) -> Normals:
        """Return the state with a wider prior (trajectory.md, eq. 7); unobserved directions stay."""
        mean, factor = self.gaussian.mean, self.gaussian.factor
        seen = factor[:, len(mean) :]
        return replace(
            self,
            gaussian=UnknownsPrior(mean, np.concatenate((factor, self.prior_scales.beside(seen @ seen.T)), axis=1)),
        )

    @property
    def links(self) -> UnknownsPrior:
        """Mean and covariance of the links' numbers, ten each."""
        count = len(self.prior.mean)
        return UnknownsPrior(self.gaussian.mean[:count], self.gaussian.factor[:count])

    @property
    def of_the_robot(self) -> UnknownsPrior:
        """Mean and covariance of links, joints, mount, wheels and thrusters: all but the sensors."""
        of_the_run = (unknown for unknown in self.unknowns if unknown.read and not isinstance(unknown, OdometryMount))
        count = len(self.gaussian.mean) - sum(unknown.count for unknown in of_the_run)
        return UnknownsPrior(self.gaussian.mean[:count], self.gaussian.factor[:count])

    def thrusters(self) -> tuple[Thruster, ...]:
        """Return by how much thrusters are off their commands."""
        found: list[Thruster] = []
        place = 10
        for unknown in self.unknowns:
            numbers = slice(place, place + unknown.count)
            place = numbers.stop
            if isinstance(unknown, Thrusters):
                stds = np.linalg.norm(unknown.factor @ self.gaussian.factor[numbers], axis=1)
                found += Thruster.all_of(unknown.frames, unknown.factor @ self.gaussian.mean[numbers], stds)
        return tuple(found)

    def passive_joints(self, kernel: MomentumKernel, seconds: float) -> tuple[PassiveJoint, ...]:
        """Return the passive joints of a kernel as estimated from motions so long; how far they swing is not asked."""
        springs, place = kernel.springs, 10
        value, std, prior = np.zeros((3, springs.count, 2))
        for unknown in self.unknowns:
            numbers = slice(place, place + unknown.count)
            place = numbers.stop
            if isinstance(unknown, SpringErrors):
                value = (unknown.factor @ self.gaussian.mean[numbers]).reshape(-1, 2)
                std = np.linalg.norm(unknown.factor @ self.gaussian.factor[numbers], axis=1).reshape(-1, 2)
                prior = np.linalg.norm(unknown.factor, axis=1).reshape(-1, 2)
        names = [kernel.model.joint_names[joint] for joint in springs.joints]
        declared, unasked = (springs.rate, springs.ratio, prior), np.full((3, springs.count), np.nan)
        found = resolved(springs.rate, springs.ratio, std[:, 0], seconds)
        return PassiveJoint.all_of(names, declared, value, std, unasked, found)

    def blocks(self) -> tuple[Array, Array]:
        """Return values (10 k + 6 n + 6,) and covariance of the links' standard parameters, joints and mount.

        A joint has zero (rad or m), displacement of its frame (m) and two tilts of its axis (rad), in its own axes; the
        mount a rotation vector (rad) and a position (m): all of them beside the robot description.
        """
        size = len(self.prior.mean)
        rows = np.zeros((size + 6 * self.joints + 6, len(self.gaussian.mean)))
        rows[:size, :size] = block_diag(*self.prior.roots)
        place = 10
        for unknown in self.unknowns:
            columns = slice(place, place + unknown.count)
            place = columns.stop
            if isinstance(unknown, JointPlacements):
                rows[size:-6, columns] = unknown.factor
            elif isinstance(unknown, OdometryMount):
                rows[-6:, columns] = unknown.factor
        values, factor = rows @ self.gaussian.mean, rows @ self.gaussian.factor
        values[:size] += self.prior.mean
        return values, factor @ factor.T


# Standard deviation, in typical sizes, of an unknown without a prior (as in difference).
NO_PRIOR = 100.0
_EXACT = 1e-6  # relative standard deviation of numbers declared exact: a covariance has to be regular
# Smallest eigenvalue of a pseudo-inertia, relative to the largest, that still counts as a body: flat ones are common.
_FLAT = -1e-9
# Least size of an element of inertia that its deviation is relative to, in thirds of the trace: a thin rod has zeros.
_SMALLEST = 1e-3
_ROWS = np.array([4, 4, 4, 7, 7, 9])
_COLUMNS = np.array([4, 7, 9, 7, 9, 9])


@dataclass(frozen=True)
class LinkPrior:
    """How far the values of a link's <inertial> may be off: one standard deviation; 0 means that nothing is known."""

    mass: float  # relative; the inertia goes with it
    com: float  # m, of each coordinate of the centre of mass
    inertia: float  # of the element I_ij about the centre of mass at a given mass, relative to sqrt(I_ii I_jj)
    factor: Array | None = None  # (10, e) of the covariance of the standard parameters, as the estimator declares it

    @property
    def given(self) -> Flags:
        """(10,) True for each of mass, CoM and inertia that something is known of."""
        return np.repeat([self.mass > 0.0, self.com > 0.0, self.inertia > 0.0], (1, 3, 6))


@dataclass(frozen=True)
class Prior:
    """The Gaussian prior of k links."""

    links: tuple[Link, ...]  # the unknown links
    stds: tuple[LinkPrior, ...]  # of each link, as asked for
    mean: Array  # (10 k,) standard parameters
    covariance: Array  # (10 k, 10 k), block diagonal
    given: Flags  # (k, 10) True for each of (mass, CoM, inertia) that something is known of

    @cached_property
    def roots(self) -> tuple[Array, ...]:
        """Of each link, the (10, 10) lower triangular factor of its covariance."""
        blocks = (self.covariance[start : start + 10, start : start + 10] for start in range(0, len(self.mean), 10))
        return tuple(map(_root, blocks))

    def errors(self, but: int) -> KnownErrors:
        """Return the prior of the moving bodies from all links but the first few: ten numbers a link."""
        bodies, carry = to_bodies(self.links[but:])
        return KnownErrors(bodies, carry @ block_diag(*self.roots[but:]) if bodies else np.zeros((0, 0)))


def make_prior(kernel: MomentumKernel, stds: Sequence[LinkPrior], *, scaled: bool = False) -> Prior:
    """Return the prior of a kernel's unknown links.

    Raises ModelError: The robot description gives a link an inertia that no body has.
    Raises ParameterError: Nothing fixes the scale: every massive body is unknown, and nothing is known of any mass or
    inertia.

    Parameters
    ----------
    stds : one for each of its unknown links
    scaled : whether the mass of the whole robot is known
    """
    scale = unknown_scale(kernel)[:10]
    size = 10 * len(kernel.unknown)
    mean, covariance = np.zeros(size), np.zeros((size, size))
    given = np.zeros((len(kernel.unknown), 10), dtype=bool)
    for index, (link, std) in enumerate(zip(kernel.unknown, stds, strict=True)):
        place = slice(10 * index, 10 * index + 10)
        mean[place] = link.parameters
        # A link without <inertial> has no values to be near to.
        if link.parameters[0] > 0.0 and np.any(std.given):
            given[index] = std.given
            covariance[place, place] = _covariance(link, std, scale)
        else:
            covariance[place, place] = np.diag((NO_PRIOR * scale) ** 2)
    if not (scaled or np.any(kernel.known[:, 0]) or np.any(given[:, [0, 4]])):
        raise ParameterError(
            'nothing fixes the scale: all bodies are unknown, and no mass or inertia has a prior; accepted: '
            'known_links.total_mass, prior.links.<link>.mass_relative_std for one body at least, or a body left out of '
            '--unknown'
        )
    return Prior(kernel.unknown, tuple(stds), mean, covariance, given)


def physical_std(link: Link, std: LinkPrior) -> Array:
    """Return the (10,) standard deviations of (m, r_c, I_c at that m); infinite where nothing is known."""
    values = physical(link.parameters)
    diagonal = values[[4, 7, 9]]
    floor = _SMALLEST * float(np.sum(diagonal)) / 3.0
    inertia = np.maximum(np.sqrt(np.maximum(values[_ROWS] * values[_COLUMNS], 0.0)), floor)
    deviation = np.concatenate(([std.mass * values[0]], np.full(3, std.com), std.inertia * inertia))
    return np.where(std.given, deviation, np.inf)


def _covariance(link: Link, std: LinkPrior, scale: Array) -> Array:
    """Return the (10, 10) covariance of a link's standard parameters."""
    _require_a_body(link)
    if std.factor is not None:
        exact = np.diag((_EXACT * body_sizes(link.parameters)) ** 2)
        return np.asarray(std.factor @ std.factor.T + exact)
    # Rows of unknowns without a prior vanish; the wide prior keeps the matrix regular.
    rows = physical_jacobian(link.parameters)
    if std.mass > 0.0:
        rows[4:] -= np.outer(physical(link.parameters)[4:] / link.parameters[0], rows[0])
    rows /= physical_std(link, std)[:, None]
    information = scale[:, None] * (rows.T @ rows) * scale + np.eye(10) / NO_PRIOR**2
    covariance = np.linalg.inv(information)
    return np.asarray(0.5 * (covariance + covariance.T) * scale[:, None] * scale)


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
