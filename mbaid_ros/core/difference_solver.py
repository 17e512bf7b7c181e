"""Weighted least squares with noisy coefficients over a sliding window, older rows marginalised."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg

from mbaid_ros.core.geometry import (
    Array,
    chi_square_limit,
    inverse_factor,
    inverse_factors,
    solve_definite,
    solve_symmetric,
    square_root,
)
from mbaid_ros.core.samples import ArrayRecord, S

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
        # Compensation fails if the noise is smaller than specified.
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


@dataclass(frozen=True)
class CrossInformation:
    """The parts of the normal equations by e consider parameters: C (u, e), and the diagonal (e,) of their own."""

    cross: Array
    diagonal: Array

    @staticmethod
    def from_rows(rows: Array, columns: Array) -> CrossInformation:
        """Return the sums over whitened rows (K, r, u) and columns (K, r, e)."""
        flat = rows.reshape(-1, rows.shape[-1])
        by_parameter = columns.reshape(len(flat), columns.shape[-1])
        return CrossInformation(flat.T @ by_parameter, np.sum(by_parameter**2, axis=0))

    def __add__(self, other: CrossInformation) -> CrossInformation:
        """Return the sums over the windows of both."""
        return CrossInformation(self.cross + other.cross, self.diagonal + other.diagonal)

    def surplus(self, covariance: Array) -> float:
        """Return the expected part of the parameters, of variance one, in the sum of squared residuals.

        `covariance` (u, u) is that of the unknowns by noise alone.
        """
        left = self.diagonal - np.sum(self.cross * (covariance @ self.cross), axis=0)
        return float(np.sum(np.maximum(left, 0.0)))


class MarginalisedPrior:
    """The windows that have left: a quadratic cost (x - x_m)^T N (x - x_m) + const (method.md, eq. 7).

    N holds information beyond the noise. The sum over windows may be negative in directions that the data do not
    excite, since the noise's own information is subtracted in expectation: N leaves such directions out.

    Parameters
    ----------
    floor : (u, u) positive definite information too small to count

    Attributes
    ----------
    information, right_side : (u, u) N, (u,) N x_m
    noise_information : (u, u) expected information by noise alone
    equations : number of equations
    """

    def __init__(self, floor: Array) -> None:
        self._floor = floor
        self._constant = 0.0
        self._sum: Array = np.zeros_like(floor)
        self._sum_right: Array = np.zeros(len(floor))
        self.information: Array = self._sum
        self.right_side: Array = self._sum_right
        self.noise_information: Array = np.zeros_like(floor)
        self.equations = 0

    def add(self, linear: Linearisation, noise_information: Array, x: Array) -> None:
        """Add a quadratic form around x (u,), without the noise's own information (u, u), and that by itself."""
        # cost(x') = c + 2 g (x' - x) + (x' - x) N (x' - x)
        self._sum = self._sum + linear.information
        self._sum_right = self._sum_right + linear.information @ x - linear.gradient
        self._constant += linear.cost - 2.0 * float(linear.gradient @ x) + float(x @ linear.information @ x)
        self.noise_information = self.noise_information + noise_information
        self.equations += linear.equations
        idle = self.noise_information + self._floor
        self.information, self.right_side = self._sum, self._sum_right
        # Directions with more information than `idle`, orthonormal in it, and the ratio of both.
        size = 1.0 / np.sqrt(np.diag(idle))
        ratio, vectors = scipy.linalg.eigh(self._sum * size * size[:, None], idle * size * size[:, None])
        excited = ratio > 1.0
        if not np.all(excited):
            known = size[:, None] * vectors[:, excited]
            mapped = idle @ known
            self.information = (mapped * ratio[excited]) @ mapped.T
            self.right_side = mapped @ (known.T @ self._sum_right)

    def cost(self, x: Array) -> float:
        """Return the cost at x, (u,)."""
        return float(x @ self.information @ x - 2.0 * self.right_side @ x) + self._constant

    def gradient(self, x: Array) -> Array:
        """Return half the derivative of the cost at x, (u,)."""
        return self.information @ x - self.right_side


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
            self._white = _joined(self._white, whitened(self.equations[done:], self.x))
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
            own = row_noise_information(self.equations[done:], self.white[done:])
            self._own = np.concatenate((self._own, own)) if done else own
        return self._own

    def whitened_at(self, x: Array) -> WhitenedBlocks | None:
        """Return the windows whitened at another x, (u,); None where undefined."""
        try:
            return whitened(self.equations, x)
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
        return uncertain_share(self.windows.equations[-1:], *self._regularised(self.x)) < _LARGEST_SHARE

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
        share = uncertain_share(window, *self._regularised(self.x))
        self._converged = share < _LARGEST_SHARE
        if self._converged:
            linear = normal_equations(white)
            self._marginalised.add(replace(linear, information=linear.information - own), own, x)
        else:
            linear, own, whitener = bias_compensated(window, *self._regularised(self.x))
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
        x, past, linear = self.windows.x, self._marginalised, normal_equations(self.windows.white)
        return Linearisation(
            cost=linear.cost + past.cost(x),
            gradient=linear.gradient + past.gradient(x) + self._prior @ x,
            information=linear.information + past.information + self._prior,
            equations=linear.equations + past.equations,
        )
