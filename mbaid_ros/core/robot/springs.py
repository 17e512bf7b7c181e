"""Springs and dampers of passive joints, as the nominal model has them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mbaid_ros.core.geometry import Array


@dataclass(frozen=True, eq=False)
class Springs:
    """f joints that no JointState reports."""

    joints: tuple[int, ...] = ()  # f indices
    # rate, ratio: (f,) natural angular frequency, rad/s, with all else held; damping ratio
    rate: Array = field(default_factory=lambda: np.zeros(0))
    ratio: Array = field(default_factory=lambda: np.zeros(0))
    # (2, f) deflection and rate at the first instant, rad or m, and per s
    start: Array = field(default_factory=lambda: np.zeros((2, 0)))

    @property
    def count(self) -> int:
        """Number f."""
        return len(self.joints)

    @property
    def fastest(self) -> float:
        """The highest natural frequency, Hz; 0 without any."""
        return float(np.max(self.rate, initial=0.0) / (2.0 * np.pi))
