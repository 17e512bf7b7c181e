"""What the momentum equations depend on beside the unknowns, and what is known of it beforehand.

A nuisance adds E d to the equations of every window, with known columns E and d of covariance F F^T: the errors of
known bodies, of joint zeros, of the odometry's mount. Solved for or not, it is uncertain; as a consider parameter
(Schmidt 1966) it widens the covariance of the unknowns by what it does to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from scipy.linalg import orth

from mbaid_ros.core.equations.window_rows import joined, mean_of_each
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.momentum import regressor
from mbaid_ros.core.samples import Samples


class Nuisance(Protocol):
    """Quantities d (k,) that the model takes for zero."""

    @property
    def factor(self) -> Array:
        """(k, e) prior factor F: d is F times e independent numbers of variance one."""
        ...

    @property
    def labels(self) -> Mapping[str, slice]:
        """The parts that are told apart, by name, each with its places in d."""
        ...

    def columns(self, kernel: MomentumKernel, states: BodyStates, samples: Samples) -> Array:
        """Return the derivative of the momentum (P, L about the base's origin) by d where N samples were measured.

        Parameters
        ----------
        kernel : MomentumKernel
        states : of all bodies at these samples
        samples : N Samples

        Returns
        -------
        (N, 6, k) array, odometry axes
        """
        ...


class KnownBodies:
    """The errors of the known bodies' standard parameters.

    Parameters
    ----------
    kernel : MomentumKernel, whose `errors` say how large they may be
    """

    def __init__(self, kernel: MomentumKernel) -> None:
        self._bodies = list(kernel.errors.bodies)
        self.factor = kernel.errors.factor
        names = {link.body: link.name for link in reversed(kernel.model.links)}
        self.labels = {f'link:{names[body]}': slice(10 * k, 10 * k + 10) for k, body in enumerate(self._bodies)}

    def columns(self, kernel: MomentumKernel, states: BodyStates, samples: Samples) -> Array:  # noqa: ARG002
        """Return the regressors of the bodies beside each other, (N, 6, 10 b)."""
        place, bodies = states.configuration, self._bodies
        rows = regressor(place.rotation[:, bodies], place.position[:, bodies], states.body_twist[:, bodies])
        return np.concatenate(np.moveaxis(rows, 1, 0), axis=2)


class ConsiderParameters:
    """Several nuisances together, each in independent numbers of variance one.

    Parameters
    ----------
    kernel : MomentumKernel
    nuisances : those without any error are left out

    Attributes
    ----------
    count : number e of independent numbers
    labels : names of all parts
    """

    def __init__(self, kernel: MomentumKernel, nuisances: Sequence[Nuisance]) -> None:
        self._kernel = kernel
        self._nuisances = [nuisance for nuisance in nuisances if nuisance.factor.shape[1]]
        sizes = [nuisance.factor.shape[1] for nuisance in self._nuisances]
        self.count = sum(sizes)
        self.labels: list[str] = []
        self._directions: list[Array] = []  # of each part, what it has a share in: orthonormal (e, k)
        for nuisance, end in zip(self._nuisances, np.cumsum(sizes), strict=True):
            whole = np.zeros((len(nuisance.factor), self.count))
            whole[:, end - nuisance.factor.shape[1] : end] = nuisance.factor
            for label, places in nuisance.labels.items():
                self.labels.append(label)
                self._directions.append(orth(whole[places].T))

    def columns(self, windows: Sequence[Samples]) -> Array:
        """Return the means of E F over each of K windows, (K, 6, e)."""
        if not self.count:
            return np.zeros((len(windows), 6, 0))
        samples, counts = joined(windows)
        states = self._kernel.states(samples)
        means = (
            mean_of_each(nuisance.columns(self._kernel, states, samples), counts) @ nuisance.factor
            for nuisance in self._nuisances
        )
        return np.concatenate(list(means), axis=2)

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
