"""Windows in which nothing is of note but where the joints are."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.filter.knots import AFTER, BEFORE, Knots
from mbaid_ros.core.filter.window import Window, WindowNoise
from mbaid_ros.core.geometry import Array

SPACING = 0.05  # s, of knots


def joint_window(positions: Array, start: float) -> Window:
    """Return a window with joints at positions (J, n), its neighbours' knots among these; it begins at a time, s."""
    length = len(positions)
    there, nothing = np.zeros((length, 3)), np.zeros((length, 0))
    turns = np.broadcast_to(np.eye(3), (length, 3, 3))
    twist, times = np.zeros((length, 6)), np.zeros(length)
    knots = Knots(positions, turns, there, twist, times, times, twist, nothing, nothing, nothing, there, nothing)
    noise = WindowNoise(100, 1e-4, np.eye(6), np.eye(6))
    return Window(knots, slice(BEFORE, length - AFTER), SPACING, noise, start, fresh=False)
