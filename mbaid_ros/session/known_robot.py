"""The nominal model and its uncertainty, as declared or calibrated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.config.calibration import CalibrationFile, read_calibration
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import KnownLinksConfig, TargetPriorConfig
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.filter.state import Declared
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.model_errors import BodyDeviations, KnownErrors, calibrated_errors, independent_errors
from mbaid_ros.core.robot.momentum import body_sizes
from mbaid_ros.core.unknowns.bodies import KnownTarget, TotalMass
from mbaid_ros.core.unknowns.catalogue import CalibratedModel
from mbaid_ros.session.catalogue import declaration

# Largest difference between the two files, which have 12 digits: of a body, relative to its typical size; of a joint's
# frame, m or rad.
_SAME = 1e-6
# Warning of a contradicted run in which nothing may deviate.
EXACT_ROBOT = (
    'the robot is declared to be exactly its URDF, as only a simulated one is: leave known_links, known_joints and '
    'odometry_mount at their defaults, or declare its uncertainty'
)
_ACCEPTED = 'accepted: the URDF that calibrate --output wrote with it'


@dataclass(frozen=True, eq=False)
class KnownRobot:
    """The nominal model with its uncertainty, as the trajectory filter needs it."""

    kernel: MomentumKernel  # with the errors of its known bodies, as the unknowns have them
    declared: Declared


def with_known_errors(kernel: MomentumKernel, config: KnownLinksConfig) -> tuple[MomentumKernel, Array | None]:
    """Return a kernel with the errors of its known bodies, and the covariance of the target link's own parameters.

    The covariance is (10, 10) of (m, h, I_o) in the target link's frame, None where they count as exact.

    Raises ParameterError: The parameters contradict each other or the robot, or the calibration cannot be used.
    """
    link = kernel.target.parameters
    if not config.calibration:
        given = config.links.get(kernel.target.name)
        own = {0: link_deviations(link, config, given)} if given and link[0] > 0.0 else {}
        target = independent_errors(link[None], config.relative_std, own)
        return kernel.with_errors(declared_errors(kernel, config)), target.covariance if target.count else None
    found = _calibration(kernel.model, config)
    count = 10 * len(found.links)
    links = [kernel.model.link(name) for name in found.links]
    errors = calibrated_errors(links, found.covariance[:count, :count], [link.name for link in kernel.unknown])
    place = 10 * found.links.index(kernel.target.name) if kernel.target.name in found.links else None
    alone = None if place is None else found.covariance[place : place + 10, place : place + 10]
    return kernel.with_errors(errors), alone


def nominal_model(config: EstimatorConfig, kernel: MomentumKernel) -> KnownRobot:
    """Return the nominal model of a kernel that has the errors of its known bodies, as declared or calibrated.

    Raises ParameterError: The parameters contradict each other or the robot, or the calibration cannot be used.
    """
    as_declared = declaration(config, kernel)
    if not config.known_links.calibration:
        given = config.known_links.links.get(kernel.target.name)
        if given is not None and not config.debris.report:  # otherwise it is of the <inertial> alone
            as_declared = replace(as_declared, target=_target_prior(config.target_prior, kernel, given))
        return KnownRobot(kernel, replace(as_declared, total_mass=_mass_without_target(config.known_links, kernel)))
    found = _calibration(kernel.model, config.known_links)
    side = CalibratedModel(
        tuple(kernel.model.link(name) for name in found.links),
        found.values[10 * len(found.links) : -6 : 6],
        found.values[-6:],
        found.covariance,
    )
    located = not config.imu.alone or config.imu.orientation
    kernel, unknowns, known = side.with_kernel(kernel, as_declared.unknowns, located=located)
    return KnownRobot(kernel, replace(as_declared, unknowns=unknowns, joint_prior=known))


def declared_mass(config: KnownLinksConfig) -> TotalMass | None:
    """Return the mass of the whole robot, None where it is not declared; half of a declaration is refused."""
    if (config.total_mass > 0.0) != (config.total_mass_std > 0.0):
        raise ParameterError(
            f"parameters 'known_links.total_mass' and '.total_mass_std' are {config.total_mass:g} kg and "
            f'{config.total_mass_std:g} kg; accepted: both above 0, or none'
        )
    return TotalMass(config.total_mass, config.total_mass_std) if config.total_mass else None


def _mass_without_target(config: KnownLinksConfig, kernel: MomentumKernel) -> TotalMass | None:
    """Return the mass of all bodies but the target, whose own part has the mass of its <inertial>, as declared."""
    total, own = declared_mass(config), kernel.target.parameters
    if total is None or own[0] <= 0.0:
        return total
    given = config.links.get(kernel.target.name, {}).get('mass_relative_std', np.sqrt(2.0) * config.relative_std)
    return TotalMass(total.mass - float(own[0]), float(np.hypot(total.std, given * own[0])))


def declared_exact(config: EstimatorConfig) -> bool:
    """Return whether the parameters declare a robot that is exactly its URDF.

    Fault isolation tries single causes one by one: that everything deviates a little is none of them.
    """
    links, joints, mount = config.known_links, config.known_joints, config.odometry_mount
    uncertain = (
        *(links.relative_std, links.links, links.calibration),
        *(joints.zero_std, joints.origin_std, joints.axis_std, joints.tracking_std, joints.joints),
        *(mount.position_std, mount.orientation_std),
    )
    return not any(uncertain)


def _calibration(model: RobotModel, config: KnownLinksConfig) -> CalibrationFile:
    """Return the calibration that the parameters name, of the very robot."""
    found = read_calibration(config.calibration)
    _require_the_same(found, model)
    return found


def _require_the_same(found: CalibrationFile, model: RobotModel) -> None:
    """Refuse a calibration of another robot, or one whose values the robot description does not have."""
    names = [link.name for link in model.links]
    foreign = [name for name in found.links if name not in names]
    if foreign:
        raise ParameterError(
            f"calibration '{found.path}' is of {listing(foreign)}; accepted: links of the robot description: "
            f'{listing(names)}'
        )
    if found.joints != model.joint_names:
        raise ParameterError(
            f"calibration '{found.path}' has the joints {listing(found.joints)}; accepted: those of the robot "
            f'description: {listing(model.joint_names)}'
        )
    for index, name in enumerate(found.links):
        link, values = model.link(name).parameters, found.values[10 * index : 10 * index + 10]
        if not link[0] > 0.0 or np.any(np.abs(link - values) > _SAME * body_sizes(link)):
            raise ParameterError(
                f"link '{name}' has other values in the robot description than in calibration '{found.path}' "
                f'({link[0]:.6g} kg, {values[0]:.6g} kg); {_ACCEPTED}'
            )
    moved = np.linalg.norm(model.positions - found.positions, axis=1)
    turned = np.linalg.norm(model.rotations - found.rotations, axis=(1, 2))
    for name, metres, radians in zip(model.joint_names, moved, turned, strict=True):
        if max(metres, radians) > _SAME:
            raise ParameterError(
                f"joint '{name}' is elsewhere in the robot description than in calibration '{found.path}' "
                f'({metres:.2g} m, {radians:.2g} rad away); {_ACCEPTED}'
            )


def declared_errors(kernel: MomentumKernel, config: KnownLinksConfig) -> KnownErrors:
    """Return the errors that the parameters declare, body by body.

    Raises ParameterError: A name is not that of a known link with mass.
    """
    unknown = {link.name for link in kernel.unknown}
    massive = (link for link in kernel.model.links if link.parameters[0] > 0.0 and link.name not in unknown)
    bodies = {link.name: link.body for link in massive}
    own: dict[int, BodyDeviations] = {}
    for name, given in config.links.items():
        if name == kernel.target.name:
            continue  # it has a prior of its own
        if name not in bodies:
            raise ParameterError(
                f"parameter 'known_links.{name[:60]}' is of no known link with mass; accepted: {listing(bodies)}"
            )
        own[bodies[name]] = link_deviations(kernel.known[bodies[name]], config, given)
    return independent_errors(kernel.known, config.relative_std, own)


def link_deviations(body: Array, config: KnownLinksConfig, given: Mapping[str, float]) -> BodyDeviations:
    """Return the declared deviations of a body (10,): those given by name, the others of the relative std."""
    every = BodyDeviations.from_relative(body, config.relative_std)
    return BodyDeviations(
        given.get('mass_relative_std', every.mass),
        given.get('com_std', every.com),
        given.get('inertia_relative_std', every.inertia),
    )


def _target_prior(config: TargetPriorConfig, kernel: MomentumKernel, given: Mapping[str, float]) -> KnownTarget:
    """Return the prior of a target link that the robot description describes as well as `given`."""
    target, name = kernel.target, f'known_links.{kernel.target.name[:60]}'
    stds = [given.get(part, 0.0) for part in ('mass_relative_std', 'com_std', 'inertia_relative_std')]
    if min(stds) <= 0.0 or target.parameters[0] <= 0.0:
        raise ParameterError(
            f"parameter '{name}' is of the link that is identified; accepted: mass_relative_std, com_std and "
            'inertia_relative_std, all above 0, and an <inertial> in the robot description, or target_prior.mass'
        )
    if config.mass_std > 0.0:
        raise ParameterError(f"parameters '{name}' and 'target_prior' are both of the same link; accepted: one")
    return KnownTarget(target.parameters, BodyDeviations(*stds).factor(target.parameters))
