"""A robot description with an identified link put in: everything else in it stays as it was written."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array

_INERTIAL = """\
<inertial>
  <origin xyz="{x} {y} {z}" rpy="0 0 0"/>
  <mass value="{m}"/>
  <inertia ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"/>
</inertial>"""


def replace_inertial(urdf: str, link: str, parameters: Array) -> str:
    """Return a URDF in which one link has the given inertia.

    Only the link's <inertial> is replaced (or added): comments, extensions and layout of the rest stay.

    Parameters
    ----------
    urdf : str
        A robot description that `load_model` accepts.
    link : str
        Name of the link.
    parameters : (10,) array
        Mass, centre of mass in the link's frame, inertia about it in the link's axes: kg, m, kg m^2.

    Raises
    ------
    ModelError
        The document is not XML or has no such link.
    """
    document = urdf.encode()
    place = _find(document, link)
    names = ('m', 'x', 'y', 'z', 'ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
    # repr is the shortest text that reads back as the same number.
    element = _INERTIAL.format(**{name: repr(float(value)) for name, value in zip(names, parameters, strict=True)})
    if place.inertial_end:
        indent = _indent(document, place.inertial_start)
        return _joined(document, place.inertial_start, element.replace('\n', '\n' + indent), place.inertial_end)
    outer = _indent(document, place.start)
    inner = outer + '  '
    text = f'\n{inner}' + element.replace('\n', '\n' + inner)
    if place.self_closing:  # <link name="x"/> has to be opened
        slash = document.rindex(b'/', place.start, place.content)
        return _joined(document, slash, f'>{text}\n{outer}</link>', place.content)
    return _joined(document, place.content, text, place.content)


def inertial_text(urdf: str, link: str) -> tuple[int, str]:
    """Return where in a URDF a link's <inertial> begins, and its text; empty where the link has none.

    Raises
    ------
    ModelError
        The document is not XML or has no such link.
    """
    document = urdf.encode()
    place = _find(document, link)
    text = document[place.inertial_start : place.inertial_end].decode() if place.inertial_end else ''
    return len(document[: place.inertial_start].decode()), text


def _joined(document: bytes, start: int, text: str, end: int) -> str:
    return (document[:start] + text.encode() + document[end:]).decode()


def _indent(document: bytes, position: int) -> str:
    """Return the white space that a line begins with, if nothing else stands before the position."""
    before = document[document.rfind(b'\n', 0, position) + 1 : position].decode()
    return before if not before.strip() else ''


@dataclass
class _Place:
    """Byte offsets of a link and of its <inertial>; an end of 0 is not found."""

    start: int = 0  # of <link ...>
    content: int = 0  # behind <link ...>
    end: int = 0  # behind </link>
    self_closing: bool = False
    inertial_start: int = 0
    inertial_end: int = 0
    path: list[str] = field(default_factory=list)


def _find(document: bytes, link: str) -> _Place:
    """Return where the link stands."""
    place = _Place()
    # The text is Unicode already: what its XML declaration says about an encoding no longer holds.
    parser = expat.ParserCreate('utf-8')

    def inside() -> bool:
        return bool(place.content) and not place.end

    def start(tag: str, attributes: dict[str, str]) -> None:
        place.path.append(tag)
        if place.path == ['robot', 'link'] and attributes.get('name') == link and not place.content:
            place.start = parser.CurrentByteIndex
            place.content = _end_of_tag(document, place.start)
            place.self_closing = document[place.content - 2 : place.content] == b'/>'
        elif place.path == ['robot', 'link', 'inertial'] and inside() and not place.inertial_end:
            place.inertial_start = parser.CurrentByteIndex

    def end(_tag: str) -> None:
        if place.path == ['robot', 'link', 'inertial'] and inside() and not place.inertial_end:
            opened = _end_of_tag(document, place.inertial_start)
            empty = document[opened - 2 : opened] == b'/>'
            place.inertial_end = opened if empty else _end_of_tag(document, parser.CurrentByteIndex)
        elif place.path == ['robot', 'link'] and inside():
            place.end = parser.CurrentByteIndex
        place.path.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(document, True)  # noqa: FBT003 - expat's own signature
    except expat.ExpatError as error:
        raise ModelError(f'the robot description is not valid XML: {error}') from error
    if not place.content:
        raise ModelError(f"link '{link}' is not in the robot description")
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
