"""The evolution strategy of the search: a mean that moves to the best samples about it, and an adapted step.

In many dimensions the mean of the best few, weighted by rank, is nearer to an optimum than the best one is. The step
grows where its successive moves agree and shrinks where they cancel: cumulative step-size adaptation (Hansen and
Ostermeier 2001, "Completely derandomized self-adaptation in evolution strategies"), with its usual constants.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, Flags

GENERATION = 32  # motions drawn at a time: fewer are hardly faster
CHOSEN = 9  # of these, that the mean moves to
_WEIGHTS = np.log(CHOSEN + 0.5) - np.log(np.arange(1, CHOSEN + 1))
_FIRST_STEP, _LEAST, _AGAIN, _LARGEST = 0.2, 0.02, 0.15, 1.0
_FEW = 0.25  # of the numbers, that are varied in half of the motions


class EvolutionStrategy:
    """The distribution of motions of one duration, each of (G, k) numbers.

    Parameters
    ----------
    mean : (G, k) to begin at
    step : to begin with
    """

    def __init__(self, mean: Array, step: float = _FIRST_STEP) -> None:
        self._mean = mean
        self._step = step
        self._path = np.zeros(mean.shape)  # the moves of the mean, as a walk of unit steps would have them
        self._noise = np.zeros((GENERATION, *mean.shape))

    def restarted_at(self, mean: Array) -> EvolutionStrategy:
        """Return the strategy about another mean, for a new duration; its step has a lower limit."""
        return EvolutionStrategy(mean, max(self._step, _AGAIN))

    def sample(self, moved: Flags, generator: np.random.Generator) -> Array:
        """Return a sample of motions about the mean, (GENERATION, G, k).

        Parameters
        ----------
        moved : (k,) joints that are varied
        generator : of random numbers
        """
        noise = generator.standard_normal(self._noise.shape)
        few = generator.random(noise.shape) < _FEW
        noise[GENERATION // 2 :] *= few[GENERATION // 2 :] / np.sqrt(_FEW)
        self._noise = noise * moved
        return np.asarray(self._mean + self._step * self._noise)

    def update(self, motions: Array, cost: Array) -> None:
        """Move the mean to the best motions of the sample, and adapt the step.

        Parameters
        ----------
        motions : (GENERATION, G, k) that were drawn, as they have become
        cost : (GENERATION,) infinite or NaN of those that cannot be
        """
        order = [place for place in np.argsort(cost).tolist() if np.isfinite(cost[place])][:CHOSEN]
        if not order:
            return
        weights = _WEIGHTS[: len(order)] / _WEIGHTS[: len(order)].sum()
        self._mean = np.tensordot(weights, motions[order], axes=1)
        effective, varied = 1.0 / float(weights @ weights), max(np.count_nonzero(self._noise.any(axis=0)), 1)
        memory = (effective + 2.0) / (varied + effective + 5.0)
        moved = np.sqrt(memory * (2.0 - memory) * effective) * np.tensordot(weights, self._noise[order], axes=1)
        self._path = (1.0 - memory) * self._path + moved
        expected = np.sqrt(varied) * (1.0 - 0.25 / varied + 1.0 / (21.0 * varied**2))
        damped = memory / (1.0 + memory + 2.0 * max(0.0, np.sqrt((effective - 1.0) / (varied + 1.0)) - 1.0))
        change = np.exp(np.clip(damped * (np.linalg.norm(self._path) / expected - 1.0), -0.5, 0.5))
        self._step = float(np.clip(self._step * change, _LEAST, _LARGEST))
