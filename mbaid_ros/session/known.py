"""How well the known bodies are known: what the parameters declare, or what a calibration has left open."""

from __future__ import annotations

import numpy as np

from mbaid_ros.config.calibrated import CalibratedLinks, read_calibration
from mbaid_ros.config.known_side import KnownLinksConfig
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.known_errors import KnownErrors, body_sizes, calibrated, declared
from mbaid_ros.core.robot.model import RobotModel

# Parts of a body's typical sizes by which its values in the two files may differ: they are written to 12 digits.
_SAME = 1e-6


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
        size = config.relative_std * body_sizes(link) if link[0] > 0.0 else np.zeros(10)
        return kernel.doubted(declared_errors(kernel, config)), np.diag(size**2) if np.any(size) else None
    if config.names:
        raise ParameterError(
            f"parameter 'known_links.names' is {config.names!r}; with 'known_links.calibration', which says it of all "
            'bodies, none is accepted'
        )
    found = read_calibration(config.calibration)
    _require_the_same(found, kernel.model)
    links = [kernel.model.link(name) for name in found.names]
    errors = calibrated(links, found.covariance, [link.name for link in kernel.unknown])
    place = 10 * found.names.index(kernel.target.name) if kernel.target.name in found.names else None
    own = None if place is None else found.covariance[place : place + 10, place : place + 10]
    return kernel.doubted(errors), own


def _require_the_same(found: CalibratedLinks, model: RobotModel) -> None:
    """Refuse a calibration of another robot, or one whose values the robot description does not have."""
    names = [link.name for link in model.links]
    foreign = [name for name in found.names if name not in names]
    if foreign:
        raise ParameterError(
            f"calibration '{found.path}' is of {listing(foreign)}; accepted: links of the robot description: "
            f'{listing(names)}'
        )
    for index, name in enumerate(found.names):
        link, values = model.link(name).parameters, found.values[10 * index : 10 * index + 10]
        if not link[0] > 0.0 or np.any(np.abs(link - values) > _SAME * body_sizes(link)):
            raise ParameterError(
                f"link '{name}' has other values in the robot description than in calibration '{found.path}' "
                f'({link[0]:.6g} kg, {values[0]:.6g} kg); accepted: the URDF that calibrate --output wrote with it'
            )


def declared_errors(kernel: MomentumKernel, config: KnownLinksConfig) -> KnownErrors:
    """Return the errors that the parameters declare, body by body.

    Raises
    ------
    ParameterError
        Names and standard deviations differ in number, or a name is not that of a link.
    """
    if len(config.names) != len(config.stds):
        raise ParameterError(
            f"parameter 'known_links.stds' has {len(config.stds)} numbers; accepted: {len(config.names)}, one for each "
            "of 'known_links.names'"
        )
    stds = [config.relative_std] * len(kernel.known)
    bodies = {link.name: link.body for link in kernel.model.links}
    for name, std in zip(config.names, config.stds, strict=True):
        if name not in bodies:
            raise ParameterError(f"parameter 'known_links.names' has '{name[:60]}'; accepted: {listing(bodies)}")
        stds[bodies[name]] = std
    return declared(kernel.known, stds)
