"""How well the known bodies are known: what the parameters declare, or what a calibration has left open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.config.calibrated import CalibrationFile, read_calibration
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.known_side import KnownLinksConfig
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.known_errors import BodyDeviations, KnownErrors, body_sizes, calibrated, declared
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.unknowns.calibrated_side import CalibratedSide
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.session.uncertainty import declared_uncertainty

# Parts of a body's typical sizes by which its values in the two files may differ: they are written to 12 digits.
# Joints' frames: m, and about as many rad.
_SAME = 1e-6
# Said of data that contradict a model in which nothing may be off.
EXACT_ROBOT = (
    'the robot is said to be exactly its URDF, as only a simulated one is: leave known_links, known_joints and '
    'odometry_mount at their defaults, or say how well it is known'
)
_ACCEPTED = 'accepted: the URDF that calibrate --output wrote with it'


@dataclass(frozen=True, eq=False)
class KnownRobot:
    """How well a robot is known, as the trajectory filter needs it.

    Attributes
    ----------
    kernel : with the errors of its known bodies, as the catalogue of unknowns has them
    uncertainty : of all else, and what is known of all of it together
    """

    kernel: MomentumKernel
    uncertainty: Uncertainty


def with_known_errors(kernel: MomentumKernel, config: KnownLinksConfig) -> tuple[MomentumKernel, Array | None]:
    """Return a kernel with the errors of its known bodies, and the covariance of the target link's own parameters.

    Returns
    -------
    MomentumKernel; (10, 10) of (m, h, I_o) in the target link's frame, None where they count as exact

    Raises
    ------
    ParameterError
        The parameters contradict each other or the robot, or the calibration cannot be used.
    """
    link = kernel.target.parameters
    if not config.calibration:
        target = declared(link[None], config.relative_std)
        return kernel.with_uncertainty(declared_errors(kernel, config)), target.covariance if target.count else None
    found = _calibration(kernel.model, config)
    count = 10 * len(found.links)
    links = [kernel.model.link(name) for name in found.links]
    errors = calibrated(links, found.covariance[:count, :count], [link.name for link in kernel.unknown])
    place = 10 * found.links.index(kernel.target.name) if kernel.target.name in found.links else None
    own = None if place is None else found.covariance[place : place + 10, place : place + 10]
    return kernel.with_uncertainty(errors), own


def known_side(config: EstimatorConfig, kernel: MomentumKernel) -> KnownRobot:
    """Return how well the parameters, or a calibration that they name, have a robot known.

    Parameters
    ----------
    config : EstimatorConfig
    kernel : with the errors of its known bodies

    Raises
    ------
    ParameterError
        The parameters contradict each other or the robot, or the calibration cannot be used.
    """
    uncertainty = declared_uncertainty(config, kernel.model)
    if not config.known_links.calibration:
        return KnownRobot(kernel, uncertainty)
    found = _calibration(kernel.model, config.known_links)
    side = CalibratedSide(
        tuple(kernel.model.link(name) for name in found.links),
        found.values[10 * len(found.links) : -6 : 6],
        found.values[-6:],
        found.covariance,
    )
    return KnownRobot(*side.known_to(kernel, uncertainty))


def doubting_exactness(estimates: list[Estimate], config: EstimatorConfig) -> list[Estimate]:
    """Return estimates, of which those that contradict the data recall that the robot is said to be its URDF exactly.

    Single causes are tried one by one: that everything is a little off is none of them.
    """
    links, joints, mount = config.known_links, config.known_joints, config.odometry_mount
    uncertain = (
        *(links.relative_std, links.links, links.calibration),
        *(joints.zero_std, joints.origin_std, joints.axis_std, joints.tracking_std, joints.joints),
        *(mount.position_std, mount.orientation_std),
    )
    if any(uncertain):
        return estimates
    return [replace(each, warnings=(*each.warnings, EXACT_ROBOT)) if each.contradicted else each for each in estimates]


def _calibration(model: RobotModel, config: KnownLinksConfig) -> CalibrationFile:
    """Return the calibration that the parameters name, of the very robot."""
    if config.links:
        raise ParameterError(
            f"parameter 'known_links.{next(iter(config.links))}' is given; with 'known_links.calibration', which says "
            'it of all bodies, none is accepted'
        )
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

    Raises
    ------
    ParameterError
        A name is not that of a known link with mass.
    """
    unknown = {link.name for link in kernel.unknown}
    massive = (link for link in kernel.model.links if link.parameters[0] > 0.0 and link.name not in unknown)
    bodies = {link.name: link.body for link in massive}
    own: dict[int, BodyDeviations] = {}
    for name, given in config.links.items():
        if name in unknown:
            raise ParameterError(
                f"parameter 'known_links.{name[:60]}' is of the link that is identified; what is known of that goes "
                'into target_prior.mass, mass_std, com and com_std'
            )
        if name not in bodies:
            raise ParameterError(
                f"parameter 'known_links.{name[:60]}' is of no known link with mass; accepted: {listing(bodies)}"
            )
        every = BodyDeviations.relative(kernel.known[bodies[name]], config.relative_std)
        own[bodies[name]] = BodyDeviations(
            given.get('mass_relative_std', every.mass),
            given.get('com_std', every.com),
            given.get('inertia_relative_std', every.inertia),
        )
    return declared(kernel.known, config.relative_std, own)
