"""Hypotheses of a disturbance or drift: constant forces and random walks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from mbaid_ros.core.geometry import Array, Integers

# N s / sqrt(s) / kg of the known bodies: random walk of the momentum that stands for a force which is not constant.
_CHANGING_FORCE = 5e-5

Axes = Literal['none', 'inertial', 'inertial on the base', 'body']


@dataclass(frozen=True)
class Hypothesis:
    """A disturbance or drift: a constant force, and random walks with intensities a square root of a second."""

    name: str  # in words
    cause: str = ''  # the likely source, and the remedy
    momentum: float = 0.0  # N s and N m s: an external force
    position: float = 0.0  # m: the odometry's own drift
    # axes of a constant force and torque: of the base, on its origin, or inertial, at the common centre of mass
    force: Axes = 'none'
    physical: bool = True  # whether it has a mechanism; a random walk follows anything

    @property
    def disturbed(self) -> bool:
        """Whether anything acts or drifts at all."""
        return self.force != 'none' or len(self.walking) > 0

    @cached_property
    def walking(self) -> Integers:
        """Which of pose error and momentum (12) walk."""
        return np.flatnonzero(self._intensities)

    @cached_property
    def intensities(self) -> Array:
        """Of these."""
        return self._intensities[self.walking]

    @cached_property
    def _intensities(self) -> Array:
        return np.repeat((0.0, self.position, self.momentum), (3, 3, 6))


UNDISTURBED = Hypothesis('nothing drifts')


def _constant_force(axes: Axes, where: str, what: str) -> Hypothesis:
    name = f'a constant force or torque acts, in {where}'
    declared = 'body' if axes == 'body' else 'inertial'
    return Hypothesis(name, f'{name}: {what}; set disturbance.constant to {declared}', force=axes)


_INERTIAL_FORCES = (
    _constant_force('inertial', 'inertial axes, at the common centre of mass', 'a tilted table, or drag'),
    _constant_force('inertial on the base', 'inertial axes, on the base', 'a cable, or a leak'),
)
_BODY_FORCE = _constant_force('body', 'base axes', 'a leak or thrust, or unreported wheels spin up')


def hypotheses(known_mass: float, position_std: float, constant: Axes, *, adapt: bool) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of a run; the first is the one to beat.

    Parameters
    ----------
    known_mass : kg, of the known bodies
    position_std : m, of one reading of the base's position
    constant : axes of a force that is taken to act, wherever; there are no other hypotheses then
    adapt : whether others than the first are followed
    """
    if constant != 'none':
        return (_BODY_FORCE,) if constant == 'body' else _INERTIAL_FORCES
    if not adapt:
        return (UNDISTURBED,)
    return (
        UNDISTURBED,
        *_INERTIAL_FORCES,
        _BODY_FORCE,
        Hypothesis(
            'the momentum drifts',
            'an unreported part moves (wheels, an arm, fuel), or a changing force acts: the momentum drifts',
            momentum=_CHANGING_FORCE * known_mass,
            physical=False,
        ),
        Hypothesis(
            'the odometry position drifts',
            'the odometry position drifts: check the sensor, or set noise.base_correlation_time',
            position=position_std,
            physical=False,
        ),
    )
