"""Is momentum conserved? Tests of every new window against the others, for a jump and for a constant force.

All of them ask how much the sum of squared residuals would fall if something more were unknown, which follows from
the normal equations at the solution alone (score test; Rao 1948). Undisturbed, that fall is chi-square distributed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.difference.coupling import Coupling, Places
from mbaid_ros.core.difference.errors_in_variables import Blocks, White
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class Fall:
    """How much some more unknowns would lower the sum of squared residuals, and what they would be.

    Attributes
    ----------
    amount : (...,)
    value : (..., c)
    """

    amount: Array
    value: Array


@dataclass(frozen=True)
class Nuisance:
    """The normal equations of everything that is unknown anyhow: the unknowns, and effects of known variance.

    Attributes
    ----------
    inverse : (w, w) covariance
    gradient : (w,) at the solution
    """

    inverse: Array
    gradient: Array

    @staticmethod
    def of(
        information: Array, gradient: Array, coupling: Coupling, x: Array, effects: Places, weight: Array
    ) -> Nuisance:
        """Return them for the unknowns x and some of the effects.

        Parameters
        ----------
        information, gradient : (u, u), (u,) of the unknowns at x
        coupling : of all windows
        x : (u,)
        effects : indices of the effects that are uncertain
        weight : of these, the inverse of their variance
        """
        cross = coupling.cross[:, effects]
        own = coupling.own[np.ix_(effects, effects)] + np.diag(weight)
        joint = np.block([[information, cross], [cross.T, own]])
        return Nuisance(inverse(joint), np.concatenate((gradient, coupling.gradient(x)[effects])))


def innovation(block: Blocks, columns: Array, x: Array, covariance: Array) -> float:
    """Return the squared innovation of a window in the metric of its covariance: chi-square of as many equations.

    Parameters
    ----------
    block : one window
    columns : (r, e) its uncertain effects
    x : (u,) the solution of all earlier windows
    covariance : (u + e, u + e) of (x, effects)
    """
    residual = block.rows[0] @ x + block.offset[0]
    noise = block.noise[0] + block.noise_rows[0] @ x
    rows = np.concatenate((block.rows[0], columns), axis=1)
    expected = noise @ noise.T + rows @ covariance @ rows.T
    return float(residual @ np.linalg.solve(expected, residual))


def jumps(white: White, effects: Array, momentum: slice, nuisance: Nuisance) -> Fall:
    """Return, for each of K windows, what a momentum that jumped just before it would explain.

    Parameters
    ----------
    white : K windows at the solution
    effects : (K, r, e) their uncertain effects, in units of their noise
    momentum : places of the momentum among the unknowns
    nuisance : Nuisance
    """
    later = white.rows[..., momentum]
    rows = np.concatenate((white.rows, effects), axis=-1)
    cross = _from_the_end(np.swapaxes(rows, 1, 2) @ later)
    own = _from_the_end(np.swapaxes(later, 1, 2) @ later)
    gradient = _from_the_end((np.swapaxes(later, 1, 2) @ white.residual[..., None])[..., 0])
    return _fall(cross, own, gradient, nuisance)


def force(coupling: Coupling, x: Array, acting: slice, effects: Places, nuisance: Nuisance) -> Fall:
    """Return what a constant force and torque would explain.

    Parameters
    ----------
    coupling : of all windows
    x : (u,)
    acting : places of the force and torque among the effects
    effects : indices of the effects that are uncertain anyhow
    nuisance : Nuisance
    """
    cross = np.concatenate((coupling.cross[:, acting], coupling.own[effects, acting]))
    return _fall(cross, coupling.own[acting, acting], coupling.gradient(x)[acting], nuisance)


def _fall(cross: Array, own: Array, gradient: Array, nuisance: Nuisance) -> Fall:
    weighed = nuisance.inverse @ cross
    back = np.swapaxes(cross, -1, -2)
    left = own - back @ weighed
    slope = gradient - np.swapaxes(weighed, -1, -2) @ nuisance.gradient
    value = -(inverse(left) @ slope[..., None])[..., 0]
    return Fall(-np.sum(value * slope, axis=-1), value)


def _from_the_end(values: Array) -> Array:
    """Return sums over each place and all later ones."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def inverse(information: Array) -> Array:
    """Return the inverse of (..., k, k) information, zero where there is none to double precision."""
    size = 1.0 / np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information * size[..., None] * size[..., None, :])
    usable = values > 1e-12 * values[..., -1:]
    inverted = np.where(usable, 1.0 / np.where(usable, values, 1.0), 0.0)
    matrix = (vectors * inverted[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return np.asarray(matrix * size[..., None] * size[..., None, :])
