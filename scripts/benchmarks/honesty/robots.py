"""Robot descriptions: servicer7 with errors or more parts, and robots of other shapes."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence

import numpy as np
import pinocchio

from benchmarks.data import model
from benchmarks.honesty.paths import ROBOT
from benchmarks.precapture import BARE_LINK7
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.body import physical, standard
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf import replace_inertial

Vector = Sequence[float] | Array
LINK, BASE = 'link7', 'base_link'
DIRECTION = np.array([1.0, -2.0, 2.0]) / 3.0  # of errors of a place or an orientation
_MATRIX = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # elements of an inertia


def servicer() -> str:
    """Return servicer7 with the target as part of its last link."""
    return model(ROBOT).urdf


def bare(urdf: str) -> str:
    """Return servicer7 without the target."""
    return replace_inertial(urdf, LINK, BARE_LINK7)


def body_of(urdf: str, link: str) -> Array:
    """Return the (10,) physical parameters of a link."""
    return physical(load_model(urdf).link(link).parameters)


def scaled(urdf: str, link: str, factor: float) -> str:
    """Return a robot with a link that is denser by a factor."""
    return replace_inertial(urdf, link, body_of(urdf, link) * np.where(np.isin(range(10), (1, 2, 3)), 1.0, factor))


def off_centre(distance: float, urdf: str) -> str:
    """Return a robot with its base's centre of mass displaced (m)."""
    return replace_inertial(urdf, BASE, body_of(urdf, BASE) + np.array([0.0, *distance * DIRECTION, *[0.0] * 6]))


def exchanged(urdf: str, one: str, other: str) -> str:
    """Return a robot with the inertials of two links exchanged."""
    return replace_inertial(replace_inertial(urdf, one, body_of(urdf, other)), other, body_of(urdf, one))


def in_millimetres(urdf: str) -> str:
    """Return a robot with all lengths in millimetres; its masses and inertias are right."""
    root = ET.fromstring(urdf)
    for origin in root.iter('origin'):
        origin.set('xyz', _text(1e3 * _numbers(origin.get('xyz', '0 0 0'))))
    return ET.tostring(root, encoding='unicode')


def reversed_axis(urdf: str, joint: str) -> str:
    """Return a robot with the axis of a joint reversed."""
    return _joint_changed(urdf, joint, 'axis', lambda axis: -axis)


def misplaced(joint: str, distance: float, urdf: str) -> str:
    """Return a robot with a joint displaced (m)."""
    return _joint_changed(urdf, joint, 'origin', lambda place: place + distance * DIRECTION)


def tilted(joint: str, angle: float, urdf: str) -> str:
    """Return a robot with the axis of a joint tilted (rad)."""

    def tilt(axis: Array) -> Array:
        across = np.cross(axis, DIRECTION)
        return np.asarray(exp(angle * across / np.linalg.norm(across)) @ axis)

    return _joint_changed(urdf, joint, 'axis', tilt)


def with_parts(urdf: str, parts: Sequence[str]) -> str:
    """Return a robot with more links and joints."""
    return urdf.replace('</robot>', f'{"".join(parts)}</robot>')


def with_panel(urdf: str) -> str:
    """Return a robot with a panel of 20 kg and 2.2 m on a hinge `panel_joint`."""
    panel = box(20.0, (0.9, 2.2, 0.03), (0.0, 1.1, 0.0))
    return with_parts(urdf, [part('panel', BASE, (-0.1, 0.6, 0.0), (1, 0, 0), panel, 'revolute')])


def locked(urdf: str, *names: str) -> str:
    """Return a robot whose links of `part` are taken as fixed."""
    for name in names:
        urdf = re.sub(f'name="{name}_joint" type="[a-z]+"', f'name="{name}_joint" type="fixed"', urdf)
    return urdf


def with_flexible_joint(urdf: str, joint: str) -> str:
    """Return a robot with a joint `flexible_joint` in series behind one of its joints, about the same axis."""
    root = ET.fromstring(urdf)
    child, axis = (_part(root, f"joint[@name='{joint}']/{name}") for name in ('child', 'axis'))
    far = child.get('link', '')
    child.set('link', 'rotor')
    along = _numbers(axis.get('xyz', '1 0 0'))
    parts = [_link('rotor', box(0.01, (0.05,) * 3)), _jointed('flexible_joint', 'revolute', ('rotor', far), along)]
    return with_parts(ET.tostring(root, encoding='unicode'), parts)


def part(name: str, parent: str, place: Vector, axis: Vector, body: Array, kind: str) -> str:
    """Return a link and the joint <name>_joint, placed in the parent's frame with its axes; the body in its own."""
    return _link(name, body) + _jointed(f'{name}_joint', kind, (parent, name), axis, place)


def box(mass: float, size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """Return the (10,) physical parameters of a box with its sides (m) along the axes."""
    x, y, z = (nominal * nominal for nominal in size)
    moments = mass / 12.0 * np.array([y + z, x + z, x + y])
    return np.array([mass, *centre, moments[0], 0.0, 0.0, moments[1], 0.0, moments[2]])


def chain(axes: Sequence[Sequence[float]], slides: Sequence[int] = (), *, folded: bool = False) -> str:
    """Return a satellite of 400 kg with an arm of equal links, some joints prismatic, that holds a body of 80 kg.

    All frames are parallel at zero; folded, all joints are on one line, so that equal axes are collinear.
    """
    base = '<robot name="chain"><link name="base_link"><inertial><origin xyz="0.02 -0.03 0.04"/><mass value="400"/>'
    base += '<inertia ixx="130" ixy="2" ixz="-3" iyy="110" iyz="1.5" izz="120"/></inertial></link></robot>'
    parts, parent, length = [], BASE, 3.0 / len(axes)
    step = (0.0, 0.0, length) if folded else (0.8 * length, 0.5 * length, 0.2 * length)
    for index, axis in enumerate(axes):
        body = box(40.0 / len(axes), (0.1, 0.12, length), tuple(0.5 * value for value in step))
        if index == len(axes) - 1:
            body = np.array([80.0, 0.25, -0.15, 0.4, 9.0, -1.1, 0.8, 12.0, -0.6, 10.0])
        place = (0.6, 0.1, 0.3) if index == 0 else step
        parts.append(part(f'arm{index}', parent, place, axis, body, 'prismatic' if index in slides else 'revolute'))
        parent = f'arm{index}'
    return with_parts(base, parts)


def held_apart(place: Sequence[float]) -> str:
    """Return servicer7 whose hand holds the target by an undeclared joint."""
    held = load_model(servicer()).link(LINK).parameters - standard(BARE_LINK7)
    moved = physical(held) - np.concatenate(([0.0], place, np.zeros(6)))
    return with_parts(bare(servicer()), [part('held', LINK, place, (1, 0, 0), moved, 'revolute')])


def slipped(place: Sequence[float], angle: float) -> Array:
    """Return the (10,) physical parameters of hand and target after the target has turned in the grasp (rad)."""
    body = body_of(held_apart(place), 'held')
    turned = pinocchio.SE3(exp(angle * np.array([1.0, 0.0, 0.0])), np.array(place))
    hand, held = (pinocchio.Inertia(each[0], each[1:4], each[4:][_MATRIX]) for each in (BARE_LINK7, body))
    own = hand + held.se3Action(turned)
    return np.concatenate(([own.mass], own.lever, own.inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]))


def _link(name: str, body: Array) -> str:
    names = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
    inertia = ' '.join(f'{key}="{value!r}"' for key, value in zip(names, body[4:].tolist(), strict=True))
    inertial = f'<origin xyz="{_text(body[1:4])}"/><mass value="{float(body[0])!r}"/><inertia {inertia}/>'
    return f'<link name="{name}"><inertial>{inertial}</inertial></link>'


def _jointed(name: str, kind: str, links: tuple[str, str], axis: Vector, place: Vector = (0.0, 0.0, 0.0)) -> str:
    limit = '' if kind == 'continuous' else '<limit lower="-3" upper="3" effort="100" velocity="10"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{links[0]}"/><child link="{links[1]}"/>'
        f'<origin xyz="{_text(place)}"/><axis xyz="{_text(axis)}"/>{limit}</joint>'
    )


def _part(element: ET.Element, name: str) -> ET.Element:
    found = element.find(name)
    assert found is not None, f'there is {name} in {element.tag}'
    return found


def _joint_changed(urdf: str, joint: str, name: str, change: Callable[[Array], Array]) -> str:
    root = ET.fromstring(urdf)
    changed = _part(root, f"joint[@name='{joint}']/{name}")
    changed.set('xyz', _text(change(_numbers(changed.get('xyz', '1 0 0' if name == 'axis' else '0 0 0')))))
    return ET.tostring(root, encoding='unicode')


def _numbers(text: str) -> Array:
    return np.array([float(value) for value in text.split()])


def _text(values: Vector) -> str:
    return ' '.join(repr(float(value)) for value in values)
