"""Maximum likelihood over a growing run at bounded cost: the latest windows solved again, the older ones folded.

A pure recursion keeps the bad weights of its first estimates. Here every update solves all kept windows again from the
last solution; a window that leaves lives on in one matrix and vector. It is linearised at the solution of that time,
if that is known well enough. While it is not, the solution may stand anywhere, and what is linearised far off would
pull there for ever: the window's weighted least squares, less what the noise in the rows adds in expectation, is
quadratic as it is, and its weights allow for the uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.coupling import Coupling, Places
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation, White
from mbaid_ros.core.difference.first_solutions import first_solutions
from mbaid_ros.core.difference.folded import Folded
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.symmetric import solve_symmetric

_ITERATIONS_AT_START = 12
_ITERATIONS_WARM = 2
_HALVINGS = 5
_SMALL_STEP = 1e-3  # standard deviations
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
        self._kept = kept
        self._forgetting = forgetting
        self._blocks: list[Blocks] = []
        self._typical = typical
        self._folded = Folded(prior)
        self._signal: Array = np.zeros_like(prior)  # information beyond the noise
        self._sure = False  # whether the latest fold was made at a solution that is known well enough
        self.x: Array = np.zeros(len(prior))
        self.noise_information: Array = np.zeros_like(prior)
        self.information: Array = prior
        self.coupling = Coupling.nothing(len(prior), effects)
        self._columns: list[Array] = []
        self._white = White.nothing()  # the blocks at the solution

    def __len__(self) -> int:
        """Return the number of windows that are solved again."""
        return len(self._blocks)

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
        self._blocks.append(block)
        self._columns.append(np.zeros((*block.offset.shape, 0)) if columns is None else columns)
        if len(self._blocks) > self._kept:
            self._fold()
        return self.solve()

    def solve(self) -> Linearisation:
        """Solve again and return the likelihood's quadratic form at the solution `x`."""
        blocks = Blocks.concatenate(self._blocks)
        iterations = _ITERATIONS_WARM if self._sure else _ITERATIONS_AT_START
        if not self._sure:
            # A negative mass can fit better while little is known, and the way back leads through infinity.
            starts = first_solutions(blocks, self._folded.information + self._prior, self._folded.right_side)
            self.x = min([*starts, self.x], key=lambda x: (x[0] <= 0.0, self._cost(blocks, x)))
        linear = self._refine(blocks, iterations)
        # Like the information itself: the kept windows' at this x, the folded ones' at that of their folding.
        own = eiv.own_information(blocks, self._white)
        self.noise_information = self._folded.noise_information + own
        self._signal = linear.information - _CERTAIN * own - self._prior
        self.information = linear.information
        return replace(linear, information=linear.information + self._folded.noise_information)

    @property
    def columns(self) -> Array:
        """How the equations that are solved again depend on the effects, (K, r, e)."""
        return np.concatenate(self._columns)

    def whitened(self) -> tuple[White, Coupling]:
        """Return the windows that are solved again, at the solution, and how all windows depend on the effects."""
        return self._white, self.coupling + Coupling.of(self._white, self.columns, self.x)

    def certain(self, block: Blocks) -> bool:
        """Return whether the uncertainty of the solution hardly matters for the noise of a block's equations."""
        return eiv.uncertain_share(block, *self._plausible()) < _LARGEST_SHARE

    def drop(self, first: int, last: int) -> None:
        """Give up windows first, ..., last - 1 of those that are solved again."""
        del self._blocks[first:last], self._columns[first:last]

    def substitute(self, bases: Sequence[Array], earlier: Array, prior: Array) -> None:
        """Go over to more unknowns x', with x = basis x'; those that are new come last and begin at zero.

        Parameters
        ----------
        bases : (u, w) of each window that is solved again
        earlier : (u, w) of the windows before, and of what was known beforehand
        prior : (w - u,) information of the new ones about zero
        """
        old = len(self.x)
        self._blocks = [
            block.restrict(np.eye(block.offset.shape[1]), basis)
            for block, basis in zip(self._blocks, bases, strict=True)
        ]
        self._prior = earlier.T @ self._prior @ earlier
        self._prior[old:, old:] += np.diag(prior)
        self._folded.substitute(earlier, self._prior)
        self.coupling = self.coupling.substitute(earlier)
        self._signal = earlier.T @ self._signal @ earlier
        self._typical = np.concatenate((self._typical, np.max(np.abs(earlier[:, old:].T) * self._typical, axis=1)))
        self.x = np.concatenate((self.x, np.zeros(len(prior))))

    def solve_for(self, effects: slice, weight: Array, prior: Array) -> None:
        """Take combinations of effects among the unknowns; they come last and begin at zero; the effects are gone.

        Parameters
        ----------
        effects : which
        weight : (n, w) the effects are weight times the new unknowns
        prior : (w,) information about zero
        """
        self._blocks = [
            block.widened(columns[..., effects] @ weight)
            for block, columns in zip(self._blocks, self._columns, strict=True)
        ]
        for columns in self._columns:
            columns[..., effects] = 0.0
        more = len(prior)
        self._prior = np.asarray(block_diag(self._prior, np.diag(prior)))
        self._folded.extend(self.coupling.mixed(effects, weight), self._prior)
        self.coupling = self.coupling.solve_for(effects, weight)
        self._signal = np.pad(self._signal, (0, more))
        self._typical = np.concatenate((self._typical, 1.0 / np.sqrt(prior)))
        self.x = np.concatenate((self.x, np.zeros(more)))

    def eliminate(self, gone: Places, prior: Array) -> None:
        """Minimise over unknowns that only folded windows depend on.

        Parameters
        ----------
        gone : indices
        prior : (k, k) information about zero of the others, from now on
        """
        keep = np.setdiff1d(np.arange(len(self.x)), gone)
        information, right_side = self._folded.eliminate(self._prior, keep, gone, prior)
        self.coupling = self.coupling.eliminate(information, right_side, keep, gone)
        self._blocks = [
            block.restrict(np.eye(block.offset.shape[1]), np.eye(len(self.x))[:, keep]) for block in self._blocks
        ]
        self._prior, self._typical, self.x = prior, self._typical[keep], self.x[keep]
        self._signal = self._signal[np.ix_(keep, keep)]

    def _fold(self) -> None:
        oldest, self._blocks = self._blocks[0], self._blocks[1:]
        columns, self._columns = self._columns[0], self._columns[1:]
        if self._forgetting < 1.0 and self.folded:
            kept = Blocks.concatenate(self._blocks)
            recent = eiv.maximum_likelihood(kept, self.x).information
            idle = _EXCITED * eiv.noise_information(kept, self.x) + self._prior
            root = self._folded.forget(self._forgetting, recent, idle)
            self.coupling = self.coupling.forget(root, self._forgetting)
        plausible, spread = self._plausible()
        self._sure = eiv.uncertain_share(oldest, plausible, spread) < _LARGEST_SHARE
        if self._sure:
            white = eiv.whitened(oldest, self.x)
            linear, own = eiv.normal_equations(white), eiv.own_information(oldest, white)
            self._folded.add(replace(linear, information=linear.information - own), own, self.x)
            self.coupling += Coupling.of(white, columns, self.x)
        else:
            zero = np.zeros(len(self.x))
            self._folded.add(*eiv.compensated(oldest, plausible, spread), zero)
            self.coupling += Coupling.of(eiv.whitened_at_zero(oldest, plausible, spread), columns, zero)

    def _plausible(self) -> tuple[Array, Array]:
        """Return the solution and a factor of its covariance, both held within the typical sizes.

        While the data determine little, the solution itself may be anywhere.
        """
        size = self._typical
        values, vectors = np.linalg.eigh(self._signal * size * size[:, None])
        values = np.maximum(values, 0.0)
        vectors = size[:, None] * vectors
        coordinates = np.linalg.solve(vectors, self.x)
        return vectors @ (values / (values + 1.0) * coordinates), vectors / np.sqrt(values + 1.0)

    def _refine(self, blocks: Blocks, iterations: int) -> Linearisation:
        """Move x by guarded Gauss-Newton steps: each finite, with positive mass, and not raising the cost.

        Returns the form at the x that is reached, where the blocks then are whitened, too.
        """
        self._white = eiv.whitened(blocks, self.x)
        linear = self._linearise(self._white, self.x)
        for _ in range(iterations):
            step = -solve_symmetric(linear.information, linear.gradient)
            current = self._whole(self._white.cost, self.x)
            for _ in range(_HALVINGS):
                trial = self.x + step
                white = _whitened(blocks, trial)
                if white is not None and (trial[0] > 0.0 or self.x[0] <= 0.0):
                    value = self._whole(white.cost, trial)
                    if np.isfinite(value) and value <= current:
                        break
                step = 0.5 * step
            else:
                return linear
            small = np.all(np.abs(step) < _SMALL_STEP / np.sqrt(np.diag(linear.information)))
            self.x, self._white = trial, white
            linear = self._linearise(white, trial)
            if small:
                return linear
        return linear

    def _cost(self, blocks: Blocks, x: Array) -> float:
        return self._whole(eiv.cost(blocks, x), x)

    def _whole(self, cost: float, x: Array) -> float:
        """Return the cost at x of everything, from that of the blocks."""
        return cost + self._folded.cost(x) + float(x @ self._prior @ x)

    def _linearise(self, white: White, x: Array) -> Linearisation:
        linear = eiv.normal_equations(white)
        return Linearisation(
            cost=linear.cost + self._folded.cost(x),
            gradient=linear.gradient + self._folded.gradient(x) + self._prior @ x,
            information=linear.information + self._folded.information + self._prior,
            equations=linear.equations + self._folded.equations,
        )


def _whitened(blocks: Blocks, x: Array) -> White | None:
    """Return blocks in units of their noise at x, None where that cannot be computed."""
    try:
        return eiv.whitened(blocks, x)
    except FloatingPointError:
        return None
