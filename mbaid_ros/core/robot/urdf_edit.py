"""New numbers in a link's <inertial>, everything else of it as it was written."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np
import pinocchio

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array, exp


def displace_joint(urdf: str, joint: str, origin: Array, tilt: Array) -> str:
    """Return a URDF in which one joint's frame is displaced: origin (3,) m and rotation vector (3,) rad, in that frame.

    The <axis> stays as it is, in the turned frame.

    Raises ModelError: The document is not XML or has no such joint.
    """
    if not (np.any(origin) or np.any(tilt)):
        return urdf
    start, old = part_text(urdf, joint, 'joint', 'origin')
    written = ET.fromstring(old) if old else ET.Element('origin')
    xyz, rpy = (np.array([float(x) for x in written.get(key, '0 0 0').split()]) for key in ('xyz', 'rpy'))
    rotation = pinocchio.rpy.rpyToMatrix(*rpy)
    place, turn = xyz + rotation @ origin, pinocchio.rpy.matrixToRpy(rotation @ exp(tilt)) if np.any(tilt) else rpy
    xyz_text, rpy_text = (' '.join(map(repr, each.tolist())) for each in (place, turn))
    return f'{urdf[:start]}<origin xyz="{xyz_text}" rpy="{rpy_text}"/>{urdf[start + len(old) :]}'


_INERTIAL = """\
<inertial>
  <origin xyz="{x} {y} {z}" rpy="0 0 0"/>
  <mass value="{m}"/>
  <inertia ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"/>
</inertial>"""


def replace_inertial(urdf: str, link: str, parameters: Array) -> str:
    """Return a URDF in which one link's <inertial> is replaced, or added, by (10,) parameters (m, r_c, I_c).

    r_c is in the link's frame, I_c about it in the link's axes; the rest of the document stays.

    Raises ModelError: The document is not XML or has no such link.
    """
    document = urdf.encode()
    place = _find(document, link, 'link', 'inertial')
    names = ('m', 'x', 'y', 'z', 'ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
    # repr is the shortest text that reads back as the same number.
    element = _INERTIAL.format(**{name: repr(float(value)) for name, value in zip(names, parameters, strict=True)})
    if place.part_end:
        indent = _indent(document, place.part_start)
        return _joined(document, place.part_start, element.replace('\n', '\n' + indent), place.part_end)
    outer = _indent(document, place.start)
    inner = outer + '  '
    text = f'\n{inner}' + element.replace('\n', '\n' + inner)
    if place.self_closing:  # <link name="x"/> has to be opened
        slash = document.rindex(b'/', place.start, place.content)
        return _joined(document, slash, f'>{text}\n{outer}</link>', place.content)
    return _joined(document, place.content, text, place.content)


def part_text(urdf: str, name: str, kind: str = 'link', part: str = 'inertial') -> tuple[int, str]:
    """Return where a link's <inertial>, or a joint's <origin>, begins or could begin, and its text, empty for none.

    Raises ModelError: The document is not XML or has no such link or joint.
    """
    document = urdf.encode()
    place = _find(document, name, kind, part)
    start = place.part_start if place.part_end else place.content
    text = document[start : place.part_end].decode() if place.part_end else ''
    return len(document[:start].decode()), text


def _joined(document: bytes, start: int, text: str, end: int) -> str:
    return (document[:start] + text.encode() + document[end:]).decode()


def _indent(document: bytes, position: int) -> str:
    """Return the white space at the beginning of a line, if nothing else precedes the position."""
    before = document[document.rfind(b'\n', 0, position) + 1 : position].decode()
    return before if not before.strip() else ''


@dataclass
class _Place:
    """Byte offsets of a link and its <inertial>, or of a joint and its <origin>; an end of 0 means not found."""

    start: int = 0  # of <link ...> or <joint ...>
    content: int = 0  # behind it
    end: int = 0  # behind </link> or </joint>
    self_closing: bool = False
    part_start: int = 0
    part_end: int = 0
    path: list[str] = field(default_factory=list)


def _find(document: bytes, name: str, kind: str, part: str) -> _Place:
    """Return the place of a link and its <inertial>, or of a joint and its <origin>."""
    place = _Place()
    # The text is Unicode already: the encoding in its XML declaration no longer holds.
    parser = expat.ParserCreate('utf-8')

    def inside() -> bool:
        return bool(place.content) and not place.end

    def start(tag: str, attributes: dict[str, str]) -> None:
        place.path.append(tag)
        if place.path == ['robot', kind] and attributes.get('name') == name and not place.content:
            place.start = parser.CurrentByteIndex
            place.content = _end_of_tag(document, place.start)
            place.self_closing = document[place.content - 2 : place.content] == b'/>'
        elif place.path == ['robot', kind, part] and inside() and not place.part_end:
            place.part_start = parser.CurrentByteIndex

    def end(_tag: str) -> None:
        if place.path == ['robot', kind, part] and inside() and not place.part_end:
            opened = _end_of_tag(document, place.part_start)
            empty = document[opened - 2 : opened] == b'/>'
            place.part_end = opened if empty else _end_of_tag(document, parser.CurrentByteIndex)
        elif place.path == ['robot', kind] and inside():
            place.end = parser.CurrentByteIndex
        place.path.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(document, True)  # noqa: FBT003 - expat's own signature
    except expat.ExpatError as error:
        raise ModelError(f'the robot description is not valid XML: {error}') from error
    if not place.content:
        raise ModelError(f"{kind} '{name}' is not in the robot description")
    return place


def _end_of_tag(document: bytes, start: int) -> int:
    """Return the offset behind the tag that begins at `start`; a quoted value may hold a '>'."""
    quote = 0
    for position in range(start, len(document)):
        char = document[position]
        if quote:
            quote = 0 if char == quote else quote
        elif char in b'"\'':
            quote = char
        elif char == ord('>'):
            return position + 1
    return len(document)
