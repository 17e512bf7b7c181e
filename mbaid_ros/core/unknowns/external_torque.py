"""A torque from outside that stays in axes of the base: the air's on a thrown body, or that of a leak.

It brings angular momentum alone, in the direction that the base has turned it to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.unknowns.declaration import Linear

TORQUE = 'external torque'


@dataclass(frozen=True, eq=False)
class ExternalTorque(Linear):
    """The torque, (3,) N m in base axes; another one in every motion."""

    in_equations = True
    pushes = True
    of_a_motion = True

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the change of (P, L) a second by each component."""
        del origin, time
        rates = np.zeros((len(whole), 6, 3))
        rates[:, 3:] = rotation
        return rates

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the one about the normal."""
        return np.asarray(detector.plane_of(0).normal[:, None])


def external_torque(deviation: float) -> ExternalTorque:
    """Return it as an unknown, with a standard deviation in N m about each axis; 0 is none."""
    deviations = np.full(3, deviation)
    return ExternalTorque(np.diag(deviations)[:, deviations > 0.0], (TORQUE,) * 3)
