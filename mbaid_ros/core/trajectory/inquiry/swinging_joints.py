"""Joints whose far side swings against their encoder, however it does: springs at their resonance, or play.

What a joint carries then goes on by e(t), which nobody reads, and the base by A e with the joint's own column A. A free
swing has a frequency of its own, which changes with the robot's shape, and windows are about as long as it takes. So
nothing is said of e but its size: it is as noise of that joint's reading alone, many times what is declared, and what
the windows gain by that tells which joint it is, by the direction in which the base is pushed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbaid_ros.core.trajectory.windows.window import Window
from mbaid_ros.core.verdict.judgement import LARGEST_NIS

# The declared noise, so many times: all joints are tried with the first, the likeliest with the others. Where little is
# unexplained, a swing that has died down, fewer.
_LARGE, _SMALL = (30.0, 10.0, 100.0), (3.0, 2.0, 10.0)


def times_of(nis: float) -> tuple[float, ...]:
    """Return how many times as noisy a joint is tried, by the mean normalised innovation squared."""
    return _LARGE if nis > LARGEST_NIS else _SMALL


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
