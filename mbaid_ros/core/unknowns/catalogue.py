"""The list of what is uncertain on the known side. A new unknown is a file beside this one, a field and a line here.

The field is one of `Uncertainty`. The line is in `of_sensors` where the unknown belongs to a run, in `catalogue` where
it belongs to the robot: `CalibratedSide` then has to count its numbers, too, which no calibration speaks of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.unknowns.base import odometry_mount, odometry_scale, twist_bias
from mbaid_ros.core.unknowns.bodies import KnownTarget, TargetPrior, known_bodies, spin_inertias
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.environment import Circle, Thrusters, external_torque, gravity, orbit_shape, thrusters
from mbaid_ros.core.unknowns.joints import JointTracking, joint_placements, joint_tracking
from mbaid_ros.core.unknowns.priors import UnknownsPrior
from mbaid_ros.core.unknowns.sensors import GyroErrors, clock_drift, gyro, time_offset


@dataclass(frozen=True)
class Uncertainty:
    """How uncertain the known side is: standard deviations, 0 is exact. Bodies' errors are those of the kernel.

    Attributes
    ----------
    zeros, origins, axes : of each joint: rad (m for a prismatic one), m, rad; empty is exact
    mount_position, mount_orientation : m, rad, of the base's frame in the one that the odometry locates
    time_offset : s, of the joints' stamps
    target : what is known of the target body
    linear_momentum : N s, of the total linear momentum about zero; 0 where nothing is known of it
    carried : what is known of the unknowns' independent numbers together; None for nothing but their own variances
    spin_inertias : kg m^2, of each of what stores momentum inside bodies; empty is exact
    thrusters : frames of those that are not as commanded
    thrust_scale, thrust_direction, thrust_delay : of each of them: relative; rad; s
    gyro : of an IMU's angular velocity; None where there is none
    clock_drift : s/s, of the joints' stamps
    odometry_scale : relative, of the lengths that the odometry reads
    twist_bias : rad/s, of its angular velocity
    orbit : rad/s, mean motion of an orbit that may be there undeclared; 0 is none
    circle : the orbit that is declared, where it may be no circle
    torque : N m, of a torque from outside in base axes
    tracking, tracking_time : of each joint: rad (m for a prismatic one), how far it wanders from where it is read to
        be, and s, over which it does; empty is not at all
    """

    zeros: Sequence[float] = ()
    origins: Sequence[float] = ()
    axes: Sequence[float] = ()
    mount_position: float = 0.0
    mount_orientation: float = 0.0
    time_offset: float = 0.0
    target: TargetPrior | KnownTarget = field(default_factory=TargetPrior)
    linear_momentum: float = 0.0
    carried: UnknownsPrior | None = None
    spin_inertias: Sequence[float] = ()
    thrusters: Sequence[str] = ()
    thrust_scale: float = 0.0
    thrust_direction: float = 0.0
    thrust_delay: float = 0.0
    gyro: GyroErrors | None = None
    clock_drift: float = 0.0
    odometry_scale: float = 0.0
    twist_bias: float = 0.0
    orbit: float = 0.0
    circle: Circle | None = None
    torque: float = 0.0
    tracking: Sequence[float] = ()
    tracking_time: Sequence[float] = ()


def catalogue(kernel: MomentumKernel, uncertainty: Uncertainty) -> tuple[Unknown, ...]:
    """Return all unknowns of the known side; those that are exact are left out, those only read come last."""
    none = [0.0] * kernel.model.joints
    placements = (uncertainty.zeros or none, uncertainty.origins or none, uncertainty.axes or none)
    every = (
        known_bodies(kernel.model, kernel.errors),
        joint_placements(kernel, *placements),
        spin_inertias(kernel, uncertainty.spin_inertias),
        pushing(uncertainty),
        wandering(kernel, uncertainty),
        odometry_mount(uncertainty.mount_position, uncertainty.mount_orientation),
        *of_sensors(uncertainty),
    )
    return tuple(unknown for unknown in every if unknown.count and unknown.factor.any())


def of_sensors(uncertainty: Uncertainty) -> tuple[Unknown, ...]:
    """Return what belongs to a run, its sensors and where it is, not to the robot: no calibration speaks of it."""
    every = (
        gyro(uncertainty.gyro),
        time_offset(uncertainty.time_offset),
        clock_drift(uncertainty.clock_drift),
        odometry_scale(uncertainty.odometry_scale),
        twist_bias(uncertainty.twist_bias, 0.0),
        gravity(uncertainty.orbit),
        external_torque(uncertainty.torque),
        *(() if uncertainty.circle is None else (orbit_shape(uncertainty.circle),)),
    )
    return tuple(unknown for unknown in every if unknown.count and unknown.factor.any())


def pushing(uncertainty: Uncertainty) -> Thrusters:
    """Return the thrusters."""
    deviations = uncertainty.thrust_scale, uncertainty.thrust_direction, uncertainty.thrust_delay
    return thrusters(uncertainty.thrusters, *deviations)


def wandering(kernel: MomentumKernel, uncertainty: Uncertainty) -> JointTracking:
    """Return how joints wander from where they are read to be: of a run, as no calibration speaks of it."""
    return joint_tracking(kernel.model.joint_names, uncertainty.tracking, uncertainty.tracking_time)
