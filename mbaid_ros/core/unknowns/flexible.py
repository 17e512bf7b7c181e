"""Passive joints: natural frequency and damping of each, and how it swings at the first instant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.unknowns.declaration import NominalModel, Unknown, Words, diagonal

FREQUENCY, DAMPING, SWING, DISTURBANCE = 'frequency', 'damping', 'swing', 'disturbance'


@dataclass(frozen=True, eq=False, kw_only=True)
class _OfSprings(Unknown):
    """Numbers of passive joints; where they are held, windows are linearised at their declaration."""

    held: bool = False
    in_equations = False

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return zero where it is held."""
        del deviation
        return np.zeros_like(value) if self.held else value

    def eased(self, part: float, unknowns: Sequence[Unknown]) -> Unknown:
        """Return it held in the loosest stage, which begins as declared; itself where no swing at the start is free."""
        return self if _at_the_start(unknowns) is None else replace(self, held=part >= 1.0)


@dataclass(frozen=True, eq=False)
class SpringErrors(_OfSprings):
    """Of each passive joint: relative error of its natural frequency, and error of its damping ratio.

    Attributes
    ----------
    joints : names
    """

    joints: tuple[str, ...]

    words: ClassVar = {
        FREQUENCY: Words(
            'the frequencies of passive joints',
            'flexible.<joint>.frequency_relative_std',
            'the frequency of {}: measure it (flexible)',
            lambda name, value: f'the frequency of {name} is off by {100.0 * np.sum(value):+.3g} %: correct flexible',
        ),
        DAMPING: Words(
            'the damping of passive joints',
            'flexible.<joint>.damping_std',
            'the damping of {}: measure it (flexible)',
            lambda name, value: f'the damping ratio of {name} is off by {np.sum(value):+.2g}: correct flexible',
        ),
    }

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these springs, or with the joints held; a damper never drives."""
        springs, each = side.kernel.springs, value.reshape(-1, 2)
        if not springs.count:
            return side
        rate = springs.frequency * np.exp(each[:, 0])
        ratio = np.maximum(springs.damping_ratio + each[:, 1], 0.0)
        return replace(side, kernel=side.kernel.with_springs(replace(springs, frequency=rate, damping_ratio=ratio)))


@dataclass(frozen=True, eq=False)
class StartingSwing(_OfSprings):
    """Of each passive joint: deflection (rad or m) and rate at the first instant after a gap or the start."""

    words: ClassVar = {SWING: Words('the swing of passive joints at the start', 'flexible.<joint>.initial_std')}
    redrawn_per_motion = True
    redrawn_after_gap = True

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this start, or with the joints held."""
        springs = side.kernel.springs
        if not springs.count:
            return side
        state = springs.initial_state + value.reshape(-1, 2).T
        return replace(side, kernel=side.kernel.with_springs(replace(springs, initial_state=state)))


def _at_the_start(unknowns: Sequence[Unknown]) -> Array | None:
    """Return the factor (2 f, e) of the swing at the start; None where it is exact."""
    return next((each.factor for each in unknowns if isinstance(each, StartingSwing)), None)


@dataclass(frozen=True, eq=False)
class SwingNoise(Unknown):
    """Unmodelled excitation of each passive joint, as two quadratures of a swing, Gauss-Markov processes.

    White noise drives a spring with a damper to a swing whose amplitudes are first-order Gauss-Markov processes, with
    the time constant of the damping.

    Attributes
    ----------
    correlation : (e,) s, time constant of each independent number
    """

    correlation: Array

    words: ClassVar = {
        DISTURBANCE: Words('unmodelled excitation of passive joints', 'flexible.<joint>.disturbance_std')
    }
    in_equations = False
    noise_driven = True

    @property
    def time_constants(self) -> Array:
        """Time constants of the amplitudes."""
        return self.correlation

    def process_variances(self, rates: Array) -> Array:
        """Return the variances (B, e) that white noise adds to the amplitudes, and rates (B, f) of that size to joints.

        Either amplitude takes half.
        """
        joints = np.argmax(np.abs(self.factor), axis=0) // 2
        return np.asarray(0.5 * (rates / np.sqrt(np.sum(self.factor[1::2] ** 2, axis=1)))[:, joints] ** 2)

    def eased(self, part: float, unknowns: Sequence[Unknown]) -> Unknown:
        """Return it for a swing that changes by part of its start at least."""
        start = _at_the_start(unknowns)
        if start is None or start.shape != self.factor.shape:
            return self
        return replace(self, factor=np.maximum(self.factor, part * start))

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model as it is: windows are linearised without."""
        del value
        return side

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return zero."""
        del deviation
        return np.zeros_like(value)


# Standard deviation of the phase, rad, up to which a frequency is resolved: beyond it, the sum of squares has more than
# one minimum within a few deviations. Times 1/(rate ratio) that a swing keeps its phase.
_RESOLVED, _COHERENT = 0.35, 3.0


def resolved(rates: Array, ratios: Array, relative: Array, seconds: float) -> Flags:
    """Return which frequencies (f,) are resolved after a time, with relative standard deviations; rates in rad/s."""
    times = np.minimum(seconds, _COHERENT / (np.maximum(ratios, _SLOWEST) * rates))
    return np.asarray(relative * rates * times < _RESOLVED)


_SLOWEST = 1e-3  # damping ratio, as which less counts: the amplitudes' time constant is finite


def swing_noise(
    joints: Sequence[str],
    deviations: Sequence[float] | Array,
    rates: Sequence[float] | Array,
    ratios: Sequence[float] | Array,
) -> SwingNoise:
    """Return it as an unknown: stationary standard deviations of deflections, rad or m; rates, rad/s; ratios."""
    each, rate = np.asarray(deviations, dtype=float), np.asarray(rates, dtype=float)
    factor = diagonal(np.column_stack((each, each * rate)).ravel())
    labels = tuple(f'{DISTURBANCE}:{name}' for name in joints for _ in range(2))
    times = np.repeat(1.0 / (np.maximum(ratios, _SLOWEST) * rate), 2)[np.repeat(each > 0.0, 2)]
    return SwingNoise(factor, labels, times)


def spring_errors(
    joints: Sequence[str], frequencies: Sequence[float] | Array, ratios: Sequence[float] | Array
) -> SpringErrors:
    """Return them as an unknown: relative standard deviations of frequencies, and those of damping ratios."""
    labels = tuple(f'{kind}:{name}' for name in joints for kind in (FREQUENCY, DAMPING))
    return SpringErrors(diagonal(np.column_stack((frequencies, ratios)).ravel()), labels, joints=tuple(joints))


def starting_swing(
    joints: Sequence[str], deviations: Sequence[float] | Array, rates: Sequence[float] | Array
) -> StartingSwing:
    """Return it as an unknown: standard deviations of deflections, rad or m; natural frequencies, rad/s."""
    each = np.asarray(deviations, dtype=float)
    labels = tuple(f'{SWING}:{name}' for name in joints for _ in range(2))
    return StartingSwing(diagonal(np.column_stack((each, each * np.asarray(rates))).ravel()), labels)
