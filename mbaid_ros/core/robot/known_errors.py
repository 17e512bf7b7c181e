"""How far the known bodies may be off: declared body by body, or as a calibration leaves it, correlations and all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.model import Link, express

# Part of the largest variance (all parameters in units of their own deviation) from which one is rounding.
_NOTHING = 1e-14


@dataclass(frozen=True)
class KnownErrors:
    """Errors of the standard parameters of b known bodies: the factor times e independent numbers of variance one.

    Attributes
    ----------
    bodies : (b,) indices of the bodies
    factor : (10 b, e), each body's rows in its own frame
    """

    bodies: tuple[int, ...] = ()
    factor: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def count(self) -> int:
        """Number e of independent errors."""
        return self.factor.shape[1]

    @property
    def covariance(self) -> Array:
        """Of the standard parameters, (10 b, 10 b)."""
        return np.asarray(self.factor @ self.factor.T)


def body_sizes(parameters: Array) -> Array:
    """Return what relative errors of a body's (10,) standard parameters are relative to.

    The mass; the mass times distance of the CoM and radius of gyration together; the mean moment of inertia.
    """
    mass, com = parameters[0], physical(parameters)[1:4]
    mean = float(parameters[[4, 7, 9]].sum()) / 3.0
    gyration = np.sqrt(max(mean, 0.0) / mass)
    return np.concatenate(([mass], np.full(3, mass * max(float(np.linalg.norm(com)), gyration)), np.full(6, mean)))


def declared(known: Array, stds: Sequence[float]) -> KnownErrors:
    """Return independent errors of a relative size.

    Parameters
    ----------
    known : (n + 1, 10) standard parameters of the known bodies
    stds : (n + 1,) relative standard deviation of each body's parameters; 0 is exact
    """
    bodies = tuple(int(body) for body in np.flatnonzero((known[:, 0] > 0.0) & (np.array(stds) > 0.0)))
    sizes = [stds[body] * body_sizes(known[body]) for body in bodies]
    return KnownErrors(bodies, np.diag(np.concatenate([np.zeros(0), *sizes])))


def calibrated(links: Sequence[Link], covariance: Array, unknown: Sequence[str] = ()) -> KnownErrors:
    """Return the errors that a calibration has left.

    Parameters
    ----------
    links : k links
    covariance : (10 k, 10 k) of their standard parameters, each in its own frame
    unknown : names of those that do not count as known
    """
    bodies, carry = to_bodies(links, unknown)
    return KnownErrors(bodies, _factor(carry @ covariance @ carry.T))


def to_bodies(links: Sequence[Link], unknown: Sequence[str] = ()) -> tuple[tuple[int, ...], Array]:
    """Return the b bodies of k links, and the (10 b, 10 k) matrix from the links' standard parameters to theirs.

    Parameters
    ----------
    links : k links
    unknown : names of those that do not count
    """
    known = [(index, link) for index, link in enumerate(links) if link.name not in unknown]
    bodies = tuple(sorted({link.body for _, link in known}))
    matrix = np.zeros((10 * len(bodies), 10 * len(links)))
    for index, link in known:
        row = 10 * bodies.index(link.body)
        matrix[row : row + 10, 10 * index : 10 * index + 10] += express(np.eye(10), link.rotation, link.position).T
    return bodies, matrix


def _factor(covariance: Array) -> Array:
    """Return a factor with as many columns as the covariance has directions; its entries may differ widely in size."""
    size = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(covariance / size / size[:, None])
    some = values > _NOTHING * max(float(values[-1]), 0.0) if len(values) else np.zeros(0, dtype=bool)
    return np.asarray(size[:, None] * vectors[:, some] * np.sqrt(values[some]))
