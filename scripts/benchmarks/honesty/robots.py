"""Robot descriptions: servicer7 with something wrong or something more, and robots of other shapes."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np
import pinocchio

from benchmarks.data import model
from benchmarks.honesty.paths import ROBOT
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import physical, standard
from mbaid_ros.core.robot.urdf_edit import change_inertial

Vector = Sequence[float] | Array
LINK, BASE = 'link7', 'base_link'
DIRECTION = np.array([1.0, -2.0, 2.0]) / 3.0  # of errors of a place or an orientation
# The arm's own last link, in the table of servicer7.urdf.
BARE = np.array([7.0, 0.010, -0.015, 0.150, 0.070, 0.001, -0.003, 0.075, 0.002, 0.040])


def servicer() -> str:
    """Return servicer7 with the body that it holds as part of its last link."""
    return model(ROBOT).urdf


def scaled(urdf: str, link: str, factor: float) -> str:
    """Return a robot with a link that is denser by a factor."""
    body = physical(load_model(urdf).link(link).parameters)
    body[[0, 4, 5, 6, 7, 8, 9]] *= factor
    return change_inertial(urdf, link, body)


def off_centre(urdf: str, distance: float) -> str:
    """Return a robot with its base's centre of mass elsewhere (m)."""
    body = physical(load_model(urdf).link(BASE).parameters)
    body[1:4] += distance * DIRECTION
    return change_inertial(urdf, BASE, body)


def in_millimetres(urdf: str) -> str:
    """Return a robot whose every length is given in millimetres; its masses and inertias are right."""
    root = ET.fromstring(urdf)
    for origin in root.iter('origin'):
        origin.set('xyz', _text(1e3 * _numbers(origin.get('xyz', '0 0 0'))))
    return ET.tostring(root, encoding='unicode')


def reversed_axis(urdf: str, joint: str) -> str:
    """Return a robot with the axis of a joint the other way round."""
    root, element = _joint(urdf, joint)
    axis = element.find('axis')
    if axis is None:
        raise ValueError(f"joint '{joint}' has no axis")
    axis.set('xyz', _text(-_numbers(axis.get('xyz', '1 0 0'))))
    return ET.tostring(root, encoding='unicode')


def exchanged(urdf: str, one: str, other: str) -> str:
    """Return a robot with the inertials of two links in each other's place."""
    bodies = [physical(load_model(urdf).link(link).parameters) for link in (one, other)]
    return change_inertial(change_inertial(urdf, one, bodies[1]), other, bodies[0])


def misplaced(urdf: str, joint: str, distance: float) -> str:
    """Return a robot with a joint elsewhere (m)."""
    root, element = _joint(urdf, joint)
    origin = element.find('origin')
    if origin is None:
        raise ValueError(f"joint '{joint}' has no origin")
    origin.set('xyz', _text(_numbers(origin.get('xyz', '0 0 0')) + distance * DIRECTION))
    return ET.tostring(root, encoding='unicode')


def tilted(urdf: str, joint: str, angle: float) -> str:
    """Return a robot with the axis of a joint tilted (rad)."""
    root, element = _joint(urdf, joint)
    axis = element.find('axis')
    if axis is None:
        raise ValueError(f"joint '{joint}' has no axis")
    along = _numbers(axis.get('xyz', '1 0 0'))
    across = np.cross(along, DIRECTION)
    axis.set('xyz', _text(exp(angle * across / np.linalg.norm(across)) @ along))
    return ET.tostring(root, encoding='unicode')


def with_parts(urdf: str, parts: Sequence[str]) -> str:
    """Return a robot with more links and joints."""
    return urdf.replace('</robot>', f'{"".join(parts)}</robot>')


def locked(urdf: str, *names: str) -> str:
    """Return a robot as somebody has it who takes for fixed what moves: links of `part`."""
    for name in names:
        urdf = re.sub(f'name="{name}_joint" type="[a-z]+"', f'name="{name}_joint" type="fixed"', urdf)
    return urdf


def with_flexible_joint(urdf: str, joint: str) -> str:
    """Return a robot with a joint `flexible_joint` in series behind one of its joints, about the same axis."""
    root, element = _joint(urdf, joint)
    child, axis = element.find('child'), element.find('axis')
    if child is None or axis is None:
        raise ValueError(f"joint '{joint}' has no child or no axis")
    far = child.get('link', '')
    child.set('link', 'rotor')
    along = _numbers(axis.get('xyz', '1 0 0'))
    parts = [_link('rotor', box(0.01, (0.05,) * 3)), _jointed('flexible_joint', 'revolute', ('rotor', far), along)]
    return with_parts(ET.tostring(root, encoding='unicode'), parts)


def part(name: str, parent: str, place: Vector, axis: Vector, body: Array, kind: str) -> str:
    """Return a link and the joint that carries it.

    Parameters
    ----------
    name : of the link; its joint is called <name>_joint
    parent : link
    place : (3,) m of the joint in the parent's frame, whose axes it has
    axis : (3,)
    body : (10,) physical parameters in the link's frame
    kind : of the joint
    """
    return _link(name, body) + _jointed(f'{name}_joint', kind, (parent, name), axis, place)


def box(mass: float, size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """Return the (10,) physical parameters of a box with its sides (m) along the axes."""
    x, y, z = (side * side for side in size)
    moments = mass / 12.0 * np.array([y + z, x + z, x + y])
    return np.array([mass, *centre, moments[0], 0.0, 0.0, moments[1], 0.0, moments[2]])


def chain(axes: Sequence[Sequence[float]], slides: Sequence[int] = (), *, folded: bool = False) -> str:
    """Return a satellite of 400 kg with an arm of equal links that holds a body of 80 kg.

    Parameters
    ----------
    axes : of the joints, in frames that are all parallel at zero
    slides : the prismatic ones among them
    folded : all joints on one line, so that equal axes are collinear
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
    """Return servicer7 whose hand holds the body by a joint that nobody knows of, and has its own bare last link."""
    held = load_model(servicer()).link(LINK).parameters - standard(BARE)
    moved = physical(held) - np.concatenate(([0.0], place, np.zeros(6)))
    return with_parts(
        change_inertial(servicer(), LINK, BARE), [part('held', LINK, place, (1, 0, 0), moved, 'revolute')]
    )


def slipped(place: Sequence[float], angle: float) -> Array:
    """Return the (10,) physical parameters of hand and body after the body has turned in the grasp (rad)."""
    robot = load_model(held_apart(place))
    body = physical(robot.link('held').parameters)
    rotation = exp(angle * np.array([1.0, 0.0, 0.0]))
    inertia = pinocchio.Inertia(body[0], body[1:4], _matrix(body[4:]))
    moved = inertia.se3Action(pinocchio.SE3(rotation, np.array(place)))
    own = pinocchio.Inertia(BARE[0], BARE[1:4], _matrix(BARE[4:])) + moved
    return np.concatenate(([own.mass], own.lever, own.inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]))


def _link(name: str, body: Array) -> str:
    names = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
    inertia = ' '.join(f'{key}="{value!r}"' for key, value in zip(names, body[4:].tolist(), strict=True))
    inertial = f'<origin xyz="{_text(body[1:4])}"/><mass value="{float(body[0])!r}"/><inertia {inertia}/>'
    return f'<link name="{name}"><inertial>{inertial}</inertial></link>'


def _jointed(name: str, kind: str, links: tuple[str, str], axis: Vector, place: Vector = (0.0, 0.0, 0.0)) -> str:
    """Return a joint between parent and child."""
    limit = '' if kind == 'continuous' else '<limit lower="-3" upper="3" effort="100" velocity="10"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{links[0]}"/><child link="{links[1]}"/>'
        f'<origin xyz="{_text(place)}"/><axis xyz="{_text(axis)}"/>{limit}</joint>'
    )


def _matrix(elements: Array) -> Array:
    return elements[np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]


def _joint(urdf: str, name: str) -> tuple[ET.Element, ET.Element]:
    root = ET.fromstring(urdf)
    found = root.find(f"joint[@name='{name}']")
    if found is None:
        raise ValueError(f"no joint '{name}'")
    return root, found


def _numbers(text: str) -> Array:
    return np.array([float(value) for value in text.split()])


def _text(values: Vector) -> str:
    return ' '.join(repr(float(value)) for value in values)
