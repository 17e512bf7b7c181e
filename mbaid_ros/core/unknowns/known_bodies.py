"""The known bodies: mass, first moment and inertia of each may be off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.known_errors import KnownErrors
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import regressor
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.known_side import KnownSide


@dataclass(frozen=True, eq=False)
class KnownBodies(Unknown):
    """Errors of the standard parameters (m, h, I_o) of b moving bodies, each in its own frame.

    Attributes
    ----------
    bodies : (b,) indices
    """

    bodies: tuple[int, ...]

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Of each independent number, the mass of its link where it alone makes that out; or ''."""
        return masses([label.partition(':')[2] for label in self.labels[::10]], self.factor)

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the bodies' regressors, less what an orbit has brought: momentum is linear in what a body is."""
        del kernel
        index = list(self.bodies)
        placed = states.configuration
        columns = regressor(placed.rotation[:, index], placed.position[:, index], states.body_twist[:, index])
        if states.tide.shape[1]:
            columns -= states.tide[:, index]
        return np.moveaxis(columns, 1, 2).reshape(len(columns), 6, -1)

    def moved(self, side: KnownSide, value: Array) -> KnownSide:
        """Return the known side with these bodies."""
        change = np.zeros_like(side.kernel.known)
        change[list(self.bodies)] = value.reshape(-1, 10)
        return replace(side, kernel=side.kernel.corrected(change))

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return mass, first moment in the plane and moment about its normal, of each."""
        return np.asarray(block_diag(*(detector.plane_of(body).basis for body in self.bodies)))


def masses(names: Sequence[str], factor: Array) -> tuple[str, ...]:
    """Return which of e independent numbers are the masses of links, 'mass:arm', all else of these going with them.

    Parameters
    ----------
    names : of b links
    factor : (10 b, e) of the covariance of their standard parameters
    """
    found = [''] * factor.shape[1]
    for name, row in zip(names, factor[::10], strict=True):
        (columns,) = np.nonzero(row)
        if len(columns) == 1:
            found[columns[0]] = f'mass:{name}'
    return tuple(found)


def known_bodies(model: RobotModel, errors: KnownErrors) -> KnownBodies:
    """Return the errors of known bodies as an unknown."""
    names = _names(model, errors.bodies)
    return KnownBodies(errors.factor, tuple(f'link:{name}' for name in names for _ in range(10)), errors.bodies)


def _names(model: RobotModel, bodies: Sequence[int]) -> list[str]:
    """Return the name of each body: that of its first link with mass."""
    found = {link.body: link.name for link in reversed(model.links)}
    found |= {link.body: link.name for link in reversed(model.links) if link.parameters[0] > 0.0}
    return [found[body] for body in bodies]
