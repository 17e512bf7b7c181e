"""Maximum likelihood over a growing run at bounded cost: the latest windows solved again, the older ones folded.

A pure recursion keeps the bad weights of its first estimates. Here every update solves all kept windows again from the
last solution; a window that leaves lives on in one matrix and vector. It is linearised at the solution of that time,
if that is known well enough. While it is not, the solution may stand anywhere, and what is linearised far off would
pull there for ever: the window's weighted least squares, less what the noise in the rows adds in expectation, is
quadratic as it is, and its weights allow for the uncertainty.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core import chi_square
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.coupling import Coupling, Places, bordered, normal_equations
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation
from mbaid_ros.core.difference.first_solutions import first_solutions
from mbaid_ros.core.difference.folded import Folded
from mbaid_ros.core.difference.kept import KeptWindows
from mbaid_ros.core.difference.plausible import Plausible
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.symmetric import solve_definite, solve_symmetric

_ITERATIONS_AT_START = 12
_ITERATIONS_WARM = 2
_HALVINGS = 5
# Redundant equations from which a solution that explains the data is no accident, and the chance that it seems not to.
_ENOUGH, _UNLIKELY = 50, 1e-3
# Root of the fall of the cost by a step, up to which the parabola is taken for the likelihood.
_SMALL_STEP, _CLOSE = 1e-3, 0.5
# Four times the noise's own information is taken off before a solution counts as known: it fluctuates.
_CERTAIN = 4.0
# Part of the variance of a block's equations that the uncertainty of x may add for the block to be linearised there.
_LARGEST_SHARE = 0.1
# Information that recent windows must have, in units of what noise alone brings, to count as excited: it fluctuates.
_EXCITED = 5.0


class RollingLikelihood:
    """The likelihood of all windows so far and its maximum.

    Parameters
    ----------
    prior : (u, u) information about x = 0
    kept : number of blocks solved again at each update
    forgetting : weight of the past from one block to the next, 0 < forgetting <= 1
    typical : (u,) typical sizes of the unknowns
    effects : number e of effects that are looked at, but not solved for

    Attributes
    ----------
    x : (u,) the solution
    noise_information : (u, u) what noise alone has brought
    information : (u, u) of the quadratic form that was solved
    coupling : of the folded windows with the effects
    """

    def __init__(self, prior: Array, kept: int, forgetting: float, typical: Array, effects: int = 0) -> None:
        self._prior = prior
        self._most = kept
        self._forgetting = forgetting
        self._typical = typical
        self._folded = Folded(prior)
        self._signal: Array = np.zeros_like(prior)  # information beyond the noise
        self._sure = False  # whether the latest fold was made at a solution that is known well enough
        self.x: Array = np.zeros(len(prior))
        self.noise_information: Array = np.zeros_like(prior)
        self.information: Array = prior
        self.coupling = Coupling.nothing(len(prior), effects)
        self._kept = KeptWindows(self.x)
        self._squares: Array = np.zeros((len(prior) + 1 + effects, len(prior) + 1 + effects))  # of the kept windows

    def __len__(self) -> int:
        """Return the number of windows that are solved again."""
        return len(self._kept)

    @property
    def folded(self) -> bool:
        """Whether some windows are no longer solved again."""
        return len(self._folded) > 0

    def add(self, block: Blocks, columns: Array | None = None) -> Linearisation:
        """Take one block, solve again and return the likelihood's quadratic form at the solution `x`.

        Parameters
        ----------
        block : Blocks
        columns : (1, r, e) how its equations depend on the effects
        """
        self._kept.append(block, np.zeros((*block.offset.shape, 0)) if columns is None else columns)
        if len(self._kept) > self._most:
            self._fold()
        return self.solve()

    def solve(self) -> Linearisation:
        """Solve again and return the likelihood's quadratic form at the solution `x`."""
        if not self._sure:
            self._start()
        linear = self._maximise(_ITERATIONS_WARM if self._sure else _ITERATIONS_AT_START)
        # Like the information itself: the kept windows' at this x, the folded ones' at that of their folding.
        own = self._kept.noise_information
        self.noise_information = self._folded.noise_information + own
        self._signal = linear.information - _CERTAIN * own - self._prior
        self.information = linear.information
        return replace(linear, information=linear.information + self._folded.noise_information)

    @property
    def bordered(self) -> Array:
        """The bordered rows of each window that is solved again, where it is linearised."""
        return self._kept.bordered

    @property
    def form(self) -> int:
        """Number of the quadratic form that is solved: the same while windows are only added to it."""
        return self._kept.forms + (len(self._folded) if self._forgetting < 1.0 else 0)

    @property
    def past_linearisation(self) -> Array:
        """How far the solution is from where the windows are linearised, (u,)."""
        return self.x - self._kept.x

    @property
    def coupling_of_all(self) -> Coupling:
        """How all windows, with those that are solved again, depend on the effects."""
        return self.coupling + Coupling.of(self._squares, self._kept.x)

    @property
    def certain(self) -> bool:
        """Whether the uncertainty of the solution hardly matters for the noise of the latest window's equations."""
        return self._sure or eiv.uncertain_share(self._kept.newest, *self._plausible.solution(self.x)) < _LARGEST_SHARE

    @property
    def _plausible(self) -> Plausible:
        return Plausible(self._signal, self._typical)

    def drop(self, first: int, last: int) -> None:
        """Give up windows first, ..., last - 1 of those that are solved again."""
        self._kept.drop(first, last)

    def substitute(self, place: int, earlier: Array, prior: Array) -> None:
        """Go over to more unknowns x', with x = earlier x' before a window; those that are new come last, from zero on.

        From that window on x is the first part of x'.

        Parameters
        ----------
        place : of that window, among those that are solved again
        earlier : (u, w) of the windows before, and of what was known beforehand
        prior : (w - u,) information of the new ones about zero
        """
        old, blocks = len(self.x), self._kept.blocks
        before, after = blocks[:place], blocks[place:]
        before = before.restrict(np.eye(blocks.offset.shape[1]), earlier)
        after = after.widened(np.zeros((*after.offset.shape, len(prior))))
        self._prior = earlier.T @ self._prior @ earlier
        self._prior[old:, old:] += np.diag(prior)
        self._folded.substitute(earlier, self._prior)
        self.coupling = self.coupling.substitute(earlier)
        self._signal = earlier.T @ self._signal @ earlier
        self._typical = np.concatenate((self._typical, np.max(np.abs(earlier[:, old:].T) * self._typical, axis=1)))
        self.x = np.concatenate((self.x, np.zeros(len(prior))))
        self._kept.replace(Blocks.concatenate([before, after]), self.x)

    def solve_for(self, effects: slice, weight: Array, prior: Array) -> None:
        """Take combinations of effects among the unknowns; they come last and begin at zero; the effects are gone.

        Parameters
        ----------
        effects : which
        weight : (n, w) the effects are weight times the new unknowns
        prior : (w,) information about zero
        """
        more = len(prior)
        self._prior = np.asarray(block_diag(self._prior, np.diag(prior)))
        self._folded.extend(self.coupling.mixed(effects, weight), self._prior)
        self.coupling = self.coupling.solve_for(effects, weight)
        self._signal = np.pad(self._signal, (0, more))
        self._typical = np.concatenate((self._typical, 1.0 / np.sqrt(prior)))
        self.x = np.concatenate((self.x, np.zeros(more)))
        self._kept.solve_for(effects, weight, self.x)

    def eliminate(self, gone: Places, prior: Array) -> None:
        """Minimise over unknowns that only folded windows depend on.

        Parameters
        ----------
        gone : indices
        prior : (k, k) information about zero of the others, from now on
        """
        keep, blocks = np.setdiff1d(np.arange(len(self.x)), gone), self._kept.blocks
        information, right_side = self._folded.eliminate(self._prior, keep, gone, prior)
        self.coupling = self.coupling.eliminate(information, right_side, keep, gone)
        blocks = blocks.restrict(np.eye(blocks.offset.shape[1]), np.eye(len(self.x))[:, keep])
        self._prior, self._typical, self.x = prior, self._typical[keep], self.x[keep]
        self._kept.replace(blocks, self.x)
        self._signal = self._signal[np.ix_(keep, keep)]

    def _start(self) -> None:
        """Linearise where to search from: where the last search ended, unless that fails to explain the data so far."""
        blocks = self._kept.blocks
        redundancy = blocks.offset.size + self._folded.equations - len(self.x)
        if self.x[0] > 0.0 and redundancy >= _ENOUGH:
            white = self._kept.at(self.x)
            limit = chi_square.limit(_UNLIKELY, redundancy)
            if white is not None and self._whole(white.cost, self.x) < limit:
                self._kept.linearise(self.x, white)
                return
        known = self._folded.information + self._prior
        starts = [*first_solutions(blocks, known, self._folded.right_side), self.x]
        # A negative mass can fit better while little is known, and the way back leads through infinity.
        possible = [x for x in starts if x[0] > 0.0] or starts
        costs = [self._whole(*pair) for pair in zip(eiv.costs(blocks, np.array(possible)), possible, strict=True)]
        self._kept.linearise(possible[int(np.argmin(np.nan_to_num(costs, nan=np.inf)))])

    def _fold(self) -> None:
        oldest = self._kept.pop()
        if self._forgetting < 1.0 and self.folded:
            white = eiv.whitened(self._kept.blocks, self.x)
            recent = eiv.normal_equations(white).information
            own = eiv.own_information(self._kept.blocks, white).sum(axis=0)
            root = self._folded.forget(self._forgetting, recent, _EXCITED * own + self._prior)
            self.coupling = self.coupling.forget(root, self._forgetting)
        block, own, x = oldest.block, oldest.own, self._kept.x
        if self._sure:
            share = float(np.vdot(own, self._plausible.covariance)) / block.offset.size
        else:
            share = eiv.uncertain_share(block, *self._plausible.solution(self.x))
        self._sure = share < _LARGEST_SHARE
        if self._sure:
            squares = eiv.square(oldest.bordered)
            linear = normal_equations(squares, len(x), block.offset.size)
            self._folded.add(replace(linear, information=linear.information - own), own, x)
            self.coupling += Coupling.of(squares, x)
        else:
            zero, (plausible, spread) = np.zeros(len(self.x)), self._plausible.solution(self.x)
            self._folded.add(*eiv.compensated(block, plausible, spread), zero)
            white = eiv.whitened_at_zero(block, plausible, spread)
            self.coupling += Coupling.of(eiv.square(bordered(white, white.whitener @ oldest.columns)), zero)

    def _maximise(self, iterations: int) -> Linearisation:
        """Move x by guarded Gauss-Newton steps: each finite, with positive mass, and not raising the cost.

        The last is that to the top of the parabola, if that is close. Returns the form at the x that is reached.
        """
        kept, close = self._kept, _CLOSE if self._sure else _SMALL_STEP
        linear = self._linearised()
        for _ in range(iterations):
            solve = solve_definite if self._sure else solve_symmetric
            step = -solve(linear.information, linear.gradient)
            if -float(linear.gradient @ step) < close**2:
                self.x = kept.x + step
                form = linear.at(step)
                return replace(form, cost=form.cost + self._of_prior(kept.x) - self._of_prior(self.x))
            if not self._step(step, linear.cost + self._of_prior(kept.x)):
                break
            linear = self._linearised()
        self.x = kept.x
        return linear

    def _step(self, step: Array, current: float) -> bool:
        """Linearise the kept windows further on, as far as the cost allows; return whether there is such a place."""
        kept = self._kept
        for _ in range(_HALVINGS):
            trial = kept.x + step
            white = kept.at(trial)
            if white is not None and (trial[0] > 0.0 or kept.x[0] <= 0.0):
                value = self._whole(white.cost, trial)
                if np.isfinite(value) and value <= current:
                    kept.linearise(trial, white)
                    return True
            step = 0.5 * step
        return False

    def _whole(self, cost: float, x: Array) -> float:
        """Return the cost at x of everything, from that of the blocks."""
        return cost + self._folded.cost(x) + self._of_prior(x)

    def whole(self, linear: Linearisation) -> float:
        """Return the cost of a form at the solution, what was known beforehand included."""
        return linear.cost + self._of_prior(self.x)

    def _of_prior(self, x: Array) -> float:
        return float(x @ self._prior @ x)

    def _linearised(self) -> Linearisation:
        """Return the likelihood's quadratic form where the kept windows are linearised."""
        x, kept = self._kept.x, self._kept
        self._squares = eiv.square(kept.bordered)
        linear = normal_equations(self._squares, len(x), kept.blocks.offset.size)
        return Linearisation(
            cost=linear.cost + self._folded.cost(x),
            gradient=linear.gradient + self._folded.gradient(x) + self._prior @ x,
            information=linear.information + self._folded.information + self._prior,
            equations=linear.equations + self._folded.equations,
        )
