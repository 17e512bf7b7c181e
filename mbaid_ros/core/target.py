"""The target: its prior, the captured body alone, a target that slips or is exchanged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.contracts import RIGHT, Convention
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.filter.time_update import pose_reset, with_process_noise
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import BodyDeviations
from mbaid_ros.core.repair import Repair
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.robot.body import physical, physical_jacobian, standard
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.state import BODY, MOMENTUM, Variables
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import parameter

# Relative standard deviation from which a mass may be zero, at two standard deviations.
_MASS_MAY_VANISH = 0.5
_KNOWN = 0.1  # relative standard deviation of a mass, up to which its centre of mass can be compared
_STILL_A_LINK = 0.5  # times its described mass, that a link has at least: what it holds makes it no lighter
_NO_MOMENTUM = 1e-9  # N s, of a frame that nothing locates: it moves with the common centre of mass


@dataclass(frozen=True)
class TargetPriorConfig:
    """The prior of the target link with everything it holds."""

    mass: float = parameter(0.0, 'kg', minimum=0.0)
    """Mass of the target link, if known."""
    mass_std: float = parameter(0.0, 'kg', minimum=0.0)
    """Standard deviation of the target's mass; 0: unknown."""
    com: tuple[float, ...] = parameter((), 'm', lengths=(0, 3))
    """Centre of mass of the target link in its frame, if known."""
    com_std: float = parameter(0.0, 'm', minimum=0.0)
    """Standard deviation of each coordinate of target_prior.com; needs mass_std too; 0: unknown."""


@dataclass(frozen=True)
class MomentumConfig:
    """The prior of the total momentum."""

    linear_prior_std: float = parameter(0.0, 'N s', minimum=0.0)
    """Standard deviation of the total linear momentum about zero, if the servicer matched velocities before the
    capture; 0: unknown."""


@dataclass(frozen=True)
class DebrisConfig:
    """The captured body alone."""

    report: bool = parameter(default=False)
    """Also report the captured body alone: the estimate minus the target link's <inertial>, which known_links.<link>
    then declares, as in calibrate. It needs all ten numbers: on a table, use a separate link for the body."""


def changed_by(text: str, mass: float | None, centre: Array) -> str:
    """Return a target-changed text with the size of the change: kg, None if fixed, and (3,) m of the centre of mass."""
    along = ', '.join(f'{value:+.3g}' for value in centre)
    heavier = '' if mass is None else f', the mass by {mass:+.3g} kg'
    return f'{text}; the centre of mass has changed by ({along}) m{heavier}'


@dataclass(frozen=True)
class Debris:
    """The captured body: mass, CoM and inertia about it (10,), with covariance, in the target link's frame."""

    parameters: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """One standard deviation of each parameter, (10,)."""
        return np.sqrt(np.diag(self.covariance))


def debris(estimate: Estimate, link: Array, link_covariance: Array | None = None) -> Debris | None:
    """Return the captured body, None where not all ten parameters are determined or its mass may be zero.

    Standard parameters add up, so those of the link are subtracted, and the covariances of both added.

    Parameters
    ----------
    estimate : of link and captured body together
    link : (10,) standard parameters (m, h, I_o) of the link itself
    link_covariance : (10, 10) of the link's parameters; known exactly where not given
    """
    if not np.all(estimate.identifiable) or not np.all(np.isfinite(estimate.covariance)):
        return None
    together = standard(estimate.parameters)
    alone = together - link
    if alone[0] <= 0.0:
        return None
    # Covariance of (m, h, I_o) from that of (m, r_c, I_c), then on to the captured body's own (m, r_c, I_c).
    onward = physical_jacobian(alone)
    change = np.linalg.solve(physical_jacobian(together).T, onward.T).T
    covariance = change @ estimate.covariance @ change.T
    if link_covariance is not None:
        covariance = covariance + onward @ link_covariance @ onward.T
    if covariance[0, 0] > (_MASS_MAY_VANISH * alone[0]) ** 2:
        return None
    return Debris(physical(alone), covariance)


class DebrisPublication:
    """The captured body alone, as estimates that follow each other have it."""

    def __init__(self) -> None:
        self._published: Debris | None = None

    def next_published(self, found: Debris | None) -> Debris | None:
        """Return the next one, without numbers where it is not determined any more; None where that is known."""
        before, self._published = self._published, found
        if found is None and before is not None:
            return replace(before, parameters=np.full(10, np.nan), covariance=np.full((10, 10), np.nan))
        return found


@dataclass(frozen=True)
class TargetPrior:
    """The prior of the target link: mass and CoM, where given. Its step in time: `filter/time_update.py`."""

    mass: float = 0.0  # kg; 0 where nothing is known of it
    mass_std: float = 0.0  # kg
    # (3,) m in the link's frame; not used where the mass is unknown, as their product is estimated.
    com: tuple[float, ...] = ()
    com_std: float = 0.0  # m

    @property
    def declared(self) -> bool:
        """Whether anything is."""
        return self.mass_std > 0.0

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o): h = m c, to first order."""
        if self.mass_std == 0.0:
            return
        mean[0], factor[0, 0] = self.mass, self.mass_std
        if self.com and self.com_std > 0.0:
            centre = np.array(self.com)
            mean[1:4] = self.mass * centre
            factor[1:4] = 0.0
            factor[1:4, 1:4] = self.mass * self.com_std * np.eye(3)
            factor[1:4, 0] = centre * self.mass_std


@dataclass(frozen=True, eq=False)
class KnownTarget:
    """All of the target link known beforehand, as it is before a capture."""

    parameters: Array  # (10,) standard parameters (m, h, I_o)
    factor: Array  # (10, 10) of their covariance

    @property
    def declared(self) -> bool:
        """Whether anything is."""
        return True

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o)."""
        mean[:], factor[:] = self.parameters, self.factor


def target_changed_text(time: float, *, exchanged: bool) -> str:
    """Return that the body moved in the grasp at a time, s, or was exchanged for another."""
    if exchanged:
        return f'another body is in the grasp since {time:.1f} s, caught or lost: identify it from then on'
    return f'the body moved in the grasp at {time:.1f} s: identify it again from then on'


def other_targets(kernel: MomentumKernel, *, declared: bool = False) -> Iterator[Convention]:
    """Yield another unknown link on each other body: the last one with an inertia.

    Where the parameters name the target, numbers of another link would answer another question: there is no repair.
    """
    last = {link.body: link for link in kernel.model.links if link.parameters[0] > 0.0}
    for body, link in last.items() if len(kernel.unknown) == 1 else ():
        if body != kernel.target.body:
            found = f'the unknown body seems to be held by {link.name}, not {kernel.target.name}'
            yield Convention(
                f'{found}: set target_link: {link.name}',
                kernel.with_unknown_link(link.name),
                misfit_left=RIGHT,
                least_mass=_STILL_A_LINK * float(link.parameters[0]),
                repair=None if declared else Repair(found, {'target_link': link.name}),
            )


@dataclass(frozen=True, eq=False)
class ChangedTarget:
    """A target that has changed in a run."""

    time: float  # s since the first sample
    text: str  # the event in words
    exchanged: bool  # whether it is another body, not the same elsewhere
    before: MeanAndCovariance | None  # state until then; None where unknown

    def event(self, after: MeanAndCovariance | None) -> Event:
        """Return it as an event, with the change of mass and centre of mass where both states are known."""
        text, both = self.text, [each for each in (self.before, after) if each is not None]
        known = [each.deviation[BODY.start] < _KNOWN * each.mean[BODY.start] for each in both]
        if len(both) == 2 and all(known):
            then, now = (each.mean[BODY] for each in both)
            heavier = float(now[0] - then[0]) if self.exchanged else None
            text = changed_by(text, heavier, now[1:4] / now[0] - then[1:4] / then[0])
        return Event(self.time, 'target_changed', np.zeros(3), np.zeros(3), text)


def declared_linear_momentum(config: MomentumConfig, *, located: bool) -> float:
    """Return the standard deviation of the linear momentum, N s; 0 where nothing is known of it."""
    return config.linear_prior_std if located else _NO_MOMENTUM


def declared_target(config: TargetPriorConfig) -> TargetPrior:
    """Return the prior of the target; a value without its deviation, or the reverse, is refused."""
    given = {
        'mass': f'{config.mass:g} kg' if config.mass else '',
        'mass_std': f'{config.mass_std:g} kg' if config.mass_std else '',
        'com': f'{[*config.com]} m' if config.com else '',
        'com_std': f'{config.com_std:g} m' if config.com_std else '',
    }
    needs = ('mass', 'mass_std'), ('mass_std', 'mass'), ('com', 'com_std'), ('com_std', 'com'), ('com_std', 'mass_std')
    for name, other in needs:
        if given[name] and not given[other]:
            raise ParameterError(
                f"parameter 'target_prior.{name}' is {given[name]} without 'target_prior.{other}'; accepted: both"
            )
    return TargetPrior(config.mass, config.mass_std, config.com, config.com_std)


def described_prior(config: TargetPriorConfig, kernel: MomentumKernel, given: Mapping[str, float]) -> KnownTarget:
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


def another_body(gaussian: SquareRootInformation, variables: Variables, *, exchanged: bool) -> SquareRootInformation:
    """Return the gaussian with an unknown target, or with the same mass elsewhere in the grasp, and a new pose error.

    Parameters
    ----------
    gaussian : before
    variables : of the filter
    exchanged : whether it is another body, which brings or takes along a momentum of its own
    """
    own, opened = variables.first_unknown, variables.uninformative_deviation.copy()
    if not exchanged:
        opened[MOMENTUM] = opened[BODY.start] = 0.0
    places = np.flatnonzero(opened)
    return pose_reset(with_process_noise(gaussian, variables.from_state[:own, places] * opened[places]), variables)
