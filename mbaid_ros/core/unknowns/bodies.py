"""Bodies: errors of the known ones and of spin inertias, and the prior of the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.model_errors import KnownErrors
from mbaid_ros.core.robot.momentum import regressor
from mbaid_ros.core.unknowns.declaration import NominalModel, Unknown, Words, diagonal


def _link_deviation(name: str, value: Array) -> str:
    heavier = 'heavier' if value[0] > 0.0 else 'lighter'
    moment = ', '.join(f'{part:+.2g}' for part in value[1:4])
    return (
        f'link {name} is not as described: it looks {abs(value[0]):.3g} kg {heavier}, its first moment ({moment}) '
        'kg m off; check its inertial, or raise known_links.relative_std'
    )


@dataclass(frozen=True, eq=False)
class KnownBodies(Unknown):
    """Errors of the standard parameters (m, h, I_o) of b moving bodies, each in its own frame."""

    bodies: tuple[int, ...]  # (b,) indices

    words: ClassVar = {
        'link': Words(
            'the links',
            'known_links.relative_std',
            'the uncertainty of link {}: weigh it, or calibrate before the capture (known_links)',
            _link_deviation,
        ),
        'mass': Words(parameter='known_links.relative_std'),
    }
    calibrated = True

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Of each independent number, the mass of its link where it alone makes that out; or ''."""
        return masses([label.partition(':')[2] for label in self.labels[::10]], self.factor)

    def mass_row(self) -> Array:
        """Return the sum of the bodies' masses."""
        return np.asarray(self.factor[::10].sum(axis=0))

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the bodies' regressors, less the orbit's momentum: momentum is linear in a body's parameters."""
        del kernel
        index = list(self.bodies)
        placed = states.configuration
        columns = regressor(placed.rotation[:, index], placed.position[:, index], states.body_twist[:, index])
        if states.tide.shape[1]:
            columns -= states.tide[:, index]
        return np.moveaxis(columns, 1, 2).reshape(len(columns), 6, 10 * len(index))

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these bodies."""
        change = np.zeros_like(side.kernel.known)
        change[list(self.bodies)] = value.reshape(-1, 10)
        return replace(side, kernel=side.kernel.with_body_changes(change))

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return mass, first moment in the plane and moment about its normal, of each."""
        return np.asarray(block_diag(*(detector.plane_of_body(body).basis for body in self.bodies)))


def masses(names: Sequence[str], factor: Array) -> tuple[str, ...]:
    """Return which of e independent numbers are links' masses, 'mass:arm', by their covariance factor (10 b, e)."""
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


@dataclass(frozen=True)
class TargetPrior:
    """The prior of the target link: mass and CoM, where given. What changes with time: `core/filter/variables.py`."""

    mass: float = 0.0  # kg; 0 where nothing is known of it
    mass_std: float = 0.0  # kg
    # (3,) m in the link's frame; not used where the mass is unknown, as their product is estimated.
    com: tuple[float, ...] = ()
    com_std: float = 0.0  # m

    @property
    def declared(self) -> bool:
        """Whether anything is."""
        return self.mass_std > 0.0

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o): h = m c, to first order."""
        if self.mass_std == 0.0:
            return
        mean[0], factor[0, 0] = self.mass, self.mass_std
        if self.com and self.com_std > 0.0:
            centre = np.array(self.com)
            mean[1:4] = self.mass * centre
            factor[1:4] = 0.0
            factor[1:4, 1:4] = self.mass * self.com_std * np.eye(3)
            factor[1:4, 0] = centre * self.mass_std


@dataclass(frozen=True, eq=False)
class KnownTarget:
    """All of the target link known beforehand, as it is before a capture."""

    parameters: Array  # (10,) standard parameters (m, h, I_o)
    factor: Array  # (10, 10) of their covariance

    @property
    def declared(self) -> bool:
        """Whether anything is."""
        return True

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o)."""
        mean[:], factor[:] = self.parameters, self.factor


@dataclass(frozen=True)
class TotalMass:
    """The mass of the whole robot, weighed: of all bodies but the target, whose own part counts as declared."""

    mass: float  # kg
    std: float  # kg
    with_target: bool = False  # whether all of the target is weighed as well, as before a capture


@dataclass(frozen=True, eq=False)
class SpinInertias(Unknown):
    """Errors of the spin inertias of wheels inside bodies, kg m^2."""

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the momentum of each at a unit spin inertia."""
        directions = kernel.storage.axes_in_odometry(states.configuration.rotation)
        columns = np.zeros((len(directions), 6, kernel.storage.count))
        columns[:, 3:] = np.swapaxes(states.readings[..., None] * directions, 1, 2)
        return columns

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these spin inertias."""
        return replace(side, kernel=side.kernel.with_storage(side.kernel.storage.with_inertia_changes(value)))


def spin_inertias(kernel: MomentumKernel, deviations: Sequence[float]) -> SpinInertias:
    """Return the spin inertias as an unknown, of standard deviations (c,) in kg m^2; 0 is exact, and empty all."""
    sizes = deviations if len(deviations) else (0.0,) * kernel.storage.count
    return SpinInertias(diagonal(sizes), tuple(f'wheel:{name}' for name in kernel.storage.names))
