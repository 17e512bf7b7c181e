"""The start of joints that swing several times in the first windows: from a loose swing to one as declared.

A wrong body, or a frequency off by a few percent, puts the predicted swing out of phase there, and no iteration leads
back. So the swing may first change from window to window as much as it may be at the start, then ever less.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.filter.batch import BatchIteration
from mbaid_ros.core.filter.square_root import MeanAndCovariance
from mbaid_ros.core.filter.state import Layout
from mbaid_ros.core.filter.whitened import LinearisationCache
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.flexible import SpringErrors, StartingSwing, SwingNoise, resolved

# Natural frequency (Hz) from which it is loose first: an iteration follows the three periods of the first 5 s only.
_FAST = 0.6
_LOOSE = (1.0, 0.1, 0.01)  # unmodelled excitation, in deviations of the swing at the start


def from_loose_swing(batch: BatchIteration) -> list[BatchIteration]:
    """Return iterations to run one after the other, the last as it is; alone where no passive joint is fast."""
    layout = batch.layout
    start = [each.factor for each in layout.unknowns if isinstance(each, StartingSwing)]
    if layout.kernel.springs.fastest < _FAST or not start:
        return [batch]
    stages: list[BatchIteration] = []
    for part in _LOOSE:
        looser = replace(layout, unknowns=tuple(_looser(each, part, start[0]) for each in layout.unknowns))
        stages.append(replace(batch, layout=looser, linearised=LinearisationCache(looser, batch.variables)))
    return [*stages, batch]


def _looser(unknown: Unknown, part: float, start: Array) -> Unknown:
    """Return an unknown for a swing that changes by part of its start (2 f, e); the loosest begins anew as declared."""
    if isinstance(unknown, SwingNoise) and unknown.factor.shape == start.shape:
        return replace(unknown, factor=np.maximum(unknown.factor, part * start))
    if isinstance(unknown, SpringErrors | StartingSwing):
        return replace(unknown, held=part == max(_LOOSE))
    return unknown


def resolved_frequencies(layout: Layout, distribution: MeanAndCovariance, seconds: float) -> Flags:
    """Return which passive joints' frequencies (f,) the data of some seconds resolve."""
    springs = layout.kernel.springs
    relative: Array = np.zeros(springs.count)
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, SpringErrors):
            relative = np.abs(unknown.factor @ distribution.deviation[place])[::2]
    return resolved(springs.rate, springs.ratio, relative, seconds)
