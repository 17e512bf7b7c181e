"""The windows of the sliding window, whitened where all of them were last linearised.

In units of its noise, a window's residual and rows change little with x: while x is a small part of its standard
deviation away, the parabola of that linearisation is the likelihood, and only a new window has to be whitened.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.array_record import ArrayRecord, Queue
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.consider_parameters import CrossInformation
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation, White
from mbaid_ros.core.difference.first_solutions import first_solutions
from mbaid_ros.core.difference.marginalised import MarginalisedPrior, Regularised
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import solve_definite, solve_symmetric


@dataclass(frozen=True)
class WindowEquations(Blocks):
    """The equations of K windows.

    Attributes
    ----------
    columns : (K, r, e) how they depend on the consider parameters
    """

    columns: Array


@dataclass(frozen=True)
class _Own(ArrayRecord):
    """The information that noise alone brings to K windows, (K, u, u)."""

    information: Array


class LinearisedWindows:
    """Windows in the order of their time.

    Parameters
    ----------
    x : (u,) the linearisation point to begin with

    Attributes
    ----------
    x : the linearisation point
    """

    def __init__(self, x: Array) -> None:
        self._windows = Queue(WindowEquations(*np.zeros((5, 0))))
        self.linearise(x)

    def __len__(self) -> int:
        """Return their number."""
        return len(self._windows)

    @property
    def equations(self) -> WindowEquations:
        """Their equations."""
        return self._windows.entries

    @property
    def white(self) -> White:
        """All windows in units of their noise at the linearisation point.

        Raises
        ------
        FloatingPointError
            The covariance of a window is not positive definite there.
        """
        done = len(self._white)
        if done < len(self):
            self._white.append(eiv.whitened(self.equations[done:], self.x))
        return self._white.entries

    @property
    def columns(self) -> Array:
        """How they depend on the consider parameters in units of their noise, (K, r, e)."""
        return self.white.whitener @ self.equations.columns

    @property
    def noise_information(self) -> Array:
        """What noise alone brings to each window's information at the linearisation point, (K, u, u)."""
        done = len(self._own)
        if done < len(self):
            self._own.append(_Own(eiv.own_information(self.equations[done:], self.white[done:])))
        return self._own.entries.information

    def normal_equations(self) -> Linearisation:
        """Return the likelihood's quadratic form at the linearisation point."""
        return eiv.normal_equations(self.white)

    def at(self, x: Array) -> White | None:
        """Return the windows whitened at another x, (u,); None where that cannot be computed."""
        try:
            return eiv.whitened(self.equations, x)
        except FloatingPointError:
            return None

    def linearise(self, x: Array, white: White | None = None) -> None:
        """Move the linearisation point to x, (u,); `white` are the windows there, where that is known already."""
        self.x = x
        self._white = Queue(White.nothing() if white is None else white)
        self._own = Queue(_Own(np.zeros(0)))

    def append(self, window: WindowEquations) -> None:
        """Take the next window."""
        self._windows.append(window)

    def pop(self) -> None:
        """Give up the oldest window."""
        for queue in (self._windows, self._white, self._own):
            queue.drop(1)


_ITERATIONS_AT_START = 12  # at most: from first solutions far away, steps are halved again and again
_ITERATIONS_WARM = 2  # a window: it begins where the last one ended, and what is left is done with the next
# Lengths of a step that are tried, each half the last: what does not help at a sixteenth is not in this direction.
_HALVINGS = 5
# Redundant equations from which a solution that explains the data is no accident, and the chance that it seems not to.
_ENOUGH, _UNLIKELY = 50, 1e-3
# Root of the fall of the cost by a step, up to which the parabola is the likelihood: before x is well known, and
# after.
_SMALL_STEP, _CLOSE = 1e-3, 0.5
# Four times the noise's own information is taken off before a solution counts as known: it fluctuates.
_CERTAIN = 4.0
# Part of the variance of a window's equations that the uncertainty of x may add for it to be linearised there.
_LARGEST_SHARE = 0.1


class SlidingWindow:
    """The likelihood of all windows so far and its maximum.

    Parameters
    ----------
    prior : (u, u) information about x = 0
    length : number of windows solved again at each update
    typical : (u,) typical sizes of the unknowns
    considered : number e of consider parameters

    Attributes
    ----------
    x : (u,) the solution
    noise_information : (u, u) what noise alone has brought
    linear : the quadratic form that was solved, at x; the noise's information of marginalised windows is taken off
    cross_information : what ties the consider parameters to the unknowns, by all windows
    windows : those that are solved again
    """

    def __init__(self, prior: Array, length: int, typical: Array, considered: int = 0) -> None:
        self._prior = prior
        self._length = length
        self._typical = typical
        self._marginalised = MarginalisedPrior(prior)
        self._past_cross = self.cross_information = CrossInformation.nothing(len(prior), considered)
        self._signal: Array = np.zeros_like(prior)  # information beyond the noise
        self._settled = False  # whether the latest window to leave was linearised at a solution known well enough
        self.x: Array = np.zeros(len(prior))
        self.noise_information: Array = np.zeros_like(prior)
        self.linear = Linearisation(0.0, np.zeros(len(prior)), prior, 0)
        self.windows = LinearisedWindows(self.x)

    def add(self, block: Blocks, columns: Array | None = None) -> Linearisation:
        """Take one window, solve again and return the likelihood's quadratic form at the solution `x`.

        Parameters
        ----------
        block : Blocks
        columns : (1, r, e) how its equations depend on the consider parameters
        """
        if len(self.windows) == self._length:
            self._marginalise()
        columns = np.zeros((*block.offset.shape, 0)) if columns is None else columns
        self.windows.append(WindowEquations(block.rows, block.offset, block.noise, block.noise_rows, columns))
        if not self._settled:
            self._start()
        linear = self._maximise(_ITERATIONS_WARM if self._settled else _ITERATIONS_AT_START)
        # Like the information itself: the windows' at this x, the marginalised ones' at that of their time.
        own = self.windows.noise_information.sum(axis=0)
        self.noise_information = self._marginalised.noise_information + own
        self._signal = linear.information - _CERTAIN * own - self._prior
        self.linear = linear
        self.cross_information = self._past_cross + CrossInformation.of(self.windows.white.rows, self.windows.columns)
        return replace(linear, information=linear.information + self._marginalised.noise_information)

    @property
    def marginalised(self) -> int:
        """Number of windows that are no longer solved again."""
        return len(self._marginalised)

    @property
    def certain(self) -> bool:
        """Whether the uncertainty of the solution hardly matters for the noise of the latest window's equations."""
        if self._settled:
            return True
        return eiv.uncertain_share(self.windows.equations[-1:], *self._regularised.solution(self.x)) < _LARGEST_SHARE

    @property
    def _regularised(self) -> Regularised:
        return Regularised(self._signal, self._typical)

    def _start(self) -> None:
        """Linearise where to search from: where the last search ended, unless that fails to explain the data so far."""
        blocks = self.windows.equations
        redundancy = blocks.offset.size + self._marginalised.equations - len(self.x)
        if self.x[0] > 0.0 and redundancy >= _ENOUGH:
            white = self.windows.at(self.x)
            limit = chi_square.limit(_UNLIKELY, redundancy)
            if white is not None and self._whole(white.cost, self.x) < limit:
                self.windows.linearise(self.x, white)
                return
        known = self._marginalised.information + self._prior
        starts = [*first_solutions(blocks, known, self._marginalised.right_side), self.x]
        # A negative mass can fit better while little is known, and the way back leads through infinity.
        possible = [x for x in starts if x[0] > 0.0] or starts
        costs = [self._whole(*pair) for pair in zip(eiv.costs(blocks, np.array(possible)), possible, strict=True)]
        self.windows.linearise(possible[int(np.argmin(np.nan_to_num(costs, nan=np.inf)))])

    def _marginalise(self) -> None:
        """Move the oldest window to the prior."""
        windows, x = self.windows, self.windows.x
        window, white, own = windows.equations[:1], windows.white[:1], windows.noise_information[0]
        columns = windows.columns[:1]
        if self._settled:
            share = float(np.vdot(own, self._regularised.covariance)) / window.offset.size
        else:
            share = eiv.uncertain_share(window, *self._regularised.solution(self.x))
        self._settled = share < _LARGEST_SHARE
        if self._settled:
            linear = eiv.normal_equations(white)
            self._marginalised.add(replace(linear, information=linear.information - own), own, x)
        else:
            regularised = self._regularised.solution(self.x)
            self._marginalised.add(*eiv.compensated(window, *regularised), np.zeros(len(x)))
            white = eiv.whitened_at_zero(window, *regularised)
            columns = white.whitener @ window.columns
        self._past_cross += CrossInformation.of(white.rows, columns)
        windows.pop()

    def _maximise(self, iterations: int) -> Linearisation:
        """Move x by guarded Gauss-Newton steps: each finite, with positive mass, and not raising the cost.

        The last is that to the top of the parabola, if that is close. Returns the form at the x that is reached.
        """
        windows, close = self.windows, _CLOSE if self._settled else _SMALL_STEP
        linear = self._linearised()
        for _ in range(iterations):
            solve = solve_definite if self._settled else solve_symmetric
            step = -solve(linear.information, linear.gradient)
            if -float(linear.gradient @ step) < close**2:
                self.x = windows.x + step
                form = linear.at(step)
                return replace(form, cost=form.cost + self._of_prior(windows.x) - self._of_prior(self.x))
            if not self._step(step, linear.cost + self._of_prior(windows.x)):
                break
            linear = self._linearised()
        self.x = windows.x
        return linear

    def _step(self, step: Array, current: float) -> bool:
        """Move the linearisation point as far as the cost allows; return whether there is such a place."""
        windows = self.windows
        for _ in range(_HALVINGS):
            trial = windows.x + step
            white = windows.at(trial)
            if white is not None and (trial[0] > 0.0 or windows.x[0] <= 0.0):
                value = self._whole(white.cost, trial)
                if np.isfinite(value) and value <= current:
                    windows.linearise(trial, white)
                    return True
            step = 0.5 * step
        return False

    def _whole(self, cost: float, x: Array) -> float:
        """Return the cost at x of everything, from that of the windows."""
        return cost + self._marginalised.cost(x) + self._of_prior(x)

    def _of_prior(self, x: Array) -> float:
        return float(x @ self._prior @ x)

    def _linearised(self) -> Linearisation:
        """Return the likelihood's quadratic form at the linearisation point."""
        x, past, linear = self.windows.x, self._marginalised, self.windows.normal_equations()
        return Linearisation(
            cost=linear.cost + past.cost(x),
            gradient=linear.gradient + past.gradient(x) + self._prior @ x,
            information=linear.information + past.information + self._prior,
            equations=linear.equations + past.equations,
        )
