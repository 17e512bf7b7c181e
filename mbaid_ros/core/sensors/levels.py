"""Noise levels of the sensors: declared ones beside those estimated from the data, and windows that carry them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, SensorNoise, Stamps
from mbaid_ros.core.sensors.correlation import NoiseLevels
from mbaid_ros.core.sensors.noise import ORDER, median

CHANNELS = (
    'joint_position',
    'joint_velocity',
    'base_position',
    'base_orientation',
    'base_linear_velocity',
    'base_angular_velocity',
)
UNITS = ('rad', 'rad/s', 'm', 'rad', 'm/s', 'rad/s')  # m and m/s of a prismatic joint
TYPICAL = np.array([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4])  # usual for the sensors of a servicer
# Declared joint noise over found noise, from which the bias correction of the equations biases them itself.
_FAR_TOO_LARGE = 10.0
_WRONG = 1.3  # times too small or too large, from which a declared value is reported as wrong: declarations are rough


@dataclass(frozen=True)
class SensorLevels:
    """Standard deviations of single readings.

    Attributes
    ----------
    declared, estimated : (6,) of CHANNELS, SI; NaN if undeclared, if not estimated
    assumed : (6,) used for readings that have neither
    correlation_time, twist_correlation_time : s, of the errors of the base's poses and twists; 0 for independent ones
    used : (6,) whether the estimated level is used instead of the declared one
    contradicted : (6,) whether that is because the readings contradict the declared one
    clear : as of `Levels`
    """

    declared: Array
    estimated: Array
    assumed: Array
    correlation_time: float
    used: Flags
    twist_correlation_time: float = 0.0
    contradicted: Flags = field(default_factory=lambda: np.zeros(len(CHANNELS), dtype=bool))
    clear: bool = True

    @property
    def as_declared(self) -> bool:
        """Whether the errors of the base are independent, and as large as declared."""
        return self.clear and not (self.correlation_time or self.twist_correlation_time or np.any(self.contradicted))

    @property
    def warnings(self) -> list[str]:
        """A sentence if a declared level is replaced, and one if joints are far better than declared.

        The filter subtracts the expected bias of their noise in the coefficients; too much of it biases estimates.
        """
        each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.contradicted, strict=True)
        replaced = [
            f'{name.replace("_", " ")} {_wrong(found / declared)}: {found:.2g} {unit} is used, not {declared:.2g}'
            for name, unit, declared, found, wrong in each
            if wrong
        ]
        texts = [f'the declared noise of the odometry is wrong: {"; ".join(replaced)}'] if replaced else []
        declared, found = float(self.declared[0]), max(float(self.estimated[0]), float(TYPICAL[0]))
        if self.used[0] or not declared > _FAR_TOO_LARGE * found:
            return texts
        texts.append(
            f'noise.joint_position is {declared:.2g} rad, the readings scatter by {self.estimated[0]:.2g}: estimates '
            'may be biased by more than their intervals; declare the noise of the joints, or set noise.estimate'
        )
        return texts

    def rows(self) -> list[tuple[str, str, str]]:
        """Return name and unit of each sensor, and its declared and found level, the one in use first."""
        each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.assumed, self.used, strict=True)
        rows = []
        for name, unit, declared, found, assumed, used in each:
            both = [(declared, 'declared'), (found, 'found')]
            every = [*(both[::-1] if used else both), (assumed, 'assumed')]
            known = [f'{value:.2g} {how}' for value, how in every if np.isfinite(value)]
            rows.append((name.replace('_', ' '), unit, ', '.join(known)))
        return rows

    def differences(self) -> list[str]:
        """Return a line for each sensor whose noise is not as declared."""
        lines = []
        each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.used, strict=True)
        for name, unit, declared, found, used in each:
            ratio = found / declared
            if np.isnan(ratio) or 1.0 / _WRONG < ratio < _WRONG:
                continue
            use = '; the data are used' if used else ''
            value = f'your noise value, {declared:.2g} {unit}, is {_wrong(ratio)}'
            lines.append(f'{name.replace("_", " ")}: {value}: {found:.2g} {unit} in the data{use}')
        if found_alone := self._undeclared(self.estimated):
            lines.append(f'no noise is declared for {listing(found_alone)}: estimated from the data')
        if assumed := self._undeclared(self.assumed):
            lines.append(f'no noise is declared for {listing(assumed)}, and the data do not determine it: assumed')
        for what, time in (('pose', self.correlation_time), ('twist', self.twist_correlation_time)):
            if time > 0.0:
                lines.append(f'the errors of the base {what} are taken to be correlated over {time:.2g} s')
        return lines

    def _undeclared(self, known: Array) -> list[str]:
        """Return known levels (6,) of undeclared sensors in words."""
        return [
            f'{name.replace("_", " ")} ({value:.2g} {unit})'
            for name, unit, declared, value in zip(CHANNELS, UNITS, self.declared, known, strict=True)
            if np.isnan(declared) and not np.isnan(value)
        ]


def _wrong(ratio: float) -> str:
    return f'{ratio:.2g} times too small' if ratio > 1.0 else f'{1.0 / ratio:.2g} times too large'


# Least level, as a part of a servicer's usual sensor noise: models deviate by more than that.
_LEAST = 1.0 / 30.0
# Of poses without a twist, undeclared: spacing (s) up to which differences determine their noise, poses that this
# takes, lost ones included, and how many times as noisy as usual they count until then.
_SLOWEST, _FIRST, _AT_FIRST = 0.2, 40, 100.0
# s, and poses, after which differences separate errors that last from small ones; s, after which no run waits longer.
_SETTLED, _READ, _PATIENCE = 4.0, 80, 10.0
_NEVER = np.iinfo(np.int64).max


class NoiseEstimator:
    """Estimates the noise levels of the sensors and applies them to windows.

    Parameters
    ----------
    noise : as declared; that of the base serves messages without a covariance
    joints : number
    undeclared : (6,) which CHANNELS are undeclared: their estimated level is used until a message declares one
    estimate : whether estimated levels replace all declared ones
    trusted : whether no readings contradict a declared level
    passive : joints that nothing measures
    """

    def __init__(
        self,
        noise: SensorNoise,
        joints: int,
        undeclared: Flags | None = None,
        *,
        estimate: bool = False,
        trusted: bool = False,
        passive: Sequence[int] = (),
    ) -> None:
        self._noise = noise
        self._estimate = estimate
        self._undeclared = np.zeros(len(CHANNELS), dtype=bool) if undeclared is None else undeclared
        self._declared_from: Stamps = np.full(len(CHANNELS), _NEVER)  # by messages, ns
        self._waiting: list[Samples] = []  # the first windows
        self._settled = False
        self._levels = NoiseLevels(noise, joints, passive, trusted=trusted)

    @property
    def joint_position(self) -> float:
        """Declared standard deviation of a joint position, rad or m."""
        return self._noise.joint_position

    def add_readings(self, joints: JointStream | None, base: BaseStream | None) -> None:
        """Add readings in the order of their stamps, without repeated poses and outliers."""
        self._levels.add_readings(joints, base)
        if base is not None and len(base.stamp):
            first = np.where(base.declared, base.stamp[:, None], _NEVER).min(axis=0)
            self._declared_from[2:] = np.minimum(self._declared_from[2:], first)

    def windows_with_noise(
        self, windows: list[Samples], origin: int, *, last: bool = False
    ) -> list[tuple[Samples, SensorLevels]]:
        """Return the next windows with their noise, and the levels until then; `origin` is the stamp at time 0, ns.

        The first seconds wait while their noise is not as declared: how large it is shows later, for all of them; or
        until the `last` ones.
        """
        released = []
        for window in windows:
            end = float(window.time[-1])
            self._waiting.append(window)
            if not self._settled:
                enough = min(max(_SETTLED, _READ * float(median(window.apart))), _PATIENCE)
                self._settled = end > enough or self.with_noise(self._waiting[0], origin, end)[1].as_declared
            if self._settled:
                released += [self.with_noise(each, origin, end) for each in self._waiting]
                self._waiting.clear()
        if last and self._waiting:
            end = float(self._waiting[-1].time[-1])
            released += [self.with_noise(each, origin, end) for each in self._waiting]
            self._waiting.clear()
        return released

    def with_noise(self, window: Samples, origin: int, until: float | None = None) -> tuple[Samples, SensorLevels]:
        """Return a window with the noise estimated until a time (s), its end by default, and the levels then."""
        until = float(window.time[-1]) if until is None else until
        end = origin + round(until * 1e9)
        undeclared = self._undeclared & (self._declared_from > end)
        free = undeclared | self._estimate
        spacing = float(median(window.apart))
        levels = self._levels.levels_at(end, spacing, free=(bool(free[2:4].all()), bool(free[4:].all())))
        contradicted = levels.contradicted & ~free
        used = free | levels.used
        declared = self._declared(window, spacing)
        found = np.maximum(levels.factor * declared, _LEAST * TYPICAL)
        unknown = undeclared & np.isnan(found)
        factor = np.where(np.isnan(found) | ~used, 1.0, found / declared)
        if window.missing_rates[1] and spacing <= _SLOWEST and window.time[-1] < _FIRST * spacing:
            # With poses alone a window of far too much weight is never made up for; one of hardly any is no loss. A
            # twist informs as much, and poses that stay exact would never count.
            factor[2:4] = np.where(unknown, _AT_FIRST, factor)[2:4]
        time, of_twist = levels.times.tolist()
        time = self._noise.base_correlation_time or time
        noise = np.array([*(factor[:2] * declared[:2]), time])
        return replace(
            window,
            pose_covariance=_scaled(window.pose_covariance, factor[2:4], _correlation_factor(window.apart, time)),
            twist_covariance=_scaled(window.twist_covariance, factor[4:], _correlation_factor(window.apart, of_twist)),
            noise=np.repeat(noise[None], len(window), axis=0),
        ), SensorLevels(
            declared=np.where(undeclared, np.nan, declared),
            estimated=found,
            assumed=np.where(unknown & _measured(window) if unknown.any() else unknown, factor * declared, np.nan),
            correlation_time=time,
            used=used & ~np.isnan(found),
            twist_correlation_time=of_twist,
            contradicted=contradicted,
            # Before the first difference nothing can contradict what is declared.
            clear=levels.clear and (until > ORDER * spacing or bool(free[2:].all())),
        )

    def _declared(self, window: Samples, apart: float) -> Array:
        """Return the (6,) declared standard deviations of single readings in a window, whose poses are s apart."""
        spacing = float(median(np.diff(window.time))) if len(window) > 1 else 0.0
        # Samples between two poses have the noise that they share as if it were each one's own.
        shared = max(apart / spacing, 1.0) if spacing > 0.0 else 1.0
        base = [
            np.sqrt(np.mean(np.diagonal(each, axis1=1, axis2=2).reshape(-1, 2, 3), axis=(0, 2)) / shared)
            for each in (window.pose_covariance, window.twist_covariance)
        ]
        return np.concatenate(([self._noise.joint_position, self._noise.joint_velocity], *base))


def _measured(window: Samples) -> Flags:
    """Return which of CHANNELS (6,) a window has readings of; poses are read where their covariance is finite."""
    pose = np.split(np.diagonal(window.pose_covariance, axis1=1, axis2=2), 2, axis=1)
    twist = window.base_linear_velocity, window.base_angular_velocity
    return np.array([bool(np.isfinite(x).any()) for x in (window.joint_position, window.joint_velocity, *pose, *twist)])


def _scaled(covariance: Array, factor: Array, weight: Array) -> Array:
    """Return covariances (N, 6, 6) times weights (N,), standard deviations of their two blocks times factors (2,)."""
    if np.all(factor == 1.0) and np.all(weight == 1.0):
        return covariance
    size = np.repeat(factor, 3)
    return weight[:, None, None] * covariance * (size * size[:, None])


def _correlation_factor(apart: Array, time: float) -> Array:
    """Return the variance of slow means of correlated readings over that of independent ones, (N,).

    An autoregression of first order with correlation c between neighbours has (1 + c) / (1 - c). `apart` (N,) s is the
    time between poses, 0 if unknown; `time` (s) that of the correlation.
    """
    if time <= 0.0:
        return np.ones(len(apart))
    return np.where(apart > 0.0, 1.0 / np.tanh(np.where(apart > 0.0, 0.5 * apart / time, 1.0)), 1.0)
