"""What momentum can tell of the unknown bodies at all, from the mechanism alone: rank, null space, base parameters.

The momentum of all bodies is Y theta, and some directions of theta have none whatever the motion: at every joint mass,
first moment along the axis and the inertia of a rod on the axis may be taken from one body and given to the other. They
are found numerically, from the regressor at random states, and so hold for trees, sliding joints, joints that are
braked and any set of known bodies.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, exp, vec
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.scale import unknown_scale

# Singular values, relative to the largest, that are rounding: those of mechanisms are above 1e-4.
_ROUNDING = 1e-9
# Random states for each unknown number, six equations each (three in a plane): far more than would do.
_STATES_PER_UNKNOWN = 2
_SEED = 20  # of these states: the same structure every time


@dataclass(frozen=True)
class Mechanism:
    """What of a robot moves.

    Attributes
    ----------
    kernel : with the unknown links
    moving : (n,) True for the joints that do not rest
    posture : (n,) rad or m, where the resting ones are
    normal : (3,) of the plane of motion in the base link's frame; None in space
    """

    kernel: MomentumKernel
    moving: Flags
    posture: Array
    normal: Array | None = None


@dataclass(frozen=True)
class BaseParameter:
    """A combination of standard parameters that momentum determines.

    Attributes
    ----------
    leading : index in theta of the parameter that it is named after, with factor 1
    factors : (10 k,) the combination is factors theta
    """

    leading: int
    factors: Array


@dataclass(frozen=True)
class Structure:
    """The unknown standard parameters as momentum sees them.

    Attributes
    ----------
    regressor : (m, 10 k) at random states, columns in typical sizes
    scale : (10 k,) those sizes
    """

    regressor: Array
    scale: Array

    @cached_property
    def _svd(self) -> tuple[Array, Array]:
        _, values, vectors = np.linalg.svd(self.regressor, full_matrices=True)
        return values, vectors

    @property
    def unknowns(self) -> int:
        """Number 10 k of standard parameters."""
        return len(self.scale)

    @property
    def rank(self) -> int:
        """Number of directions that a known momentum determines."""
        values = self._svd[0]
        return int(np.sum(values > _ROUNDING * values[0]))

    @property
    def null_space(self) -> Array:
        """(10 k, d) directions of theta that have no momentum, orthonormal in typical sizes."""
        return np.asarray(self.scale[:, None] * self._svd[1][self.rank :].T)

    def has_none(self, direction: Array) -> bool:
        """Return whether a direction (10 k,) of theta has no momentum in any motion."""
        scaled = direction / self.scale
        size = float(np.linalg.norm(self.regressor, ord=2) * np.linalg.norm(scaled))
        return bool(np.linalg.norm(self.regressor @ scaled) < 1e3 * _ROUNDING * size)

    def base_parameters(self) -> tuple[BaseParameter, ...]:
        """Return a minimal set of combinations that momentum determines.

        Bodies come from the base outwards: what cannot be told from a parent's parameters is counted with them.
        """
        chosen: list[int] = []
        basis: Array = np.zeros((len(self.regressor), 0))
        for column in range(self.unknowns):
            rest = self.regressor[:, column]
            for _ in range(2):  # once more, for what rounding leaves
                rest = rest - basis @ (basis.T @ rest)
            length = float(np.linalg.norm(rest))
            if length > 1e2 * _ROUNDING * max(float(np.linalg.norm(self.regressor[:, column])), 1e-300):
                chosen.append(column)
                basis = np.column_stack((basis, rest / length))
        factors: Array = np.linalg.lstsq(self.regressor[:, chosen], self.regressor, rcond=None)[0]
        factors = factors * self.scale[chosen][:, None] / self.scale
        size = np.abs(factors) * self.scale / self.scale[chosen][:, None]
        factors[size < 1e-7] = 0.0
        return tuple(BaseParameter(column, row) for column, row in zip(chosen, factors, strict=True))


def structure(mechanism: Mechanism) -> Structure:
    """Return what momentum can tell of a mechanism's unknown links."""
    kernel = mechanism.kernel
    model = kernel.model
    count = _STATES_PER_UNKNOWN * 10 * len(kernel.unknown)
    rng = np.random.default_rng(_SEED)
    position = np.where(mechanism.moving, rng.uniform(-np.pi, np.pi, (count, model.joints)), mechanism.posture)
    velocity = np.where(mechanism.moving, rng.normal(size=(count, model.joints)), 0.0)
    twist = rng.normal(size=(count, 6))
    rotation: Array = np.broadcast_to(np.eye(3), (count, 3, 3))
    equations = np.eye(6)
    if mechanism.normal is not None:
        normal = mechanism.normal
        across = np.linalg.svd(normal[None])[2][1:]
        equations = np.zeros((3, 6))
        equations[:2, :3], equations[2, 3:] = across, normal
        twist = twist @ equations.T @ equations
        rotation = exp(rng.uniform(-np.pi, np.pi, (count, 1)) * normal)
    states = kernel.states_of(rotation, position, velocity, twist)
    regressor = np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=2)
    scale = np.tile(unknown_scale(kernel)[:10], len(kernel.unknown))
    return Structure((equations @ regressor).reshape(-1, regressor.shape[2]) * scale, scale)


def planar_basis(mechanism: Mechanism, link: Link) -> Array:
    """Return the (10, 4) orthonormal basis of what planar motion can tell of a link: mass, first moment, moment."""
    kernel = mechanism.kernel
    configuration = kernel.kinematics.configure(np.eye(3)[None], np.zeros((1, kernel.model.joints)))
    normal = configuration.link(link)[0][0].T @ np.asarray(mechanism.normal)
    basis = np.zeros((10, 4))
    basis[0, 0] = 1.0
    basis[1:4, 1:3] = np.linalg.svd(normal[None])[2][1:].T
    about = vec(normal[:, None] * normal)
    basis[4:, 3] = about / np.linalg.norm(about)
    return basis
