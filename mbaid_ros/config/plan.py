"""The parameters of the motions that are planned, for `plan` and for the estimator node alike."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.config.parameters import parameter


@dataclass(frozen=True)
class PlanConfig:
    """Goal and limits of a planned motion."""

    relative_std: tuple[float, ...] = parameter((), lengths=(0, 1, 10))
    """Wanted relative standard deviation, in the sense of convergence.relative_std: one for all parameters, or ten in
    the order mass, com_x, com_y, com_z, ixx, ixy, ixz, iyy, iyz, izz; empty: convergence.relative_std."""
    duration: float = parameter(0.0, 's', minimum=0.0, maximum=3600.0)
    """Length of the most informative motion; 0: the shortest that reaches relative_std."""
    joint_velocity: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Velocity that no joint exceeds, in addition to its limit in the URDF (m/s for a prismatic joint); 0: the URDF's
    limit alone."""
    joint_acceleration: float = parameter(0.1, 'rad/s^2', minimum=0.0, exclusive_minimum=True)
    """Acceleration that no joint exceeds (m/s^2 for a prismatic joint)."""
    base_rotation: float = parameter(0.0, 'rad', minimum=0.0)
    """Largest rotation of the base by the motion, against a base with the joints at rest; 0: any."""
    base_translation: float = parameter(0.0, 'm', minimum=0.0)
    """Largest displacement of the base link's origin by the motion, against a base with the joints at rest; 0: any."""
    base_rate: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Largest change of the base's angular velocity by the motion, against a base with the joints at rest; 0: any."""
    deflection: float = parameter(0.0, 'rad', minimum=0.0)
    """Largest deflection of passive joints (flexible.joints) by the motion from rest (or m); 0: any."""
    clearance: float = parameter(0.02, 'm', minimum=0.0)
    """Smallest distance between collision shapes of the URDF; 0: they may touch, but not overlap."""
    stuck: tuple[str, ...] = parameter(())
    """Joints that are not moved."""
    held: tuple[str, ...] = parameter(())
    """Joints that keep the speed they have at the end of the run, as wheels do; empty: continuous joints without a
    velocity limit, if plan.joint_velocity is not given or they are faster."""
    effort: int = parameter(1200, minimum=10, maximum=1_000_000)
    """Motions that are compared before the best is taken."""
