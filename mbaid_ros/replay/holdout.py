"""A check on data that were not used: the last part of a run, predicted from the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.results.estimate import Estimate

DEFAULT_FRACTION = 0.2  # of a run, that the report predicts from the rest
LONG_ENOUGH = 59.0  # s: in a fifth of a shorter run there are too few windows for a ratio to within a tenth
# Times the standard deviation: beyond it the model does not predict, below it the noise is not as large as declared.
_FAR, _NEAR = 1.5, 0.5


@dataclass(frozen=True)
class Holdout:
    """How well the model predicts data that the estimate had not seen."""

    fraction: float  # of the run, at its end, that is predicted
    begin: float  # s since the first sample, of that part
    # error of the prediction over its standard deviation, root mean square; NaN where the rest leads to no solution, or
    # the target changes afterwards
    ratio: float
    contradicted: bool = False  # whether the run contradicts its model

    @property
    def sentence(self) -> str:
        """Return it in one line."""
        what = f'holdout: the last {100.0 * self.fraction:.3g} %, predicted from the rest'
        if math.isnan(self.ratio):
            return f'{what}: not available, there is no one solution from {self.begin:.3g} s to the end'
        if self.ratio > _FAR:
            meaning = 'the model does not predict them'
        elif self.contradicted:
            meaning = 'the estimate follows a wrong model: see the causes'
        else:
            meaning = 'the model predicts them' if self.ratio > _NEAR else 'the noise is smaller than declared'
        return f'{what}: errors {self.ratio:.2f} times their standard deviation (1 is ideal); {meaning}'


def holdout_of(history: Sequence[Estimate], fraction: float) -> Holdout | None:
    """Return how well the last part of a run is predicted from the rest; None of an empty run.

    Innovations are independent where the model is right, so the sum of their normalised squares over the last windows
    is the squared distance of all those data together from their prediction by the estimate before them. What acts by
    a mechanism, as the slope of a table, is predicted with; a random walk is not, as it follows anything.

    Parameters
    ----------
    history : estimates of method `trajectory`, in order
    fraction : of the run
    """
    if not history:
        return None
    last = history[-1]
    begin = (1.0 - fraction) * last.time
    before = max((each for each in history if each.time <= begin), key=lambda each: each.time, default=None)
    changed = any(event.kind == 'target_changed' and event.time > begin for event in last.events)
    if before is None or changed or before.innovations.shape != last.innovations.shape or not last.innovations.size:
        return Holdout(fraction, begin, math.nan, last.contradicted)
    squares, count = (last.innovations - before.innovations).T
    ratio = float(np.sqrt(np.min(squares / count))) if np.all(count > 0.0) and np.all(squares > 0.0) else math.nan
    return Holdout(fraction, begin, ratio, last.contradicted)
