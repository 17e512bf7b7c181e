"""Typical sizes of what is unknown, for scaling before anything is solved."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel


def unknown_scale(kernel: MomentumKernel) -> Array:
    """Return the (16,) typical sizes of (m, h, I_o, P_0, L_0) for a robot.

    Mass and size of the known bodies set them; momentum is that of the whole moving at 1 m/s and 1 rad/s.
    """
    bodies = kernel.model.body_parameters(without=kernel.target.name)
    mass = max(float(np.sum(bodies[:, 0])), 1e-3)
    steps = np.concatenate((kernel.model.positions, kernel.target.position[None]))
    length = max(float(np.sum(np.linalg.norm(steps, axis=1))), 0.1)
    body = np.concatenate(([mass], np.full(3, mass * length), np.full(6, mass * length**2)))
    return np.concatenate((body, np.full(3, mass), np.full(3, mass * length)))
