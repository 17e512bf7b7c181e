"""The result of a calibration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.calibration.unknowns import Prior
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.estimate import PassiveJoint, Thruster
from mbaid_ros.core.robot.body import InertiaRatios, inertia_ratios, physical, physical_jacobian
from mbaid_ros.core.robot.model import Kinematics
from mbaid_ros.core.robot.momentum import MomentumKernel

# Part of a prior variance that the data have to take away for a value to count as theirs.
_MOVED = 0.5


@dataclass(frozen=True)
class LinkResult:
    """One link before and after."""

    name: str  # of the link
    # (10,) mass, CoM in the link's frame, inertia about it in link axes, as in the robot description; NaN without
    cad: Array
    parameters: Array  # (10,) the same, calibrated
    covariance: Array  # (10, 10) of these
    prior_std: Array  # (10,) before the data; infinite where nothing was known
    consistency_correction: float  # size of the projection on a body that can exist, in standard deviations; 0 is none

    @property
    def std(self) -> Array:
        """One standard deviation of each parameter after the data, (10,)."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def ratios(self) -> InertiaRatios:
        """The ratios of its moments of inertia after the data."""
        return inertia_ratios(self.parameters, self.covariance)

    @property
    def variance_reduction(self) -> Array:
        """Part of each parameter's prior variance that the data took away, (10,): 0 nothing, 1 all of it."""
        return np.clip(1.0 - (self.std / self.prior_std) ** 2, 0.0, 1.0)

    @property
    def shift_in_prior_stds(self) -> Array:
        """How far the data moved each parameter, in standard deviations of the prior, (10,); NaN without a prior."""
        with np.errstate(invalid='ignore'):
            return np.where(np.isfinite(self.prior_std), (self.parameters - self.cad) / self.prior_std, np.nan)

    @property
    def is_prior(self) -> Flags:
        """(10,) True where the data add little: by itself the value is as uncertain as before."""
        return np.asarray(self.variance_reduction < _MOVED)


@dataclass(frozen=True)
class Calibration:
    """The unknown links after the data."""

    prior: Prior  # the nominal model
    # values, block_covariance: (10 k + 6 n + 6,) of links, joints and mount as `Normals.blocks` has them, and all of
    # their covariance
    values: Array
    block_covariance: Array
    thrusters: tuple[Thruster, ...]  # deviations from their commands, of those that may deviate
    flexible: tuple[PassiveJoint, ...]  # passive joints
    corrections: Array  # (k,) sizes of the projections on bodies that can exist
    # momentum, momentum_covariance: (R, 6), (R, 6, 6) of each motion (P, L), odometry frame, L about its origin
    momentum: Array
    momentum_covariance: Array
    kernel: MomentumKernel  # with the unknown links
    moving: Flags  # (n,) True for the joints that do not rest
    normal: Array | None  # (3,) of the plane of motion in the base link's frame; None in space
    # information of the data on links, joints and mount in units of the prior's, along its principal directions, the
    # largest first
    gains: Array
    # (kind of thing, error over its prior deviation) of those that surely are; covariances allow for it
    prior_scales: tuple[tuple[str, float], ...]
    residual: float  # root mean square of the normalised innovations: 1 matches the noise
    converged: bool  # whether the iterations have converged
    redundancy: int  # number of innovations
    located: bool  # whether anything locates the base
    samples: int  # number used
    span: float  # s, length of all motions

    @property
    def planar(self) -> bool:
        """Whether the motion was planar, and only its parameters were used."""
        return self.normal is not None

    @property
    def at_rest(self) -> tuple[str, ...]:
        """Names of the joints that do not move."""
        names = self.kernel.model.joint_names
        return tuple(name for name, moves in zip(names, self.moving, strict=True) if not moves)

    @property
    def theta(self) -> Array:
        """Standard parameters (m, h, I_o) of the links, each in its own frame, (10 k,)."""
        return self.values[: len(self.prior.mean)]

    @property
    def covariance(self) -> Array:
        """Of these, (10 k, 10 k)."""
        size = len(self.prior.mean)
        return self.block_covariance[:size, :size]

    @property
    def scale_std(self) -> float:
        """Relative standard deviation of the common factor of all masses: of the links' total mass."""
        return float(np.sqrt(np.sum(self.covariance[::10, ::10])) / np.sum(self.theta[::10]))

    @property
    def joints(self) -> Array:
        """(n, 6) of each joint: zero, displacement of its frame (3), tilts of its axis (2)."""
        return self.values[len(self.prior.mean) : -6].reshape(-1, 6)

    @property
    def displacements(self) -> tuple[Array, Array]:
        """(n, 3) m and (n, 3) rad: displacement and turn of each joint's frame, in that frame."""
        across = Kinematics(self.kernel.model).across
        return self.joints[:, 1:4], (across @ self.joints[:, 4:, None])[..., 0]

    @property
    def mount(self) -> Array:
        """(6,) rotation vector and position of the base's frame in the one that the odometry locates."""
        return self.values[-6:]

    @property
    def stds(self) -> Array:
        """One standard deviation of each of the values."""
        return np.sqrt(np.diag(self.block_covariance))

    @property
    def determined(self) -> int:
        """Number of directions of links, joints and mount that the data determine better than the prior; at rest, none.

        A body that nothing locates need not move its joints: its tumbling determines the ratios of its moments.
        """
        return int(np.sum(self.gains > 1.0)) if np.any(self.moving) or not self.located else 0

    @cached_property
    def links(self) -> tuple[LinkResult, ...]:
        """Each link before and after."""
        return tuple(self._link(index) for index in range(len(self.prior.links)))

    def _link(self, index: int) -> LinkResult:
        link = self.prior.links[index]
        place = slice(10 * index, 10 * index + 10)
        jacobian = physical_jacobian(self.theta[place])
        cad: Array = np.full(10, np.nan)
        prior_std: Array = np.full(10, np.inf)
        if link.parameters[0] > 0.0:
            cad = physical(link.parameters)
            before = physical_jacobian(link.parameters)
            variance = np.diag(before @ self.prior.covariance[place, place] @ before.T)
            prior_std = np.where(self.prior.given[index], np.sqrt(variance), np.inf)
        return LinkResult(
            name=link.name,
            cad=cad,
            parameters=physical(self.theta[place]),
            covariance=jacobian @ self.covariance[place, place] @ jacobian.T,
            prior_std=prior_std,
            consistency_correction=float(self.corrections[index]),
        )
