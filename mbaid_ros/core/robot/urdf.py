"""The robot description as a document: limits, links and joints, refusals, and new numbers written into it."""

from __future__ import annotations

import math
import os
import re
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NoReturn
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt
import pinocchio

from mbaid_ros import limits
from mbaid_ros.core.geometry import Array, exp, skew, unvec, vec
from mbaid_ros.errors import ModelError, listing

_LONGEST_REASON = 1_000  # characters: a line that is read
_XACRO = ('http://www.ros.org/wiki/xacro', 'http://ros.org/wiki/xacro', 'http://wiki.ros.org/xacro')
_VALUE = re.compile(r"""=\s*(?:"[^"<]*"|'[^'<]*')""")
_SPACES = str.maketrans('\n\r\t', '   ')
_EXPAND = 'expand it first: xacro robot.urdf.xacro > robot.urdf'
GROUND = 'world'  # the usual name of the root that a robot stands on
_LOOSE = ('floating', 'planar')  # joints that a robot floats on
_STDERR = 2  # descriptor of the stream that the parser complains on
_COMPLAINT = re.compile(r'^Error:\s+(.*)$', re.MULTILINE)
_MOST = 10_000  # bytes that are looked at: a broken file has no end of complaints
_INERTIA = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
# How the tensors of a description may be meant otherwise than about the centres of mass, in the inertials' axes.
InertiaMeaning = Literal['as read', 'about the origins', 'opposite products', 'not turned']
_one_at_a_time = threading.Lock()
SUPPORTED_JOINTS = ('revolute', 'continuous', 'prismatic', 'fixed')


def refuse(reason: str) -> NoReturn:
    """Raise a ModelError with one line of bounded length."""
    line = ' '.join(reason[: 2 * _LONGEST_REASON].split())
    raise ModelError(line if len(line) <= _LONGEST_REASON else f'{line[: _LONGEST_REASON - 3]}...')


def parse_document(text: str) -> ET.Element:
    """Return the <robot> of a URDF.

    Raises ModelError: The document is not XML, not a robot, a xacro that has not been expanded, or larger than the
    limit.
    """
    if len(text) > limits.URDF_CHARACTERS:
        refuse(f'robot description of {len(text)} characters; at most {limits.URDF_CHARACTERS} are accepted')
    if '<!DOCTYPE' in text or '<!ENTITY' in text:
        refuse('the robot description contains a DOCTYPE or ENTITY declaration; plain URDF is accepted')
    try:
        robot = tree_of(text)
    except (ET.ParseError, UnicodeEncodeError) as error:
        if '<xacro:' in text:
            refuse(f'the robot description is a xacro ({error}); {_EXPAND}')
        raise ModelError(f'the robot description is not valid XML: {error}') from error
    _check_size(robot)
    if robot.tag != 'robot':
        refuse(f"the robot description's root element is <{robot.tag}>; <robot> is accepted")
    _refuse_xacro(robot)
    if not robot.get('name'):
        refuse('the robot description gives <robot> no name')
    return robot


def tree_of(text: str, *, comments: bool = False) -> ET.Element:
    """Return the root of an XML document, its elements and their kin without the namespace that is its default.

    With comments inside the root, if asked for.

    Raises ParseError, UnicodeEncodeError: It is not XML.
    """
    root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=comments)))
    if root.tag.startswith('{'):
        space = root.tag[: root.tag.index('}') + 1]
        for element in root.iter():
            if isinstance(element.tag, str):
                element.tag = element.tag.removeprefix(space)
    return root


def on_one_line(text: str) -> str:
    """Return a document with the line breaks and tabs in its attributes as spaces: as XML has them, pinocchio not."""
    return _VALUE.sub(lambda value: value[0].replace('\r\n', '\n').translate(_SPACES), text)


def names_of(robot: ET.Element, kind: str) -> list[str]:
    """Return the names of the elements of a kind, each there and given once."""
    names = [element.get('name', '') for element in robot.findall(kind)]
    if '' in names:
        refuse(f'a <{kind}> has no name')
    longest = max(names, key=len, default='')
    if len(longest) > limits.NAME_CHARACTERS:
        refuse(
            f"{kind} '{longest[:40]}...' has a name of {len(longest)} characters; at most "
            f'{limits.NAME_CHARACTERS} are accepted'
        )
    duplicates = sorted(name for name, count in Counter(names).items() if count > 1)
    if duplicates:
        refuse(f'{kind} names given twice: {listing(duplicates)}')
    return names


def _check_size(robot: ET.Element) -> None:
    """Refuse elements that take pinocchio's parser minutes: it reads all attributes again for each of them."""
    level, count, depth = [robot], 0, 0
    while level:
        count, depth = count + len(level), depth + 1
        if count > limits.URDF_ELEMENTS:
            refuse(f'the robot description has more than {limits.URDF_ELEMENTS} elements, which is the limit')
        if depth > limits.URDF_DEPTH:
            refuse(f'the robot description nests elements more than {limits.URDF_DEPTH} deep, which is the limit')
        for element in level:
            if len(element.attrib) > limits.ELEMENT_ATTRIBUTES:
                refuse(
                    f'an element <{element.tag[:40]}> has {len(element.attrib)} attributes; at most '
                    f'{limits.ELEMENT_ATTRIBUTES} are accepted'
                )
        level = [child for element in level for child in element]


def _refuse_xacro(robot: ET.Element) -> None:
    """Refuse expressions that xacro would have replaced in the robot itself: in links, joints and their children."""
    for element in robot.iter():
        found = [f'{{{space}}}' for space in _XACRO if element.tag.startswith(f'{{{space}}}')]
        if found:
            refuse(f'the robot description is a xacro (xacro:{element.tag[len(found[0]) :][:40]}); {_EXPAND}')
    for part in (*robot.findall('link'), *robot.findall('joint')):
        for element in part.iter():
            for value in element.attrib.values():
                if '${' in value or '$(' in value:
                    refuse(f"the robot description is a xacro (<{element.tag}> has '{value[:60]}'); {_EXPAND}")


def number(what: str, element: ET.Element | None, key: str, name: str = '') -> float:
    """Return the finite number that an attribute holds."""
    text = element.get(key, '') if element is not None else ''
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        refuse(f"{what} {name or key} '{text}'; a finite number is accepted")
    return value


def number_or(default: float, what: str, element: ET.Element | None, key: str) -> float:
    """Return the finite number that an attribute holds, a default where it is not there."""
    return number(what, element, key) if element is not None and key in element.attrib else default


def quantity(what: str, element: ET.Element | None, key: str, name: str = '') -> float:
    """Return a number of bounded size: a mass, or an element of an inertia."""
    value = number(what, element, key, name)
    if abs(value) > limits.QUANTITY:
        refuse(f'{what} {name or key} {value:g}; at most {limits.QUANTITY:g} is accepted')
    return value


def triple(what: str, element: ET.Element | None, key: str, default: str = '0 0 0') -> tuple[float, ...]:
    """Return three numbers of bounded size, the default's where the attribute is not there."""
    text = element.get(key, default) if element is not None else default
    try:
        values = tuple(float(part) for part in text.split())
    except ValueError:
        values = ()
    if len(values) != 3 or not all(map(math.isfinite, values)):
        refuse(f"{what} {key} '{text}'; three finite numbers are accepted")
    if max(map(abs, values)) > limits.LENGTH:
        refuse(f"{what} {key} '{text}'; numbers up to {limits.LENGTH:g} are accepted")
    return values


@dataclass(frozen=True)
class Branch:
    """The joint that carries a link: its name and type, and the name of the parent link."""

    joint: str
    joint_type: str
    parent: str


def read_tree(robot: ET.Element, links: Sequence[str]) -> tuple[dict[str, Branch], list[str]]:
    """Return the branch of each carried link, and the problems with the joints' ends."""
    known, branches, problems = set(links), dict[str, Branch](), list[str]()
    for joint in robot.findall('joint'):
        name = joint.get('name', '')
        ends = {}
        for role in ('parent', 'child'):
            element = joint.find(role)
            ends[role] = element.get('link', '') if element is not None else ''
            if ends[role] not in known:
                problems.append(f"joint '{name}' names {role} link '{ends[role]}', which is not defined")
        if ends['child'] in branches:
            problems.append(f"link '{ends['child']}' has two parent joints; the robot must be a tree")
        branches[ends['child']] = Branch(name, joint.get('type', ''), ends['parent'])
    return branches, problems


def floating_link(links: Sequence[str], branches: Mapping[str, Branch], massive: set[str], wanted: str) -> str:
    """Return the link that floats: the wanted one, or else the root, or the link on a ground without mass.

    ModelError if there is no such link, no tree, or nothing that floats.

    Parameters
    ----------
    links : names, in the order of the document
    branches : the joint that carries each link
    massive : names of the links that have mass
    wanted : name of a link; empty for none
    """
    roots = [name for name in links if name not in branches]
    tied = set(links).difference(*(subtree_links(root, branches) for root in roots))
    if tied:
        refuse(f'joints tie links in a loop: {listing(sorted(tied))}; the robot must be a tree')
    if wanted:
        if wanted not in links:
            refuse(f"parameter 'base_link' is '{wanted[:60]}', which is no link; links: {listing(links)}")
        return wanted
    if len(roots) != 1:
        refuse(
            f'the robot description must have one root link, not {len(roots)}: {listing(roots)}; name the one that '
            'floats by parameter base_link'
        )
    return _off_the_ground(roots[0], branches, massive)


def subtree_links(base: str, branches: Mapping[str, Branch]) -> set[str]:
    """Return a link and all that it carries."""
    children: dict[str, list[str]] = {}
    for child, branch in branches.items():
        children.setdefault(branch.parent, []).append(child)
    reached, waiting = {base}, [base]
    while waiting:
        new = [child for child in children.get(waiting.pop(), []) if child not in reached]
        reached.update(new)
        waiting += new
    return reached


def _off_the_ground(root: str, branches: Mapping[str, Branch], massive: set[str]) -> str:
    """Return the root, or the link that it carries if the root is the ground that the robot floats over."""
    on = {child: branch for child, branch in branches.items() if branch.parent == root}
    loose = root not in massive and len(on) == 1 and next(iter(on.values())).joint_type in _LOOSE
    if root != GROUND and not loose:
        return root
    if len(on) != 1:
        refuse(
            f"root link '{root}' carries {listing(on)}; one of them floats, or the link that parameter base_link names"
        )
    child, branch = next(iter(on.items()))
    if branch.joint_type not in {'fixed', *_LOOSE}:
        refuse(
            f"joint '{branch.joint}' ties '{child}' to root link '{root}' by a {branch.joint_type} joint; accepted: a "
            'fixed or floating one, or parameter base_link with the link that floats'
        )
    return child


@contextmanager
def captured_stderr(complaints: list[str]) -> Iterator[None]:
    """Capture the lines that C++ code writes on stderr during a block, and add its complaints to a list, in order."""
    with _one_at_a_time:
        try:
            usual = os.dup(_STDERR)
        except OSError:  # a process without stderr has nothing to keep clean
            yield
            return
        with tempfile.TemporaryFile() as kept:
            with suppress(AttributeError):  # no stream of Python's, as under pythonw
                sys.stderr.flush()
            os.dup2(kept.fileno(), _STDERR)
            try:
                yield
            finally:
                os.dup2(usual, _STDERR)
                os.close(usual)
                kept.seek(0)
                complaints += _COMPLAINT.findall(kept.read(_MOST).decode(errors='replace'))


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

    @property
    def followers(self) -> tuple[int, ...]:
        """Indices of the joints that mimic others."""
        return tuple(np.setdiff1d(np.arange(len(self.driver)), self.independent).tolist())

    @property
    def leaders(self) -> npt.NDArray[np.intp]:
        """Index (n,) of the independent joint that moves each joint: of an independent one its own."""
        return np.asarray(self.independent[self.driver])

    @cached_property
    def errors(self) -> Array:
        """How much each joint (row) is off by an error of each (column), (n, n): followers with their leaders."""
        followers = list(self.followers)
        found = self._following.copy()
        found[followers, followers] = 1.0  # by their own
        return found

    @cached_property
    def _following(self) -> Array:
        """How much each joint (row) moves by each that is read (column), (n, n)."""
        found = np.zeros((len(self.driver), len(self.driver)))
        found[np.arange(len(self.driver)), self.leaders] = self.multiplier
        return found

    def positions(self, values: Array) -> Array:
        """Return the positions (..., n) of all joints at those (..., k) of the independent ones."""
        return values if self.direct else values[..., self.driver] * self.multiplier + self.offset

    def by_noise(self, deviation: Array, columns: Array) -> Array:
        """Return columns (..., n) by joints, times the deviation (..., n or 1) of each joint's reading.

        The columns of followers are in those of the joint that is read.
        """
        if self.direct:
            return np.asarray(deviation * columns)
        each = self.leaders if deviation.shape[-1] > 1 else [0]
        return np.asarray((deviation[..., each] * columns) @ self._following)

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


def displace_joint(urdf: str, joint: str, origin: Array, tilt: Array) -> str:
    """Return a URDF in which one joint's frame is displaced: origin (3,) m and rotation vector (3,) rad, in that frame.

    The <axis> stays as it is, in the turned frame.

    Raises ModelError: The document has no such joint.
    """
    if not (np.any(origin) or np.any(tilt)):
        return urdf
    robot = tree_of(urdf, comments=True)
    written = _part(robot, 'joint', joint, 'origin')
    xyz, rpy = (np.array([float(x) for x in written.get(key, '0 0 0').split()]) for key in ('xyz', 'rpy'))
    rotation = pinocchio.rpy.rpyToMatrix(*rpy)
    written.set('xyz', _numbers(xyz + rotation @ origin))
    written.set('rpy', _numbers(pinocchio.rpy.matrixToRpy(rotation @ exp(tilt)) if np.any(tilt) else rpy))
    return ET.tostring(robot, encoding='unicode')


def replace_inertial(urdf: str, link: str, parameters: Array) -> str:
    """Return a URDF in which one link's <inertial> is replaced, or added, by (10,) parameters (m, r_c, I_c).

    r_c is in the link's frame, I_c about it in the link's axes. Comments and all other elements stay.

    Raises ModelError: The document has no such link.
    """
    robot = tree_of(urdf, comments=True)
    inertial = _part(robot, 'link', link, 'inertial')
    behind = inertial.tail
    inertial.clear()
    ET.SubElement(inertial, 'origin', xyz=_numbers(parameters[1:4]), rpy='0 0 0')
    ET.SubElement(inertial, 'mass', value=_numbers(parameters[:1]))
    ET.SubElement(inertial, 'inertia', {key: _numbers(parameters[4 + k : 5 + k]) for k, key in enumerate(_INERTIA)})
    ET.indent(inertial, level=2)
    inertial.tail = behind
    return ET.tostring(robot, encoding='unicode')


def scale_inertials(urdf: str, factors: Mapping[str, float]) -> str:
    """Return a URDF with the masses and inertias of links multiplied by factors, by name.

    Raises ModelError: The document has no such link.
    """
    robot = tree_of(urdf, comments=True)
    for link, factor in factors.items():
        inertial = _part(robot, 'link', link, 'inertial')
        for element in (*inertial.findall('mass'), *inertial.findall('inertia')):
            for key, value in element.attrib.items():
                element.set(key, repr(factor * float(value)))
    return ET.tostring(robot, encoding='unicode')


def with_inertias(urdf: str, meaning: InertiaMeaning) -> str:
    """Return a URDF with all tensors about the centres of mass, in the axes of the inertials, that it has otherwise."""
    robot = tree_of(urdf, comments=True)
    for inertial in robot.findall('link/inertial'):
        written, origin, mass = (inertial.find(part) for part in ('inertia', 'origin', 'mass'))
        if written is None or mass is None:
            continue
        read = np.array([float(written.get(key, '0')) for key in _INERTIA])
        offset, turn = (
            np.array([float(x) for x in ('0 0 0' if origin is None else origin.get(key, '0 0 0')).split()])
            for key in ('xyz', 'rpy')
        )
        axes = pinocchio.rpy.rpyToMatrix(*turn)
        if meaning == 'opposite products':
            meant = np.where(np.isin(np.arange(6), (1, 2, 4)), -read, read)
        elif meaning == 'not turned':
            meant = vec(axes.T @ unvec(read) @ axes)
        else:  # I_c = I_o + m [c]x [c]x, in the axes of the inertial
            lever = skew(axes.T @ offset)
            meant = read + float(mass.get('value', '0')) * vec(lever @ lever)
        for key, value in zip(_INERTIA, meant.tolist(), strict=True):
            written.set(key, repr(value))
    return ET.tostring(robot, encoding='unicode')


def scale_lengths(urdf: str, factor: float) -> str:
    """Return a URDF with all its origins, of joints, inertials and shapes, a factor away."""
    robot = tree_of(urdf, comments=True)
    for origin in robot.iter('origin'):
        origin.set('xyz', ' '.join(repr(factor * float(value)) for value in origin.get('xyz', '0 0 0').split()))
    return ET.tostring(robot, encoding='unicode')


def _part(robot: ET.Element, kind: str, name: str, part: str) -> ET.Element:
    """Return the part of a link or joint, added where there is none."""
    for element in robot.findall(kind):
        if element.get('name') == name:
            found = element.find(part)
            return ET.SubElement(element, part) if found is None else found
    raise ModelError(f"{kind} '{name}' is not in the robot description")


def _numbers(values: Array) -> str:
    """Return numbers as the shortest text that reads back as the same ones."""
    return ' '.join(map(repr, values.tolist()))
