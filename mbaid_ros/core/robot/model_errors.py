"""How a robot may differ from its URDF: bodies, joint zeros, joint placements, and the mount of its odometry.

The simulator draws robots by these five blocks, and the estimator has them among its unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import Link, RobotModel, express
from mbaid_ros.core.robot.momentum import body_length, body_sizes, physical, physical_jacobian


@dataclass(frozen=True)
class ModelErrors:
    """The true robot of n joints less its URDF."""

    bodies: Array  # (n + 1, 10) standard parameters (m, h, I_o) of each moving body, in its own frame: kg, kg m, kg m^2
    zeros: Array  # (n,) true joint position less the measured one, rad or m
    origins: Array  # (n, 3) m, displacement of each joint's frame, in that frame
    # (n, 3) rad, rotation vector of each joint's frame with its subtree, in that frame, normal to the axis
    tilts: Array
    mount: Array  # (6,) the true base frame in the one that the odometry locates: rotation vector (rad), position (m)

    @staticmethod
    def zero(joints: int) -> ModelErrors:
        """Return the errors of a robot that is exactly its URDF."""
        return ModelErrors(
            np.zeros((joints + 1, 10)), np.zeros(joints), np.zeros((joints, 3)), np.zeros((joints, 3)), np.zeros(6)
        )

    @property
    def is_zero(self) -> bool:
        """Whether the robot is exactly its URDF."""
        return not any(np.any(block) for block in vars(self).values())


def with_bodies(model: RobotModel, change: Array, fixed: Sequence[str]) -> RobotModel:
    """Return a robot whose moving bodies differ by (n + 1, 10) standard parameters, each in its own frame.

    The `heaviest_link` of each body takes the change; a body without one stays.
    """
    changed = {}
    for body in np.flatnonzero(np.any(change, axis=1)).tolist():
        link = heaviest_link(model, body, fixed)
        if link is not None:
            changed[link.name] = replace(link, parameters=link.parameters + in_link_frame(link, change[body]))
    return replace(model, links=tuple(changed.get(link.name, link) for link in model.links))


def heaviest_link(model: RobotModel, body: int, fixed: Sequence[str] = ()) -> Link | None:
    """Return the heaviest link of a moving body, other than those in `fixed`; None where none of them has mass."""
    massive = [
        link for link in model.links if link.body == body and link.name not in fixed and link.parameters[0] > 0.0
    ]
    return max(massive, key=lambda link: float(link.parameters[0]), default=None)


def in_link_frame(link: Link, parameters: Array) -> Array:
    """Return a body's (10,) standard parameters in the frame of one of its links."""
    back = link.rotation.T
    return express(parameters, back, -back @ link.position)


# Part of the largest variance (all parameters in units of their own deviation) up to which one is rounding.
_NOTHING = 1e-14


@dataclass(frozen=True)
class KnownErrors:
    """Errors of the standard parameters of b known bodies: a factor times e independent numbers of variance one.

    `bodies` are indices; the rows of the factor (10 b, e) are in the bodies' own frames.
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


def relative_factor(parameters: Array, std: float) -> Array:
    """Return the lower triangular factor of the covariance of a body's (10,) parameters phi, for a relative std.

    All have one error in common, and each one of its own, relative to its `body_sizes` s: std^2 (phi phi^T + diag(s^2))
    (trajectory.md, eq. 12). With independent errors alone, the mean of ten would be known better than any: that of
    the base, in units of which a target is weighed.
    """
    sizes = body_sizes(parameters)
    whole = np.divide(parameters, sizes, out=np.zeros(10), where=sizes > 0.0)  # a point at its joint has mass alone
    return np.asarray(std * sizes[:, None] * np.linalg.cholesky(np.eye(10) + np.outer(whole, whole)))


@dataclass(frozen=True)
class BodyDeviations:
    """Standard deviations of one body's mass (relative), CoM (m, each coordinate) and inertia about it (relative).

    That of each element of the inertia, at a given mass, is relative to the mean moment, a third of the trace. First
    moment and inertia scale with the mass.
    """

    mass: float
    com: float
    inertia: float

    @staticmethod
    def from_relative(parameters: Array, std: float) -> BodyDeviations:
        """Return those of a body, of standard parameters (10,), whose errors are of a relative size."""
        return BodyDeviations(std, std * body_length(parameters), std)

    def factor(self, parameters: Array) -> Array:
        """Return the (10, e) factor of the covariance of the standard parameters (10,)."""
        inertia = np.full(6, float(physical(parameters)[[4, 7, 9]].sum()) / 3.0)
        deviation = np.concatenate(([self.mass], np.full(3, self.com), self.inertia * inertia))
        turned = np.linalg.solve(physical_jacobian(parameters), np.eye(10))
        turned[:, 0] = parameters  # a heavier body, the same otherwise
        return np.asarray((turned * deviation)[:, deviation > 0.0])


def independent_errors(known: Array, std: float, own: Mapping[int, BodyDeviations] | None = None) -> KnownErrors:
    """Return independent errors of known bodies (n + 1, 10): `own` by index, others of a relative std (0: exact)."""
    own = own or {}
    factors = {
        int(body): own[body].factor(known[body]) if body in own else relative_factor(known[body], std)
        for body in np.flatnonzero(known[:, 0] > 0.0)
        if body in own or std > 0.0
    }
    uncertain = {body: factor for body, factor in factors.items() if factor.size}
    return KnownErrors(tuple(uncertain), block_diag(*uncertain.values()) if uncertain else np.zeros((0, 0)))


def calibrated_errors(links: Sequence[Link], covariance: Array, unknown: Sequence[str] = ()) -> KnownErrors:
    """Return the errors after a calibration, by the covariance (10 k, 10 k) of k links' standard parameters.

    Links in `unknown`, by name, do not count; each link's parameters are in its own frame.
    """
    bodies, carry = links_to_bodies(links, unknown)
    return KnownErrors(bodies, _factor(carry @ covariance @ carry.T))


def links_to_bodies(links: Sequence[Link], unknown: Sequence[str] = ()) -> tuple[tuple[int, ...], Array]:
    """Return the b bodies of k links, without `unknown` ones, and the (10 b, 10 k) matrix from links to bodies."""
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
