"""What the momentum equations depend on beside the unknowns that are solved for: consider parameters (Schmidt 1966).

An unknown of the known side adds E e to the equations of every window: e independent numbers of variance one, E its
columns times the factor of its prior covariance. It is not solved for here, and widens the covariance of what is by
what it does to that. Unknowns that a calibration has left are dependent: E has a factor of their covariance in it, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, orth

from mbaid_ros.core.difference.window_rows import joined, mean_of_each
from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.priors import UnknownsPrior


class ConsiderParameters:
    """Several unknowns together, each in independent numbers of variance one.

    Parameters
    ----------
    kernel : of the robot at the mean of what is known
    unknowns : those that the equations do not depend on are left out
    known : what is known of the numbers of all unknowns together; None where they are independent

    Attributes
    ----------
    count : number e of independent numbers
    labels : names of all parts
    """

    def __init__(self, kernel: MomentumKernel, unknowns: Sequence[Unknown], known: UnknownsPrior | None = None) -> None:
        self._kernel = kernel
        self._start: Array | None = None  # of the base, about which what has been brought is counted
        self._before: dict[Unknown, tuple[float, Array, Array]] = {}  # time, rates and total at the last sample
        self._unknowns = [unknown for unknown in unknowns if unknown.in_equations]
        factor = block_diag(np.zeros((0, 0)), *(unknown.factor for unknown in self._unknowns))
        self._together = None if known is None else _factor_of_some(unknowns, known)
        if self._together is not None:
            factor = factor @ self._together
        self.count = factor.shape[1]
        every = np.array([label for unknown in self._unknowns for label in unknown.labels])
        self.labels = list(dict.fromkeys(every.tolist()))
        # Of each part, what it has a share in: orthonormal (e, k).
        self._directions = [orth(factor[every == label].T) for label in self.labels]

    def columns(self, windows: Sequence[Samples], body: Array) -> Array:
        """Return the means of E over each of K windows, (K, 6, e), with a target body (10,) (m, h, I_o).

        The windows follow those of the call before.
        """
        if not self.count:
            return np.zeros((len(windows), 6, 0))
        samples, counts = joined(windows)
        target = self._kernel.target
        change = np.zeros_like(self._kernel.known)
        change[target.body] = express(body, target.rotation, target.position)
        kernel = self._kernel.corrected(change)
        states = kernel.states(samples)
        means = []
        for unknown in self._unknowns:
            if unknown.pushes:
                by_unknown = self._brought(unknown, samples, np.sum(states.known, axis=1))
            else:
                by_unknown = unknown.equation_columns(kernel, states)
            means.append(mean_of_each(by_unknown, counts) @ unknown.factor)
        columns = np.concatenate(means, axis=2)
        return columns if self._together is None else columns @ self._together

    def _brought(self, unknown: Unknown, samples: Samples, about_base: Array) -> Array:
        """Return how the equations of N samples depend on what an unknown has brought since the first, (N, 6, k).

        Parameters
        ----------
        unknown : that changes the momentum as time goes by
        samples : after those before
        about_base : (N, 10) standard parameters of the whole robot
        """
        if self._start is None:
            self._start = samples.base_position[0].copy()
        place = samples.base_position - self._start
        whole = express(about_base, np.broadcast_to(np.eye(3), (len(place), 3, 3)), place)
        rates = unknown.momentum_rates(whole, self._start, samples.time, samples.base_rotation)
        time, rate, total = self._before.get(unknown, (samples.time[0], rates[0], np.zeros_like(rates[0])))
        steps = np.diff(samples.time, prepend=time)[:, None, None]
        totals = total + np.cumsum(0.5 * steps * (rates + np.concatenate((rate[None], rates[:-1]))), axis=0)
        self._before[unknown] = (float(samples.time[-1]), rates[-1], totals[-1])
        columns = -totals
        columns[:, 3:] -= skew(place) @ columns[:, :3]
        return columns

    def shares(self, spread: Array) -> Array:
        """Return the part of some variances that each labelled part alone would take away if it were known exactly.

        Parameters
        ----------
        spread : (..., e) what each of the independent numbers does

        Returns
        -------
        (..., p) array; parts whose errors are correlated each count for what they share
        """
        parts = [np.sum((spread @ directions) ** 2, axis=-1) for directions in self._directions]
        return np.stack(parts, axis=-1) if parts else np.zeros((*spread.shape[:-1], 0))


def _factor_of_some(unknowns: Sequence[Unknown], known: UnknownsPrior) -> Array:
    """Return a factor of the covariance of the numbers that the equations depend on, no wider than it is high."""
    some = np.repeat([unknown.in_equations for unknown in unknowns], [unknown.count for unknown in unknowns])
    factor = known.factor[some]
    return factor if len(factor) >= factor.shape[1] else np.asarray(np.linalg.qr(factor.T, mode='r')).T


@dataclass(frozen=True)
class CrossInformation:
    """The parts of the normal equations that e consider parameters bring.

    Attributes
    ----------
    cross : (u, e) C
    own : (e,) diagonal of D
    """

    cross: Array
    own: Array

    @staticmethod
    def nothing(unknowns: int, parameters: int) -> CrossInformation:
        """Return what no data say."""
        return CrossInformation(np.zeros((unknowns, parameters)), np.zeros(parameters))

    @staticmethod
    def of(rows: Array, columns: Array) -> CrossInformation:
        """Return the sums over whitened rows (K, r, u) and columns (K, r, e)."""
        flat = rows.reshape(-1, rows.shape[-1])
        by_parameter = columns.reshape(len(flat), columns.shape[-1])
        return CrossInformation(flat.T @ by_parameter, np.sum(by_parameter**2, axis=0))

    def __add__(self, other: CrossInformation) -> CrossInformation:
        """Return the sums over the windows of both."""
        return CrossInformation(self.cross + other.cross, self.own + other.own)

    def surplus(self, covariance: Array) -> float:
        """Return what the parameters, of variance one, add to the sum of squared residuals in expectation.

        Parameters
        ----------
        covariance : (u, u) of the unknowns without them
        """
        left = self.own - np.sum(self.cross * (covariance @ self.cross), axis=0)
        return float(np.sum(np.maximum(left, 0.0)))
