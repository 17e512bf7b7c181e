"""Springs and dampers of joints that nothing drives: panels, booms, propellant, a grasp that gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.robot.kernel import cantilever_inertias
from mbaid_ros.core.robot.model import RobotModel


@dataclass(frozen=True)
class Springs:
    """f joints that a spring draws to zero and a damper slows.

    Attributes
    ----------
    joints : (f,) indices
    stiffness, damping : (f,) N m/rad, N m s/rad; N/m, N s/m for a prismatic joint
    """

    joints: Integers
    stiffness: Array
    damping: Array

    @staticmethod
    def of(model: RobotModel, names: Sequence[str], frequencies: Sequence[float], ratios: Sequence[float]) -> Springs:
        """Return those of joints with natural frequencies, Hz, all else held, and damping ratios."""
        joints = np.array([model.joint_names.index(name) for name in names], dtype=np.intp)
        inertia = cantilever_inertias(model, model.body_parameters())[joints]
        rate = 2.0 * np.pi * np.array(frequencies)
        return Springs(joints, inertia * rate**2, 2.0 * np.array(ratios) * inertia * rate)

    def torque(self, position: Array, velocity: Array) -> Array:
        """Return their torques on their joints, (f,), from all joints' (n,) positions and rates."""
        return np.asarray(-self.stiffness * position[self.joints] - self.damping * velocity[self.joints])
