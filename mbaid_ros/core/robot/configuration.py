"""From joint positions to pinocchio's configuration, in which a joint that turns without limits is (cos, sin)."""

from __future__ import annotations

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel


def configurations(model: RobotModel, parsed: pinocchio.Model, position: Array) -> Array:
    """Return the configurations (..., nq) of joints at (..., n), the base at the origin.

    Parameters
    ----------
    model : RobotModel
    parsed : the same as `parse` returns it
    position : (..., n) rad or m
    """
    found = np.zeros((*position.shape[:-1], parsed.nq))
    found[..., 6] = 1.0
    # Before the joints come pinocchio's universe and the floating base.
    places = np.array([joint.idx_q for joint in list(parsed.joints)[2:]], dtype=int)
    turning = np.array(model.continuous, dtype=bool)
    found[..., places] = np.where(turning, np.cos(position), position)
    found[..., places[turning] + 1] = np.sin(position[..., turning])
    return found
