"""Linear equations whose coefficients carry noise too: maximum likelihood, its information, and what noise adds to it.

Block k of the problem reads (numbers as in docs/method.md)

    f_k = A_k x + y_k,    covariance of f_k = G_k G_k^T,    G_k = G0_k + G1_k . x         (3), (4)

with A, y computed from measured quantities and G their whitened derivatives: d A / d e = G1, d y / d e = G0 for unit
errors e. Plain weighted least squares is biased, because A is noisy. The functional maximum likelihood minimises
sum f^T (G G^T)^-1 f (5); its gradient is that of a least squares with the corrected rows A + G1 . eta, where
eta = -G^T (G G^T)^-1 f (6) is the adjustment of the measurements that fulfils the equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import inverse_factor, inverse_factors


@dataclass(frozen=True)
class Blocks(ArrayRecord):
    """K blocks of r equations for u unknowns, with z error sources each.

    Attributes
    ----------
    rows : (K, r, u) A
    offset : (K, r) y
    noise : (K, r, z) G0
    noise_rows : (K, r, z, u) G1
    """

    rows: Array
    offset: Array
    noise: Array
    noise_rows: Array

    def restrict(self, selection: Array, basis: Array) -> Blocks:
        """Return the equations Pi f in the unknowns x' with x = B x'.

        Parameters
        ----------
        selection : (k, r) Pi
        basis : (u, v) B
        """
        count, equations, sources, _ = self.noise_rows.shape
        mixed = (self.noise_rows @ basis).reshape(count, equations, -1)
        # A block at a time: what becomes of one does not depend on those beside it, to the last bit.
        return Blocks(
            selection @ self.rows @ basis,
            (selection @ self.offset[..., None])[..., 0],
            selection @ self.noise,
            (selection @ mixed).reshape(count, len(selection), sources, basis.shape[1]),
        )


@dataclass(frozen=True)
class Linearisation:
    """The normal equations of some blocks at one x: cost(x + d) = cost + 2 gradient d + d information d.

    Attributes
    ----------
    cost : sum of the squared normalised residuals
    gradient : (u,)
    information : (u, u)
    equations : number of equations
    """

    cost: float
    gradient: Array
    information: Array
    equations: int

    def at(self, step: Array) -> Linearisation:
        """Return the same form around x + step, (u,)."""
        slope = self.information @ step
        cost = self.cost + float(step @ (2.0 * self.gradient + slope))
        return Linearisation(cost, self.gradient + slope, self.information, self.equations)


@dataclass(frozen=True)
class White(ArrayRecord):
    """K blocks at one x in units of their noise.

    Attributes
    ----------
    residual : (K, r)
    rows : (K, r, u) corrected for the noise in them
    noise : (K, r, z) W G, with orthonormal rows
    whitener : (K, r, r) W with W^T W the inverse of the covariance of the residuals
    """

    residual: Array
    rows: Array
    noise: Array
    whitener: Array

    @staticmethod
    def nothing() -> White:
        """Return no blocks."""
        return White(np.zeros((0, 0)), *np.zeros((3, 0, 0, 0)))

    @property
    def cost(self) -> float:
        """The sum of the squared normalised residuals."""
        return float(np.sum(self.residual**2))  # (5)


def noise_at(blocks: Blocks, x: Array) -> Array:
    """Return the whitened derivatives G of the residuals at x, (K, r, z)."""
    shape = blocks.noise_rows.shape
    return blocks.noise + (blocks.noise_rows.reshape(-1, shape[-1]) @ x).reshape(shape[:-1])


def cost(blocks: Blocks, x: Array) -> float:
    """Return the sum of the squared normalised residuals at x (infinite where it cannot be computed)."""
    return float(costs(blocks, x[None])[0])


def costs(blocks: Blocks, several: Array) -> Array:
    """Return the same at each of several x, (C, u): (C,)."""
    shape = blocks.noise_rows.shape
    noise = (several @ blocks.noise_rows.reshape(-1, shape[-1]).T).reshape(-1, *shape[:-1]) + blocks.noise
    try:
        whitener = whitener_of(noise.reshape(-1, *shape[1:-1]))
    except FloatingPointError:
        if len(several) == 1:
            return np.array([np.inf])
        return np.concatenate([costs(blocks, x[None]) for x in several])
    residual = (blocks.rows @ several.T).transpose(2, 0, 1) + blocks.offset
    white = whitener @ residual.reshape(-1, shape[1], 1)
    return np.asarray((white.reshape(len(several), -1) ** 2).sum(axis=1))


def whitened(blocks: Blocks, x: Array) -> White:
    """Return residuals and corrected rows at x (u,) in units of their noise.

    Raises
    ------
    FloatingPointError
        The covariance of a block is not positive definite at this x.
    """
    residual = blocks.rows @ x + blocks.offset
    noise = noise_at(blocks, x)  # (4)
    whitener = whitener_of(noise)
    white_residual = (whitener @ residual[..., None])[..., 0]
    white_noise = whitener @ noise
    adjustment = -(white_residual[:, None] @ white_noise)  # eta (6), (K, 1, z)
    corrected = blocks.rows + (adjustment[:, None] @ blocks.noise_rows)[:, :, 0]
    return White(white_residual, whitener @ corrected, white_noise, whitener)


def normal_equations(white: White) -> Linearisation:
    """Return the likelihood's gradient and Gauss-Newton information where the blocks were whitened."""
    rows, residual = white.rows.reshape(-1, white.rows.shape[-1]), white.residual.reshape(-1)
    return Linearisation(white.cost, rows.T @ residual, rows.T @ rows, len(residual))


def maximum_likelihood(blocks: Blocks, x: Array) -> Linearisation:
    """Return the likelihood's gradient and Gauss-Newton information at x.

    Raises
    ------
    FloatingPointError
        The covariance of a block is not positive definite at this x.
    """
    return normal_equations(whitened(blocks, x))


def own_information(blocks: Blocks, white: White) -> Array:
    """Return what the noise in the rows brings in expectation of each block's information, (K, u, u)."""
    shape = blocks.noise_rows.shape
    rows = (white.whitener @ blocks.noise_rows.reshape(*shape[:2], -1)).reshape(shape)
    # After the adjustment the rows keep the errors that the equations do not see: the projector 1 - G^T W^T W G.
    seen = white.noise[:, None] @ rows
    return _square_of_each(rows) - _square_of_each(seen)


def compensated(blocks: Blocks, x: Array, spread: Array) -> tuple[Linearisation, Array]:
    """Return the weighted least squares less what the noise in the rows adds in expectation, as a form around zero.

    It is quadratic as it is: x has a part in its weights alone, and those allow for x being uncertain.

    Parameters
    ----------
    blocks : Blocks
    x : (u,) for the weights
    spread : (u, k) factor of the covariance of x

    Returns
    -------
    Linearisation at x = 0, without the noise's own information, and (u, u) that information

    Raises
    ------
    FloatingPointError
        The covariance of a block is not positive definite.
    """
    noise = noise_at(blocks, x)
    count, equations = blocks.offset.shape
    uncertain = (blocks.noise_rows @ spread).reshape(count, equations, -1)
    whitener = whitener_of(np.concatenate((noise, uncertain), axis=2))
    weight = np.swapaxes(whitener, 1, 2) @ whitener
    own = _weighted_square(weight, blocks.noise_rows)
    known, offset = weight @ blocks.noise, (weight @ blocks.offset[..., None])[..., 0]
    bias = np.tensordot(blocks.noise_rows, known, axes=((0, 1, 2), (0, 1, 2)))
    expected = float(np.sum((whitener @ noise) ** 2))
    return Linearisation(
        cost=float(np.sum(blocks.offset * offset) - np.sum(blocks.noise * known)) + expected,
        gradient=np.tensordot(blocks.rows, offset, axes=((0, 1), (0, 1))) - bias,
        information=_weighted_square(weight, blocks.rows[:, :, None]) - own,
        equations=blocks.offset.size,
    ), own


def whitened_at_zero(blocks: Blocks, x: Array, spread: Array) -> White:
    """Return residuals at x = 0 and rows as they are, with the weights of `compensated` at x (u,) and spread (u, k).

    Raises
    ------
    FloatingPointError
        The covariance of a block is not positive definite.
    """
    noise = noise_at(blocks, x)
    uncertain = (blocks.noise_rows @ spread).reshape(*blocks.offset.shape, -1)
    whitener = whitener_of(np.concatenate((noise, uncertain), axis=2))
    residual = (whitener @ blocks.offset[..., None])[..., 0]
    return White(residual, whitener @ blocks.rows, whitener @ noise, whitener)


def uncertain_share(blocks: Blocks, x: Array, spread: Array) -> float:
    """Return how much the uncertainty of x (spread: factor of its covariance) adds to the variance of the equations."""
    count, equations = blocks.offset.shape
    whitener = whitener_of(noise_at(blocks, x))
    uncertain = whitener @ (blocks.noise_rows @ spread).reshape(count, equations, -1)
    return float(np.sum(uncertain**2)) / blocks.offset.size


def square(rows: Array) -> Array:
    """Return the (u, u) sum of rows^T rows, for rows (..., u)."""
    flat = rows.reshape(-1, rows.shape[-1])
    return np.asarray(flat.T @ flat)


def _square_of_each(rows: Array) -> Array:
    """Return the sums of rows^T rows over each block, (K, u, u), for rows (K, ..., u)."""
    flat = rows.reshape(len(rows), -1, rows.shape[-1])
    return np.asarray(np.swapaxes(flat, 1, 2) @ flat)


def _weighted_square(weight: Array, rows: Array) -> Array:
    """Return the (u, u) sum over k, z of rows^T W rows, for W (K, r, r) and rows (K, r, z, u)."""
    weighted_rows = (weight @ rows.reshape(*rows.shape[:2], -1)).reshape(-1, rows.shape[-1])
    return rows.reshape(weighted_rows.shape).T @ weighted_rows


def whitener_of(noise: Array) -> Array:
    """Return W (K, r, r) with W^T W the inverse of G G^T, for G (K, r, z).

    Raises
    ------
    FloatingPointError
        A covariance is not positive definite.
    """
    covariance = noise @ np.swapaxes(noise, 1, 2)
    one = len(covariance) == 1  # as often as not, and it takes much less time
    whitener = inverse_factor(covariance[0]) if one else inverse_factors(covariance)
    if whitener is None:
        raise FloatingPointError('the covariance of the momentum equations is not positive definite')
    return whitener[None] if one else whitener
