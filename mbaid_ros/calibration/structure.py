"""The combinations of standard parameters that momentum determines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, exp
from mbaid_ros.core.robot.kernel import MomentumKernel, unknown_scale
from mbaid_ros.core.robot.model import Link

STANDARD = ('m', 'hx', 'hy', 'hz', 'Ixx', 'Ixy', 'Ixz', 'Iyy', 'Iyz', 'Izz')
_LONGEST_FORMULA = 6  # terms: a longer one explains nothing


def parameter(links: Sequence[Link], index: int) -> str:
    """Return a standard parameter's short name: ``link3.hx``."""
    return f'{links[index // 10].name}.{STANDARD[index % 10]}'


def formula(links: Sequence[Link], factors: Array) -> str:
    """Return a combination (10 b,) of the links' standard parameters as a sum, cut after a few terms."""
    indices = np.flatnonzero(factors)
    terms = []
    for index in indices[:_LONGEST_FORMULA]:
        factor = factors[index]
        size = '' if abs(abs(factor) - 1.0) < 1e-9 else f'{abs(factor):.4g} '
        sign = '-' if factor < 0.0 else '+'
        terms.append(f'{sign} {size}{parameter(links, int(index))}')
    text = ' '.join(terms).removeprefix('+ ')
    more = len(indices) - _LONGEST_FORMULA
    return f'{text} + {more} more' if more > 0 else text


# Singular values, relative to the largest, that are rounding: those of mechanisms are above 1e-4.
_ROUNDING = 1e-9
# Random states for each unknown number, six equations each (three in a plane): far more than would do.
_STATES_PER_UNKNOWN = 2
_SEED = 20  # of these states: the same structure every time


@dataclass(frozen=True)
class Mechanism:
    """The moving parts of a robot."""

    kernel: MomentumKernel  # with the unknown links
    moving: Flags  # (n,) True for the joints that do not rest
    posture: Array  # (n,) rad or m, where the resting ones are
    normal: Array | None = None  # (3,) of the plane of motion in the base link's frame; None in space


@dataclass(frozen=True)
class BaseParameter:
    """A combination of standard parameters that momentum determines."""

    leading: int  # index in theta of the parameter that it is named after, with factor 1
    factors: Array  # (10 k,) the combination is factors theta


@dataclass(frozen=True)
class Structure:
    """The unknown standard parameters as momentum sees them."""

    regressor: Array  # (m, 10 k) at random states, columns in typical sizes
    scale: Array  # (10 k,) those sizes

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

    def base_parameters(self) -> tuple[BaseParameter, ...]:
        """Return a minimal set of combinations that momentum determines.

        Bodies come from the base outwards: combinations inseparable from a parent's parameters count with these.
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
    """Return the parameters of a mechanism's unknown links that momentum determines."""
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
