"""A robot description: the tree of links and joints, the link that floats, and all numbers of the document."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt

from mbaid_ros import limits
from mbaid_ros.core.errors import ModelError, listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.urdf_document import (
    Branch,
    floating_link,
    names_of,
    number,
    number_or,
    parse_document,
    quantity,
    read_tree,
    refuse,
    subtree_links,
    triple,
)


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another (URDF's <mimic>): q = multiplier * q of the other + offset (rad or m)."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Transmission:
    """How the n joints of a robot follow k independent ones."""

    independent: npt.NDArray[np.intp]  # (k,) indices of these among all joints
    driver: npt.NDArray[np.intp]  # (n,) index among the independent joints of the one that moves each joint
    # multiplier, offset: (n,) 1 and 0 for an independent joint; offset in rad or m
    multiplier: Array
    offset: Array
    direct: bool  # whether every joint is independent

    def positions(self, values: Array) -> Array:
        """Return the positions (..., n) of all joints at those (..., k) of the independent ones."""
        return values if self.direct else values[..., self.driver] * self.multiplier + self.offset

    def rates(self, values: Array) -> Array:
        """Return the rates (..., n) of all joints at those (..., k) of the independent ones."""
        return values if self.direct else values[..., self.driver] * self.multiplier


def transmission(joints: Sequence[str], mimics: Mapping[str, Mimic]) -> Transmission:
    """Return how n joints, by name, follow each other; ModelError if one follows itself, or one that does not move."""
    independent = [place for place, name in enumerate(joints) if name not in mimics]
    place = {joints[index]: k for k, index in enumerate(independent)}
    driver, multiplier, offset = [], [], []
    for name in joints:
        leader, gain, shift = _driver_of(name, mimics, place)
        driver.append(place[leader])
        multiplier.append(gain)
        offset.append(shift)
    own, direct = np.array(independent, dtype=np.intp), len(independent) == len(driver)
    return Transmission(own, np.array(driver, dtype=np.intp), np.array(multiplier), np.array(offset), direct)


def _driver_of(name: str, mimics: Mapping[str, Mimic], independent: Mapping[str, int]) -> tuple[str, float, float]:
    """Return the independent joint that moves a joint in the end, the multiplier and the offset."""
    leader, gain, shift = name, 1.0, 0.0
    for _ in range(len(mimics) + 1):
        if leader in independent:
            return leader, gain, shift
        if leader not in mimics:
            raise ModelError(
                f"joint '{name}' mimics '{leader[:60]}', which is no joint that moves; accepted: a revolute, "
                'continuous or prismatic joint'
            )
        step = mimics[leader]
        leader, gain, shift = step.joint, gain * step.multiplier, shift + gain * step.offset
    raise ModelError(f"joint '{name}' mimics joints that mimic it; accepted: one that moves by itself")


SUPPORTED_JOINTS = ('revolute', 'continuous', 'prismatic', 'fixed')


@dataclass(frozen=True)
class Inertial:
    """A link's <inertial>: mass (kg), origin (m, rad), inertia (xx, xy, xz, yy, yz, zz) about the CoM (kg m^2)."""

    mass: float
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    inertia: tuple[float, ...]


@dataclass(frozen=True)
class Limit:
    """Range (rad or m), largest rate (rad/s or m/s) and effort (N m or N) of a joint; infinite where not given."""

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf


@dataclass(frozen=True)
class Description:
    """A robot that floats, as described by its document."""

    text: str  # the document without links that the floating one does not carry and without massless <inertial>s
    base_link: str  # the link that floats
    inertials: dict[str, Inertial]  # by link, of those with mass
    joints: tuple[str, ...]  # names of all joints of the document, fixed and dropped ones included
    mimics: dict[str, Mimic]  # by joint, of those that have one
    limits: dict[str, Limit]  # by joint, of those that move
    axes: dict[str, tuple[float, ...]]  # by joint, of those that move: directions of any length
    dropped: tuple[str, ...]  # a line, with the reason, for everything that is left out


def read_description(text: str, base_link: str = '') -> Description:
    """Return the description of a robot by the text of its URDF.

    `base_link` names the link that floats; empty means the root, or the link on a root 'world'.

    Raises ModelError: The document is not XML, not a robot, not a tree, tied to the ground, or has joints or masses
    that cannot be used; the message lists all problems.
    """
    robot = parse_document(text)
    links = names_of(robot, 'link')
    if not links:
        refuse('the robot description has no <link>')
    if len(links) > limits.LINKS:
        refuse(f'the robot description has {len(links)} links; at most {limits.LINKS} are accepted')
    joints = names_of(robot, 'joint')
    moving = sum(joint.get('type') in SUPPORTED_JOINTS[:-1] for joint in robot.findall('joint'))
    if moving > limits.MOVING_JOINTS:
        refuse(
            f'the robot description has {moving} joints that move; at most {limits.MOVING_JOINTS} are accepted: make '
            'those that rest fixed'
        )
    branches, problems = read_tree(robot, links)
    _refuse_all(problems)
    massive = {link.get('name', '') for link in robot.findall('link') if _claims_mass(link)}
    base = floating_link(links, branches, massive, base_link)
    dropped = _cut_off(robot, base, branches)
    inertials, massless = _inertials(robot, problems)
    mimics, bounds, axes = _joints(robot, problems)
    _refuse_all(problems)
    changed = bool(dropped) or massless
    return Description(
        text=ET.tostring(robot, encoding='unicode') if changed else text,
        base_link=base,
        inertials=inertials,
        joints=tuple(joints),
        mimics=mimics,
        limits=bounds,
        axes=axes,
        dropped=dropped,
    )


def _refuse_all(problems: list[str]) -> None:
    """Refuse a document with all its problems in one line."""
    if problems:
        count = f'the robot description has {len(problems)} problems: ' if len(problems) > 1 else ''
        refuse(count + '; '.join(problems))


@contextmanager
def _collected_problems(problems: list[str]) -> Iterator[None]:
    """Add a ModelError within the block to a list, and continue behind it."""
    try:
        yield
    except ModelError as error:
        problems.append(str(error))


def _claims_mass(link: ET.Element) -> bool:
    mass = link.find('inertial/mass')
    return mass is not None and mass.get('value', '').strip(' 0.+-') != ''


def _cut_off(robot: ET.Element, base: str, branches: dict[str, Branch]) -> tuple[str, ...]:
    """Remove everything that the floating link does not carry from a document; return a line about it."""
    kept = subtree_links(base, branches)
    links = [link for link in robot.findall('link') if link.get('name', '') not in kept]
    if not links:
        return ()
    names = {branch.joint for child, branch in branches.items() if child not in kept or child == base}
    for element in (*links, *(joint for joint in robot.findall('joint') if joint.get('name', '') in names)):
        robot.remove(element)
    gone = listing(link.get('name', '') for link in links)
    return (f"'{base}' floats; the robot description is used without the parts that it does not carry: {gone}",)


def _inertials(robot: ET.Element, problems: list[str]) -> tuple[dict[str, Inertial], bool]:
    """Return the inertials of the links that have mass, and whether others were removed."""
    inertials, massless = {}, False
    for link in robot.findall('link'):
        element = link.find('inertial')
        if element is None:
            continue
        with _collected_problems(problems):
            inertial = _inertial(link.get('name', ''), element)
            if inertial is None:
                link.remove(element)
                massless = True
            else:
                inertials[link.get('name', '')] = inertial
    return inertials, massless


def _inertial(name: str, inertial: ET.Element) -> Inertial | None:
    """Return an <inertial>, None if its mass is zero: many describe frames so."""
    what = f"link '{name}' has"
    mass = quantity(what, inertial.find('mass'), 'value', 'mass')
    if mass < 0.0:
        refuse(f'{what} mass {mass:g} kg; a number of 0 or above is accepted')
    if mass == 0.0:
        return None
    if mass < limits.LIGHTEST:
        refuse(f'{what} mass {mass:g} kg; 0 or at least {limits.LIGHTEST:g} kg is accepted')
    origin = inertial.find('origin')
    inertia = inertial.find('inertia')
    return Inertial(
        mass=mass,
        xyz=triple(f'{what} inertial origin', origin, 'xyz'),
        rpy=triple(f'{what} inertial origin', origin, 'rpy'),
        inertia=tuple(quantity(what, inertia, key) for key in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')),
    )


def _joints(
    robot: ET.Element, problems: list[str]
) -> tuple[dict[str, Mimic], dict[str, Limit], dict[str, tuple[float, ...]]]:
    """Return the mimics, limits and axes of the joints."""
    mimics, bounds, axes = {}, {}, {}
    for joint in robot.findall('joint'):
        name, kind = joint.get('name', ''), joint.get('type', '')
        with _collected_problems(problems):
            _check_kind(joint, name, kind)
            for key in ('xyz', 'rpy'):  # pinocchio's parser would refuse these without naming the joint
                triple(f"joint '{name}' has origin", joint.find('origin'), key)
            if kind == 'fixed':
                continue
            axes[name] = _axis(joint, f"joint '{name}' has")
            bounds[name] = _limit(joint, f"joint '{name}' has limit", kind)
            mimic = joint.find('mimic')
            if mimic is not None:
                what = f"joint '{name}' has mimic"
                gain, offset = number_or(1.0, what, mimic, 'multiplier'), number_or(0.0, what, mimic, 'offset')
                mimics[name] = Mimic(mimic.get('joint', ''), gain, offset)
    return mimics, bounds, axes


def _check_kind(joint: ET.Element, name: str, kind: str) -> None:
    if kind in SUPPORTED_JOINTS:
        return
    child = joint.find('child')
    advice = ''
    if kind in {'floating', 'planar'} and child is not None:
        advice = (
            f"; make it fixed, or let parameter base_link be '{child.get('link', '')}' if the robot floats from there"
        )
    refuse(f"joint '{name}' is of type '{kind}'; accepted are {listing(SUPPORTED_JOINTS)}{advice}")


def _axis(joint: ET.Element, what: str) -> tuple[float, ...]:
    axis = triple(f'{what} axis', joint.find('axis'), 'xyz', '1 0 0')
    if not any(axis):
        refuse(f'{what} an axis of length zero')
    return axis


def _limit(joint: ET.Element, what: str, kind: str) -> Limit:
    """Return a joint's limits; ignore ranges with lower >= upper, and rates and efforts <= 0."""
    limit = joint.find('limit')
    if kind in {'revolute', 'prismatic'}:
        for key in ('effort', 'velocity'):
            number(what, limit, key)
    elif limit is None:
        return Limit()
    lower, upper, *most = (number_or(0.0, what, limit, key) for key in ('lower', 'upper', 'velocity', 'effort'))
    velocity, effort = (each if each > 0.0 else math.inf for each in most)
    if kind == 'continuous' or lower >= upper:
        lower, upper = -math.inf, math.inf
    return Limit(lower, upper, velocity, effort)
