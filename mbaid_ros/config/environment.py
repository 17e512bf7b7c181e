"""The parameters that no robot description has: the orbit, and wheels inside the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.config.parameters import parameter
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import Storage
from mbaid_ros.core.robot.orbit import Frame, Orbit

FRAMES = ('inertial', 'lvlh', 'hill')
TWISTS = ('relative', 'inertial')
_ACROSS = 0.02  # rad, by how much nadir and normal may miss a right angle


@dataclass(frozen=True)
class SimulatedOrbitConfig:
    """An orbit, and how the frame of the odometry stands to it."""

    mean_motion: float = parameter(0.0, 'rad/s', minimum=0.0, maximum=0.1)
    """Mean motion: 0.00113 at 400 km above the Earth; 0 is no orbit."""
    frame: str = parameter('inertial', choices=FRAMES)
    """Frame of the odometry, with its origin on the orbit (CCSDS 500.0-G): inertial axes, or axes that rotate with the
    orbit (lvlh, hill)."""
    nadir: tuple[float, ...] = parameter((), lengths=(0, 3))
    """Direction to the centre at the epoch in an inertial frame of the odometry."""
    normal: tuple[float, ...] = parameter((), lengths=(0, 3))
    """Direction of the orbit's angular momentum in an inertial frame of the odometry."""
    eccentricity: float = parameter(0.0, minimum=0.0, maximum=0.9)
    """Eccentricity of the orbit; 0 is a circle."""
    true_anomaly: float = parameter(0.0, 'rad')
    """True anomaly at the epoch, from the lowest point; without effect on a circle."""
    twist: str = parameter('relative', choices=TWISTS)
    """Twist in a rotating orbit.frame: relative to that frame (the ROS convention), or inertial, as a gyro measures
    it."""


@dataclass(frozen=True)
class OrbitConfig(SimulatedOrbitConfig):
    """The same with the time at which the directions are as given."""

    epoch: float = parameter(0.0, 's', minimum=0.0)
    """Stamp at which nadir has the given direction, and a rotating frame has the axes of the reported momentum; 0: the
    first sample."""
    undeclared_rate: float = parameter(1.2e-3, 'rad/s', minimum=0.0, maximum=0.1)
    """Without orbit.mean_motion: largest rate of an undeclared orbit, whose gravity gradient is estimated; 0: none."""
    undeclared_eccentricity: float = parameter(0.002, minimum=0.0, maximum=0.02)
    """With orbit.mean_motion but no orbit.eccentricity: largest undeclared eccentricity, which is estimated; 0: a
    circle."""


def make_orbit(config: SimulatedOrbitConfig) -> Orbit | None:
    """Return the orbit that the parameters describe, None where there is none.

    Raises ParameterError: Directions are missing, not at right angles, or given for a frame that has its own.
    """
    if config.mean_motion == 0.0:
        return None
    frame: Frame = 'lvlh' if config.frame == 'lvlh' else 'hill' if config.frame == 'hill' else 'inertial'
    given = [name for name in ('nadir', 'normal') if getattr(config, name)]
    if frame != 'inertial':
        if given:
            raise ParameterError(
                f"parameter 'orbit.{given[0]}' is given with orbit.frame: {frame}, which has its own; accepted: none"
            )
        return Orbit.rotating(config.mean_motion, frame).with_eccentricity(config.eccentricity, config.true_anomaly)
    if len(given) < 2:
        missing = 'normal' if 'nadir' in given else 'nadir'
        raise ParameterError(
            f"parameter 'orbit.{missing}' is empty with an orbit.frame that is inertial; accepted: three numbers, in "
            'the axes of the odometry'
        )
    nadir, normal = np.array(config.nadir), np.array(config.normal)
    size = float(np.linalg.norm(nadir) * np.linalg.norm(normal))
    if size == 0.0 or abs(float(nadir @ normal)) > _ACROSS * size:
        raise ParameterError(
            f"parameters 'orbit.nadir' {list(config.nadir)} and 'orbit.normal' {list(config.normal)} are not at right "
            'angles; accepted: directions that are'
        )
    return Orbit.inertial(config.mean_motion, nadir, normal).with_eccentricity(config.eccentricity, config.true_anomaly)


@dataclass(frozen=True)
class WheelBodies:
    """Wheels inside the base that are no joints of the robot description."""

    names: tuple[str, ...] = parameter(())
    """Names of the wheels in JointState, whose velocities are read; none may be a joint of the robot."""
    axes: tuple[float, ...] = parameter(())
    """Axis of each wheel in the base link's frame, three numbers each; any length but zero."""
    spin_inertias: tuple[float, ...] = parameter((), 'kg m^2', minimum=0.0, exclusive_minimum=True)
    """Moment of inertia of each wheel about its axis; the base link's inertia also includes it, with the wheels
    locked."""


@dataclass(frozen=True)
class WheelsConfig(WheelBodies):
    """The wheels, with their uncertainty, and gyros of which only the momentum is published."""

    spin_inertia_relative_std: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Relative standard deviation of each spin inertia, estimated by trajectory; 0: exact."""
    momentum_frame: str = parameter('')
    """Link whose axes stored_momentum uses for the angular momentum of wheels or gyros, in place of wheels.names;
    samples without such a message are not used. Empty: the topic is not used."""
    momentum_std: float = parameter(0.0, 'N m s', minimum=0.0)
    """Standard deviation of each coordinate of stored_momentum."""


@dataclass(frozen=True)
class SimulatedWheelsConfig(WheelBodies):
    """Wheels inside the base of the simulated robot that are no joints of its description."""

    speeds: tuple[float, ...] = parameter((), 'rad/s')
    """Speed of each wheel relative to the base at time 0; empty means zero."""
    accelerations: tuple[float, ...] = parameter((), 'rad/s^2')
    """Constant acceleration of each wheel; empty means zero."""
    speed_noise: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Noise of the speeds that are read."""
    publish: str = parameter('joint_states', choices=('joint_states', 'stored_momentum', 'none'))
    """Publication of the wheels: as velocities in joint_states (positions are 0), as their momentum on stored_momentum
    with every JointState, or none."""


def make_storage(
    names: Sequence[str], axes: Sequence[float], spin_inertias: Sequence[float], model: RobotModel, noise: float = 0.0
) -> Storage:
    """Return wheels inside the base, whose speeds are read with a noise (rad/s).

    Raises ParameterError: Names, axes and spin inertias differ in number, an axis is zero, or a name is that of a
    joint.
    """
    count = len(names)
    for name, values, wanted in (('axes', axes, 3 * count), ('spin_inertias', spin_inertias, count)):
        if len(values) != wanted:
            raise ParameterError(
                f"parameter 'wheels.{name}' has {len(values)} numbers; accepted: {wanted}, for the {count} of "
                "'wheels.names'"
            )
    if len(set(names) - set(model.joint_names)) < count:
        raise ParameterError(
            f"parameter 'wheels.names' is {listing(names)}; accepted: names that differ, none of them a joint's: "
            f'{listing(model.joint_names)}'
        )
    directions = np.array(axes, dtype=float).reshape(count, 3)
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    if np.any(lengths == 0.0):
        raise ParameterError(
            f"parameter 'wheels.axes' is {list(axes)}; accepted: three numbers each, not all of them 0"
        )
    return Storage.from_wheels(model.link(model.base_link), names, directions / lengths, spin_inertias, noise)
