"""What a run that begins before the capture learns of the robot itself: the calibration, and the method after it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mbaid_ros.config.capture import SelfCalibrationConfig
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.core.calibration.prior import LinkPrior, make_prior
from mbaid_ros.core.calibration.result import Calibration
from mbaid_ros.core.capture import Calibrate, Chaser, Handover
from mbaid_ros.core.errors import DataError, ParameterError, listing
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.known_errors import calibrated
from mbaid_ros.core.samples import Samples, SensorNoise


def self_calibration(
    config: EstimatorConfig, kernel: MomentumKernel, make: Callable[[MomentumKernel], Estimator]
) -> Calibrate | None:
    """Return what calibrates a robot from the windows before its capture, None where that is not asked for.

    Parameters
    ----------
    config : EstimatorConfig
    kernel : of the robot as it is known before
    make : what makes the method after the capture, for the robot as it is known then

    Raises
    ------
    ModelError, ParameterError
        The parameters contradict each other or the robot.
    """
    if not config.calibration.enabled:
        return None
    declared = next((x for x in ('calibration', 'names') if getattr(config.known_links, x)), '')
    if declared:
        raise ParameterError(
            f"parameter 'known_links.{declared}' is {getattr(config.known_links, declared)!r}; with "
            "'calibration.enabled', which finds how well all links are known, none is accepted"
        )
    model, target = kernel.model, kernel.target.name
    links = [link for link in model.links if link.parameters[0] > 0.0]
    robot = MomentumKernel(model, *(link.name for link in links))
    settings = CalibrationSettings(
        noise=SensorNoise(**vars(config.noise)),
        priors=_priors(config.calibration, [link.name for link in links]),
        linear_momentum_std=config.momentum.linear_prior_std,
    )
    make_prior(robot, settings.priors)  # what is wrong with it is said at once, not at the capture

    def learn(windows: list[Samples]) -> Handover:
        found = calibrate(robot, [windows], settings)
        if found.determined == 0:
            raise DataError(
                'the data before it say nothing that the URDF does not; accepted: a run in which all joints move'
            )
        values = dict(zip((link.name for link in links), found.theta.reshape(-1, 10), strict=True))
        known = replace(
            model, links=tuple(replace(x, parameters=values.get(x.name, x.parameters)) for x in model.links)
        )
        after = MomentumKernel(known, target).doubted(calibrated(links, found.covariance, [target]))
        place = 10 * list(values).index(target) if target in values else None
        return Handover(
            kernel=after,
            after=make(after),
            chaser=Chaser(found.momentum[0], found.momentum_covariance[0], found.residual, found.samples),
            link_covariance=None if place is None else found.covariance[place : place + 10, place : place + 10],
            told=_told(found),
        )

    return learn


def _priors(config: SelfCalibrationConfig, links: list[str]) -> tuple[LinkPrior, ...]:
    if len(config.weighed_links) != len(config.weighed_stds):
        raise ParameterError(
            f"parameter 'calibration.weighed_stds' has {len(config.weighed_stds)} numbers; accepted: "
            f"{len(config.weighed_links)}, one for each of 'calibration.weighed_links'"
        )
    weighed = dict(zip(config.weighed_links, config.weighed_stds, strict=True))
    foreign = [name for name in weighed if name not in links]
    if foreign:
        raise ParameterError(
            f"parameter 'calibration.weighed_links' has '{foreign[0][:60]}'; accepted: links with an <inertial>: "
            f'{listing(links)}'
        )
    return tuple(
        LinkPrior(weighed.get(name, config.mass_relative_std), config.com_std, config.inertia_relative_std)
        for name in links
    )


def _told(found: Calibration) -> str:
    return (
        f'{len(found.prior.links)} bodies calibrated from the {found.span:.3g} s before the capture: '
        f'they say more than the URDF of {found.determined} combinations, total mass known to '
        f'{100.0 * found.scale.relative_std:.2g} %, residual {found.residual:.2f}'
    )
