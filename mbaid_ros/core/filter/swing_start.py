"""The start of joints that swing several times in the first windows: a spectrum over their natural frequencies.

A wrong body, or a frequency off by a few percent, puts the predicted swing out of phase there, and no iteration leads
back. So the body is first sought with all passive joints held, and then their frequencies with that body.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.filter.bank import HypothesisFilter
from mbaid_ros.core.filter.batch import BatchIteration, Work
from mbaid_ros.core.filter.gaussian import MeanAndCovariance
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.filter.whitened import LinearisationCache
from mbaid_ros.core.filter.window import Stack
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.robot.springs import Springs
from mbaid_ros.core.unknowns.flexible import FREQUENCY, SpringErrors, StartingSwing, resolved

_FAST = 0.6  # Hz, from which joints are held first: an iteration follows the three periods of the first 5 s, not more
_SWEEPS = 2  # over all joints: each spectrum needs the other frequencies
_WIDE, _PHASE = 2.5, 1.5  # deviations of the prior on either side; rad between frequencies, at the windows' end


def swing_held(batch: BatchIteration) -> BatchIteration:
    """Return the iteration with passive joints held where one is fast; itself without any."""
    kernel = batch.layout.kernel
    if kernel.springs.fastest < _FAST:
        return batch
    layout = replace(batch.layout, kernel=kernel.swinging(Springs()))
    return replace(batch, layout=layout, linearised=LinearisationCache(layout, batch.variables))


def likeliest_frequencies(
    batch: BatchIteration, stacks: list[list[Stack]], point: Point, prior: HypothesisFilter
) -> Work[Point]:
    """Return a point with the frequencies that explain the windows best: the linear part fits amplitudes and phases.

    Parameters
    ----------
    batch, stacks : of the windows
    point : of another body and swing; joints are at rest in that returned
    prior : a hypothesis before the first window
    """
    layout = batch.layout
    state: Array = np.zeros(layout.size)
    state[layout.parameters], state[layout.readings] = point.parameters, point.readings
    numbers: list[tuple[int, float]] = []  # of each fast joint's frequency: place, and rad that its deviation turns by
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, SpringErrors | StartingSwing):
            state[place] = 0.0
        if isinstance(unknown, SpringErrors):
            turns = np.repeat(layout.kernel.springs.rate, 2) @ np.abs(unknown.factor) * _seconds(stacks)
            numbers += [
                (place.start + index, turn)
                for index, (cause, turn) in enumerate(zip(unknown.causes, turns, strict=True))
                if cause.startswith(FREQUENCY)
            ]
    for number, turn in _SWEEPS * numbers:
        found: list[tuple[float, float]] = []
        for value in np.linspace(-_WIDE, _WIDE, 2 * int(np.ceil(_WIDE * turn / _PHASE)) + 1).tolist():
            state[number] = value
            try:
                relinearised = yield from batch.relinearise(stacks, layout.point(state))
                (filtered,) = yield from batch.filter(relinearised, (prior,))
                found.append((filtered.gaussian.log_likelihood, value))
            except np.linalg.LinAlgError:
                continue
        state[number] = max(found)[1] if found else 0.0
    return layout.point(state)


def resolved_frequencies(layout: Layout, moments: MeanAndCovariance, seconds: float) -> Flags:
    """Return which passive joints' frequencies (f,) the data of some seconds resolve."""
    springs = layout.kernel.springs
    relative: Array = np.zeros(springs.count)
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, SpringErrors):
            relative = np.abs(unknown.factor @ moments.deviation[place])[::2]
    return resolved(springs.rate, springs.ratio, relative, seconds)


def _seconds(stacks: list[list[Stack]]) -> float:
    return sum(window.length for part in stacks for stack in part for window in stack.windows)
