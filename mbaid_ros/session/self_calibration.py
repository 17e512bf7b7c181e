"""What a run that begins before the capture learns of the robot itself: the calibration, and the method after it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from mbaid_ros.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.calibration.result import Calibration
from mbaid_ros.calibration.unknowns import LinkPrior, make_prior
from mbaid_ros.config.capture import SelfCalibrationConfig
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.capture import Calibrate, Chaser, Handover
from mbaid_ros.core.errors import DataError, ParameterError, listing
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.robot.model_errors import calibrated, displaced
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.unknowns.catalogue import underestimated_text
from mbaid_ros.session.posterior import KnownRobot
from mbaid_ros.session.uncertainty import declared_uncertainty

# Where the priors of bodies are declared; of the others, where those of any run are.
_DECLARED = {
    'link': 'calibration.mass_relative_std, .com_std, .inertia_relative_std',
    'mass': 'calibration.mass_relative_std',
}


def self_calibration(
    config: EstimatorConfig, kernel: MomentumKernel, make: Callable[..., Estimator]
) -> Calibrate | None:
    """Return what calibrates a robot from the windows before its capture, None where that is not asked for.

    Parameters
    ----------
    config : EstimatorConfig
    kernel : of the robot as it is known before
    make : what makes the method after the capture, of a kernel and of how well the robot is known then

    Raises
    ------
    ModelError, ParameterError
        The parameters contradict each other or the robot.
    """
    if not config.calibration.enabled:
        return None
    known = config.known_links
    declared = 'calibration' if known.calibration else next(iter(known.links), '')
    if declared:
        raise ParameterError(
            f"parameter 'known_links.{declared}' is given; with 'calibration.enabled', which finds how well all links "
            'are known, none is accepted'
        )
    model, target = kernel.model, kernel.target
    # The target link comes first: it is what the filter has unknown after the capture.
    massive = [link for link in model.links if link.parameters[0] > 0.0 and link.name != target.name]
    links = [target, *massive]
    robot = MomentumKernel(model, *(link.name for link in links)).storing(kernel.storage)
    settings = CalibrationSettings(
        noise=config.noise.declared,
        priors=_priors(config.calibration, links),
        uncertainty=declared_uncertainty(config, model),
        window=config.window,
        gyro=config.imu.noise_density,
    )
    make_prior(robot, settings.priors)  # what is wrong with it is said at once, not at the capture

    def learn(windows: list[Samples]) -> Handover:
        found = calibrate(robot, [windows], settings)
        if not found.settled:
            raise DataError('the data before it lead to no solution that stays; accepted: a URDF that is nearer')
        if found.determined == 0:
            raise DataError(
                'the data before it say nothing that the URDF does not; accepted: a run in which all joints move'
            )
        after = MomentumKernel(_learnt(model, found), target.name).storing(kernel.storage)
        after = after.with_uncertainty(calibrated(links, found.covariance, [target.name]))
        # From here on the target link may be anything; all else is as it has been found, correlations and all.
        before = kernel.with_uncertainty(found.prior.errors(1))
        known = KnownRobot(before, replace(settings.uncertainty, carried=found.carried))
        return Handover(
            kernel=after,
            after=make(after, known),
            again=partial(make, after, known),
            chaser=Chaser(found.momentum[0], found.momentum_covariance[0], found.residual, found.samples),
            link_covariance=found.covariance[:10, :10] if target.parameters[0] > 0.0 else None,
            told=_told(found),
        )

    return learn


def _learnt(model: RobotModel, found: Calibration) -> RobotModel:
    """Return a robot with the bodies and joint frames of a calibration."""
    values = dict(zip((link.name for link in found.prior.links), found.theta.reshape(-1, 10), strict=True))
    links = (
        replace(link, parameters=values[link.name]) if link.name in values and link.parameters[0] > 0.0 else link
        for link in model.links
    )
    return displaced(replace(model, links=tuple(links)), *found.displacements)


def _priors(config: SelfCalibrationConfig, links: Sequence[Link]) -> tuple[LinkPrior, ...]:
    if len(config.weighed_links) != len(config.weighed_stds):
        raise ParameterError(
            f"parameter 'calibration.weighed_stds' has {len(config.weighed_stds)} numbers; accepted: "
            f"{len(config.weighed_links)}, one for each of 'calibration.weighed_links'"
        )
    weighed = dict(zip(config.weighed_links, config.weighed_stds, strict=True))
    names = [link.name for link in links if link.parameters[0] > 0.0]
    foreign = [name for name in weighed if name not in names]
    if foreign:
        raise ParameterError(
            f"parameter 'calibration.weighed_links' has '{foreign[0][:60]}'; accepted: links with an <inertial>: "
            f'{listing(names)}'
        )
    return tuple(
        LinkPrior(weighed.get(link.name, config.mass_relative_std), config.com_std, config.inertia_relative_std)
        if link.parameters[0] > 0.0
        else LinkPrior(0.0, 0.0, 0.0, empty=True)
        for link in links
    )


def _told(found: Calibration) -> str:
    bodies = sum(not std.empty for std in found.prior.stds)
    further_off = ''.join('; ' + underestimated_text(kind, size, _DECLARED) for kind, size in found.further_off)
    return (
        f'{bodies} bodies calibrated from the {found.span:.3g} s before the capture: '
        f'they say more than the URDF of {found.determined} combinations, total mass known to '
        f'{100.0 * found.scale.relative_std:.2g} %, residual {found.residual:.2f}{further_off}'
    )
