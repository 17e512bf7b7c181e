"""Windows some of which a joint's reading has spoilt: what is left of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.verdict import LARGEST_NIS


@dataclass(frozen=True)
class SpoiltReading:
    """A joint's reading that may be wrong in some of the windows.

    Attributes
    ----------
    text : in words
    windows : the others, as they would be without it
    """

    text: str
    windows: list[Window]


def but_for(windows: Sequence[Window], spoilt: Flags) -> list[Window]:
    """Return windows without spoilt ones and their neighbours, each told where nothing links it to the one before.

    Parameters
    ----------
    windows : in order
    spoilt : (W,) which of them
    """
    left = ~(spoilt | np.append(spoilt[1:], False) | np.append(False, spoilt[:-1]))
    return [
        replace(window, fresh=window.fresh or (place > 0 and not left[place - 1]))
        for place, window in enumerate(windows)
        if left[place]
    ]


# A step among the middle ones of eight knots, less what those beside them go by: of a quadratic motion there is none.
_STEP = np.array([0.75, 0.0, -1.75, 0.0, 0.0, 1.75, 0.0, -0.75])
_MIDDLE = 3.5  # knots, from the first of them: where a step between knots lies
# Times the usual second difference of the joint's motion: acceleration and noise seldom reach it.
_LARGE_STEP = 8.0


@dataclass(frozen=True)
class SlippedReading(SpoiltReading):
    """A joint's reading that may have jumped.

    Attributes
    ----------
    as_read : the same windows, the jump left in
    """

    as_read: list[Window]


def slipped_readings(windows: Sequence[Window], joints: Sequence[str]) -> list[SlippedReading]:
    """Return the joints whose readings may have jumped, the clearest first; whether they have, a pass has to tell.

    Parameters
    ----------
    windows : in order
    joints : their names
    """
    parts = [_steps(window) for window in windows]
    times, steps = (np.concatenate(each) for each in zip(*parts, strict=True))
    size = np.abs(steps)
    usual = np.median(size, axis=0)
    found = []
    for joint, place in enumerate(np.argmax(size, axis=0).tolist()):
        if size[place, joint] > _LARGE_STEP * usual[joint]:
            clear = size[place, joint] / max(usual[joint], np.finfo(float).tiny)
            found.append((clear, joint, float(times[place]), float(steps[place, joint])))
    found.sort(reverse=True)
    return [_slipped(windows, joints[joint], joint, time, step) for _, joint, time, step in found]


def _steps(window: Window) -> tuple[Array, Array]:
    """Return the times, s, and the steps between knots there, (J - 7, n); zero where a knot is empty."""
    steps = sliding_window_view(window.knots.joint_position, len(_STEP), axis=0) @ _STEP
    places = np.arange(len(steps)) + _MIDDLE - window.inside.start
    return window.start + window.spacing * places, np.nan_to_num(steps)


def _slipped(windows: Sequence[Window], name: str, joint: int, time: float, step: float) -> SlippedReading:
    has = np.array([window.start <= time < window.start + window.length for window in windows])
    back = [_moved(window, joint, -step) if window.start > time else window for window in windows]
    text = f'the reading of {name} jumps by {1e3 * step:+.3g} mrad (mm) at {time:.1f} s: look at its encoder'
    return SlippedReading(text, but_for(back, has), but_for(windows, has))


def _moved(window: Window, joint: int, step: float) -> Window:
    positions = window.knots.joint_position.copy()
    positions[:, joint] += step
    return replace(window, knots=replace(window.knots, joint_position=positions))


_SAME = 1e-12  # rad or m, by which means of equal numbers differ: rounding
_LISTED = 3  # times that are told: a line holds no more


def stopped_readings(windows: Sequence[Window], joints: Sequence[str]) -> list[SpoiltReading]:
    """Return the joints that stand still in some windows, to the bit, while others move; the longest ones first.

    Parameters
    ----------
    windows : in order
    joints : their names
    """
    still = np.array([_still(window.knots.joint_position) for window in windows])
    still[still.all(axis=1)] = False  # the robot may be at rest
    found = [place for place in np.argsort(-still.sum(axis=0), kind='stable') if still[:, place].any()]
    return [_stopped(windows, still[:, place], joints[place]) for place in found]


def _still(positions: Array) -> Flags:
    """Return which columns of (J, n) are constant; False where some are unknown."""
    return np.max(positions, axis=0) - np.min(positions, axis=0) <= _SAME


def _stopped(windows: Sequence[Window], still: Flags, joint: str) -> SpoiltReading:
    stretches = [[place for place, _ in group] for stays, group in groupby(enumerate(still), key=_of_second) if stays]
    times = [f'{windows[each[0]].start:.1f} to {windows[each[-1]].start + windows[0].length:.1f}' for each in stretches]
    told = ', '.join(times[:_LISTED]) + (' and more' if len(times) > _LISTED else '')
    text = f'the reading of {joint} stands still from {told} s: look at its encoder or driver'
    return SpoiltReading(text, but_for(windows, still))  # the windows beside them may have a part of it


def _of_second(pair: tuple[int, bool]) -> bool:
    return bool(pair[1])


# The declared noise, so many times: all joints are tried with the first, the likeliest with the others. Where little is
# unexplained, a swing that has died down, fewer.
_LARGE_SWING, _SMALL_SWING = (30.0, 10.0, 100.0), (3.0, 2.0, 10.0)


def times_of(nis: float) -> tuple[float, ...]:
    """Return how many times as noisy a joint is tried, by the mean normalised innovation squared."""
    return _LARGE_SWING if nis > LARGEST_NIS else _SMALL_SWING


def swinging(windows: Sequence[Window], joint: int, times: float, joints: int) -> list[Window]:
    """Return windows in which one of so many joints' readings is so many times as noisy."""
    larger = np.where(np.arange(joints) == joint, times, 1.0)
    return [
        replace(window, noise=replace(window.noise, joint_position=larger * window.noise.joint_position))
        for window in windows
    ]


def size(windows: Sequence[Window], times: float) -> float:
    """Return by how much a window's mean is off with noise so many times as declared, one standard deviation."""
    noise = [window.noise for window in windows]
    return times * float(np.mean([np.max(each.joint_position) / np.sqrt(each.samples) for each in noise]))
