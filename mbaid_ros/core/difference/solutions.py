"""What is known of the unknowns after each of many windows: none depends on the others.

Together they take less time: there are few steps for all of them instead of many for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from mbaid_ros.core.difference.errors_in_variables import Linearisation
from mbaid_ros.core.difference.run import Run
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import inverses
from mbaid_ros.core.results.reporting import Solution

# The noise's own information fluctuates: what is less than twice it is not signal.
NOISE_MARGIN = 2.0


@dataclass(frozen=True)
class WindowSolution:
    """What a run knows after a window.

    Attributes
    ----------
    run : it belongs to
    x : (u,) the solution
    information, noise : (u, u) of the unknowns, and what noise alone has brought of it
    cross : (u, e) cross-information with the consider parameters
    cost : sum of the squared normalised residuals
    surplus : how much the consider parameters add to it in expectation
    redundancy : number of equations less that of unknowns
    """

    run: Run
    x: Array
    information: Array
    noise: Array
    cross: Array
    cost: float
    surplus: float
    redundancy: int

    @classmethod
    def of(cls, run: Run, linear: Linearisation) -> WindowSolution:
        """Return what a run knows after a window with a given quadratic form."""
        return cls(
            run=run,
            x=run.window.x,
            information=linear.information,
            noise=run.window.noise_information,
            cross=run.window.cross_information.cross,
            cost=linear.cost,
            surplus=run.surplus,
            redundancy=linear.equations - len(run.window.x),
        )


def solutions(posteriors: Sequence[WindowSolution]) -> tuple[list[Solution], list[Array]]:
    """Return what is known after each window, and the consider parameters' part in it.

    Returns
    -------
    Solutions, and shares of the consider parameters in the variance of the identified body, (1 + p,): of all, and of
    each labelled part
    """
    found = [pair for _, alike in groupby(posteriors, lambda one: id(one.run)) for pair in _of_one_run(list(alike))]
    return [solution for solution, _ in found], [shares for _, shares in found]


def _of_one_run(posteriors: list[WindowSolution]) -> list[tuple[Solution, Array]]:
    run = posteriors[0].run
    information, noise, cross = (
        np.array([getattr(one, name) for one in posteriors]) for name in ('information', 'noise', 'cross')
    )
    covariances = []
    shares: list[Array] = [np.zeros(1)] * len(posteriors)
    for margin in (1.0, NOISE_MARGIN):
        plain = inverses(information, information - margin * noise)
        spread = plain @ cross
        if margin == 1.0 and cross.shape[2]:
            shares = [_shares(*pair, run) for pair in zip(plain, spread, strict=True)]
        whole = plain + spread @ np.swapaxes(spread, 1, 2)  # docs/method.md, eq. 8
        covariances.append(run.space.lift(whole, run.open_variance))
    return [
        (
            Solution(
                x=run.space.basis @ one.x,
                covariance=covariances[0][k],
                cautious_covariance=covariances[1][k],
                # Uncertain parameters leave residuals that the noise does not explain.
                cost=one.cost * max(one.redundancy, 1) / (max(one.redundancy, 1) + one.surplus),
                redundancy=one.redundancy,
                origin=run.origin,
                plane=run.space.plane,
                restarted=run.restarted,
            ),
            shares[k],
        )
        for k, one in enumerate(posteriors)
    ]


def _shares(covariance: Array, spread: Array, run: Run) -> Array:
    """Return the consider parameters' share in the variance of the body, (1 + p,), a mean over its parameters.

    Parameters
    ----------
    covariance : (u, u) without them
    spread : (u, e) standard deviations due to each of them
    run : Run
    """
    body = run.momentum.start
    parts = np.column_stack((np.sum(spread[:body] ** 2, axis=1), run.considered.shares(spread[:body])))
    return np.asarray(np.mean(parts / (np.diag(covariance)[:body] + parts[:, 0])[:, None], axis=0))
