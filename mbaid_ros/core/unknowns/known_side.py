"""The known side of a robot where a prediction is linearised: its URDF, moved by what has been estimated of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, moved_base
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples


@dataclass(frozen=True, eq=False)
class KnownSide:
    """What the prediction takes for known.

    Attributes
    ----------
    kernel : bodies and joint placements
    zeros : (n,) rad or m, what is added to the measured joint positions
    mount : (6,) the base's frame in the one that the odometry locates: rotation vector (rad), position (m)
    delay : s, by how much the joints' stamps are late
    thrust : (5 f,) by how much each thruster is off its command: scale, turn, delay; empty is not at all
    gyro : (12,) bias, scale, turn and what axes have in common, of a gyro that alone tells the orientation
    """

    kernel: MomentumKernel
    zeros: Array
    mount: Array
    delay: float
    thrust: Array = field(default_factory=lambda: np.zeros(0))
    gyro: Array = field(default_factory=lambda: np.zeros(12))

    @staticmethod
    def nominal(kernel: MomentumKernel) -> KnownSide:
        """Return the robot as its URDF has it."""
        return KnownSide(kernel, np.zeros(kernel.model.joints), np.zeros(6), 0.0)

    def corrected(self, samples: Samples) -> Samples:
        """Return samples of the base's own frame: q + zeros, p + R mu_p and R Exp(mu_R); delayed as they are."""
        if not (np.any(self.zeros) or np.any(self.mount)):
            return samples
        rotation, away, linear = moved_base(
            samples.base_rotation, samples.base_linear_velocity, samples.base_angular_velocity, self.mount
        )
        return replace(
            samples,
            joint_position=samples.joint_position + self.zeros,
            base_position=samples.base_position + away,
            base_rotation=rotation,
            base_linear_velocity=linear,
        )
