"""Is momentum conserved? Tests of every new window against the others, for a jump and for a constant force.

All of them ask how much the sum of squared residuals would fall if something more were unknown, which follows from
the normal equations at the solution alone (score test; Rao 1948). Undisturbed, that fall is chi-square distributed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.difference.coupling import Coupling, Places
from mbaid_ros.core.difference.effects import Kind
from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.symmetric import inverse_root, whitened

_ROUNDING = 1e-12  # part of a whole, of which what is left after subtraction is nothing
_DOUBTFUL = 1e-9  # the same, from which on each direction has to be looked at


@dataclass(frozen=True)
class Nuisance:
    """What is unknown anyhow: the unknowns that are solved for, and effects that are known to be small.

    Attributes
    ----------
    inverse : (u, u) covariance of the unknowns by noise alone
    gradient : (u,) at the solution
    size : (e,) standard deviations of the effects
    spread : (u, e) what one standard deviation of each effect does to the solution, with the sign turned
    """

    inverse: Array
    gradient: Array
    size: Array
    spread: Array

    @staticmethod
    def of(information: Array, gradient: Array, cross: Array, size: Array) -> Nuisance:
        """Return it for normal equations.

        Parameters
        ----------
        information, gradient : (u, u), (u,)
        cross : (u, e) of the coupling with the effects
        size : (e,) their standard deviations
        """
        root = inverse_root(information)
        covariance = inverse(information) if root is None else root.T @ root
        return Nuisance(covariance, gradient, size, covariance @ cross * size)


def innovation(block: Blocks, columns: Array, x: Array, nuisance: Nuisance) -> float:
    """Return the squared innovation of a window in the metric of its covariance: chi-square of as many equations.

    Parameters
    ----------
    block : one window
    columns : (r, e) its uncertain effects
    x : (u,) the solution of all earlier windows
    nuisance : of these
    """
    rows = block.rows[0]
    residual = rows @ x + block.offset[0]
    noise = block.noise[0] + block.noise_rows[0] @ x
    effects = columns * nuisance.size - rows @ nuisance.spread
    expected = noise @ noise.T + rows @ nuisance.inverse @ rows.T + effects @ effects.T
    root = inverse_root(expected)
    if root is None:
        return float(residual @ np.linalg.solve(expected, residual))
    white = root @ residual
    return float(white @ white)


def jumps(rows: Array, step: Array, momentum: slice, effects: Places, nuisance: Nuisance) -> Array:
    """Return by how much a momentum that jumped just before one of K windows, the latest, would lower the cost.

    Parameters
    ----------
    rows : (K, r, u + 1 + e) these windows' bordered rows
    step : (u,) from where they are linearised to the solution
    momentum : places of the momentum among the unknowns
    effects : indices of the effects that are uncertain anyhow
    nuisance : Nuisance
    """
    unknowns = len(step)
    sums = _from_the_end(np.swapaxes(rows[..., momentum], 1, 2) @ rows)
    cross = sums[..., :unknowns]
    own, coupled = cross[..., momentum], sums[..., unknowns + 1 + effects]
    return _squared(*_left(cross, own, sums[..., unknowns] + cross @ step, coupled, nuisance), own)


def falls(
    coupling: Coupling, x: Array, acting: Mapping[Kind, tuple[slice, Array]], effects: Places, nuisance: Nuisance
) -> dict[Kind, float]:
    """Return by how much each of several combinations of effects would lower the cost.

    Parameters
    ----------
    coupling : of all windows
    x : (u,)
    acting : places of n effects, and what they are of k new unknowns, (n, k)
    effects : indices of the effects that are uncertain anyhow
    nuisance : Nuisance
    """
    ends = np.cumsum([weight.shape[1] for _, weight in acting.values()])
    weights = np.zeros((len(coupling.offset), ends[-1] if acting else 0))
    parts = {}
    for (kind, (places, weight)), end in zip(acting.items(), ends, strict=True):
        parts[kind] = slice(int(end) - weight.shape[1], int(end))
        weights[places, parts[kind]] = weight
    mixed = coupling.mixed(slice(None), weights)
    slope, covariance = _left(
        mixed.cross.T, mixed.own, mixed.gradient(x), weights.T @ coupling.own[:, effects], nuisance
    )
    return {
        kind: float(_squared(slope[part], covariance[part, part], mixed.own[part, part]))
        for kind, part in parts.items()
    }


def _left(cross: Array, own: Array, gradient: Array, effects: Array, nuisance: Nuisance) -> tuple[Array, Array]:
    """Return the gradient by c more unknowns at the solution for the others, (..., c), and its (..., c, c) covariance.

    Parameters
    ----------
    cross, own, gradient : (..., c, u), (..., c, c), (..., c) of the normal equations
    effects : (..., c, e) their coupling with the uncertain effects
    nuisance : Nuisance
    """
    # All of them in one product.
    weighed = (cross.reshape(-1, cross.shape[-1]) @ nuisance.inverse).reshape(cross.shape)
    slope = gradient - weighed @ nuisance.gradient
    covariance = own - weighed @ np.swapaxes(cross, -1, -2)
    if effects.shape[-1]:
        unsure = effects * nuisance.size - cross @ nuisance.spread
        covariance = covariance + unsure @ np.swapaxes(unsure, -1, -2)
    return slope, covariance


def _from_the_end(values: Array) -> Array:
    """Return sums over each place and all later ones."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def _squared(slope: Array, covariance: Array, whole: Array) -> Array:
    """Return the squares (...) of (..., c) in the metric of (..., c, c); the rest as for `inverse`."""
    if covariance.ndim == 2:
        root = inverse_root(covariance, _ROUNDING * whole.diagonal())
        if root is not None:
            white = root @ slope
            return np.asarray(white @ white)
    elif (covariance.diagonal(axis1=1, axis2=2) > _ROUNDING * whole.diagonal(axis1=1, axis2=2)).all():
        several = whitened(slope, covariance)
        if several is not None:
            return np.asarray((several**2).sum(axis=-1))
    return np.asarray(np.sum((inverse(covariance, whole) @ slope[..., None])[..., 0] * slope, axis=-1))


def inverse(information: Array, whole: Array | None = None) -> Array:
    """Return the inverse of (..., k, k) information, zero where there is none to double precision.

    Parameters
    ----------
    information : (..., k, k) what is left of `whole`, less what explains all of it but for rounding
    whole : (..., k, k); where not given, the information itself
    """
    size, scaled, factor = _scaled(information, whole)
    if factor is not None:
        root = np.linalg.inv(factor) * size[..., None, :]
        return np.asarray(np.swapaxes(root, -1, -2) @ root)
    values, vectors = np.linalg.eigh(scaled)
    usable = values > _ROUNDING * np.maximum(values[..., -1:], np.finfo(float).tiny)
    inverted = np.where(usable, 1.0 / np.where(usable, values, 1.0), 0.0)
    matrix = (vectors * inverted[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return np.asarray(matrix * size[..., None] * size[..., None, :])


def _scaled(information: Array, whole: Array | None) -> tuple[Array, Array, Array | None]:
    """Return scales (..., k), 0 where nothing is left, what they make of the information, and its Cholesky factors.

    The factors are those of matrices with unit diagonals; None if one is near to being singular.
    """
    left = np.diagonal(information, axis1=-2, axis2=-1)
    least = 0.0 if whole is None else _ROUNDING * np.diagonal(whole, axis1=-2, axis2=-1)
    there = left > least
    if not there.all():
        size = np.where(there, 1.0 / np.sqrt(np.where(there, left, 1.0)), 0.0)
        return size, information * size[..., None] * size[..., None, :], None
    size = 1.0 / np.sqrt(left)
    scaled = information * size[..., None] * size[..., None, :]
    try:
        factor = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return size, scaled, None
    # Its diagonal: what is left of each unit once those before it are known.
    sound = (np.diagonal(factor, axis1=-2, axis2=-1) ** 2 > _DOUBTFUL).all()
    return size, scaled, factor if sound else None
