"""What is believed of the state: a Gaussian in square-root information form, and how well the data agree with it.

R x = z with unit covariance (Bierman 1977, chapter 5; docs/trajectory.md, eq. 4): a window adds rows to R, Householder
reflections make it triangular again, and what no window has seen of an unknown stays at its prior exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dtrtri, dtrtrs

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.knots import Integers
from mbaid_ros.core.trajectory.state import BODY, Layout
from mbaid_ros.core.trajectory.variables import Variables
from mbaid_ros.core.verdict.innovations import Innovations


@dataclass(frozen=True, eq=False)
class Belief:
    """The state in scaled variables.

    The variables are those of `Variables`, then those of a constant force where a hypothesis has one.

    Attributes
    ----------
    root : (v, v + 2) the triangle R, and beside it z of the correction for noise that rows and values share, and z of
        the least squares' mean: x = R^-1 (their sum); innovations are those of the mean itself
    innovations : what they were, sensor by sensor
    nis, measured : sum of the normalised innovations squared, and how many there were
    last_nis, last_measured : the same of the last update
    log_likelihood : of all measurements, up to a constant
    """

    root: Array
    innovations: Innovations
    nis: float = 0.0
    measured: int = 0
    last_nis: float = 0.0
    last_measured: int = 0
    log_likelihood: float = 0.0

    @staticmethod
    def prior(variables: Variables, extra: int = 0, mass: float | None = None) -> Belief:
        """Return the belief before the first measurement.

        Parameters
        ----------
        variables : of the filter
        extra : how many numbers of unit variance a hypothesis has beside them
        mass : kg that the target body is held near
        """
        mean, triangle, likelihood = variables.prior(mass)
        size = len(mean) + extra
        root = np.zeros((size, size + 2))
        root[: len(mean), : len(mean)] = triangle
        root[: len(mean), -1] = triangle @ mean
        root[len(mean) :, len(mean) : -2] = np.eye(extra)
        return Belief(root, Innovations.none(variables.poses), log_likelihood=likelihood)

    @property
    def size(self) -> int:
        """Number v of variables."""
        return len(self.root)

    def moments(self) -> tuple[Array, Array, Array]:
        """Return the mean (v,), what of it is the correction for shared noise (v,), and a covariance factor (v, v).

        Raises
        ------
        LinAlgError
            The information has a direction without any.
        """
        factor, info = dtrtri(self.root[:, :-2])
        if info:
            raise np.linalg.LinAlgError('a direction of the state has no information')
        both = factor @ self.root[:, -2:]
        return both[:, 0] + both[:, 1], both[:, 0], np.asarray(factor)

    @property
    def least_squares(self) -> Array:
        """The mean without the correction for shared noise, (v,)."""
        return np.asarray(dtrtrs(self.root[:, :-2], self.root[:, -1])[0])

    def with_root(self, root: Array) -> Belief:
        """Return the same with other variables: what has been measured stays."""
        return replace(self, root=root)


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean and covariance of a belief, SI units.

    Attributes
    ----------
    mean : (s,) of the state
    factor : (s, v) of its covariance, without what the variables leave out
    shift : (s,) what of the mean is the correction for shared noise
    variance : (s,) with what the variables leave out
    force, force_factor : (6,), (6, v) of a constant force; zero where there is none
    """

    mean: Array
    factor: Array
    shift: Array
    variance: Array
    force: Array
    force_factor: Array

    @staticmethod
    def of(belief: Belief, variables: Variables) -> Moments:
        """Return the moments of a belief."""
        mean, shift, factor = belief.moments()
        count, spread = len(variables.scale), variables.spread
        spread_factor = spread @ factor[:count]
        variance = np.add.reduce(spread_factor**2, axis=1) + variables.outside.diagonal()
        force = variables.force[:, : belief.size - count]
        return Moments(
            spread @ mean[:count],
            spread_factor,
            spread @ shift[:count],
            variance,
            force @ mean[count:],
            force @ factor[count:],
        )

    @property
    def deviation(self) -> Array:
        """Standard deviations, (s,)."""
        return np.sqrt(self.variance)

    def covariance(self, rows: Integers, variables: Variables) -> Array:
        """Return the covariance of some numbers of the state."""
        part = self.factor[rows]
        return np.asarray(part @ part.T + variables.outside[np.ix_(rows, rows)])

    def contributions(self, own: Array, layout: Layout) -> tuple[tuple[str, ...], Array]:
        """Return the part of the variance of m numbers that comes from the prior of each cause.

        An estimate errs by what noise and priors contribute, which are independent: the prior of unknowns of unit
        variance contributes the square of their covariance with the estimate. What is left of the variance is sensor
        noise.

        Parameters
        ----------
        own : (m, v) a covariance factor of the numbers, rows of `factor` or linear in these
        layout : of the state

        Returns
        -------
        names of c causes, (m, c) variances
        """
        squares = (own @ self.factor[BODY.stop :].T @ layout.known.whitening.T) ** 2
        return layout.causes, squares @ layout.belongs
