"""Joints whose reading stands still: a frozen driver repeats its last value to the bit, which noise never does.

A joint at rest whose encoder has coarse steps looks the same. So it is a cause only where the windows in which it
stands still are those that contradict the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.trajectory.inquiry.spoilt_reading import SpoiltReading, but_for
from mbaid_ros.core.trajectory.windows.window import Window

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
