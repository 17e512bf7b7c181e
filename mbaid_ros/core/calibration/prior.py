"""What is known of the unknown bodies before the data: the values of the robot description, as a Gaussian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.errors import ModelError, ParameterError
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.robot.inertia import physical, physical_jacobian, pseudo_inertia
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.known_errors import KnownErrors, to_bodies
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.robot.scale import unknown_scale

# Standard deviation, in typical sizes, of what nothing is known of: far too much to be a prior (as in difference).
NO_PRIOR = 100.0
_EMPTY = 1e-9  # standard deviation, in typical sizes, of a link that is known to have no mass
# Smallest eigenvalue of a pseudo-inertia, relative to the largest, that still counts as a body: flat ones are common.
_FLAT = -1e-9
# Least size of an element of inertia that its deviation is relative to, in thirds of the trace: a thin rod has zeros.
_SMALLEST = 1e-3
_ROWS = np.array([4, 4, 4, 7, 7, 9])
_COLUMNS = np.array([4, 7, 9, 7, 9, 9])


@dataclass(frozen=True)
class LinkPrior:
    """How far the values of a link's <inertial> may be off: one standard deviation; 0 means that nothing is known.

    Attributes
    ----------
    mass : relative; the inertia goes with it
    com : m, of each coordinate of the centre of mass
    inertia : of the element I_ij about the centre of mass at a given mass, relative to sqrt(I_ii I_jj)
    empty : whether a link without <inertial> is known to have no mass
    """

    mass: float
    com: float
    inertia: float
    empty: bool = False

    @property
    def given(self) -> Flags:
        """(10,) True for each of mass, CoM and inertia that something is known of."""
        return np.repeat([self.mass > 0.0, self.com > 0.0, self.inertia > 0.0], (1, 3, 6))


@dataclass(frozen=True)
class Prior:
    """The Gaussian prior of k links.

    Attributes
    ----------
    links : the unknown links
    stds : of each link, as asked for
    mean : (10 k,) standard parameters
    covariance : (10 k, 10 k), block diagonal
    given : (k, 10) True for each of (mass, CoM, inertia) that something is known of
    """

    links: tuple[Link, ...]
    stds: tuple[LinkPrior, ...]
    mean: Array
    covariance: Array
    given: Flags

    @cached_property
    def roots(self) -> tuple[Array, ...]:
        """Of each link, the (10, 10) lower triangular factor of its covariance."""
        blocks = (self.covariance[start : start + 10, start : start + 10] for start in range(0, len(self.mean), 10))
        return tuple(map(_root, blocks))

    def errors(self, but: int) -> KnownErrors:
        """Return what the priors of all links but the first few say of the moving bodies: ten numbers a link."""
        bodies, carry = to_bodies(self.links[but:])
        return KnownErrors(bodies, carry @ block_diag(*self.roots[but:]) if bodies else np.zeros((0, 0)))


def make_prior(kernel: MomentumKernel, stds: Sequence[LinkPrior]) -> Prior:
    """Return the prior of a kernel's unknown links.

    Parameters
    ----------
    kernel : MomentumKernel
    stds : one for each of its unknown links

    Raises
    ------
    ModelError
        The robot description gives a link an inertia that no body has.
    ParameterError
        Nothing fixes the scale: every massive body is unknown, and nothing is known of any mass or inertia.
    """
    scale = unknown_scale(kernel)[:10]
    size = 10 * len(kernel.unknown)
    mean, covariance = np.zeros(size), np.zeros((size, size))
    given = np.zeros((len(kernel.unknown), 10), dtype=bool)
    for index, (link, std) in enumerate(zip(kernel.unknown, stds, strict=True)):
        place = slice(10 * index, 10 * index + 10)
        mean[place] = link.parameters
        # A link without <inertial> has no values to be near to.
        if link.parameters[0] > 0.0 and np.any(std.given):
            given[index] = std.given
            covariance[place, place] = _covariance(link, std, scale)
        else:
            covariance[place, place] = np.diag(((_EMPTY if std.empty else NO_PRIOR) * scale) ** 2)
    if not np.any(kernel.known[:, 0]) and not np.any(given[:, [0, 4]]):
        raise ParameterError(
            'nothing fixes the scale: all bodies are unknown, and no mass or inertia has a prior; accepted: '
            'prior.links.<link>.mass_relative_std for one body at least, or a body left out of --unknown'
        )
    return Prior(kernel.unknown, tuple(stds), mean, covariance, given)


def physical_std(link: Link, std: LinkPrior) -> Array:
    """Return the (10,) standard deviations of (m, r_c, I_c at that m); infinite where nothing is known."""
    values = physical(link.parameters)
    diagonal = values[[4, 7, 9]]
    floor = _SMALLEST * float(np.sum(diagonal)) / 3.0
    inertia = np.maximum(np.sqrt(np.maximum(values[_ROWS] * values[_COLUMNS], 0.0)), floor)
    deviation = np.concatenate(([std.mass * values[0]], np.full(3, std.com), std.inertia * inertia))
    return np.where(std.given, deviation, np.inf)


def _covariance(link: Link, std: LinkPrior, scale: Array) -> Array:
    """Return the (10, 10) covariance of a link's standard parameters."""
    _require_a_body(link)
    # Rows of what nothing is known of vanish; the wide prior keeps the matrix regular.
    rows = physical_jacobian(link.parameters)
    if std.mass > 0.0:
        rows[4:] -= np.outer(physical(link.parameters)[4:] / link.parameters[0], rows[0])
    rows /= physical_std(link, std)[:, None]
    information = scale[:, None] * (rows.T @ rows) * scale + np.eye(10) / NO_PRIOR**2
    covariance = np.linalg.inv(information)
    return np.asarray(0.5 * (covariance + covariance.T) * scale[:, None] * scale)


def _root(covariance: Array) -> Array:
    """Return the lower triangular factor of a covariance whose entries differ widely in size."""
    size = np.sqrt(np.diag(covariance))
    return np.asarray(size[:, None] * np.linalg.cholesky(covariance / size / size[:, None]))


def _require_a_body(link: Link) -> None:
    """Refuse an <inertial> that no distribution of mass has: there is nothing to be near to.

    Raises
    ------
    ModelError
        It is none.
    """
    values = physical(link.parameters)
    about_com = np.concatenate((values[:1], np.zeros(3), values[4:]))
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(about_com)[:3, :3])
    if eigenvalues[0] < _FLAT * max(eigenvalues[-1], 0.0) or eigenvalues[-1] <= 0.0:
        shown = ', '.join(f'{name} {value:g}' for name, value in zip(_NAMES, values[4:], strict=True))
        raise ModelError(
            f"link '{link.name}' has an inertia that no body has ({shown} kg m^2 about its centre of mass): no prior; "
            'accepted: principal moments that are positive and none larger than the sum of the other two'
        )


_NAMES = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
