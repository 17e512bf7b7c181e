"""Linear equations whose coefficients carry noise too: maximum likelihood, its information, and first solutions.

Block k reads (numbers as in method.md)

    f_k = A_k x + y_k,    covariance of f_k = G_k G_k^T,    G_k = G0_k + G1_k . x         (3), (4)

with A and y computed from measurements, and G their derivatives by unit errors e: G1 = dA / de, G0 = dy / de. Weighted
least squares is biased, since A is noisy. The functional maximum likelihood minimises sum f^T (G G^T)^-1 f (5). Its
gradient is that of a least squares with the corrected rows A + G1 . eta, where eta = -G^T (G G^T)^-1 f (6) adjusts the
measurements until the equations hold. A covariance that is not positive definite raises FloatingPointError.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import inverse_factor, inverse_factors, solve_symmetric, square_root
from mbaid_ros.core.samples import ArrayRecord


@dataclass(frozen=True)
class Blocks(ArrayRecord):
    """K blocks of r equations for u unknowns, with z error sources each."""

    rows: Array  # (K, r, u) A
    offset: Array  # (K, r) y
    noise: Array  # (K, r, z) G0
    noise_rows: Array  # (K, r, z, u) G1

    def restrict(self, selection: Array, basis: Array) -> Blocks:
        """Return the equations Pi f, for Pi (k, r), in the unknowns x' with x = B x', for B (u, v)."""
        count, equations, sources, _ = self.noise_rows.shape
        mixed = (self.noise_rows @ basis).reshape(count, equations, -1)
        # One product per block: the result for a block does not depend on its neighbours, to the last bit.
        return Blocks(
            selection @ self.rows @ basis,
            (selection @ self.offset[..., None])[..., 0],
            selection @ self.noise,
            (selection @ mixed).reshape(count, len(selection), sources, basis.shape[1]),
        )


@dataclass(frozen=True)
class Linearisation:
    """The normal equations of some blocks at one x: cost(x + d) = cost + 2 gradient d + d information d."""

    cost: float  # sum of the squared normalised residuals
    gradient: Array  # (u,)
    information: Array  # (u, u)
    equations: int  # number of equations

    def expanded_at(self, step: Array) -> Linearisation:
        """Return the same form around x + step, (u,)."""
        slope = self.information @ step
        cost = self.cost + float(step @ (2.0 * self.gradient + slope))
        return Linearisation(cost, self.gradient + slope, self.information, self.equations)


@dataclass(frozen=True)
class WhitenedBlocks(ArrayRecord):
    """K blocks at one x in units of their noise."""

    residual: Array  # (K, r)
    rows: Array  # (K, r, u) corrected for the noise in them
    noise: Array  # (K, r, z) W G, with orthonormal rows
    whitener: Array  # (K, r, r) W with W^T W the inverse of the covariance of the residuals

    @property
    def cost(self) -> float:
        """The sum of the squared normalised residuals."""
        return float(np.sum(self.residual**2))  # (5)


def noise_at(blocks: Blocks, x: Array) -> Array:
    """Return the derivatives G of the residuals by unit errors at x, (K, r, z)."""
    shape = blocks.noise_rows.shape
    return blocks.noise + (blocks.noise_rows.reshape(-1, shape[-1]) @ x).reshape(shape[:-1])


def whitener_of(noise: Array) -> Array:
    """Return W (K, r, r) with W^T W the inverse of G G^T, for G (K, r, z)."""
    covariance = noise @ np.swapaxes(noise, 1, 2)
    single = len(covariance) == 1  # the usual case, and LAPACK itself takes much less time
    whitener = inverse_factor(covariance[0]) if single else inverse_factors(covariance)
    if whitener is None:
        raise FloatingPointError('the covariance of the momentum equations is not positive definite')
    return whitener[None] if single else whitener


def whitened(blocks: Blocks, x: Array) -> WhitenedBlocks:
    """Return residuals and corrected rows at x (u,) in units of their noise."""
    residual = blocks.rows @ x + blocks.offset
    noise = noise_at(blocks, x)  # (4)
    whitener = whitener_of(noise)
    white_residual = (whitener @ residual[..., None])[..., 0]
    white_noise = whitener @ noise
    adjustment = -(white_residual[:, None] @ white_noise)  # eta (6), (K, 1, z)
    corrected = blocks.rows + (adjustment[:, None] @ blocks.noise_rows)[:, :, 0]
    return WhitenedBlocks(white_residual, whitener @ corrected, white_noise, whitener)


def normal_equations(white: WhitenedBlocks) -> Linearisation:
    """Return the likelihood's gradient and Gauss-Newton information where the blocks were whitened."""
    rows, residual = white.rows.reshape(-1, white.rows.shape[-1]), white.residual.reshape(-1)
    return Linearisation(white.cost, rows.T @ residual, rows.T @ rows, len(residual))


def maximum_likelihood(blocks: Blocks, x: Array) -> Linearisation:
    """Return the likelihood's gradient and Gauss-Newton information at x (u,)."""
    return normal_equations(whitened(blocks, x))


def row_noise_information(blocks: Blocks, white: WhitenedBlocks) -> Array:
    """Return the expected information that noise in the rows adds to each block, (K, u, u)."""
    shape = blocks.noise_rows.shape
    rows = (white.whitener @ blocks.noise_rows.reshape(*shape[:2], -1)).reshape(shape)
    # After the adjustment the rows keep the errors that the equations do not see: the projector 1 - G^T W^T W G.
    seen = white.noise[:, None] @ rows
    return _square_of_each(rows) - _square_of_each(seen)


def uncertain_share(blocks: Blocks, x: Array, spread: Array) -> float:
    """Return the part that the uncertainty of x (spread: factor of its covariance) adds to the equations' variance."""
    whitener = whitener_of(noise_at(blocks, x))
    uncertain = whitener @ (blocks.noise_rows @ spread).reshape(*blocks.offset.shape, -1)
    return float(np.sum(uncertain**2)) / blocks.offset.size


def bias_compensated(blocks: Blocks, x: Array, spread: Array) -> tuple[Linearisation, Array, Array]:
    """Return the weighted least squares less the expected contribution of the noise in the rows, as a form around zero.

    It is quadratic: x enters through its weights alone, which account for the uncertainty of x.

    Parameters
    ----------
    x, spread : (u,) for the weights, (u, k) factor of its covariance

    Returns
    -------
    Linearisation at x = 0 without the noise's own information, (u, u) that information, and (K, r, r) whiteners
    """
    noise = noise_at(blocks, x)
    uncertain = (blocks.noise_rows @ spread).reshape(*blocks.offset.shape, -1)
    whitener = whitener_of(np.concatenate((noise, uncertain), axis=2))
    weight = np.swapaxes(whitener, 1, 2) @ whitener
    own = _weighted_square(weight, blocks.noise_rows)
    known, offset = weight @ blocks.noise, (weight @ blocks.offset[..., None])[..., 0]
    bias = np.tensordot(blocks.noise_rows, known, axes=((0, 1, 2), (0, 1, 2)))
    expected = float(np.sum((whitener @ noise) ** 2))
    form = Linearisation(
        cost=float(np.sum(blocks.offset * offset) - np.sum(blocks.noise * known)) + expected,
        gradient=np.tensordot(blocks.rows, offset, axes=((0, 1), (0, 1))) - bias,
        information=_weighted_square(weight, blocks.rows[:, :, None]) - own,
        equations=blocks.offset.size,
    )
    return form, own, whitener


class NormalSums:
    """The squares of equations A x + y over z = (x, 1), with the weights of one x (u,), added up.

    Attributes
    ----------
    equations : (u + 1, u + 1) M, z^T M z is the sum of the squared residuals
    """

    def __init__(self, blocks: Blocks, x: Array) -> None:
        self._blocks = blocks
        self._whitener = whitener_of(noise_at(blocks, x))
        self.equations = _square(self._whitener @ np.concatenate((blocks.rows, blocks.offset[..., None]), axis=-1))

    @cached_property
    def noise(self) -> Array:
        """(u + 1, u + 1) N: the expected contribution of noise to M."""
        noise = np.concatenate((self._blocks.noise_rows, self._blocks.noise[..., None]), axis=-1)
        return _square((self._whitener @ noise.reshape(*noise.shape[:2], -1)).reshape(noise.shape))

    def weighted(self, *, compensate: bool) -> tuple[Array, Array]:
        """Return (u, u) information and (u,) right side of the weighted least squares, N subtracted if compensated."""
        sums = self.equations - self.noise if compensate else self.equations
        return sums[:-1, :-1], -sums[:-1, -1]

    def total_least_squares(self, information: Array, right_side: Array) -> Array:
        """Return the (u,) that explains the equations with the smallest errors in coefficients and offsets alike.

        It minimises z^T M z / z^T N z (renormalisation; Kanatani 1994), which always has one solution. `information`
        (u, u) and `right_side` (u,) hold prior knowledge.

        Raises FloatingPointError: Nothing is noisy.
        """
        equations = self.equations.copy()
        equations[:-1, :-1] += information
        equations[:-1, -1] -= right_side
        equations[-1, :-1] -= right_side
        root = square_root(equations)
        direction = root @ np.linalg.eigh(root.T @ self.noise @ root)[1][:, -1]
        if direction[-1] == 0.0:
            raise FloatingPointError('the equations leave no noise to explain')
        return np.asarray(direction[:-1] / direction[-1])


def first_solutions(blocks: Blocks, information: Array, right_side: Array) -> list[Array]:
    """Return starting points (u,): weighted and bias-compensated solves, each with the weights of the one before.

    Parameters
    ----------
    information, right_side : (u, u), (u,) of prior knowledge
    """
    x: Array = np.zeros(len(right_side))
    found = []
    for compensate in (False, False, True, True):
        try:
            sums = NormalSums(blocks, x)
            found.append(sums.total_least_squares(information, right_side))
        except FloatingPointError:
            break
        data, right = sums.weighted(compensate=compensate)
        candidate = solve_symmetric(data + information, right + right_side)
        # Compensation fails if the noise is smaller than declared.
        if compensate and (candidate[0] <= 0.0 < x[0] or not np.all(np.isfinite(candidate))):
            break
        x = candidate
        found.append(x)
    return found


def _square(rows: Array) -> Array:
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
