"""What may act on the robot or drift, beside what is certain: the hypotheses that a run is followed under."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.geometry import Array

# N s / sqrt(s) / kg of the known bodies: random walk of the momentum that stands for a force which is not constant.
_CHANGING_FORCE = 5e-5

Axes = Literal['none', 'inertial', 'body']


@dataclass(frozen=True)
class Hypothesis:
    """What acts or drifts: a constant force, and random walks with intensities a square root of a second.

    Attributes
    ----------
    name : in words
    cause : what it may be, and what to do
    momentum : N s and N m s: an external force
    position, orientation : m, rad: the odometry's own drift
    force : axes of a constant force and torque, which act on the base's origin, or, inertial ones, at the run's
    physical : whether it says what happens; a walk follows whatever it is
    """

    name: str
    cause: str = ''
    momentum: float = 0.0
    position: float = 0.0
    orientation: float = 0.0
    force: Axes = 'none'
    physical: bool = True

    @property
    def disturbed(self) -> bool:
        """Whether anything acts or drifts at all."""
        return self.force != 'none' or len(self.walking) > 0

    @cached_property
    def walking(self) -> npt.NDArray[np.int64]:
        """Which of pose error and momentum (12) walk."""
        return np.flatnonzero(self._intensities)

    @cached_property
    def intensities(self) -> Array:
        """Of these."""
        return self._intensities[self.walking]

    @cached_property
    def _intensities(self) -> Array:
        return np.repeat((self.orientation, self.position, self.momentum), (3, 3, 6))


UNDISTURBED = Hypothesis('nothing drifts')
_CONSTANT_IN_INERTIAL_AXES = Hypothesis(
    'a constant force or torque acts, in inertial axes',
    'a constant force or torque acts, in inertial axes: a tilted table, drag or a leak; set disturbance.constant to '
    'inertial',
    force='inertial',
)
_CONSTANT_IN_BASE_AXES = Hypothesis(
    'a constant force or torque acts, in base axes',
    'a constant force or torque acts, in base axes: a leak or thrust, or wheels that nobody reads spin up; set '
    'disturbance.constant to body',
    force='body',
)


def hypotheses(known_mass: float, position_std: float, constant: Axes, *, adapt: bool) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of a run; the first is the one to beat.

    Parameters
    ----------
    known_mass : kg, of the known bodies
    position_std : m, of one reading of the base's position
    constant : axes of a force that is taken to act; it is then the only hypothesis
    adapt : whether others than the first are followed
    """
    if constant != 'none':
        return (_CONSTANT_IN_BASE_AXES if constant == 'body' else _CONSTANT_IN_INERTIAL_AXES,)
    if not adapt:
        return (UNDISTURBED,)
    return (
        UNDISTURBED,
        _CONSTANT_IN_INERTIAL_AXES,
        _CONSTANT_IN_BASE_AXES,
        Hypothesis(
            'the momentum drifts',
            'something moves that nobody reads (wheels, an arm, fuel), or a changing force acts: the momentum drifts',
            momentum=_CHANGING_FORCE * known_mass,
            physical=False,
        ),
        Hypothesis(
            'the odometry position drifts',
            'the odometry position drifts: check the sensor, or give noise.base_correlation_time',
            position=position_std,
            physical=False,
        ),
    )
