"""How near linear the windows of a run are, found out bit by bit: about where a search has led, and where it stands."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.curvature import Curvature
from mbaid_ros.core.robot.known_errors import body_sizes
from mbaid_ros.core.trajectory.filter.bank import Track
from mbaid_ros.core.trajectory.filter.belief import Belief, Moments
from mbaid_ros.core.trajectory.search.deferred_task import DeferredTask
from mbaid_ros.core.trajectory.search.passes import Passes
from mbaid_ros.core.trajectory.state import BODY, BODY_PLACES
from mbaid_ros.core.trajectory.windows.window import Window, in_stacks

# What is left of any standard deviation of the body when its windows are linearised anew: they were linearised where
# that was hardly known. It halves the variance; sooner hardly anything has moved.
_SHARPER = 0.7
# Relative deviation of the body, in all directions seen, below which windows may stay: a tenth of it is second order.
_KNOWN = 0.1


class Linearity:
    """Follows how far a young run owes its estimate to where its windows are linearised.

    Parameters
    ----------
    passes : over the windows
    """

    def __init__(self, passes: Passes) -> None:
        self._passes = passes
        self._elsewhere = DeferredTask[Curvature](passes.layout.size)
        self._anew = DeferredTask[Curvature](passes.layout.size)
        self._curvature: Curvature | None = None  # about where a search has led
        self._displacement: Curvature | None = None  # from there on, where all windows are linearised at the estimate
        self._linearised: Array = np.zeros((10, 10))  # covariance of the body when all windows were linearised last

    @property
    def known(self) -> bool:
        """Whether there is a solution of which it is known."""
        return self._curvature is not None

    @property
    def judged(self) -> bool:
        """Whether it is known of what the latest search has led to."""
        return self.known and not self._elsewhere.under_way

    @property
    def displaced(self) -> bool:
        """Whether the estimate has left the point where its windows are near linear."""
        return self._displacement is not None and self._displacement.anywhere

    def curvatures(self, *, explained: bool) -> tuple[Curvature, ...]:
        """Return all that is known of it.

        Parameters
        ----------
        explained : whether the model explains the data: else no point is that where windows are near linear
        """
        found = (self._curvature, self._displacement if explained else None)
        return tuple(each for each in found if each is not None)

    @property
    def owing(self) -> bool:
        """Whether some of it is to be found out before the next window."""
        return self._elsewhere.owing or self._anew.owing

    def owe(self, steps: int) -> None:
        """Owe so many steps of the filter, more or less, of each task before the next window."""
        self._elsewhere.owe(steps)
        self._anew.owe(steps)

    def work_off(self) -> bool:
        """Do a slice of what is owed; return whether that has shown the estimate to be displaced."""
        if self._elsewhere.owing:
            self._curvature = self._elsewhere.work_off() or self._curvature
            return False
        found = self._anew.work_off()
        if found is None:
            return False
        self._displacement, self._linearised = found, found.covariance
        return found.anywhere

    def may_stay(self, belief: Belief) -> bool:
        """Tell whether what the windows leave open at second order is small, wherever they are linearised."""
        if self._curvature is None or self._curvature.anywhere or self.displaced:
            return False
        variables = self._passes.variables
        moments = Moments.of(belief, variables)
        factor = moments.factor_of(variables.spread[BODY])
        body, seen = moments.mean[BODY], np.sqrt(np.add.reduce(factor**2, axis=1))
        return bool(body[0] > 0.0 and np.all(seen < _KNOWN * body_sizes(body)))

    def begin(
        self, curvature: Iterator[int | Curvature] | None, covariance: Array, track: Track, *, anew: bool
    ) -> None:
        """Begin with what a search has led to.

        Parameters
        ----------
        curvature : finds out how near linear its windows are about that; None where it has not settled
        covariance : (10, 10) of the body when they were linearised
        track : the best hypothesis by now
        anew : whether the solution before did not stay
        """
        if anew:
            self._curvature = None
        self._elsewhere.begin(curvature)
        self._anew.begin(None)
        self._linearised = covariance
        if not self._sharper(self._covariance(track)):
            self._displacement = None  # of windows as they were linearised before

    def forget(self) -> None:
        """Forget the solution."""
        self._elsewhere.begin(None)
        self._curvature = None
        self.grow_up()

    def grow_up(self) -> None:
        """Follow the estimate no more: no window is linearised again."""
        self._anew.begin(None)
        self._displacement = None

    def follow(self, windows: list[Window], track: Track) -> None:
        """Begin to linearise the windows at the estimate, where that has become so much better known since.

        Parameters
        ----------
        windows : all of the run
        track : the best hypothesis after them
        """
        if not self._anew.under_way and self._sharper(self._covariance(track)):
            self._anew.begin(self._passes.displacement(in_stacks(windows), track))

    def _covariance(self, track: Track) -> Array:
        return Moments.of(track.belief, self._passes.variables).covariance(BODY_PLACES)

    def _sharper(self, covariance: Array) -> bool:
        return bool(np.any(covariance.diagonal() < _SHARPER**2 * self._linearised.diagonal()))
