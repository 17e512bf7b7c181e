"""Directions of the standard parameters in an engineer's words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array, Flags, exp, vec
from mbaid_ros.core.robot.kernel import MomentumKernel, unknown_scale
from mbaid_ros.core.robot.model import Link, express

STANDARD = ('m', 'hx', 'hy', 'hz', 'Ixx', 'Ixy', 'Ixz', 'Iyy', 'Iyz', 'Izz')
_MEANING = (
    'mass',
    *(f'first moment along {axis}' for axis in 'xyz'),
    *(f'{kind} {axes}' for kind, axes in zip(('moment', 'product', 'product', 'moment', 'product', 'moment'),
                                            ('about x', 'xy', 'xz', 'about y', 'yz', 'about z'), strict=True)),
)  # fmt: skip
_KINDS = (('mass', slice(0, 1)), ('first moment', slice(1, 4)), ('inertia', slice(4, 10)))
_LONGEST_FORMULA = 6  # terms: a longer one explains nothing


@dataclass(frozen=True)
class Exchange:
    """Something that may be taken from one link and given to another without any change of momentum.

    Attributes
    ----------
    words : the kind of change, its two links, its place
    directions : (10 k, d) of theta
    """

    words: str
    directions: Array


def parameter(links: Sequence[Link], index: int) -> str:
    """Return a standard parameter's short name: ``link3.hx``."""
    return f'{links[index // 10].name}.{STANDARD[index % 10]}'


def base_parameter(mechanism: Mechanism, combination: BaseParameter) -> str:
    """Return a base parameter in words: its leading parameter, and the parts of other links that count with it."""
    links = mechanism.kernel.unknown
    leading, own = divmod(combination.leading, 10)
    factors = combination.factors.reshape(-1, 10)
    words = f'{_MEANING[own]} of {links[leading].name}'
    also = [_MEANING[each] for each in np.flatnonzero(factors[leading]) if each != own]
    if also:
        words += f', with its {" and ".join(also)}'
    groups: dict[str, list[Link]] = {}
    for index, other in enumerate(links):
        kinds = [kind for kind, place in _KINDS if np.any(factors[index, place])]
        if index != leading and kinds:
            groups.setdefault(' and '.join(kinds), []).append(other)
    return words + ''.join(f', with {_of_links(mechanism, kinds, others)}' for kinds, others in groups.items())


def _of_links(mechanism: Mechanism, kinds: str, links: Sequence[Link]) -> str:
    """Return the links whose mass, for example, counts: a few, or all that a joint carries."""
    kernel = mechanism.kernel
    for joint, name in enumerate(kernel.model.joint_names):
        carried = [link for link in kernel.unknown if kernel.kinematics.ancestors[link.body, joint]]
        if len(carried) > 1 and {link.name for link in carried} == {link.name for link in links}:
            return f'all the {kinds} that {name} carries'
    return f'{kinds} of {listing(link.name for link in links)}'


def formula(links: Sequence[Link], factors: Array) -> str:
    """Return a combination (10 b,) of the links' standard parameters as a sum, cut after a few terms."""
    indices = np.flatnonzero(factors)
    terms = []
    for index in indices[:_LONGEST_FORMULA]:
        factor = factors[index]
        size = '' if abs(abs(factor) - 1.0) < 1e-9 else f'{abs(factor):.4g} '
        sign = '-' if factor < 0.0 else '+'
        terms.append(f'{sign} {size}{parameter(links, int(index))}')
    text = ' '.join(terms).removeprefix('+ ')
    more = len(indices) - _LONGEST_FORMULA
    return f'{text} + {more} more' if more > 0 else text


def exchanges(mechanism: Mechanism, structure: Structure) -> tuple[Exchange, ...]:
    """Return a sentence for each inseparable combination; together the directions span the null space.

    Each candidate is checked against the structure. Unexplained ones come last, by their largest parts.
    """
    found: list[Exchange] = []
    spanned = np.zeros((structure.unknowns, 0))
    for candidate in _candidates(mechanism):
        directions = [each for each in candidate.directions.T if structure.has_none(each) and _seen(mechanism, each)]
        fresh = [each for each in directions if _independent(spanned, each / structure.scale)]
        if fresh:
            scaled = [each / structure.scale / np.linalg.norm(each / structure.scale) for each in fresh]
            spanned = np.column_stack((spanned, *scaled))
            found.append(Exchange(candidate.words, np.column_stack(fresh)))
    return (*found, *_unexplained(mechanism, structure, spanned))


def _candidates(mechanism: Mechanism) -> Iterator[Exchange]:
    kernel = mechanism.kernel
    model, links = kernel.model, kernel.unknown
    of_body: dict[int, list[int]] = {}
    for index, link in enumerate(links):
        of_body.setdefault(link.body, []).append(index)
    for indices in of_body.values():
        for first, second in pairwise(indices):
            yield _exchange(mechanism, first, second, np.eye(10), 'anything', 'rigidly joined')
    for joint, parent in enumerate(model.parents):
        if parent not in of_body or joint + 1 not in of_body:
            continue
        first, second = of_body[parent][0], of_body[joint + 1][0]
        name = model.joint_names[joint]
        if not mechanism.moving[joint]:
            yield _exchange(mechanism, first, second, np.eye(10), 'anything', f'{name} does not move')
        elif model.prismatic[joint]:
            yield _exchange(mechanism, first, second, np.eye(10)[:, 4:], 'inertia', f'{name} slides, both turn alike')
        else:
            axis = model.axes[joint]
            rod = np.zeros((10, 1))
            rod[4:, 0] = vec(np.eye(3) - axis[:, None] * axis)
            along = np.concatenate(([0.0], axis, np.zeros(6)))[:, None]
            yield _exchange(mechanism, first, second, np.eye(10)[:, :1], 'mass', f'on the axis of {name}')
            yield _exchange(mechanism, first, second, along, 'first moment', f'along the axis of {name}')
            yield _exchange(mechanism, first, second, rod, 'inertia', f'of a thin rod on the axis of {name}')


def _exchange(mechanism: Mechanism, first: int, second: int, taken: Array, what: str, where: str) -> Exchange:
    """Return the exchange of parameters (10, d), given in the frame of the second link's body, between two links."""
    kernel = mechanism.kernel
    links = kernel.unknown
    posture = mechanism.posture[None]
    configuration = kernel.kinematics.configure(np.eye(3)[None], posture)
    turn, place = configuration.rotation[0, links[second].body], configuration.position[0, links[second].body]
    directions = np.zeros((10 * len(links), taken.shape[1]))
    for index, sign in ((first, -1.0), (second, 1.0)):
        rotation, position = (each[0] for each in configuration.link(links[index]))
        there = express(taken.T, rotation.T @ turn, rotation.T @ (place - position))
        directions[10 * index : 10 * index + 10] = sign * there.T
    return Exchange(f'{what} between {links[first].name} and {links[second].name}: {where}', directions)


def _seen(mechanism: Mechanism, direction: Array) -> bool:
    """Return whether a direction would count at all: in a plane, what lies out of it does not."""
    if mechanism.normal is None:
        return True
    return any(np.any(np.abs(basis.T @ part) > 1e-9) for basis, part in _planar_parts(mechanism, direction))


def _planar_parts(mechanism: Mechanism, direction: Array) -> Iterator[tuple[Array, Array]]:
    for index, link in enumerate(mechanism.kernel.unknown):
        yield planar_basis(mechanism, link), direction[10 * index : 10 * index + 10]


def _independent(spanned: Array, direction: Array) -> bool:
    direction = direction / np.linalg.norm(direction)
    if spanned.shape[1] == 0:
        return True
    return bool(np.linalg.norm(direction - spanned @ np.linalg.lstsq(spanned, direction, rcond=None)[0]) > 1e-6)


def _unexplained(mechanism: Mechanism, structure: Structure, spanned: Array) -> Iterator[Exchange]:
    """Yield the rest of the null space; in a plane everything out of it, as one."""
    null = structure.null_space / structure.scale[:, None]
    if spanned.shape[1]:
        null = null - spanned @ np.linalg.lstsq(spanned, null, rcond=None)[0]
    left, values, _ = np.linalg.svd(null, full_matrices=False)
    left = left[:, values > 1e-6]
    if not left.shape[1]:
        return
    links = mechanism.kernel.unknown
    directions = structure.scale[:, None] * left
    if mechanism.normal is not None:
        yield Exchange('everything out of the plane of motion, of every body', directions)
        return
    for direction, scaled in zip(directions.T, left.T, strict=True):
        largest = np.argsort(-np.abs(scaled))[:3]
        names = listing(parameter(links, int(index)) for index in largest)
        yield Exchange(f'a combination of {names} and others', direction[:, None])


# Singular values, relative to the largest, that are rounding: those of mechanisms are above 1e-4.
_ROUNDING = 1e-9
# Random states for each unknown number, six equations each (three in a plane): far more than would do.
_STATES_PER_UNKNOWN = 2
_SEED = 20  # of these states: the same structure every time


@dataclass(frozen=True)
class Mechanism:
    """The moving parts of a robot.

    Attributes
    ----------
    kernel : with the unknown links
    moving : (n,) True for the joints that do not rest
    posture : (n,) rad or m, where the resting ones are
    normal : (3,) of the plane of motion in the base link's frame; None in space
    """

    kernel: MomentumKernel
    moving: Flags
    posture: Array
    normal: Array | None = None


@dataclass(frozen=True)
class BaseParameter:
    """A combination of standard parameters that momentum determines.

    Attributes
    ----------
    leading : index in theta of the parameter that it is named after, with factor 1
    factors : (10 k,) the combination is factors theta
    """

    leading: int
    factors: Array


@dataclass(frozen=True)
class Structure:
    """The unknown standard parameters as momentum sees them.

    Attributes
    ----------
    regressor : (m, 10 k) at random states, columns in typical sizes
    scale : (10 k,) those sizes
    """

    regressor: Array
    scale: Array

    @cached_property
    def _svd(self) -> tuple[Array, Array]:
        _, values, vectors = np.linalg.svd(self.regressor, full_matrices=True)
        return values, vectors

    @property
    def unknowns(self) -> int:
        """Number 10 k of standard parameters."""
        return len(self.scale)

    @property
    def rank(self) -> int:
        """Number of directions that a known momentum determines."""
        values = self._svd[0]
        return int(np.sum(values > _ROUNDING * values[0]))

    @property
    def null_space(self) -> Array:
        """(10 k, d) directions of theta that have no momentum, orthonormal in typical sizes."""
        return np.asarray(self.scale[:, None] * self._svd[1][self.rank :].T)

    def has_none(self, direction: Array) -> bool:
        """Return whether a direction (10 k,) of theta has no momentum in any motion."""
        scaled = direction / self.scale
        size = float(np.linalg.norm(self.regressor, ord=2) * np.linalg.norm(scaled))
        return bool(np.linalg.norm(self.regressor @ scaled) < 1e3 * _ROUNDING * size)

    def base_parameters(self) -> tuple[BaseParameter, ...]:
        """Return a minimal set of combinations that momentum determines.

        Bodies come from the base outwards: combinations inseparable from a parent's parameters count with these.
        """
        chosen: list[int] = []
        basis: Array = np.zeros((len(self.regressor), 0))
        for column in range(self.unknowns):
            rest = self.regressor[:, column]
            for _ in range(2):  # twice, against rounding
                rest = rest - basis @ (basis.T @ rest)
            length = float(np.linalg.norm(rest))
            if length > 1e2 * _ROUNDING * max(float(np.linalg.norm(self.regressor[:, column])), 1e-300):
                chosen.append(column)
                basis = np.column_stack((basis, rest / length))
        factors: Array = np.linalg.lstsq(self.regressor[:, chosen], self.regressor, rcond=None)[0]
        factors = factors * self.scale[chosen][:, None] / self.scale
        size = np.abs(factors) * self.scale / self.scale[chosen][:, None]
        factors[size < 1e-7] = 0.0
        return tuple(BaseParameter(column, row) for column, row in zip(chosen, factors, strict=True))


def structure(mechanism: Mechanism) -> Structure:
    """Return the parameters of a mechanism's unknown links that momentum determines."""
    kernel = mechanism.kernel
    model = kernel.model
    count = _STATES_PER_UNKNOWN * 10 * len(kernel.unknown)
    rng = np.random.default_rng(_SEED)
    position = np.where(mechanism.moving, rng.uniform(-np.pi, np.pi, (count, model.joints)), mechanism.posture)
    velocity = np.where(mechanism.moving, rng.normal(size=(count, model.joints)), 0.0)
    twist = rng.normal(size=(count, 6))
    rotation: Array = np.broadcast_to(np.eye(3), (count, 3, 3))
    equations = np.eye(6)
    if mechanism.normal is not None:
        normal = mechanism.normal
        across = np.linalg.svd(normal[None])[2][1:]
        equations = np.zeros((3, 6))
        equations[:2, :3], equations[2, 3:] = across, normal
        twist = twist @ equations.T @ equations
        rotation = exp(rng.uniform(-np.pi, np.pi, (count, 1)) * normal)
    states = kernel.states_of(rotation, position, velocity, twist)
    regressor = np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=2)
    scale = np.tile(unknown_scale(kernel)[:10], len(kernel.unknown))
    return Structure((equations @ regressor).reshape(-1, regressor.shape[2]) * scale, scale)


def planar_basis(mechanism: Mechanism, link: Link) -> Array:
    """Return the (10, 4) orthonormal basis of a link's parameters in planar motion: mass, first moment, moment."""
    kernel = mechanism.kernel
    configuration = kernel.kinematics.configure(np.eye(3)[None], np.zeros((1, kernel.model.joints)))
    normal = configuration.link(link)[0][0].T @ np.asarray(mechanism.normal)
    basis = np.zeros((10, 4))
    basis[0, 0] = 1.0
    basis[1:4, 1:3] = np.linalg.svd(normal[None])[2][1:].T
    about = vec(normal[:, None] * normal)
    basis[4:, 3] = about / np.linalg.norm(about)
    return basis
