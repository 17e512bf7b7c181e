"""A robot description as an XML document: what it must be before anything in it is looked at."""

from __future__ import annotations

import re
from collections import Counter
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

    Raises
    ------
    ModelError
        The document is not XML, not a robot, a xacro that has not been expanded, or larger than what is taken.
    """
    if len(text) > limits.URDF_CHARACTERS:
        refuse(f'robot description of {len(text)} characters; at most {limits.URDF_CHARACTERS} are accepted')
    if '<!DOCTYPE' in text or '<!ENTITY' in text:
        refuse('the robot description holds a DOCTYPE or ENTITY declaration; plain URDF is accepted')
    try:
        robot = ET.fromstring(text)
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
    """Refuse what pinocchio's parser takes minutes for: it looks at all attributes of an element for each of them."""
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
    """Refuse what xacro would have replaced, where it stands in the robot itself: links, joints and what is in them."""
    for element in robot.iter():
        found = [f'{{{space}}}' for space in _XACRO if element.tag.startswith(f'{{{space}}}')]
        if found:
            refuse(f'the robot description is a xacro (xacro:{element.tag[len(found[0]) :][:40]}); {_EXPAND}')
    for part in (*robot.findall('link'), *robot.findall('joint')):
        for element in part.iter():
            for value in element.attrib.values():
                if '${' in value or '$(' in value:
                    refuse(f"the robot description is a xacro (<{element.tag}> has '{value[:60]}'); {_EXPAND}")
