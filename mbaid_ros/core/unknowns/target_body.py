"""The target body: all ten of its standard parameters, with what is known of them before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class TargetPrior:
    """What is known of the target link before anything is measured: mass and CoM, where given.

    Attributes
    ----------
    mass, mass_std : kg; 0 where nothing is known of it
    com, com_std : (3,) m in the link's frame, m; 0 where nothing is known of it. That of an unknown mass is not used:
        what is estimated is their product
    """

    mass: float = 0.0
    mass_std: float = 0.0
    com: tuple[float, ...] = ()
    com_std: float = 0.0

    @property
    def given(self) -> bool:
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
    """All of the target link known beforehand, as it is before a capture.

    Attributes
    ----------
    parameters : (10,) standard parameters (m, h, I_o)
    factor : (10, 10) of their covariance
    """

    parameters: Array
    factor: Array

    @property
    def given(self) -> bool:
        """Whether anything is."""
        return True

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o)."""
        mean[:], factor[:] = self.parameters, self.factor
