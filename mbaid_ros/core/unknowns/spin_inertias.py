"""The spin inertias of wheels inside bodies: they show when a wheel changes its speed, or the base turns its axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.known_side import KnownSide


@dataclass(frozen=True, eq=False)
class SpinInertias(Unknown):
    """Errors of the spin inertias of what stores momentum inside bodies, kg m^2."""

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the momentum of each at a unit spin inertia."""
        directions = kernel.storage.directions(states.configuration.rotation)
        columns = np.zeros((len(directions), 6, kernel.storage.count))
        columns[:, 3:] = np.swapaxes(states.readings[..., None] * directions, 1, 2)
        return columns

    def moved(self, side: KnownSide, value: Array) -> KnownSide:
        """Return the known side with these spin inertias."""
        return replace(side, kernel=side.kernel.storing(side.kernel.storage.changed(value)))


def spin_inertias(kernel: MomentumKernel, deviations: Sequence[float]) -> SpinInertias:
    """Return the spin inertias as an unknown.

    Parameters
    ----------
    kernel : MomentumKernel
    deviations : (c,) standard deviation of each, kg m^2; 0 is exact, and empty all of them
    """
    sizes = np.array(deviations if len(deviations) else (0.0,) * kernel.storage.count)
    return SpinInertias(np.diag(sizes)[:, sizes > 0.0], tuple(f'wheel:{name}' for name in kernel.storage.names))
