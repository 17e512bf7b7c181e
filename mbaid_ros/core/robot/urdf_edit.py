"""New numbers in the <inertial> of a link or the <origin> of a joint; the rest of the document keeps its meaning."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pinocchio

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.urdf_document import tree_of

_INERTIA = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


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
