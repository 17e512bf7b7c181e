"""Which passive joints' frequencies a run has resolved."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.filter.state import Layout
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.unknowns.flexible import SpringErrors, resolved


def resolved_frequencies(layout: Layout, deviation: Array, seconds: float) -> Flags:
    """Return which passive joints' frequencies (f,) the data of some seconds resolve, the state to (s,) deviations."""
    springs = layout.kernel.springs
    relative: Array = np.zeros(springs.count)
    if not springs.count:
        return relative > 0.0
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, SpringErrors):
            relative = np.abs(unknown.factor @ deviation[place])[::2]
    return resolved(springs.frequency, springs.damping_ratio, relative, seconds)
