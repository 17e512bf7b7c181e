"""The estimate and its events, the ten parameters, intervals as they are printed, and the error budget."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from mbaid_ros.core.geometry import (
    Array,
    Flags,
)
from mbaid_ros.core.noise import NoiseLevels
from mbaid_ros.core.repair import Repair

# Mass, centre of mass (link frame), inertia about it (link axes).
PARAMETERS = ('mass', 'com_x', 'com_y', 'com_z', 'ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
UNITS = ('kg', 'm', 'm', 'm', *('kg m^2',) * 6)
BAND = 1.96  # standard deviations either side that contain 95 % of a Gaussian
_DIGITS = 2  # of a standard deviation: more would claim to know how well it is known
_MOST_DECIMALS = 7  # written out: more of them, or a number from 1e7 on whose ones are not known, are a power of ten
SENSOR_NOISE = 'sensor noise'
MAIN_CAUSES = 'main causes of the variance'  # the heading of `ErrorBudget.main_causes`
UNOBSERVABLE = 'unobservable with this motion'  # the heading of `ErrorBudget.unobservable`
GROUPS = {'mass': slice(0, 1), 'centre of mass': slice(1, 4), 'inertia': slice(4, 10)}
_MOST = 0.5  # share from which one cause is named: it alone limits the precision
_RESTS, _NAMED = 0.1, 5  # share from which an unobservable standard deviation is named; how many of them
_SHORT = {'zero': 'zero of {}', 'origin': 'origin of {}', 'axis': 'axis of {}', 'link': 'link {}'}
_SHORT |= {f'{thing} {part}': f'{part} of {{}}' for thing in ('gyro', 'pose') for part in ('mount', 'delay', 'scale')}
_SHORT |= {'gyro bias': 'bias of {}', 'pose world': 'world of {}', 'pose turning': 'drift of {}'}
# Where the parameters would be published if the data did not contradict the model.
WITHHELD = 'the data contradict the model so strongly that no parameter can be published'
# Where a run is relative to the capture; core/capture.py decides.
CapturePhase = Literal['pre_capture', 'capture', 'post_capture']
Status = Literal['waiting', 'estimating', 'converged', 'not_identifiable', 'inconsistent']
PULSE = 'thrust pulse or contact'
SYMPTOM = 'one of too many jumps for a pulse: something else is wrong'


def rounded(value: float, std: float, unknown: str = '', digits: int = 6) -> tuple[str, str]:
    """Return a value and its 95 % band, both to the decimal of the second significant digit of the standard deviation.

    Parameters
    ----------
    value, std : number and one standard deviation of it; NaN where not known
    unknown : text for a number that is not known
    digits : significant ones of a value whose standard deviation is not known
    """
    if not math.isfinite(value):
        return unknown, unknown
    if not (math.isfinite(std) and std > 0.0):
        return f'{value:.{digits}g}', f'{0.0:g}' if std == 0.0 else unknown
    # As it is printed: 0.0996 has its second digit where 0.10 has it.
    decimals = _DIGITS - 1 - int(f'{std:.{_DIGITS - 1}e}'.partition('e')[2])
    return _with_decimals(value, decimals), _with_decimals(BAND * std, decimals)


def with_band(value: Array, std: Array, scale: float = 1.0) -> str:
    """Return a size with its 95 % interval: that of one number with its sign, that of several the length."""
    size = float(value[0]) if len(value) == 1 else float(np.linalg.norm(value))
    along = np.abs(value) / max(float(np.linalg.norm(value)), 1e-300)
    band = BAND * float(np.linalg.norm(along * std))
    sign = '+' if len(value) == 1 else ''
    return f'{scale * size:{sign}.3g} ± {scale * band:.2g}'


def _with_decimals(value: float, decimals: int) -> str:
    kept = round(value, decimals) + 0.0  # no -0.0
    if 0 <= decimals <= _MOST_DECIMALS:
        return f'{kept:.{decimals}f}'
    if not kept or (decimals < 0 and abs(kept) < 1e7):
        return f'{kept:.0f}'
    exponent = math.floor(math.log10(abs(kept)))
    return f'{kept:.{max(exponent + decimals, 0)}e}'


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Shares of the ten parameters' variances: the contributions of sensor noise and the independent priors add up."""

    # c names, sensor noise first: 'link:base_link', 'zero:joint6', 'origin:joint6', 'axis:joint6', 'mount',
    causes: tuple[str, ...]
    # (10, c) in the order of PARAMETERS, each row adding up to 1; NaN where a parameter is not determined
    shares: Array
    # (10, c) which of them rest on a declaration that the data hardly see: if it is wrong, the parameter is further off
    # than its interval, and no residual shows it; none where not given
    unobserved: Flags = field(default_factory=lambda: np.zeros((10, 1), dtype=bool))

    def shares_of(self, parameter: str, least: float = 1e-3) -> dict[str, float]:
        """Return the shares of one parameter, the largest first, without those below `least`; empty where not known."""
        return self._ordered(self.shares[PARAMETERS.index(parameter)], least)

    def grouped(self, std: Array, least: float = 1e-3) -> dict[str, dict[str, float]]:
        """Return the shares, from `least` on, of mass, centre of mass and inertia as wholes, where any is determined.

        The variance of a whole is the sum of its elements', so it does not depend on how the axes lie; std (10,).
        """
        found = {}
        for group, which in GROUPS.items():
            variances, shares = std[which] ** 2, self.shares[which]
            known = np.isfinite(variances) & np.all(np.isfinite(shares), axis=1)
            total = float(np.sum(variances[known]))
            if total > 0.0:
                found[group] = self._ordered(variances[known] @ shares[known] / total, least)
        return found

    def main_causes(self, std: Array) -> str:
        """Return the largest share of each group's variance in a line, empty where not known; std (10,).

        'link base_link (62 % of mass, 40 % of inertia), zero of joint7 (26 % of centre of mass)'
        """
        found: dict[str, list[str]] = {}
        for group, shares in self.grouped(std, 0.0).items():
            cause, share = next(iter(shares.items()))
            found.setdefault(cause, []).append(f'{percent(share)} of {group}')
        return _listed(found, found)

    def unobservable(self) -> str:
        """Return the declarations that dominate the intervals and are hardly observable, in a line as by `main_causes`.

        The share is the largest that one has in the variance of any parameter of a group.
        """
        found: dict[str, list[tuple[float, str]]] = {}
        shares = np.where(self.unobserved & np.isfinite(self.shares), self.shares, 0.0)
        for group, which in GROUPS.items():
            for cause, share in zip(self.causes, np.max(shares[which], axis=0), strict=True):
                if share >= _RESTS:
                    found.setdefault(cause, []).append((float(share), f'{percent(share)} of {group}'))
        order = sorted(found, key=lambda cause: -max(found[cause])[0])[:_NAMED]
        return _listed(order, {cause: [text for _, text in found[cause]] for cause in order})

    def dominant(self, std: Array) -> dict[str, dict[str, float]]:
        """Return the sources, other than sensor noise, of more than half of a group's variance: by group; std (10,)."""
        found: dict[str, dict[str, float]] = {}
        for group, shares in self.grouped(std).items():
            for cause, share in shares.items():
                if cause != SENSOR_NOISE and share > _MOST:
                    found.setdefault(cause, {})[group] = share
        return found

    def left_of_std(self, times: float) -> Array:
        """Return the least that n = `times` times the data of the same motion leave of each standard deviation, (10,).

        Where sensor noise makes the share s of a variance V, they leave at least V / (1 + (n - 1) s). Relative, NaN
        where not determined.
        """
        noise = self.shares[:, self.causes.index(SENSOR_NOISE)]
        return np.asarray(1.0 / np.sqrt(1.0 + (times - 1.0) * noise))

    def _ordered(self, row: Array, least: float) -> dict[str, float]:
        pairs = [(cause, float(share)) for cause, share in zip(self.causes, row, strict=True) if share >= least]
        return dict(sorted(pairs, key=lambda pair: -pair[1]))


class DeferredBudget(ErrorBudget):
    """An error budget that is computed when it is read: most estimates are published or kept without anybody asking.

    Parameters
    ----------
    causes : as of `ErrorBudget`
    compute : returns its shares and the unobservable part
    """

    def __init__(self, causes: tuple[str, ...], compute: Callable[[], tuple[Array, Flags]]) -> None:
        object.__setattr__(self, 'causes', causes)
        object.__setattr__(self, '_compute', compute)

    @cached_property
    def _computed(self) -> tuple[Array, Flags]:
        computed: tuple[Array, Flags] = self.__dict__.pop('_compute')()  # with the state that it is computed of
        return computed

    @property
    def shares(self) -> Array:
        """The shares, (10, c)."""
        return self._computed[0]

    @property
    def unobserved(self) -> Flags:
        """Which of them the data hardly see, (10, c)."""
        return self._computed[1]

    def __reduce__(self) -> tuple[type[ErrorBudget], tuple[tuple[str, ...], Array, Flags]]:
        """Leave the state behind when it is sent to another process."""
        return ErrorBudget, (self.causes, self.shares, self.unobserved)


def _listed(causes: Iterable[str], shares: dict[str, list[str]]) -> str:
    return ', '.join(f'{short(cause)} ({", ".join(shares[cause])})' for cause in causes)


def short(cause: str) -> str:
    """Return a cause in a few words."""
    kind, _, name = cause.partition(':')
    return _SHORT.get(kind, '{}').format(name) if name else cause


def percent(share: float) -> str:
    """Return a share in words."""
    return f'{100.0 * share:.0f} %'


def contradiction(status: str, warnings: Sequence[str]) -> bool:
    """Return whether data contradict the model, be there numbers or none for that very reason."""
    return status == 'inconsistent' or WITHHELD in warnings


def _unknown(*shape: int) -> Array:
    return np.full(shape, np.nan)


@dataclass(frozen=True)
class Event:
    """Something that changed the momentum from outside, or the target."""

    time: float  # s since the first sample
    # 'step' (a change of momentum), 'ramp' (a rate of change) or 'target_changed'
    kind: Literal['step', 'ramp', 'target_changed']
    # linear, angular: (3,) N s, N m s about the odometry origin (N, N m for a ramp; zero for a target that has changed)
    linear: Array
    angular: Array
    cause: str  # the likely cause

    def __str__(self) -> str:
        """Return it as a warning."""
        if self.kind == 'target_changed':
            return self.cause
        linear, angular = (', '.join(f'{value:.3g}' for value in vector) for vector in (self.linear, self.angular))
        if self.kind == 'ramp':
            return f'momentum changes since {self.time:.1f} s, by ({linear}) N, ({angular}) N m: {self.cause}'
        return f'momentum jumped at {self.time:.1f} s, by ({linear}) N s, ({angular}) N m s: {self.cause}'


@dataclass(frozen=True)
class Thruster:
    """By how much a thruster is off its command, in a frame: scale (1: as commanded), turn (3,) rad, delay in s."""

    frame: str
    scale: float
    scale_std: float
    turn: Array
    turn_std: Array
    delay: float
    delay_std: float

    @staticmethod
    def all_of(frames: Sequence[str], values: Array, stds: Array) -> list[Thruster]:
        """Return k of them from (5 k,) numbers with standard deviations, one thruster after the other.

        The numbers of each are scale less 1, turn, and delay at the commanded strength.
        """
        found = []
        for frame, value, std in zip(frames, *(np.reshape(each, (-1, 5)) for each in (values, stds)), strict=True):
            scale, delay, delay_std = 1.0 + float(value[0]), float(value[4]), float(std[4])
            delays = delay / scale, delay_std / abs(scale)
            found.append(Thruster(frame, scale, float(std[0]), value[1:4], std[1:4], *delays))
        return found


@dataclass(frozen=True)
class SensorFit:
    """How well a sensor of the base agrees with the model."""

    name: str  # odom, or of its parameters
    count: int  # of its numbers in all windows
    residual: float  # root mean square of its normalised innovations: 1 is as declared; NaN without any
    share: float  # of the sum of the squares of all sensors; NaN without any


@dataclass(frozen=True)
class Estimate:
    """The state of an identification after a window, or after a sample with the paper's methods."""

    method: str  # name of the method
    status: Status  # see Status; the rules stand in core/results/verdict.py
    time: float = 0.0  # s since the first sample of the run
    stamp: int = 0  # ns, stamp of the last sample used
    # (10,) in the order of PARAMETERS, SI; NaN where the data do not determine one
    parameters: Array = field(default_factory=lambda: _unknown(10))
    # (10, 10) of the parameters; NaN where not available
    covariance: Array = field(default_factory=lambda: _unknown(10, 10))
    # (10,) True where the data determine the parameter
    identifiable: Flags = field(default_factory=lambda: np.zeros(10, dtype=bool))
    # (6,) total momentum (P, L) in the odometry frame, L about its origin: kg m/s, kg m^2/s
    momentum: Array = field(default_factory=lambda: _unknown(6))
    momentum_covariance: Array = field(default_factory=lambda: _unknown(6, 6))  # (6, 6)
    residual: float = np.nan  # root mean square of the normalised residuals: 1 is as declared; NaN where not available
    # time_offset, time_offset_std: s, JointState stamps minus true time relative to Odometry; NaN where not estimated
    time_offset: float = np.nan
    time_offset_std: float = np.nan
    consistency_correction: float = 0.0  # size of the projection on physical bodies in standard deviations; 0 is none
    # (6,) change of the momentum by known thrust since the first sample
    impulse: Array = field(default_factory=lambda: np.zeros(6))
    # (k, 2) sum of the normalised innovations squared so far, and their number, under each hypothesis of the trajectory
    # filter that has a mechanism; empty where there is none
    innovations: Array = field(default_factory=lambda: np.zeros((0, 2)))
    # chi-square of the tracked target's motion before its capture, and its numbers; 0 and 0 where it does not count
    target_misfit: tuple[float, int] = (0.0, 0)
    samples: int = 0  # number of samples used
    phase: CapturePhase = 'post_capture'
    stage: str = ''  # method of the stage that it is from, where the method has several
    thrusters: tuple[Thruster, ...] = ()  # estimates of each thruster that may deviate from its command
    flexible: tuple[PassiveJoint, ...] = ()  # the passive joints as estimated
    noise: NoiseLevels | None = None  # of the sensors as estimated; None where it is not
    sensors: tuple[SensorFit, ...] = ()  # of the base, by name; empty before the trajectory filter starts
    budget: ErrorBudget | None = None  # where the parameters' variances come from; None where not available
    # candidate causes if the data contradict the model, the likeliest first, each with the gain
    # of log-likelihood without it
    causes: tuple[tuple[str, float], ...] = ()
    remedies: Mapping[str, Repair] = field(default_factory=dict)  # by the text of a cause, how to take it into account
    repairs: tuple[Repair, ...] = ()  # causes that the run takes into account, in the order in which they were found
    events: tuple[Event, ...] = ()  # disturbances of the momentum
    warnings: tuple[str, ...] = ()  # one line each

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the model, be there numbers or none."""
        return contradiction(self.status, self.warnings)

    @property
    def likely_causes(self) -> tuple[tuple[str, float], ...]:
        """The causes where the data contradict the model; none where something is suspicious at most."""
        return self.causes if self.contradicted else ()

    @property
    def std(self) -> Array:
        """One standard deviation of each parameter, (10,), NaN where not available."""
        return np.sqrt(np.diag(self.covariance))

    def after_thrust(self, impulse: Array) -> Estimate:
        """Return the estimate with the momentum of the run's begin as an impulse (6,) of known thrust has left it."""
        if not np.any(impulse):
            return self
        return replace(self, momentum=self.momentum + impulse, impulse=impulse)


@dataclass(frozen=True)
class PassiveJoint:
    """A passive joint as estimated: natural frequency (Hz, all else held), damping ratio, standard deviations.

    `deflection` is the largest one so far, rad or m, `swing` the least and the highest in the latest window; NaN where
    it is not asked. Frequency and ratio are as declared where the data do not resolve them.
    """

    joint: str
    frequency: float
    frequency_std: float
    damping: float
    damping_std: float
    deflection: float
    resolved: bool
    swing: tuple[float, float] = (np.nan, np.nan)

    @staticmethod
    def all_of(
        names: Sequence[str], declared: tuple[Array, ...], value: Array, std: Array, deflections: Array, resolved: Flags
    ) -> tuple[PassiveJoint, ...]:
        """Return f of them.

        Parameters
        ----------
        names : of each
        declared : (f,) angular frequencies, rad/s, and damping ratios; (f, 2) standard deviations as of `std`
        value, std : (f, 2) relative error of the frequency, error of the ratio
        deflections, resolved : (3, f) as of the class; (f,) whether the data resolve a frequency
        """
        rate, ratio, prior = declared
        value, std = np.where(resolved[:, None], value, 0.0), np.where(resolved[:, None], std, prior)
        frequency = rate * np.exp(value[:, 0]) / (2.0 * np.pi)
        numbers = (frequency, frequency * std[:, 0], ratio + value[:, 1], std[:, 1], deflections[0])
        columns = (each.tolist() for each in (*numbers, resolved))
        return tuple(map(PassiveJoint, names, *columns, zip(*deflections[1:].tolist(), strict=True)))

    def __str__(self) -> str:
        """Return it with 95 % intervals."""
        return (
            f'{self.joint} swings at {self.frequency:.5g} ± {BAND * self.frequency_std:.2g} Hz with a damping ratio of '
            f'{self.damping:.2g} ± {BAND * self.damping_std:.1g}{"" if self.resolved else " (as set)"}'
        ) + ('' if np.isnan(self.deflection) else f', by up to {self.deflection:.2g} rad (m)')


def determined(momentum: Array, stds: Array) -> Flags:
    """Return which components of a (3,) momentum are worth a number: of a planar motion some are not.

    One is not where its standard deviation exceeds both the momentum itself and a hundred times the best known one's.
    """
    size = max(float(np.linalg.norm(np.nan_to_num(momentum))), 100.0 * float(np.min(np.nan_to_num(stds))))
    return np.isfinite(momentum) & ~(stds > size)


def is_usable(estimate: Estimate) -> bool:
    """Return whether an estimate has a positive mass, two coordinates of the CoM and a moment: enough in a plane."""
    mass, com, moments = estimate.parameters[0], estimate.parameters[1:4], estimate.parameters[[4, 7, 9]]
    known = mass > 0.0 and np.sum(np.isfinite(com)) >= 2 and np.any(moments > 0.0)
    return bool(known) and estimate.status != 'inconsistent'


def is_complete(estimate: Estimate) -> bool:
    """Return whether all ten parameters of a link are known."""
    return is_usable(estimate) and bool(np.all(estimate.identifiable & np.isfinite(estimate.parameters)))
