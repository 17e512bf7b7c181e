"""Faults that the readings show without a model: stuck or swinging joints, their noise, vibrations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from operator import itemgetter

import numpy as np

from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.noise import white_noise


def without(windows: Sequence[Window], spoilt: Flags) -> list[Window]:
    """Return windows without spoilt ones (W,) and their neighbours, `fresh` where nothing links one to that before."""
    left = ~(spoilt | np.append(spoilt[1:], False) | np.append(False, spoilt[:-1]))
    return [
        replace(window, fresh=window.fresh or (place > 0 and not left[place - 1]))
        for place, window in enumerate(windows)
        if left[place]
    ]


_SAME = 1e-12  # rad or m, by which means of equal numbers differ: rounding
_LISTED = 3  # times that are listed: a line holds no more


def stopped_readings(windows: Sequence[Window], joints: Sequence[str]) -> list[tuple[str, list[Window]]]:
    """Return which joint stands still to the bit in some windows while others move, and the other windows.

    The joint that stands still longest comes first.
    """
    still = np.array([np.ptp(window.knots.joint_position, axis=0) <= _SAME for window in windows])  # False of NaN
    still[still.all(axis=1)] = False  # the robot may be at rest
    found = [place for place in np.argsort(-still.sum(axis=0), kind='stable') if still[:, place].any()]
    return [_stopped(windows, still[:, place], joints[place]) for place in found]


def _stopped(windows: Sequence[Window], still: Flags, joint: str) -> tuple[str, list[Window]]:
    groups = groupby(enumerate(still.tolist()), key=itemgetter(1))
    stretches = [[place for place, _ in group] for stands, group in groups if stands]
    times = [f'{windows[each[0]].start:.1f} to {windows[each[-1]].start + windows[0].length:.1f}' for each in stretches]
    listed = ', '.join(times[:_LISTED]) + (' and more' if len(times) > _LISTED else '')
    text = f'the reading of {joint} repeats from {listed} s: check its encoder or driver'
    return text, without(windows, still)  # the windows beside them may have a part of it


# The declared noise, so many times: all joints are tried with the first, the likeliest with the others. Where little is
# unexplained, a swing that has died down, fewer.
LARGE_SWING, SMALL_SWING = (30.0, 10.0, 100.0), (3.0, 2.0, 10.0)


def swinging(windows: Sequence[Window], joint: int, times: float, joints: int) -> list[Window]:
    """Return windows in which one of so many joints' readings is so many times as noisy."""
    larger = np.where(np.arange(joints) == joint, times, 1.0)
    return [
        replace(window, noise=replace(window.noise, joint_position=larger * window.noise.joint_position))
        for window in windows
    ]


def loose_joint_text(joint: str, windows: Sequence[Window], times: float) -> str:
    """Return the cause that a joint's load swings against its encoder, with that many times the declared noise."""
    noise = [window.noise for window in windows]
    # By how much a window's mean is off, one standard deviation.
    size = 1e3 * times * float(np.mean([np.max(each.joint_position) / np.sqrt(each.samples) for each in noise]))
    return (
        f'{joint} is flexible or has play: its load swings by about {size:.1g} mrad (mm) relative to its encoder; '
        'check both'
    )


_FEWEST_SAMPLES = 12  # samples of a window: fewer have too few differences of fourth order for a median


def joint_noise_factor(windows: Sequence[Samples], declared: float) -> float:
    """Return how many times as noisy as declared, rad, the joints are by their samples; NaN where not known."""
    found = [white_noise(window.joint_position, 4) for window in windows if len(window) >= _FEWEST_SAMPLES]
    return float(np.median(found)) / declared if np.size(found) else np.nan


_FEWEST_WINDOWS = 12  # windows: fewer hold a few swings and a trend of five numbers, and nothing beside
_FINER = 4  # frequencies tried for each that the length of the series resolves
_SWINGS = 2.5  # in the series at least: fewer are a drift
# Robust standard deviations (by the median) at which the series is clipped: a single large one is a jump, no swing.
_LARGEST = 4.0
_TREND = 5  # numbers of a polynomial that is no swing
_PEAKS = 2  # frequencies that are tried: each takes passes of its own
# Times the median of the spectrum: of noise, one frequency in 4000 (2^-12) is as high in one of the six numbers.
_CLEAR = 12.0


def swinging_text(frequency: float, windows: Sequence[Window], names: Sequence[str]) -> str:
    """Return that something swings (Hz), with the lines to add: for a joint that reads zero always, or a new one."""
    unread = np.all([np.all(each.knots.joint_position == 0.0, axis=0) for each in windows], axis=0)
    joint = next((name for name, flag in zip(names, unread.tolist(), strict=True) if flag), '')
    name, urdf = joint or 'panel', '' if joint else _NEW_JOINT
    return (
        f'something swings at {frequency:.2g} Hz: a panel, fuel or a flexible part, not rigid; {urdf}set '
        f'flexible.joints: [{name}], flexible.{name}.frequency: {frequency:.2g}'
    )


_NEW_JOINT = (
    'add to the URDF <joint name="panel" type="revolute"> with origin, axis, <parent link="base_link"/> and '
    '<child link="panel"/>, a link with its inertial, and '
)


def vibration_frequencies(values: Array, spacing: float) -> list[float]:
    """Return the frequencies (Hz) of the highest peaks in the spectrum of (W, k) values of windows, s apart."""
    count = len(values)
    if count < _FEWEST_WINDOWS:
        return []
    trend = np.vander(np.linspace(-1.0, 1.0, count), _TREND)
    left = values - trend @ np.linalg.lstsq(trend, values, rcond=None)[0]
    size = np.median(np.abs(left), axis=0) / 0.67
    clipped = np.clip(left, -_LARGEST * size, _LARGEST * size)
    power = np.abs(np.fft.rfft(clipped * np.hanning(count)[:, None], _FINER * count, axis=0)) ** 2
    power = np.max(power / np.maximum(np.median(power, axis=0), 1e-300), axis=1)
    frequency = np.fft.rfftfreq(_FINER * count, spacing)
    inner = power[1:-1]
    peak = np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > _CLEAR)) + 1
    peak = peak[frequency[peak] * count * spacing > _SWINGS]
    return [float(frequency[index]) for index in peak[np.argsort(-power[peak])][:_PEAKS]]
