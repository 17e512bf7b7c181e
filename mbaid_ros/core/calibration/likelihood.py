"""The likelihood of several motions, each with a momentum of its own, and of the prior; its maximum.

The unknowns are x = (theta, h_1, ..., h_R): standard parameters of k links, then the total momentum (P_0, L_0) of each
of R motions. All is solved in units of the prior, x = mean + L z with L L^T its covariance: directions that the data
leave open then have exactly unit information, and every system is regular. The momenta, of which the data know all and
the prior nothing, are eliminated first: together the two would differ by more than double precision holds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from mbaid_ros.core.equations import errors_in_variables as eiv
from mbaid_ros.core.equations.errors_in_variables import Blocks
from mbaid_ros.core.equations.first_solutions import Sums
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Stamps

_ITERATIONS = 60
_HALVINGS = 8
# Squared length of a Gauss-Newton step, in standard deviations, at which the maximum counts as reached.
_SMALL_STEP = 1e-12


@dataclass(frozen=True)
class Motion:
    """The equations of one motion.

    Attributes
    ----------
    parts : blocks of equations in (theta, P_0, L_0), a few hundred at a time
    origin : (3,) m, about which L_0 is taken, odometry frame
    """

    parts: tuple[Blocks, ...]
    origin: Array


@dataclass(frozen=True)
class Eliminated:
    """An information in units of the prior, the prior included, with the momenta h minimised over.

    Attributes
    ----------
    marginal : (10 k, 10 k) information of theta, without the prior's unit matrix
    own : (6 R, 6 R) of h at fixed theta
    gain : (10 k, 6 R) G with h = own^-1 (...) - G^T theta
    """

    marginal: Array
    own: Array
    gain: Array

    @staticmethod
    def of(information: Array, bodies: int) -> Eliminated:
        """Return the elimination of all but the first unknowns from the data's information."""
        own = information[bodies:, bodies:] + np.eye(len(information) - bodies)
        cross = information[:bodies, bodies:]
        gain = scipy.linalg.solve(own, cross.T, assume_a='sym').T
        marginal = information[:bodies, :bodies] - gain @ cross.T
        return Eliminated(0.5 * (marginal + marginal.T), own, gain)

    def solve(self, right_side: Array) -> Array:
        """Return z of (information + 1) z = right side, (u,); what is negative by rounding counts as nothing."""
        bodies = len(self.marginal)
        values, vectors = np.linalg.eigh(self.marginal)
        upper = right_side[:bodies] - self.gain @ right_side[bodies:]
        theta = vectors @ (vectors.T @ upper / (1.0 + np.maximum(values, 0.0)))
        return np.concatenate((theta, np.linalg.solve(self.own, right_side[bodies:]) - self.gain.T @ theta))

    def covariance(self) -> Array:
        """Return the (u, u) covariance in units of the prior: of theta never more than the prior's."""
        values, vectors = np.linalg.eigh(self.marginal)
        spread = vectors / np.sqrt(1.0 + np.maximum(values, 0.0))
        spread = np.concatenate((spread, -self.gain.T @ spread))
        covariance = spread @ spread.T
        bodies = len(self.marginal)
        covariance[bodies:, bodies:] += np.linalg.inv(self.own)
        return np.asarray(covariance)


@dataclass(frozen=True)
class Likelihood:
    """Motions and prior.

    Attributes
    ----------
    motions : R motions
    mean : (u,) of the prior
    root : (u, u) factor L of the prior's covariance
    masses : (k,) indices in x of the links' masses
    """

    motions: tuple[Motion, ...]
    mean: Array
    root: Array
    masses: Stamps

    @property
    def bodies(self) -> int:
        """Number 10 k of unknowns that are not momentum."""
        return len(self.mean) - 6 * len(self.motions)

    @property
    def equations(self) -> int:
        """Number of equations of the data."""
        return sum(blocks.offset.size for _, blocks in self._parts())

    def cost(self, x: Array) -> float:
        """Return the sum of the squared normalised residuals, of the data and of the prior."""
        return self.data_cost(x) + float(np.sum(self._in_prior(x) ** 2))

    def data_cost(self, x: Array) -> float:
        """Return the sum of the squared normalised residuals of the data."""
        return sum(eiv.cost(blocks, x[place]) for place, blocks in self._parts())

    def noise_information(self, x: Array) -> Array:
        """Return what the noise in the rows brings to the information in expectation, (u, u), in units of the prior."""
        total = np.zeros_like(self.root)
        for place, blocks in self._parts():
            total[np.ix_(place, place)] += eiv.noise_information(blocks, x[place])
        return self._scaled(total)

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Return the data's information (u, u) and gradient (u,) at x, in units of the prior.

        Raises
        ------
        FloatingPointError
            The covariance of some equations is not positive definite.
        """
        information, gradient = np.zeros_like(self.root), np.zeros(len(x))
        for place, blocks in self._parts():
            linear = eiv.maximum_likelihood(blocks, x[place])
            information[np.ix_(place, place)] += linear.information
            gradient[place] += linear.gradient
        return self._scaled(information), self.root.T @ gradient

    def maximum(self) -> Array:
        """Return the x that maximises the likelihood, (u,).

        Raises
        ------
        DataError
            The equations cannot be weighed: the noise of some of them vanishes.
        """
        try:
            starts = [self.mean, *self._starts()]
            x = min(starts, key=lambda start: (not self._massive(start), self.cost(start)))
            return self._refined(x)
        except (FloatingPointError, np.linalg.LinAlgError) as error:
            raise DataError(
                f'the momentum equations cannot be weighed: {error}; noise values above 0 are accepted'
            ) from error

    def _refined(self, x: Array) -> Array:
        """Return x after guarded Gauss-Newton steps: each finite, with positive masses, and not raising the cost."""
        current = self.cost(x)
        for _ in range(_ITERATIONS):
            information, gradient = self.linearise(x)
            total = gradient + self._in_prior(x)
            step = -Eliminated.of(information, self.bodies).solve(total)
            if float(-step @ total) < _SMALL_STEP:
                return x
            for _ in range(_HALVINGS):
                trial = x + self.root @ step
                value = self.cost(trial)
                if np.isfinite(value) and value <= current and (self._massive(trial) or not self._massive(x)):
                    break
                step = 0.5 * step
            else:
                return x
            x, current = trial, value
        return x

    def _starts(self) -> Iterator[Array]:
        """Yield first solutions: two weighted solves, then two that compensate the noise in the rows.

        As in the difference form: each is used for the next one's weights.
        """
        x: Array = self.mean
        for compensate in (False, False, True, True):
            information: Array = np.zeros_like(self.root)
            right_side: Array = np.zeros(len(x))
            for place, blocks in self._parts():
                part = Sums(blocks, x[place]).weighted(compensate=compensate)
                information[np.ix_(place, place)] += part[0]
                right_side[place] += part[1]
            # Around the prior's mean, in its units.
            right_side = self.root.T @ (right_side - information @ self.mean)
            z = Eliminated.of(self._scaled(information), self.bodies).solve(right_side)
            x = self.mean + self.root @ z
            yield x

    def _parts(self) -> Iterator[tuple[Stamps, Blocks]]:
        """Yield the blocks, each with the indices of its unknowns in x."""
        bodies = np.arange(self.bodies)
        for index, motion in enumerate(self.motions):
            place = np.concatenate((bodies, self.bodies + 6 * index + np.arange(6)))
            for blocks in motion.parts:
                yield place, blocks

    def _massive(self, x: Array) -> bool:
        return bool(np.all(x[self.masses] > 0.0))

    def _in_prior(self, x: Array) -> Array:
        return np.asarray(scipy.linalg.solve_triangular(self.root, x - self.mean, lower=True))

    def _scaled(self, information: Array) -> Array:
        return np.asarray(self.root.T @ information @ self.root)
