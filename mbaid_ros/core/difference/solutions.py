"""What is known of the unknowns of a run after each of many windows: none depends on the others.

Together they take less time: there are few steps for all of them instead of many for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.difference.coupling import Places
from mbaid_ros.core.difference.effects import Axes
from mbaid_ros.core.difference.errors_in_variables import Linearisation
from mbaid_ros.core.difference.problem import Problem
from mbaid_ros.core.difference.run import Run
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.reporting import NOISE_MARGIN, Solution, inverses
from mbaid_ros.core.robot.known_errors import KnownErrors


@dataclass(frozen=True)
class Knowledge:
    """What is known after a window.

    Attributes
    ----------
    problem : that is solved
    restarted : whether earlier windows had to be given up
    forces : axes of the constant forces that were found, and their places among the unknowns
    gains : (f, 6, 6) what forces have changed the momentum by, as in `Surroundings`
    x : (u,) the solution
    information, noise : (u, u) of the unknowns, and what noise alone has brought of it
    cross : (u, e) what ties the known bodies' independent errors to the unknowns
    cost : sum of the squared normalised residuals
    surplus : how much the known bodies' errors add to it in expectation
    redundancy : number of equations less that of unknowns
    """

    problem: Problem
    restarted: bool
    forces: tuple[tuple[Axes, Places], ...]
    gains: Array
    x: Array
    information: Array
    noise: Array
    cross: Array
    cost: float
    surplus: float
    redundancy: int

    @classmethod
    def of(cls, run: Run, linear: Linearisation, gains: Array) -> Knowledge:
        """Return what a run knows after a window with a given form and (f, 6, 6) gains at its end."""
        likelihood = run.likelihood.likelihood
        return cls(
            problem=run.problem,
            restarted=run.restarted,
            forces=tuple((found.kind, found.place) for found in run.likelihood.found if found.kind != 'delay'),
            gains=gains,
            x=likelihood.x,
            information=linear.information,
            noise=likelihood.noise_information,
            cross=run.likelihood.uncertain_cross,
            cost=linear.cost,
            surplus=run.likelihood.surplus,
            redundancy=linear.equations - len(likelihood.x),
        )

    @property
    def places(self) -> Places:
        """Of the unknowns without jumps of the momentum."""
        count = self.problem.space.basis.shape[1]
        return np.concatenate((np.arange(count), *(place for _, place in self.forces)))


def solutions(known: Sequence[Knowledge], errors: KnownErrors) -> tuple[list[Solution], list[Array]]:
    """Return what is known after each window, and the known bodies' part in it.

    Parameters
    ----------
    known : after each window
    errors : of the known bodies

    Returns
    -------
    Solutions, and shares of the known bodies in the variance of the identified one, (1 + b,): of all, and of each
    """
    found = [
        pair
        for _, alike in groupby(known, lambda one: (id(one.problem), len(one.x), one.places.tobytes()))
        for pair in _alike(list(alike), errors)
    ]
    return [solution for solution, _ in found], [blame for _, blame in found]


def _alike(known: Sequence[Knowledge], errors: KnownErrors) -> list[tuple[Solution, Array]]:
    """Return the same of windows with the same unknowns."""
    first, places = known[0], known[0].places
    problem, forces = first.problem, first.forces
    space, variance = problem.space, problem.open_variance
    if forces:
        space = replace(space, basis=np.asarray(block_diag(space.basis, *[space.rows.T] * len(forces))))
        more = np.full(6 * len(forces), 1.0 / np.min(problem.watched.prior['inertial']))
        variance = np.concatenate((variance, more))
    present = np.array([problem.present([axes for axes, _ in forces], one.gains) for one in known])
    information, noise, cross = (
        np.array([getattr(one, name) for one in known]) for name in ('information', 'noise', 'cross')
    )
    covariances = []
    blames: list[Array] = [np.zeros(1)] * len(known)
    for share in (1.0, NOISE_MARGIN):
        plain = inverses(information, information - share * noise)
        spread = plain @ cross
        if share == 1.0 and cross.shape[2]:
            blames = [_blame(*pair, problem.momentum.start, errors) for pair in zip(plain, spread, strict=True)]
        whole = plain + spread @ np.swapaxes(spread, 1, 2)
        # In one order in memory: otherwise products depend, in their last bits, on how many windows there are.
        whole = np.ascontiguousarray(whole[:, places[:, None], places])
        covariances.append(present @ space.lift(whole, variance) @ np.swapaxes(present, 1, 2))
    return [
        (
            Solution(
                x=present[k] @ (space.basis @ one.x[places]),
                covariance=covariances[0][k],
                cautious_covariance=covariances[1][k],
                # The uncertain bodies leave residuals that the noise does not explain.
                cost=one.cost * max(one.redundancy, 1) / (max(one.redundancy, 1) + one.surplus),
                redundancy=one.redundancy,
                origin=problem.origin,
                plane=space.plane,
                restarted=one.restarted,
            ),
            blames[k],
        )
        for k, one in enumerate(known)
    ]


def _blame(covariance: Array, spread: Array, body: int, errors: KnownErrors) -> Array:
    """Return the share of the known bodies in the variance of the identified one, (1 + b,): of all, and of each.

    A mean over its parameters.

    Parameters
    ----------
    covariance : (u, u) without them
    spread : (u, e) standard deviations due to each of the independent errors
    body : number of the identified one's parameters, which come first
    errors : of the known bodies
    """
    parts = np.column_stack((np.sum(spread[:body] ** 2, axis=1), errors.shares(spread[:body])))
    return np.asarray(np.mean(parts / (np.diag(covariance)[:body] + parts[:, 0])[:, None], axis=0))
