"""The captured body alone: what was identified less the target link's own inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.inertia import physical, physical_jacobian, standard


@dataclass(frozen=True)
class Debris:
    """Mass properties of the captured body, in the target link's frame.

    Attributes
    ----------
    parameters : (10,) mass, CoM, inertia about it, in link axes
    covariance : (10, 10)
    """

    parameters: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """One standard deviation of each parameter, (10,)."""
        return np.sqrt(np.diag(self.covariance))


def debris(estimate: Estimate, link: Array) -> Debris | None:
    """Return the captured body, None where not all ten parameters are determined or nothing is left.

    Standard parameters add up, so those of the link are subtracted; known exactly, they leave the covariance as it is.

    Parameters
    ----------
    estimate : of link and captured body together
    link : (10,) standard parameters (m, h, I_o) of the link itself
    """
    if not np.all(estimate.identifiable) or not np.all(np.isfinite(estimate.covariance)):
        return None
    together = standard(estimate.parameters)
    alone = together - link
    if alone[0] <= 0.0:
        return None
    # Covariance of (m, h, I_o) from that of (m, r_c, I_c), then on to the captured body's own (m, r_c, I_c).
    change = np.linalg.solve(physical_jacobian(together).T, physical_jacobian(alone).T).T
    return Debris(physical(alone), change @ estimate.covariance @ change.T)
