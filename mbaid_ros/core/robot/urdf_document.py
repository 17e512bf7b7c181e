"""A robot description as an XML document: checks before its contents are read, and the tree of its links."""

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
from typing import NoReturn
from xml.etree import ElementTree as ET

from mbaid_ros import limits
from mbaid_ros.core.errors import ModelError, listing

_LONGEST_REASON = 1_000  # characters: a line that is read
_XACRO = ('http://www.ros.org/wiki/xacro', 'http://ros.org/wiki/xacro', 'http://wiki.ros.org/xacro')
_VALUE = re.compile(r"""=\s*(?:"[^"<]*"|'[^'<]*')""")
_SPACES = str.maketrans('\n\r\t', '   ')
_EXPAND = 'expand it first: xacro robot.urdf.xacro > robot.urdf'


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
        refuse('the robot description holds a DOCTYPE or ENTITY declaration; plain URDF is accepted')
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


GROUND = 'world'  # the usual name of the root that a robot stands on
_LOOSE = ('floating', 'planar')  # joints that a robot floats on


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


_STDERR = 2  # descriptor of the stream that the parser complains on
_COMPLAINT = re.compile(r'^Error:\s+(.*)$', re.MULTILINE)
_MOST = 10_000  # bytes that are looked at: a broken file has no end of complaints
_one_at_a_time = threading.Lock()


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
