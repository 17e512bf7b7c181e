"""Random sinusoids within the limits of planned motions, and the time in which the best of them is as informative."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.planning.goal import BaseLimits, JointLimits, Wanted
from mbaid_ros.planning.information import Grid
from mbaid_ros.planning.motions import Motions
from mbaid_ros.simulation.motion import Sinusoids

SINUSOIDS = 50
LENGTHS = (10.0, 20.0, 40.0, 80.0, 160.0)  # s, in which sinusoids keep the limits
_BATCH, _WINDOWS = 25, 40  # sinusoids at once; windows of each length
_TINY = 1e-12  # rad or m


def best_of_sinusoids(motions: Motions, wanted: Wanted, base: BaseLimits, generator: np.random.Generator) -> float:
    """Return the shortest time in which one of the sinusoids reaches the wanted accuracy, s; infinite for none."""
    drawn = _sinusoids(motions, generator)
    for length in LENGTHS:  # in a longer one they are no larger, and reach it no sooner
        shortest = min(_time_to_reach(motions, each, length, wanted, base) for each in drawn)
        if np.isfinite(shortest):
            return shortest
    return np.inf


def _sinusoids(motions: Motions, generator: np.random.Generator) -> list[list[Sinusoids]]:
    """Return sinusoids of all joints, two terms each, as large as the joints' limits allow, in batches."""
    limits: JointLimits = motions.limits
    every = []
    for _ in range(SINUSOIDS):
        shape = (len(motions.start), 2)
        amplitude = generator.uniform(0.5, 1.0, shape)
        frequency = 1.0 / generator.uniform(8.0, 40.0, shape)
        phase = 0.5 * np.pi * generator.choice([-1.0, 1.0], shape)  # from rest: no joint jumps to a speed
        rate = 2.0 * np.pi * frequency
        centre = -(amplitude * np.sin(phase)).sum(axis=1)
        reach = amplitude.sum(axis=1)
        room = np.minimum(
            (limits.upper - motions.start) / np.maximum(reach + centre, _TINY),
            (motions.start - limits.lower) / np.maximum(reach - centre, _TINY),
        )
        fastest = limits.velocity / (amplitude * rate).sum(axis=1)
        steepest = limits.acceleration / (amplitude * rate**2).sum(axis=1)
        scale = np.minimum(np.minimum(fastest, steepest), room)
        every.append(Sinusoids(motions.start, amplitude * scale[:, None], frequency, phase))
    return [every[place : place + _BATCH] for place in range(0, SINUSOIDS, _BATCH)]


def _time_to_reach(motions: Motions, drawn: list[Sinusoids], length: float, wanted: Wanted, base: BaseLimits) -> float:
    """Return when the first of some sinusoids, reduced to the limits of the base, reaches the wanted accuracy."""
    grid = Grid(_WINDOWS, 5, length / _WINDOWS / 5)
    times = grid.half_steps
    part = np.ones(len(drawn))
    for _ in range(3):
        position, rate = _moved(drawn, times, part)
        floating = motions.floating.moved(position, rate, grid.spacing)
        resting = motions.floating.moved(*motions.at_rest(times), grid.spacing)
        use = (floating.away_from(resting).max(axis=0) / base.array).max(axis=1)
        if np.all(use <= 1.0):
            break
        part *= np.where(use > 1.0, 0.98 / use, 1.0)
    relative = motions.information.after(grid, (position[::2], rate[::2]), floating, every=1)
    reached = (wanted.ratio(relative) <= 1.0) & (use <= 1.0)
    return float(grid.ends[int(np.argmax(reached.any(axis=1)))]) if reached.any() else np.inf


def _moved(drawn: list[Sinusoids], times: Array, part: Array) -> tuple[Array, Array]:
    """Return positions and rates (T, B, n): before the begin, at rest."""
    amplitude, frequency, phase = (
        np.stack([getattr(each, name) for each in drawn]) for name in ('amplitude', 'frequency', 'phase')
    )
    amplitude, omega = amplitude * part[:, None, None], 2.0 * np.pi * frequency
    angle = omega * np.maximum(times, 0.0)[:, None, None, None] + phase
    position = drawn[0].start + (amplitude * (np.sin(angle) - np.sin(phase))).sum(axis=-1)
    rate = (amplitude * omega * np.cos(angle)).sum(axis=-1)
    return position, np.where(times[:, None, None] < 0.0, 0.0, rate)
