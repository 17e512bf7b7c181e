"""The checks a robot description must pass before pinocchio reads it, and the inertia of each single link.

Pinocchio merges the links that fixed joints join; the inertia of one of them alone is read here.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import NoReturn
from xml.etree import ElementTree as ET

from mbaid_ros import limits
from mbaid_ros.core.errors import ModelError, listing

SUPPORTED_JOINTS = ('revolute', 'continuous', 'prismatic', 'fixed')
_LONGEST_REASON = 1_000


@dataclass(frozen=True)
class Inertial:
    """A link's <inertial>: mass (kg), origin (m, rad), inertia (xx, xy, xz, yy, yz, zz) about the CoM (kg m^2)."""

    mass: float
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    inertia: tuple[float, ...]


def read_inertials(text: str) -> dict[str, Inertial]:
    """Return the inertials of a URDF's links, after checking that it is a free-floating tree with physical masses.

    Parameters
    ----------
    text : str
        The URDF document.

    Returns
    -------
    dict
        By link name; links without <inertial> are not in it.

    Raises
    ------
    ModelError
        The document is not XML, not a robot, not a tree, fixed to the world, or has an unsupported joint or mass.
    """
    robot = _parse(text)
    links = _names(robot, 'link')
    if not links:
        _refuse('the robot description has no <link>')
    if len(links) > limits.LINKS:
        _refuse(f'the robot description has {len(links)} links; at most {limits.LINKS} are accepted')
    _names(robot, 'joint')
    parents = _check_joints(robot, set(links))
    roots = [name for name in links if name not in parents]
    tied = set(links) - _descendants(roots, parents)
    if tied:
        _refuse(f'joints tie links in a loop: {listing(sorted(tied))}; the robot must be a tree')
    if len(roots) != 1:
        _refuse(f'the robot description must have one root link, not {len(roots)}: {listing(roots)}')
    if roots[0] == 'world':
        _refuse("root link 'world' fixes the robot to the ground; the base must float: remove 'world' and its joint")
    inertials = {link.get('name', ''): _inertial(link) for link in robot.findall('link')}
    return {name: inertial for name, inertial in inertials.items() if inertial is not None}


def _refuse(reason: str) -> NoReturn:
    line = ' '.join(reason[: 2 * _LONGEST_REASON].split())
    raise ModelError(line if len(line) <= _LONGEST_REASON else f'{line[: _LONGEST_REASON - 3]}...')


def _parse(text: str) -> ET.Element:
    if len(text) > limits.URDF_CHARACTERS:
        _refuse(f'robot description of {len(text)} characters; at most {limits.URDF_CHARACTERS} are accepted')
    if '<!DOCTYPE' in text or '<!ENTITY' in text:
        _refuse('the robot description holds a DOCTYPE or ENTITY declaration; plain URDF is accepted')
    try:
        robot = ET.fromstring(text)
    except (ET.ParseError, UnicodeEncodeError) as error:
        raise ModelError(f'the robot description is not valid XML: {error}') from error
    _check_size(robot)
    if robot.tag != 'robot':
        _refuse(f"the robot description's root element is <{robot.tag}>; <robot> is accepted")
    if not robot.get('name'):
        _refuse('the robot description gives <robot> no name')
    return robot


def _check_size(robot: ET.Element) -> None:
    """Refuse what pinocchio's parser takes minutes for: it looks at all attributes of an element for each of them."""
    level, count, depth = [robot], 0, 0
    while level:
        count, depth = count + len(level), depth + 1
        if count > limits.URDF_ELEMENTS:
            _refuse(f'the robot description has more than {limits.URDF_ELEMENTS} elements, which is the limit')
        if depth > limits.URDF_DEPTH:
            _refuse(f'the robot description nests elements more than {limits.URDF_DEPTH} deep, which is the limit')
        for element in level:
            if len(element.attrib) > limits.ELEMENT_ATTRIBUTES:
                _refuse(
                    f'an element <{element.tag[:40]}> has {len(element.attrib)} attributes; at most '
                    f'{limits.ELEMENT_ATTRIBUTES} are accepted'
                )
        level = [child for element in level for child in element]


def _names(robot: ET.Element, kind: str) -> list[str]:
    """Return the names of the elements of a kind, each there and given once."""
    names = [element.get('name', '') for element in robot.findall(kind)]
    if '' in names:
        _refuse(f'a <{kind}> has no name')
    longest = max(names, key=len, default='')
    if len(longest) > limits.NAME_CHARACTERS:
        _refuse(
            f"{kind} '{longest[:40]}...' has a name of {len(longest)} characters; at most "
            f'{limits.NAME_CHARACTERS} are accepted'
        )
    duplicates = sorted(name for name, count in Counter(names).items() if count > 1)
    if duplicates:
        _refuse(f'{kind} names given twice: {listing(duplicates)}')
    return names


def _descendants(roots: list[str], parents: dict[str, str]) -> set[str]:
    children: dict[str, list[str]] = {}
    for child, parent in parents.items():
        children.setdefault(parent, []).append(child)
    reached, waiting = set(roots), list(roots)
    while waiting:
        new = children.get(waiting.pop(), [])
        reached.update(new)
        waiting += new
    return reached


def _check_joints(robot: ET.Element, links: set[str]) -> dict[str, str]:
    """Return the parent link of every child link."""
    parents: dict[str, str] = {}
    for joint in robot.findall('joint'):
        name = joint.get('name', '')
        kind = joint.get('type', '')
        if kind not in SUPPORTED_JOINTS:
            _refuse(f"joint '{name}' is of type '{kind}'; accepted are {listing(SUPPORTED_JOINTS)}")
        if joint.find('mimic') is not None:
            _refuse(f"joint '{name}' mimics another; only independent joints are accepted")
        _check_placement(joint, f"joint '{name}' has", kind)
        ends = {}
        for role in ('parent', 'child'):
            element = joint.find(role)
            ends[role] = element.get('link', '') if element is not None else ''
            if ends[role] not in links:
                _refuse(f"joint '{name}' names {role} link '{ends[role]}', which is not defined")
        if ends['child'] in parents:
            _refuse(f"link '{ends['child']}' has two parent joints; the robot must be a tree")
        parents[ends['child']] = ends['parent']
    return parents


def _check_placement(joint: ET.Element, what: str, kind: str) -> None:
    """Check the numbers that pinocchio's parser would refuse without a word on where they stand."""
    for key in ('xyz', 'rpy'):
        _triple(f'{what} origin', joint.find('origin'), key)
    if kind == 'fixed':
        return
    axis = joint.find('axis')
    if not any(_triple(f'{what} axis', axis, 'xyz', '1 0 0')):
        _refuse(f'{what} an axis of length zero')
    if kind in {'revolute', 'prismatic'}:
        for key in ('effort', 'velocity'):
            _number(f'{what} limit', joint.find('limit'), key)


def _inertial(link: ET.Element) -> Inertial | None:
    inertial = link.find('inertial')
    if inertial is None:
        return None
    what = f"link '{link.get('name', '')}' has"
    mass = _quantity(what, inertial.find('mass'), 'value', 'mass')
    if mass <= 0.0:
        _refuse(f'{what} mass {mass:g} kg; a number above 0 is accepted (leave out <inertial> for none)')
    origin = inertial.find('origin')
    inertia = inertial.find('inertia')
    return Inertial(
        mass=mass,
        xyz=_triple(f'{what} inertial origin', origin, 'xyz'),
        rpy=_triple(f'{what} inertial origin', origin, 'rpy'),
        inertia=tuple(_quantity(what, inertia, key) for key in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')),
    )


def _number(what: str, element: ET.Element | None, key: str, name: str = '') -> float:
    text = element.get(key, '') if element is not None else ''
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        _refuse(f"{what} {name or key} '{text}'; a finite number is accepted")
    return value


def _quantity(what: str, element: ET.Element | None, key: str, name: str = '') -> float:
    value = _number(what, element, key, name)
    if abs(value) > limits.QUANTITY:
        _refuse(f'{what} {name or key} {value:g}; at most {limits.QUANTITY:g} is accepted')
    return value


def _triple(what: str, element: ET.Element | None, key: str, default: str = '0 0 0') -> tuple[float, ...]:
    text = element.get(key, default) if element is not None else default
    try:
        values = tuple(float(part) for part in text.split())
    except ValueError:
        values = ()
    if len(values) != 3 or not all(map(math.isfinite, values)):
        _refuse(f"{what} {key} '{text}'; three finite numbers are accepted")
    if max(map(abs, values)) > limits.LENGTH:
        _refuse(f"{what} {key} '{text}'; numbers up to {limits.LENGTH:g} are accepted")
    return values
