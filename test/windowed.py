"""One window of samples that are free of noise, and what its linear model leaves of it."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.filter.chain import WindowModel, window_models
from mbaid_ros.core.filter.knots import AFTER, BEFORE, averages
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.filter.window import Stack, Window, WindowNoise
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Samples

LENGTH = 0.5  # s, of the window
START = 4.0  # s
FIRST, LAST = START + 0.025, START + LENGTH + 0.025  # s, its first knot and the next window's, of 0.05 s each
JOINT = 1e-4  # rad


def window_of(samples: Samples, spacing: float, correlation_time: float = 0.0) -> Window:
    """Return the window at START, with its neighbours, of samples that are free of noise."""
    begin = START - BEFORE * spacing
    count = BEFORE + round(LENGTH / spacing) + AFTER
    first, last = np.searchsorted(samples.time, [begin - 1e-6, begin + count * spacing - 1e-6])
    knots = averages([samples[int(first) : int(last)]], np.array([begin]), spacing, count, np.zeros(3))
    noise = WindowNoise(round(LENGTH * 100), JOINT, np.eye(6) * 1e-30, np.eye(6) * 1e-30, 0.0, correlation_time)
    return Window(knots, slice(BEFORE, count - AFTER), spacing, noise, START, fresh=False)


def residuals(model: WindowModel, x: Array) -> tuple[Array, Array, Array]:
    """Return what pose and twist leave unexplained, and the pose error at the next window."""
    return (
        model.pose_value - model.pose_rows @ x,
        model.twist_value - model.twist_rows @ x,
        model.transition @ x + model.drift,
    )


def window_model(layout: Layout, window: Window, point: Point) -> WindowModel:
    """Return one window's model."""
    return window_models(layout, [Stack((window,), (0,))], point)[0]
