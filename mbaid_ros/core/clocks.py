"""Clocks: offset and drift of the joints' stamps relative to those of the base."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from mbaid_ros.core.contracts import CLEAR, Convention, Linear, Motion, NominalModel, Unknown, Words, converted
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.repair import Conversion, Repair, wider_prior, with_band
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.windows import Window
from mbaid_ros.parameters import parameter

OFFSET, CLOCK = 'time offset', 'clock drift'
_LARGEST_DRIFT = 0.01  # of time_offset.drift_std
# s, late or early by 50 ms to half a second: less is within the prior of the time offset.
_DELAYS = 0.05 * np.concatenate((np.arange(-10, 0), np.arange(1, 11)))


@dataclass(frozen=True)
class TimeOffsetConfig:
    """A constant offset between the stamps of JointState and Odometry."""

    estimate: bool = parameter(default=True)
    """Estimate how late JointState is stamped relative to Odometry (trajectory only)."""
    prior_std: float = parameter(0.02, 's', minimum=0.0, exclusive_minimum=True)
    """Prior standard deviation of the time offset between JointState and Odometry, about zero."""
    drift_std: float = parameter(5e-5, minimum=0.0, maximum=0.01)
    """Standard deviation of the drift between the clocks of JointState and Odometry, s a second: 2e-5 for a computer's
    own quartz; 0: one clock, or synchronised clocks."""


@dataclass(frozen=True, eq=False)
class TimeOffset(Unknown):
    """A constant delay of the joints' stamps, s. A pose error that comes of joints tau too late is -tau (w, v)."""

    words: ClassVar = {
        OFFSET: Words(
            remedy='the offset between the stamps: more motion determines it',
            deviation=lambda _, value: f'the joints are stamped {1e3 * np.sum(value):+.3g} ms late: check the stamps',
        )
    }
    of_measurement = True
    in_equations = False  # of the measured motion at one instant

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the offset as uncertain as it is large."""
        del cause, kernel
        return wider_prior(
            f'the joints are stamped {with_band(value, std, 1e3)} ms late', 'time_offset.prior_std', value, std, 's'
        )

    def measured(self, sensor: str, motion: Motion) -> Array:
        """Return how much further on any sensor of the base reads."""
        del sensor
        return motion.slope[..., None]

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return the delay that the joints are taken later by: none, unless it is clearly one."""
        return np.where(np.abs(value) > CLEAR * deviation, value, 0.0)

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this delay."""
        return replace(nominal, delay=nominal.delay + float(value[0]))


def time_offset(deviation: float) -> TimeOffset:
    """Return the offset as an unknown, of a standard deviation, s."""
    return TimeOffset(np.array([[deviation]]), (OFFSET,))


@dataclass(frozen=True, eq=False)
class ClockDrift(Linear):
    """How fast the joints' clock runs, s/s: a delay that grows with time since the run began.

    The momentum is then that of the joints' clock. Linear, as far as the base's motion is over that delay: to some
    50 ms, eight minutes at 100 ppm.
    """

    words: ClassVar = {
        CLOCK: Words(
            remedy='the drift between the clocks of joints and odometry: synchronise them (time_offset.drift_std)',
            deviation=lambda _, value: (
                f'the clocks drift apart by {1e6 * np.sum(value):+.3g} ppm: synchronise them, or raise '
                'time_offset.drift_std'
            ),
        )
    }

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return the drift as uncertain as it is large."""
        del cause, kernel
        return wider_prior(
            f'the clocks drift apart by {with_band(value, std, 1e6)} ppm',
            'time_offset.drift_std',
            value,
            std,
            most=_LARGEST_DRIFT,
        )

    def measured(self, sensor: str, motion: Motion) -> Array:
        """Return how much further on any sensor of the base reads, and how much faster by the joints' clock."""
        del sensor
        return (motion.time[:, None] * motion.slope + motion.rate)[..., None]


def clock_drift(deviation: float) -> ClockDrift:
    """Return the drift as an unknown, of a standard deviation, s/s."""
    return ClockDrift(np.array([[deviation]]), (CLOCK,))


def joints_stamped_late(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield joints that are stamped too late or too early."""
    for delay in _DELAYS.tolist():
        more = ' or more' if abs(delay) == _DELAYS[-1] else ''
        how = f'{1e3 * abs(delay):.0f} ms{more} {"late" if delay > 0.0 else "early"}'
        text = (
            f'the joints are stamped some {how} against the poses: correct the stamps, or raise time_offset.prior_std'
        )
        repair = replace(converted(text, Conversion(delay=delay)), value=delay, unit='s')
        yield Convention(text, kernel, partial(_stamped, delay=delay), delay=delay, repair=repair)


def _stamped(windows: Sequence[Window], delay: float) -> list[Window]:
    """Return windows as they are if their joints are stamped late by a delay, s; those that were read by then."""
    times = [each.start + each.spacing * (np.arange(len(each.knots)) - each.inside.start) for each in windows]
    # Windows share knots with their neighbours.
    every, place = np.unique(np.round(np.concatenate(times), 6), return_index=True)
    values = np.concatenate([each.knots.joint_position for each in windows])[place]
    known = np.isfinite(values).all(axis=1)
    every, values = every[known], values[known]
    moved = []
    for each, own in zip(windows, times, strict=True):
        read = np.isfinite(each.knots.joint_position).all(axis=1)
        then, position = np.round(own + delay, 6), np.full_like(each.knots.joint_position, np.nan)
        if np.all((then >= every[0]) & (then <= every[-1]) | ~read):
            position[read] = np.column_stack([np.interp(then[read], every, joint) for joint in values.T])
            moved.append(replace(each, knots=replace(each.knots, joint_position=position)))
    return moved


def declared_offset(config: TimeOffsetConfig) -> TimeOffset:
    """Return the offset of the joints' stamps."""
    return time_offset(config.prior_std if config.estimate else 0.0)


def declared_drift(config: TimeOffsetConfig) -> ClockDrift:
    """Return the drift of the joints' clock."""
    return clock_drift(config.drift_std if config.estimate else 0.0)
