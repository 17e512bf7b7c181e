"""The parameters of `calibrate`, beside those of the estimator: what is unknown, and how well CAD knows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mbaid_ros.config.deviations import JointDeviations, mount_orientation, mount_position
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build, parameter, specifications, unknown_parameter, values_of
from mbaid_ros.core.errors import ParameterError

NODE = 'calibrate'
_OWN = ('prior.', 'unknown_links')
_LINKS = 'prior.links.'


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
        'Standard deviation of each element I_ij about the centre of mass, relative to sqrt(I_ii I_jj); 0 means that '
        'nothing is known of it.',
        minimum=0.0,
    )


@dataclass(frozen=True)
class PriorConfig(JointDeviations, LinkPriorConfig):
    """How far links, joints and the odometry's mount may be off: one standard deviation."""

    mount_position_std: float = mount_position()
    mount_orientation_std: float = mount_orientation()


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
    links : priors of single links, by name
    """

    estimator: EstimatorConfig
    calibration: CalibrationConfig
    links: Mapping[str, LinkPriorConfig]

    def prior(self, link: str) -> LinkPriorConfig:
        """Return the prior of a link: its own, or the one for all."""
        return self.links.get(link, self.calibration.prior)


def calibration_parameters(values: Mapping[str, object]) -> CalibrationParameters:
    """Return the parameters of dotted names: the estimator's, ``unknown_links``, ``prior.*``, ``prior.links.<link>.*``.

    Raises
    ------
    ParameterError
        An unknown name, or a value that is not accepted.
    """
    of_links = {name: value for name, value in values.items() if name.startswith(_LINKS)}
    own = {name: value for name, value in values.items() if name.startswith(_OWN) and name not in of_links}
    rest = {name: value for name, value in values.items() if name not in own and name not in of_links}
    config = build(CalibrationConfig, own)
    return CalibrationParameters(build(EstimatorConfig, rest), config, _link_priors(of_links, config.prior))


def _link_priors(values: Mapping[str, object], general: PriorConfig) -> dict[str, LinkPriorConfig]:
    """Return the priors of single links: what is not given for one is as for all."""
    known = specifications(LinkPriorConfig)
    shared = {name: value for name, value in values_of(general).items() if name in known}
    given: dict[str, dict[str, object]] = {}
    for name, value in values.items():
        link, _, short = name.removeprefix(_LINKS).rpartition('.')
        if short not in known or not link:
            raise unknown_parameter(name, {f'{_LINKS}<link>.{each}': spec for each, spec in known.items()})
        try:
            given.setdefault(link, dict(shared))[short] = known[short].check(value)
        except ParameterError as error:
            raise ParameterError(str(error).replace(f"'{short}'", f"'{name}'", 1)) from error
    return {link: build(LinkPriorConfig, own) for link, own in given.items()}
