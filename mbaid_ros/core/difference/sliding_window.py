"""The likelihood of all windows so far: the latest are solved again, older ones are a marginalised prior.

In units of its noise, a window's residual and rows change little with x. While x moves by a small part of its standard
deviation, the parabola of the last linearisation is the likelihood, and only a new window has to be whitened.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation, WhitenedBlocks, first_solutions
from mbaid_ros.core.difference.marginalised import CrossInformation, MarginalisedPrior
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import chi_square_limit, solve_definite, solve_symmetric
from mbaid_ros.core.samples import S

_ITERATIONS_AT_START = 12  # at most: from first solutions far away, steps are halved again and again
_ITERATIONS_WARM = 2  # a window: it starts at the last solution, and the next window continues
# Lengths of a step that are tried, each half the last: if a sixteenth does not help, the direction is wrong.
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


@dataclass(frozen=True)
class WindowEquations(Blocks):
    """The equations of K windows, with their columns (K, r, e) by the consider parameters."""

    columns: Array


class LinearisedWindows:
    """Windows in the order of their time, whitened at one linearisation point `x` (u,).

    Attributes
    ----------
    equations : of all windows
    """

    def __init__(self, x: Array) -> None:
        self.equations = WindowEquations(*np.zeros((5, 0)))
        self._white = WhitenedBlocks(np.zeros((0, 0)), *np.zeros((3, 0, 0, 0)))
        self._own: Array = np.zeros(0)
        self.x = x

    def __len__(self) -> int:
        """Return their number."""
        return len(self.equations)

    @property
    def white(self) -> WhitenedBlocks:
        """All windows in units of their noise at the linearisation point; FloatingPointError where undefined."""
        done = len(self._white)
        if done < len(self):
            self._white = _joined(self._white, eiv.whitened(self.equations[done:], self.x))
        return self._white

    @property
    def columns(self) -> Array:
        """Their columns by the consider parameters in units of their noise, (K, r, e)."""
        return self.white.whitener @ self.equations.columns

    @property
    def noise_information(self) -> Array:
        """The information of noise alone in each window at the linearisation point, (K, u, u)."""
        done = len(self._own)
        if done < len(self):
            own = eiv.row_noise_information(self.equations[done:], self.white[done:])
            self._own = np.concatenate((self._own, own)) if done else own
        return self._own

    def whitened_at(self, x: Array) -> WhitenedBlocks | None:
        """Return the windows whitened at another x, (u,); None where undefined."""
        try:
            return eiv.whitened(self.equations, x)
        except FloatingPointError:
            return None

    def linearise(self, x: Array, white: WhitenedBlocks | None = None) -> None:
        """Move the linearisation point to x, (u,); `white` holds the windows there, if known already."""
        self.x = x
        self._white = self._white[:0] if white is None else white
        self._own = np.zeros(0)

    def append(self, window: WindowEquations) -> None:
        """Add the next window."""
        self.equations = _joined(self.equations, window)

    def pop(self) -> None:
        """Drop the oldest window."""
        self.equations, self._white, self._own = self.equations[1:], self._white[1:], self._own[1:]


def _joined(entries: S, more: S) -> S:
    """Return entries with more after them."""
    return type(more).concatenate([entries, more]) if len(entries) else more


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
    noise_information : (u, u) information by noise alone
    linear : the quadratic form that was solved, at x, without the noise's information of marginalised windows
    cross_information : of all windows
    windows : those that are solved again
    """

    def __init__(self, prior: Array, length: int, typical: Array, considered: int = 0) -> None:
        self._prior, self._length, self._typical = prior, length, typical
        self._marginalised = MarginalisedPrior(prior)
        self.cross_information = CrossInformation(np.zeros((len(prior), considered)), np.zeros(considered))
        self._past_cross = self.cross_information
        self._signal: Array = np.zeros_like(prior)  # information beyond the noise
        self._converged = False  # whether the latest window to leave was linearised at a solution known well enough
        self.x: Array = np.zeros(len(prior))
        self.noise_information: Array = np.zeros_like(prior)
        self.linear = Linearisation(0.0, np.zeros(len(prior)), prior, 0)
        self.windows = LinearisedWindows(self.x)

    def add(self, block: Blocks, columns: Array | None = None) -> Linearisation:
        """Add one window, solve again and return the likelihood's quadratic form at the solution `x`.

        `columns` (1, r, e) holds the derivatives of its equations by the consider parameters.
        """
        if len(self.windows) == self._length:
            self._marginalise()
        columns = np.zeros((*block.offset.shape, 0)) if columns is None else columns
        self.windows.append(WindowEquations(block.rows, block.offset, block.noise, block.noise_rows, columns))
        if not self._converged:
            self._start()
        self.linear = linear = self._maximise(_ITERATIONS_WARM if self._converged else _ITERATIONS_AT_START)
        # As with the information itself: the windows' at this x, that of marginalised ones at theirs.
        own = self.windows.noise_information.sum(axis=0)
        self.noise_information = self._marginalised.noise_information + own
        self._signal = linear.information - _CERTAIN * own - self._prior
        rows = self.windows.white.rows
        self.cross_information = self._past_cross + CrossInformation.from_rows(rows, self.windows.columns)
        return replace(linear, information=linear.information + self._marginalised.noise_information)

    @property
    def certain(self) -> bool:
        """Whether the uncertainty of the solution hardly matters for the noise of the latest window's equations."""
        if self._converged:
            return True
        return eiv.uncertain_share(self.windows.equations[-1:], *self._regularised(self.x)) < _LARGEST_SHARE

    def _regularised(self, x: Array) -> tuple[Array, Array]:
        """Return x (u,) and a factor of its covariance, both of typical size in directions without data."""
        size = self._typical
        values, vectors = np.linalg.eigh(self._signal * size * size[:, None])
        values = np.maximum(values, 0.0)
        vectors = size[:, None] * vectors
        coordinates = np.linalg.solve(vectors, x)
        return vectors @ (values / (values + 1.0) * coordinates), vectors / np.sqrt(values + 1.0)

    def _start(self) -> None:
        """Linearise at the last solution, or, if that fails to explain the data, at the best first solution."""
        blocks = self.windows.equations
        redundancy = blocks.offset.size + self._marginalised.equations - len(self.x)
        if self.x[0] > 0.0 and redundancy >= _ENOUGH:
            white = self.windows.whitened_at(self.x)
            limit = chi_square_limit(_UNLIKELY, redundancy)
            if white is not None and self._total_cost(white.cost, self.x) < limit:
                self.windows.linearise(self.x, white)
                return
        information = self._marginalised.information + self._prior
        starts = [*first_solutions(blocks, information, self._marginalised.right_side), self.x]
        # A negative mass can fit better while little is known, and the way back leads through infinity.
        possible = [x for x in starts if x[0] > 0.0] or starts
        whites = [self.windows.whitened_at(x) for x in possible]
        costs = [
            np.inf if white is None else self._total_cost(white.cost, x)
            for white, x in zip(whites, possible, strict=True)
        ]
        best = int(np.argmin(np.nan_to_num(costs, nan=np.inf)))
        self.windows.linearise(possible[best], whites[best])

    def _marginalise(self) -> None:
        """Move the oldest window to the prior."""
        windows, x = self.windows, self.windows.x
        window, white, own = windows.equations[:1], windows.white[:1], windows.noise_information[0]
        rows, columns = white.rows, windows.columns[:1]
        share = eiv.uncertain_share(window, *self._regularised(self.x))
        self._converged = share < _LARGEST_SHARE
        if self._converged:
            linear = eiv.normal_equations(white)
            self._marginalised.add(replace(linear, information=linear.information - own), own, x)
        else:
            linear, own, whitener = eiv.bias_compensated(window, *self._regularised(self.x))
            self._marginalised.add(linear, own, np.zeros(len(x)))
            rows, columns = whitener @ window.rows, whitener @ window.columns
        self._past_cross += CrossInformation.from_rows(rows, columns)
        windows.pop()

    def _maximise(self, iterations: int) -> Linearisation:
        """Move x by guarded Gauss-Newton steps: each finite, with positive mass, and not raising the cost.

        The last one leads to the top of the parabola, if that is close. Returns the form at the final x.
        """
        windows, close = self.windows, _CLOSE if self._converged else _SMALL_STEP
        solve = solve_definite if self._converged else solve_symmetric
        linear = self._linearised()
        for _ in range(iterations):
            step = -solve(linear.information, linear.gradient)
            if -float(linear.gradient @ step) < close**2:
                self.x = windows.x + step
                form = linear.expanded_at(step)
                return replace(form, cost=form.cost + self._prior_cost(windows.x) - self._prior_cost(self.x))
            if not self._step(step, linear.cost + self._prior_cost(windows.x)):
                break
            linear = self._linearised()
        self.x = windows.x
        return linear

    def _step(self, step: Array, current: float) -> bool:
        """Move the linearisation point as far as the cost allows; return whether it moved."""
        windows = self.windows
        for _ in range(_HALVINGS):
            trial = windows.x + step
            white = windows.whitened_at(trial)
            if white is not None and (trial[0] > 0.0 or windows.x[0] <= 0.0):
                value = self._total_cost(white.cost, trial)
                if np.isfinite(value) and value <= current:
                    windows.linearise(trial, white)
                    return True
            step = 0.5 * step
        return False

    def _total_cost(self, cost: float, x: Array) -> float:
        """Return the cost of all terms at x, from that of the windows."""
        return cost + self._marginalised.cost(x) + self._prior_cost(x)

    def _prior_cost(self, x: Array) -> float:
        return float(x @ self._prior @ x)

    def _linearised(self) -> Linearisation:
        """Return the likelihood's quadratic form at the linearisation point."""
        x, past, linear = self.windows.x, self._marginalised, eiv.normal_equations(self.windows.white)
        return Linearisation(
            cost=linear.cost + past.cost(x),
            gradient=linear.gradient + past.gradient(x) + self._prior @ x,
            information=linear.information + past.information + self._prior,
            equations=linear.equations + past.equations,
        )
