"""The likelihood of a run whose momentum may jump: the body's parameters keep what they learnt.

The momentum among the unknowns is always the latest one. A jump d is six more unknowns: the windows before it had the
momentum h - d. Once they are all folded, d is minimised over, so that there are only as many as jumps among the latest
windows. The window in which a jump happens belongs to neither side and is given up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import chi2

from mbaid_ros.core.difference import monitor
from mbaid_ros.core.difference.coupling import Coupling, Places
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation, White
from mbaid_ros.core.difference.monitor import Nuisance
from mbaid_ros.core.difference.rolling import RollingLikelihood
from mbaid_ros.core.geometry import Array

# Chance of an undisturbed window to be taken for a jump, by each test.
_FALSE_ALARM = 1e-9
# The same for the windows next to a jump, which may hold part of it.
_PART = 1e-2
# Redundant equations from which the tests can be trusted.
_ENOUGH = 50
_MOST_JUMPS = 4  # among the windows that are solved again
_LONGEST = 40  # windows that one jump may take


@dataclass
class Jump:
    """A change of the momentum.

    Attributes
    ----------
    start, end : s since the first sample, of the windows in which it happened
    value : (k,) as far as known
    covariance : (k, k) of it
    """

    start: float
    end: float
    value: Array
    covariance: Array


@dataclass
class _Open:
    """A jump among the windows that are solved again.

    Attributes
    ----------
    jump : Jump
    place : (k,) indices among the unknowns
    after : the first window after it, among those that are solved again
    given_up : windows that it took
    """

    jump: Jump
    place: Places
    after: int
    given_up: int = 0


@dataclass(frozen=True)
class _View:
    """What the tests see: the latest solution.

    Attributes
    ----------
    white : the windows that are solved again, at the solution
    effects : (K, r, e) their uncertain effects, in units of their noise
    coupling : of all windows with all effects
    nuisance : what is unknown anyhow
    scale : mean squared normalised residual, over what is expected of it, not below 1
    """

    white: White
    effects: Array
    coupling: Coupling
    nuisance: Nuisance
    scale: float


@dataclass(frozen=True)
class Uncertain:
    """Effects that are not solved for, but known to be small.

    Attributes
    ----------
    places : (e,) indices among the effects
    variance : (e,)
    """

    places: Places
    variance: Array


class SteppedLikelihood:
    """Watches a rolling likelihood for jumps of the momentum, and lets it jump.

    Parameters
    ----------
    likelihood : RollingLikelihood
    momentum : places of the momentum among its unknowns
    prior : (u, u) information about zero where nothing is known; with the momentum's, jumps begin, too
    uncertain : Uncertain

    Attributes
    ----------
    jumps : those that have been found
    ready : whether the data say enough for the tests
    surplus : how much the uncertain effects add to the sum of squared residuals in expectation
    too_many : whether some could not be allowed for
    """

    def __init__(self, likelihood: RollingLikelihood, momentum: slice, prior: Array, uncertain: Uncertain) -> None:
        self.likelihood = likelihood
        self._momentum = momentum
        self._prior = prior
        self._start = np.diag(prior)[momentum]
        self._uncertain = uncertain
        self._spans: list[tuple[float, float]] = []  # of the windows that are solved again
        self._open: list[_Open] = []
        self._view: _View | None = None
        self.jumps: list[Jump] = []
        self.ready = False
        self.surplus = 0.0
        self.too_many = False

    def add(self, block: Blocks, columns: Array, span: tuple[float, float]) -> Linearisation:
        """Take a window, solve again and return the likelihood's quadratic form at the solution.

        Parameters
        ----------
        block : in the unknowns without jumps
        columns : (1, r, e)
        span : s since the first sample, its start and end
        """
        self._expect(self._padded(block), columns, span)
        padded = self._padded(block)
        linear = self.likelihood.add(padded, columns)
        self._spans.append(span)
        if len(self._spans) > len(self.likelihood):
            del self._spans[0]
            for item in self._open:
                item.after -= 1
            linear = self._close() or linear
        self._view = self._look(linear)
        enough = linear.equations - len(self.likelihood.x) >= _ENOUGH
        self.ready = enough and self.likelihood.certain(self._padded(block))
        if self.ready and self._look_back(self._view):
            linear = self.likelihood.solve()
            self._view = self._look(linear)
        self._update(self._view)
        return linear

    def _look(self, linear: Linearisation) -> _View:
        likelihood, uncertain = self.likelihood, self._uncertain
        white, coupling = likelihood.whitened()
        nuisance = Nuisance.of(
            likelihood.information, linear.gradient, coupling, likelihood.x, uncertain.places, 1.0 / uncertain.variance
        )
        effects = np.linalg.solve(white.factor, likelihood.columns[..., uncertain.places])
        self.surplus = self._surplus(coupling)
        expected = max(linear.equations - len(likelihood.x), 1) + self.surplus
        return _View(white, effects, coupling, nuisance, max(1.0, linear.cost / expected))

    def _surplus(self, coupling: Coupling) -> float:
        """Return how much the uncertain effects add to the sum of squared residuals in expectation."""
        places = self._uncertain.places
        if not len(places):
            return 0.0
        cross = coupling.cross[:, places]
        left = np.diag(coupling.own)[places] - np.sum(
            cross * (monitor.inverse(self.likelihood.information) @ cross), axis=0
        )
        return float(np.sum(np.maximum(left, 0.0) * self._uncertain.variance))

    def _padded(self, block: Blocks) -> Blocks:
        """Return a block of the latest windows in all unknowns: jumps that are over do not enter."""
        return block.widened(np.zeros((*block.offset.shape, len(self.likelihood.x) - block.rows.shape[-1])))

    def _expect(self, block: Blocks, columns: Array, span: tuple[float, float]) -> None:
        """Let the momentum jump before a window that the earlier ones cannot explain."""
        view, effects = self._view, columns[0][:, self._uncertain.places]
        if view is None or not self.ready:
            return
        surprise = monitor.innovation(block, effects, self.likelihood.x, view.nuisance.inverse) / view.scale
        count = block.offset.shape[1]
        last = self._open[-1] if self._open else None
        goes_on = last is not None and last.after == len(self._spans) - 1 and last.given_up < _LONGEST
        if last is not None and goes_on and surprise > chi2.isf(_PART, count):
            # Still jumping: the window that was the first after it is another one in it.
            self.likelihood.drop(last.after, last.after + 1)
            self._spans.pop()
            last.given_up += 1
            last.jump.end = span[1]
        elif surprise > chi2.isf(_FALSE_ALARM, count):
            self._jump(len(self._spans), span, view)

    def _look_back(self, view: _View) -> bool:
        """Let the momentum jump between two earlier windows if that explains the data far better; return whether."""
        first = max([2, *(item.after + 2 for item in self._open)])
        if first >= len(self._spans):
            return False
        fall = monitor.jumps(view.white, view.effects, self._momentum, view.nuisance)
        best = first + int(np.argmax(fall.amount[first:]))
        if fall.amount[best] / view.scale < chi2.isf(_FALSE_ALARM, len(self._start)):
            return False
        return self._jump(best, self._spans[best], view)

    def _jump(self, place: int, span: tuple[float, float], view: _View) -> bool:
        """Let the momentum jump before a window; return whether there is room for it."""
        if len(self._open) >= _MOST_JUMPS:
            self.too_many = True
            return False
        likelihood, places = self.likelihood, np.arange(len(self.likelihood.x))[self._momentum]
        old, more = len(likelihood.x), len(places)
        same = np.eye(old, old + more)
        earlier = same.copy()
        earlier[places, old + np.arange(more)] = -1.0
        bases = [earlier if index < place else same for index in range(len(self._spans))]
        likelihood.substitute(bases, earlier, self._start)
        jump = Jump(*span, np.zeros(more), np.diag(1.0 / self._start))
        self.jumps.append(jump)
        item = _Open(jump, old + np.arange(more), place)
        self._open.append(item)
        # The window before may already hold part of it.
        misfit = float(np.sum(view.white.residual[place - 1] ** 2)) / view.scale
        if misfit > chi2.isf(_PART, more) and place > 1:
            likelihood.drop(place - 1, place)
            jump.start = self._spans.pop(place - 1)[0]
            item.after -= 1
        return True

    def _close(self) -> Linearisation | None:
        """Minimise over the jumps that no window solved again was before."""
        closed = [item for item in self._open if item.after <= 0]
        if not closed:
            return None
        for item in closed:
            self._open.remove(item)
            kept = len(self.likelihood.x) - len(item.place)
            self.likelihood.eliminate(item.place, self._fresh(kept))
            for other in self._open:
                other.place = other.place - len(item.place) * (other.place > item.place[0])
        return self.likelihood.solve()

    def _fresh(self, unknowns: int) -> Array:
        """Return the (u, u) information about zero where nothing is known, jumps included."""
        jumps = (unknowns - len(self._prior)) // len(self._start)
        return np.asarray(block_diag(self._prior, np.diag(np.tile(self._start, jumps))))

    def _update(self, view: _View) -> None:
        """Write down how large the jumps are by now."""
        for item in self._open:
            item.jump.value = self.likelihood.x[item.place]
            item.jump.covariance = view.nuisance.inverse[np.ix_(item.place, item.place)] * view.scale
