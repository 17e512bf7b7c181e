"""Known links: errors of their masses, centres and inertias, the weighed mass of the robot, wrong units."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.contracts import Convention, NominalModel, Unknown, Words, converted
from mbaid_ros.core.geometry import Array, unvec
from mbaid_ros.core.repair import Conversion, Repair, Setting, numbers, widened
from mbaid_ros.core.results.estimate import BAND
from mbaid_ros.core.robot.body import are_physical, body_length, body_sizes, physical, physical_jacobian
from mbaid_ros.core.robot.model import Link, PlaneDetector, RobotModel, express, load_model
from mbaid_ros.core.robot.momentum import BodyStates, KnownErrors, MomentumKernel, regressor
from mbaid_ros.core.robot.urdf import InertiaMeaning, with_inertias
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.parameters import by_name, parameter

# Part of the largest variance (all parameters in units of their own deviation) up to which one is rounding.
_NOTHING = 1e-14
_ALONE = 0.999  # part of a direction in one number, from which it is that number
_UNITS = (1e3, 1e-3)  # grams for kilograms, and the other way round
_HEAVY = 0.01  # share of the robot's mass, from which a link's inertia matters
_REACH = 10.0  # times the robot's size, that no link's radius of gyration reaches
_MILLIMETRE = 1e-3  # m
_SAME = 1e-9  # of the largest parameter of a body, below which tensors and their changes are rounding
_SLENDER = 200.0  # times the largest radius of gyration, that no joint is away from the one before it
# kg/m^3, lead and air: a denser link, or a lighter base, is described in another unit.
_DENSEST, _LIGHTEST = 11_300.0, 1.2


@dataclass(frozen=True)
class LinkDeviations:
    """Standard deviations of a single known link, in place of `known_links.relative_std`; 0 is exact."""

    mass_relative_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Relative standard deviation of the mass of this link and everything fixed to it; the inertia scales with it."""
    com_std: float = parameter(0.01, 'm', minimum=0.0)
    """Standard deviation of each coordinate of the centre of mass of this link and everything fixed to it."""
    inertia_relative_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Standard deviation of each element of this link's inertia about the centre of mass at a given mass, relative to
    the mean moment."""


@dataclass(frozen=True)
class KnownLinksConfig:
    """The uncertainty of the known bodies."""

    relative_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Relative standard deviation of every known body: of a common factor of its inertial parameters, and of each
    parameter by itself; 0: exact."""
    total_mass: float = parameter(0.0, 'kg', minimum=0.0)
    """Mass of the whole robot with an empty hand, if it was weighed. The target link's own <inertial> in the URDF
    counts as a part of it, so it must not contain the captured body. A known_links.calibration has this mass already.
    0: unknown."""
    total_mass_std: float = parameter(0.0, 'kg', minimum=0.0)
    """Standard deviation of known_links.total_mass; 0: unknown."""
    calibration: str = parameter('')
    """JSON file of calibrate: its covariance of links, joints and mount replaces all else of known_links, the zeros,
    origins and axes of known_joints, and odometry_mount. It needs the URDF that calibrate wrote."""
    links: Mapping[str, Mapping[str, float]] = by_name(LinkDeviations, 'link')


def relative_factor(parameters: Array, std: float) -> Array:
    """Return the lower triangular factor of the covariance of a body's (10,) parameters phi, for a relative std.

    All have one error in common, and each one of its own, relative to its `body_sizes` s: std^2 (phi phi^T + diag(s^2))
    (trajectory.md, eq. 3). With independent errors alone, the mean of ten would be known better than any: that of
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
        turned[0] = 0.0  # the mass is a number by itself: not even rounding of the others is in it
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


def _link_deviation(name: str, value: Array) -> str:
    heavier = 'heavier' if value[0] > 0.0 else 'lighter'
    moment = ', '.join(f'{part:+.2g}' for part in value[1:4])
    return (
        f'link {name} is not as described: it looks {abs(value[0]):.3g} kg {heavier}, its first moment ({moment}) '
        'kg m off; check its inertial, or raise known_links.relative_std'
    )


def _weight_deviation(name: str, value: Array) -> str:
    heavier = 'heavier' if value[0] > 0.0 else 'lighter'
    return (
        f'link {name} is {abs(value[0]):.3g} kg {heavier} than described, throughout: weigh it and correct its '
        'inertial, or raise known_links.relative_std'
    )


@dataclass(frozen=True, eq=False)
class KnownBodies(Unknown):
    """Errors of the standard parameters (m, h, I_o) of b moving bodies, each in its own frame."""

    bodies: tuple[int, ...]  # (b,) indices
    known: tuple[Array, ...] = ()  # (10,) standard parameters of each as described; empty: not known

    words: ClassVar = {
        'link': Words(
            'the links',
            'known_links.relative_std',
            'the uncertainty of link {}: weigh it, or calibrate before the capture (known_links)',
            _link_deviation,
        ),
        'mass': Words(parameter='known_links.relative_std'),
        'density': Words(parameter='known_links.relative_std', deviation=_weight_deviation),
    }
    calibrated = True

    @cached_property
    def directions(self) -> Mapping[str, Array]:
        """By 'density:arm', the direction of a body that is heavier throughout, where that is no number by itself."""
        found: dict[str, Array] = {}
        for place, known in enumerate(self.known if self.factor.any() else ()):
            rows = slice(10 * place, 10 * place + 10)
            own = np.any(self.factor[rows] != 0.0, axis=0)
            alone = not np.any(np.delete(self.factor, rows, axis=0)[:, own])
            along = np.where(own, np.linalg.lstsq(self.factor[rows], known, rcond=1e-12)[0], 0.0)
            size = np.linalg.norm(along)
            if alone and size > 0.0 and np.max(np.abs(along)) < _ALONE * size:
                found[f'density:{self.labels[10 * place].partition(":")[2]}'] = along / size
        return found

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Of each independent number, the mass of its link where it alone makes that out; or ''."""
        return masses([label.partition(':')[2] for label in self.labels[::10]], self.factor)

    def mass_row(self) -> Array:
        """Return the sum of the bodies' masses."""
        return np.asarray(self.factor[::10].sum(axis=0))

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair | None:
        """Return mass, CoM and inertia of the link as uncertain as they are off; None of a body that cannot be."""
        name = cause.partition(':')[2]
        body = kernel.known[kernel.model.link(name).body]
        if body[0] + value[0] <= 0.0:
            return None
        heavier = 'heavier' if value[0] > 0.0 else 'lighter'
        text = f'link {name} is {abs(value[0]):.3g} ± {BAND * std[0]:.2g} kg {heavier}'
        if cause.startswith('density'):
            own = f'known_links.{name}.mass_relative_std'
            wider = widened(abs(float(value[0])) / body[0], 1.0)
            return Repair(text, {own: wider}, value=float(value[0]), std=float(std[0]), unit='kg')
        before, after = physical(body), physical(body + value)
        # The inertia is declared at a given mass, relative to the mean moment.
        change = after[4:] - after[0] / before[0] * before[4:]
        moment = max(float(np.mean(before[[4, 7, 9]])), _SAME * before[0])  # it may be described without any
        sizes = abs(value[0]) / body[0], np.max(np.abs(after - before)[1:4]), np.max(np.abs(change)) / moment
        rows = np.flatnonzero(np.array(self.labels) == cause)
        declared = physical_jacobian(body) @ self.factor[rows]
        prior = np.sqrt(np.sum(declared**2, axis=1))
        beside = prior[0] / before[0], np.max(prior[1:4]), np.max(prior[4:]) / moment
        parameters: dict[str, Setting] = {}
        for part, size, given, most in zip(
            ('mass_relative_std', 'com_std', 'inertia_relative_std'), sizes, beside, (1.0, np.inf, 1.0), strict=True
        ):
            if (wider := widened(float(size), most)) > given:
                parameters[f'known_links.{name}.{part}'] = wider
        moved = float(np.linalg.norm((after - before)[1:4]))
        return Repair(
            f'{text}, its centre of mass {1e3 * moved:.3g} mm off',
            parameters,
            value=numbers(value[:1]),
            std=float(std[0]),
            unit='kg',
        )

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the bodies' regressors, less the orbit's momentum: momentum is linear in a body's parameters."""
        del kernel
        index = list(self.bodies)
        placed = states.configuration
        columns = regressor(placed.rotation[:, index], placed.position[:, index], states.body_twist[:, index])
        if states.gravity_columns.shape[1]:
            columns -= states.gravity_columns[:, index]
        return np.moveaxis(columns, 1, 2).reshape(len(columns), 6, 10 * len(index))

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these bodies."""
        change = np.zeros_like(nominal.kernel.known)
        change[list(self.bodies)] = value.reshape(-1, 10)
        return replace(nominal, kernel=nominal.kernel.with_body_changes(change))

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return mass, first moment in the plane and moment about its normal, of each."""
        return np.asarray(block_diag(*(detector.plane_of_body(body).basis for body in self.bodies)))


def masses(names: Sequence[str], factor: Array) -> tuple[str, ...]:
    """Return which of e independent numbers are links' masses, 'mass:arm', by their covariance factor (10 b, e)."""
    found = [''] * factor.shape[1]
    for name, row in zip(names, factor[::10], strict=True):
        (columns,) = np.nonzero(row)
        if len(columns) == 1:
            found[columns[0]] = f'mass:{name}'
    return tuple(found)


def known_bodies(
    model: RobotModel, errors: KnownErrors, known: Array | None = None, unknown: Collection[str] = ()
) -> KnownBodies:
    """Return the errors of known bodies as an unknown.

    Parameters
    ----------
    known : (n + 1, 10), the bodies as described
    unknown : names of links that are no part of them
    """
    labels = tuple(f'link:{name}' for name in _names(model, errors.bodies, unknown) for _ in range(10))
    described = () if known is None else tuple(known[list(errors.bodies)])
    return KnownBodies(errors.factor, labels, errors.bodies, described)


def densities(model: RobotModel, known: Array, std: float, unknown: Collection[str] = ()) -> KnownBodies:
    """Return one number for each known body (n + 1, 10) with mass: how much heavier it is, the same otherwise.

    Links in `unknown`, by name, are no part of them.
    """
    bodies = np.flatnonzero(known[:, 0] > 0.0).tolist()
    labels = tuple(f'density:{name}' for name in _names(model, bodies, unknown) for _ in range(10))
    return KnownBodies(block_diag(*(std * known[body, :, None] for body in bodies)), labels, tuple(bodies))


def _names(model: RobotModel, bodies: Sequence[int], unknown: Collection[str]) -> list[str]:
    """Return the name of each body: that of its first link with mass that is not unknown."""
    found: dict[int, str] = {}
    for link in sorted(model.links, key=lambda link: (link.name in unknown, link.parameters[0] <= 0.0)):
        found.setdefault(link.body, link.name)
    return [found[body] for body in bodies]


@dataclass(frozen=True)
class TotalMass:
    """The mass of the whole robot, weighed: of all bodies but the target, whose own part counts as declared."""

    mass: float  # kg
    std: float  # kg
    with_target: bool = False  # whether all of the target is weighed as well, as before a capture


def mistaken_masses(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield links in a wrong unit: each, and all that move."""
    links = [link for link in kernel.model.links if link.parameters[0] > 0.0]
    # Of links fixed to each other.
    heaviest = {link.body: link for link in sorted(links, key=lambda each: each.parameters[0])}
    for link in heaviest.values():
        if link.name not in {each.name for each in kernel.unknown}:
            # A base in tonnes is an arm in grams: momentum and all masses may grow together.
            for unit in _UNITS[: 1 if link.body == 0 else None]:
                change = np.zeros_like(kernel.known)
                change[link.body] = (1.0 / unit - 1.0) * kernel.known[link.body]
                text = f'link {link.name} is {unit:g} times as heavy as it is: a wrong unit or body in the URDF?'
                repair = _converted(kernel, (link.body,), unit, f'link {link.name} is described') if link.body else None
                yield Convention(text, kernel.with_body_changes(change), repair=repair)
    yield from _arms_in_another_unit(kernel, heaviest)


def _arms_in_another_unit(kernel: MomentumKernel, heaviest: Mapping[int, Link]) -> Iterator[Convention]:
    """Yield all moving links in a wrong unit, by the heaviest link of each body.

    An arm in grams moves as a base in tonnes does: they differ by the density that the links would have.
    """
    moving = ', '.join(link.name for link in kernel.model.links if link.body and link.parameters[0] > 0.0)
    known = [body for body in heaviest if body and kernel.known[body, 0] > 0.0]
    dense = all(_density(heaviest[body].parameters) > _DENSEST for body in known)
    light = 0 in heaviest and _density(heaviest[0].parameters) < _LIGHTEST
    for unit in _UNITS if dense or light else _UNITS[1:]:
        change = (1.0 / unit - 1.0) * kernel.known
        change[0] = 0.0
        yield Convention(
            f'the moving links ({moving}) are {unit:g} times as heavy as they are: a wrong unit?',
            kernel.with_body_changes(change),
            repair=_converted(kernel, known, unit, 'the arm is described') if unit > 1.0 and dense else None,
        )


def mistaken_tensors(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield inertia tensors of the description that are meant otherwise, where all links can have those."""
    unknown, model = {each.name for each in kernel.unknown}, kernel.model
    for meaning, text in _TENSORS.items():
        other = load_model(with_inertias(model.urdf, meaning), model.base_link)
        links = [link.parameters for link in other.links if link.parameters[0] > 0.0 and link.name not in unknown]
        change = other.body_parameters(unknown) - model.body_parameters(unknown)
        if np.max(np.abs(change)) > _SAME * np.max(kernel.known) and are_physical(np.array(links)).all():
            repair = converted(text, Conversion(inertias=meaning))
            yield Convention(text, kernel.with_body_changes(change), misfit_left=np.inf, repair=repair)


_TENSORS: Mapping[InertiaMeaning, str] = {
    'about the origins': (
        "the inertia tensors of the robot description are about the links' origins: in a URDF they are about the "
        'centres of mass; subtract the mass times the squared distance'
    ),
    'opposite products': (
        'the products of inertia of the robot description have the opposite sign: in a URDF ixy is minus the integral '
        'of x y; reverse ixy, ixz and iyz'
    ),
    'not turned': (
        "the inertia tensors of the robot description are in the axes of the links: in a URDF the inertial's rpy turns "
        'them; set it to 0'
    ),
}


def _converted(kernel: MomentumKernel, bodies: Sequence[int], unit: float, described: str) -> Repair:
    """Return the repair of bodies whose known links are described so many times too heavy."""
    unknown = {each.name for each in kernel.unknown}
    links = [link.name for link in kernel.model.links if link.body in bodies and link.parameters[0] > 0.0]
    factors = {name: 1.0 / unit for name in links if name not in unknown}
    return Repair(f'{described} {unit:g} times as heavy as it is', conversion=Conversion(masses=factors))


def _density(parameters: Array) -> float:
    """Return the density of the solid ellipsoid with a link's (10,) standard parameters; infinite for a plate."""
    inertia = unvec(physical(parameters)[4:])
    second = (0.5 * np.trace(inertia) * np.eye(3) - inertia) / parameters[0]
    volume = 4.0 / 3.0 * np.pi * np.sqrt(max(float(np.linalg.det(5.0 * second)), 0.0))
    return float(parameters[0] / volume) if volume > 0.0 else np.inf


def impossible(model: RobotModel) -> tuple[str, Repair | None]:
    """Return which link has an inertia that no body of its mass and the robot's size has; an empty text if none.

    Where all are far smaller than the robot, its lengths are in millimetres, and a repair converts them.
    """
    masses = np.array([link.parameters[0] for link in model.links])
    lengths = np.linalg.norm(model.positions, axis=1)
    size, largest = max(float(np.sum(lengths)), 0.1), 0.0
    for link, mass in zip(model.links, masses.tolist(), strict=True):
        if mass <= 0.0 or mass < _HEAVY * float(masses.sum()):
            continue
        offset = link.parameters[1:4] / mass
        trace = float(link.parameters[[4, 7, 9]].sum() - 2.0 * mass * offset @ offset)  # of the inertia about the CoM
        if trace <= 1e-12 * mass:
            return f"link '{link.name}' has {mass:.4g} kg and no inertia: correct it in the robot description", None
        radius = float(np.sqrt(0.5 * trace / mass))
        if radius > _REACH * size:
            text = (
                f"link '{link.name}' has {mass:.4g} kg and the inertia of a body of {radius:.3g} m: correct its "
                '<inertia> in the robot description'
            )
            return text, None
        largest = max(largest, radius)
    if np.max(lengths, initial=0.0) <= _SLENDER * largest:
        return '', None
    name = model.joint_names[int(np.argmax(lengths))]
    text = (
        f'{name} is {np.max(lengths):.3g} m from its parent, and no link has the inertia of a body of more than '
        f'{largest:.2g} m: lengths in millimetres? Correct the robot description'
    )
    return text, Repair('the robot description is in millimetres', conversion=Conversion(lengths=_MILLIMETRE))


def declared_errors(kernel: MomentumKernel, config: KnownLinksConfig) -> KnownErrors:
    """Return the errors that the parameters declare, body by body.

    Raises ParameterError: A name is not that of a known link with mass.
    """
    unknown = {link.name for link in kernel.unknown}
    massive = (link for link in kernel.model.links if link.parameters[0] > 0.0 and link.name not in unknown)
    bodies = {link.name: link.body for link in massive}
    own: dict[int, dict[str, float]] = {}
    for name, given in config.links.items():
        if name == kernel.target.name:
            continue  # it has a prior of its own
        if name not in bodies:
            raise ParameterError(
                f"parameter 'known_links.{name[:60]}' is of no known link with mass; accepted: {listing(bodies)}"
            )
        of_body = own.setdefault(bodies[name], {})
        if twice := sorted(set(of_body) & set(given)):
            raise ParameterError(
                f"parameter 'known_links.{name[:60]}.{twice[0]}' is given for another link of the same body, too; "
                'accepted: one of them'
            )
        of_body |= given
    deviations = {body: link_deviations(kernel.known[body], config, given) for body, given in own.items()}
    return independent_errors(kernel.known, config.relative_std, deviations)


def link_deviations(body: Array, config: KnownLinksConfig, given: Mapping[str, float]) -> BodyDeviations:
    """Return the declared deviations of a body (10,): those given by name, the others of the relative std."""
    every = BodyDeviations.from_relative(body, config.relative_std)
    return BodyDeviations(
        given.get('mass_relative_std', every.mass),
        given.get('com_std', every.com),
        given.get('inertia_relative_std', every.inertia),
    )
