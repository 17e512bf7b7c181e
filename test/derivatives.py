"""The one check of derivatives: central differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbaid_ros.core.geometry import Array


def central_difference(function: Callable[[Array], Array], point: Array, step: float | Array) -> Array:
    """Return d function / d point by central differences, (..., n) with the function's own axes first.

    Parameters
    ----------
    function : of an (n,) array
    point : (n,)
    step : of every coordinate, or (n,) of each: the error is of the order step^2, and of rounding / step
    """
    steps = np.broadcast_to(step, point.shape)
    columns = []
    for index, size in enumerate(steps):
        change = np.zeros(len(point))
        change[index] = size
        columns.append((np.asarray(function(point + change)) - np.asarray(function(point - change))) / (2.0 * size))
    return np.stack(columns, axis=-1)
