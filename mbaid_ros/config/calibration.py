"""The parameters of `calibrate`, beside those of the estimator: what is unknown, and how well CAD knows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

from mbaid_ros.config.deviations import JointDeviations, mount_orientation, mount_position
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build, by_name, parameter

NODE = 'calibrate'
_OWN = ('prior.', 'unknown_links')


@dataclass(frozen=True)
class LinkPriorConfig:
    """How far the <inertial> of every unknown link may be off: one standard deviation."""

    mass_relative_std: float = parameter(
        0.05, 'Relative standard deviation of each mass; 0 means that nothing is known of it.', minimum=0.0
    )
    com_std: float = parameter(
        0.01,
        'Standard deviation of each coordinate of a centre of mass; 0 means that nothing is known of it.',
        unit='m',
        minimum=0.0,
    )
    inertia_relative_std: float = parameter(
        0.1,
        'Standard deviation of each element I_ij about the centre of mass at a given mass, relative to '
        'sqrt(I_ii I_jj); 0 means that nothing is known of it.',
        minimum=0.0,
    )


@dataclass(frozen=True)
class LinkPriorsConfig:
    """The same of single links."""

    own: Mapping[str, Mapping[str, float]] = by_name(LinkPriorConfig, 'link')


@dataclass(frozen=True)
class PriorConfig(JointDeviations, LinkPriorConfig):
    """How far links, joints and the odometry's mount may be off: one standard deviation."""

    mount_position_std: float = mount_position()
    mount_orientation_std: float = mount_orientation()
    links: LinkPriorsConfig = field(default_factory=LinkPriorsConfig)


@dataclass(frozen=True)
class CalibrationConfig:
    """What is calibrated."""

    unknown_links: tuple[str, ...] = parameter(
        (), 'Links to calibrate; the others count as known. Empty means every link that has an <inertial>.'
    )
    prior: PriorConfig = field(default_factory=PriorConfig)


@dataclass(frozen=True)
class CalibrationParameters:
    """Everything that `calibrate` is told.

    Attributes
    ----------
    estimator : noise, windows, frames: as for the estimator
    calibration : CalibrationConfig
    """

    estimator: EstimatorConfig
    calibration: CalibrationConfig

    def prior(self, link: str) -> LinkPriorConfig:
        """Return the prior of a link: its own, or what is said of all."""
        prior = self.calibration.prior
        shared = {item.name: getattr(prior, item.name) for item in fields(LinkPriorConfig)}
        return LinkPriorConfig(**{**shared, **prior.links.own.get(link, {})})


def calibration_parameters(values: Mapping[str, object]) -> CalibrationParameters:
    """Return the parameters of dotted names: the estimator's, ``unknown_links``, ``prior.*``, ``prior.links.<link>.*``.

    Raises
    ------
    ParameterError
        An unknown name, or a value that is not accepted.
    """
    own = {name: value for name, value in values.items() if name.startswith(_OWN)}
    rest = {name: value for name, value in values.items() if name not in own}
    return CalibrationParameters(build(EstimatorConfig, rest), build(CalibrationConfig, own))
