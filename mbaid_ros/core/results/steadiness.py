"""Whether estimates stay where their own intervals said that the truth is.

More data move an estimate by no more than it was uncertain before: from P_1 to P_2 by P_1 - P_2 (mean square). One that
leaves its own interval by far was wrong, or is now: it had been held at a solution of equations that are not linear, or
its model is not the data's.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS

_KEPT = 10.0  # s, that an estimate is compared with later ones
_FAR = 5.0  # of its standard deviations, by which none should move: one in millions does by chance


class Steadiness:
    """Compares each estimate of a run with those of the latest seconds before it."""

    def __init__(self) -> None:
        self._earlier: deque[tuple[float, Array, Array]] = deque()  # s, (10,) parameters, (10,) standard deviations
        self._changes = 0  # of the target

    def judged(self, estimate: Estimate, *, early: bool) -> Estimate:
        """Return an estimate that is inconsistent where it has left the interval of one before it.

        Parameters
        ----------
        estimate : the next one
        early : whether it is one of the first, from which later ones are known to differ
        """
        changes = sum(event.kind == 'target_changed' for event in estimate.events)
        if changes != self._changes:
            self._earlier.clear()
            self._changes = changes
        while self._earlier and self._earlier[0][0] < estimate.time - _KEPT:
            self._earlier.popleft()
        if not estimate.identifiable.any() or estimate.status == 'inconsistent':
            return estimate
        moved = self._moved(estimate)
        if not early:
            self._earlier.append((estimate.time, estimate.parameters, estimate.std))
        return (
            estimate
            if moved is None
            else replace(estimate, status='inconsistent', warnings=(*estimate.warnings, moved))
        )

    def _moved(self, estimate: Estimate) -> str | None:
        """Return by how much an estimate has moved, in words, if that is too far."""
        if not self._earlier:
            return None
        times, parameters, stds = (np.array(each) for each in zip(*self._earlier, strict=True))
        distance = np.nan_to_num(np.abs(estimate.parameters - parameters) / stds)
        place, which = np.unravel_index(int(np.argmax(distance)), distance.shape)
        if distance[place, which] < _FAR:
            return None
        return (
            f'{PARAMETERS[which]} has moved by {distance[place, which]:.1f} of its standard deviations since '
            f'{times[place]:.1f} s: one of the two is wrong'
        )
