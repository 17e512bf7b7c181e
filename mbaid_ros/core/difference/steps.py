"""The likelihood of a run whose momentum may jump: the body's parameters keep what they learnt.

The momentum among the unknowns is always the latest one. A jump d is six more unknowns: the windows before it had the
momentum h - d. Once they are all folded, d is minimised over, so that there are only as many as jumps among the latest
windows. The window in which a jump happens belongs to neither side and is given up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.difference import monitor
from mbaid_ros.core.difference.ceiling import Ceiling
from mbaid_ros.core.difference.coupling import Places
from mbaid_ros.core.difference.disturbances import Found, Jump, Uncertain, View, Watched
from mbaid_ros.core.difference.effects import Kind
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation
from mbaid_ros.core.difference.monitor import Nuisance
from mbaid_ros.core.difference.rolling import RollingLikelihood
from mbaid_ros.core.geometry import Array

# Chance of an undisturbed window to be taken for a jump, by each test.
_FALSE_ALARM = 1e-9
# The same for the windows next to a jump, which may hold part of it.
_PART = 1e-2
# Redundant equations from which the tests can be trusted.
_ENOUGH = 50
# Fall of the sum of squared residuals by which one kind of force must be better than the other, and a jump than both.
_CLEAR = 15.0
_PRESSING = 6.0  # times the limit, at which one is taken even so
_SUSPICIOUS = 0.5  # of the limit, below which the tests can wait: the likelihood is no parabola altogether
_APART = 4  # windows between two jumps; with fewer they are one
_REMEMBERED = 100  # jumps
_MOST_JUMPS = 4  # among the windows that are solved again
_LONGEST = 40  # windows that one jump may take


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


class SteppedLikelihood:
    """Watches a rolling likelihood for jumps of the momentum, and lets it jump.

    Parameters
    ----------
    likelihood : RollingLikelihood
    momentum : places of the momentum among its unknowns
    prior : (u, u) information about zero where nothing is known; with the momentum's, jumps begin, too
    uncertain : Uncertain
    watched : Watched

    Attributes
    ----------
    watched : as given
    jumps : those that have been found, the latest of them
    found : watched effects that are there
    ready : whether the data say enough for the tests
    surplus : how much the uncertain effects add to the sum of squared residuals in expectation
    too_many : whether some could not be allowed for
    """

    def __init__(
        self, likelihood: RollingLikelihood, momentum: slice, prior: Array, uncertain: Uncertain, watched: Watched
    ) -> None:
        self.likelihood = likelihood
        self._momentum = momentum
        self._prior = prior
        self._start = np.diag(prior)[momentum]
        self._limit = chi_square.limit(_FALSE_ALARM, len(self._start))
        self._ceiling = Ceiling()
        self._uncertain = uncertain
        self.watched = watched
        self._spans: list[tuple[float, float]] = []  # of the windows that are solved again
        self._open: list[_Open] = []
        self._view: View | None = None
        self.jumps: list[Jump] = []
        self.found: list[Found] = []
        self.ready = False
        self.surplus = 0.0
        self.too_many = False

    def add(self, block: Blocks, columns: Array, span: tuple[float, float], delay: float = 0.0) -> Linearisation:
        """Take a window, solve again and return the likelihood's quadratic form at the solution.

        Parameters
        ----------
        block : in the unknowns without jumps
        columns : (1, r, e)
        span : s since the first sample, its start and end
        delay : s, by which its joints have been taken later
        """
        self._expect(*self._padded(block, columns, delay), span)
        linear = self.likelihood.add(*self._padded(block, columns, delay))
        self._spans.append(span)
        if len(self._spans) > len(self.likelihood):
            del self._spans[0]
            for item in self._open:
                item.after -= 1
            linear = self._close() or linear
        view, ceiling = self._look(linear), self._ceiling.after(self.likelihood.whole(linear), self.likelihood.form)
        enough = linear.equations - len(self.likelihood.x) >= _ENOUGH
        self.ready = enough and self.likelihood.certain
        # Uncertain effects lower what the tests find: no window bounds by how much the next one may raise it.
        suspicious = len(self._uncertain.places) > 0 or view.relative(ceiling) > _SUSPICIOUS * self._limit
        if self.ready and suspicious and self._look_back(view):
            linear = self.likelihood.solve()
            view = self._look(linear)
        self._view = view
        for item in self._open:
            item.jump.value, item.jump.covariance = self.part(item.place)
        return linear

    def part(self, place: Places) -> tuple[Array, Array]:
        """Return value and covariance of some of the unknowns, the latter widened where residuals are too large."""
        value = self.likelihood.x[place]
        if self._view is None:
            return value, np.full((len(place), len(place)), np.inf)
        return value, self._view.nuisance.inverse[np.ix_(place, place)] * self._view.scale

    @property
    def uncertain_cross(self) -> Array:
        """What ties the uncertain effects, each in its standard deviation, to the unknowns: (u, e).

        The covariance of the unknowns without them times this is what they do to the unknowns (consider covariance;
        Schmidt 1966).
        """
        if self._view is None:
            return np.zeros((len(self.likelihood.x), len(self._uncertain.places)))
        return self._view.uncertain

    def _look(self, linear: Linearisation) -> View:
        likelihood, places, size = self.likelihood, self._uncertain.places, self._uncertain.size
        cross: Array = np.zeros((len(likelihood.x), len(places)))
        self.surplus = 0.0
        if len(places):
            coupling = likelihood.coupling_of_all
            cross = coupling.cross[:, places]
        nuisance = Nuisance.of(likelihood.information, linear.gradient, cross, size)
        if len(places):
            own = np.diag(coupling.own)[places] * size**2
            self.surplus = float(np.sum(np.maximum(own - np.sum(cross * size * nuisance.spread, axis=0), 0.0)))
        expected = max(linear.equations - len(likelihood.x), 1) + self.surplus
        return View(likelihood.bordered, likelihood.past_linearisation, cross * size, nuisance, linear.cost, expected)

    def _padded(self, block: Blocks, columns: Array, delay: float) -> tuple[Blocks, Array]:
        """Return a window in all unknowns, into which jumps that are over do not enter, and its effects.

        The delay among the unknowns is that of the stamps: what has been taken off already is added again, to first
        order, so that what remains is of second order in the rest alone.
        """
        own = block.rows.shape[-1]
        more = np.zeros((*block.offset.shape, len(self.likelihood.x) - own))
        columns = columns.copy()
        for found in self.found:
            effect = columns[..., found.effects] @ self._weight(found.kind)
            more[..., found.place - own] = effect
            columns[..., found.effects] = 0.0
            if found.kind == 'delay':
                block = replace(block, offset=block.offset - delay * effect[..., 0])
        return block.widened(more), columns

    def _expect(self, block: Blocks, columns: Array, span: tuple[float, float]) -> None:
        """Let the momentum jump before a window that the earlier ones cannot explain."""
        view, effects = self._view, columns[0][:, self._uncertain.places]
        if view is None or not self.ready:
            return
        surprise = monitor.innovation(block, effects, self.likelihood.x, view.nuisance) / view.scale
        count = block.offset.shape[1]
        last = self._open[-1] if self._open else None
        since = len(self._spans) - last.after if last is not None and last.given_up < _LONGEST else _APART
        if (
            last is not None
            and since < _APART
            and surprise > chi_square.limit(_PART if since == 1 else _FALSE_ALARM, count)
        ):
            # Still jumping: the windows that seemed to come after it are others in it.
            self.likelihood.drop(last.after, len(self._spans))
            del self._spans[last.after :]
            last.given_up += since
            last.jump.end = span[1]
        elif surprise > chi_square.limit(_FALSE_ALARM, count):
            self._jump(len(self._spans), span, view)

    def _look_back(self, view: View) -> bool:
        """Let a force act or the momentum jump earlier on, if that explains the data far better; return whether."""
        limit = self._limit
        first = max([2, *(item.after + _APART for item in self._open)])
        jumps = monitor.jumps(view.rows[first:], view.step, self._momentum, self._uncertain.places, view.nuisance)
        best, explained = (int(np.argmax(jumps)), float(np.max(jumps))) if len(jumps) else (0, 0.0)
        falls = self._falls(view)
        kind = max(falls, key=lambda name: falls[name], default=None)
        self._ceiling.found(max([explained, *falls.values()]))
        # A jump may be anywhere, a force is one; and where one kind acts already, it may just be of the other kind.
        rival = 0.5 * explained if self.found else explained - _CLEAR * view.left(explained)
        if kind is not None and falls[kind] > rival and view.relative(falls[kind]) > limit:
            # Between two kinds that explain the same, time will tell; unless it is too much to wait.
            second = max((falls[other] for other in falls if other != kind), default=-np.inf)
            clear = falls[kind] - second > _CLEAR * view.left(falls[kind])
            if clear or view.relative(falls[kind]) > _PRESSING * limit:
                self._admit(kind)
                return True
            return False
        return view.relative(explained) > limit and self._jump(first + best, self._spans[first + best], view)

    def _falls(self, view: View) -> dict[Kind, float]:
        """Return how much better each watched effect would explain the data, of those that have not been found."""
        found = {item.kind for item in self.found}
        acting = {
            kind: (effects, self._weight(kind)) for kind, effects in self.watched.effects.items() if kind not in found
        }
        return monitor.falls(
            self.likelihood.coupling_of_all, self.likelihood.x, acting, self._uncertain.places, view.nuisance
        )

    def _weight(self, kind: Kind) -> Array:
        """Return what the watched effects are of the unknowns that they would become, (n, k)."""
        if kind == 'delay':
            return np.concatenate((np.ones(1), self.likelihood.x[: self._momentum.start]))[:, None]
        return np.eye(len(self.watched.prior[kind]))

    def _admit(self, kind: Kind) -> None:
        """Take a watched effect among the unknowns, from the start of the run."""
        effects, count = self.watched.effects[kind], len(self.likelihood.x)
        self.likelihood.solve_for(effects, self._weight(kind), self.watched.prior[kind])
        self.found.append(Found(kind, effects, np.arange(count, len(self.likelihood.x))))

    def _jump(self, place: int, span: tuple[float, float], view: View) -> bool:
        """Let the momentum jump before a window; return whether there is room for it."""
        if len(self._open) >= _MOST_JUMPS:
            self.too_many = True
            return False
        likelihood, places = self.likelihood, np.arange(len(self.likelihood.x))[self._momentum]
        old, more = len(likelihood.x), len(places)
        earlier = np.eye(old, old + more)
        earlier[places, old + np.arange(more)] = -1.0
        likelihood.substitute(place, earlier, self._start)
        jump = Jump(*span, np.zeros(more), np.diag(1.0 / self._start))
        self.jumps = [*self.jumps[1 - _REMEMBERED :], jump]
        item = _Open(jump, old + np.arange(more), place)
        self._open.append(item)
        # The window before may already hold part of it.
        misfit = view.squared(place - 1) / view.scale
        if misfit > chi_square.limit(_PART, more) and place > 1:
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
            later: list[_Open | Found] = [*self._open, *self.found]
            for other in later:
                other.place = other.place - len(item.place) * (other.place > item.place[0])
            prior = self._fresh(len(self.likelihood.x) - len(item.place))
            self.likelihood.eliminate(item.place, prior)
        return self.likelihood.solve()

    def _fresh(self, unknowns: int) -> Array:
        """Return the (u, u) information about zero where nothing is known, jumps and what was found included."""
        prior = np.zeros((unknowns, unknowns))
        prior[: len(self._prior), : len(self._prior)] = self._prior
        for item in self._open:
            prior[item.place, item.place] = self._start
        for found in self.found:
            prior[found.place, found.place] = self.watched.prior[found.kind]
        return prior
