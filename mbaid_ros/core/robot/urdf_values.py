"""New numbers in a link's <inertial>, everything else of it as it was written."""

from __future__ import annotations

import re

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array, exp, log, rotate, unvec, vec
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.urdf_output import part_text, replace_inertial

_COMMENT = re.compile(r'<!--.*?-->', re.DOTALL)
_INERTIA = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
# Parts of a value's size that count as no change: what was written stays.
_SAME = 1e-12


def change_inertial(urdf: str, link: str, parameters: Array) -> str:
    """Return a URDF in which one link has the given inertia, written into the attributes that were there.

    Layout, comments and the orientation of the <origin> stay. An <inertial> that lacks a value is written anew.

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
    start, old = part_text(urdf, link)
    new = _with_values(old, parameters)
    return urdf[:start] + new + urdf[start + len(old) :] if new else replace_inertial(urdf, link, parameters)


def displace_joint(urdf: str, joint: str, origin: Array, tilt: Array) -> str:
    """Return a URDF in which one joint's frame is elsewhere; its <axis> stays, in a frame that is turned.

    Parameters
    ----------
    urdf : str
        A robot description that `load_model` accepts.
    joint : str
        Name of the joint.
    origin, tilt : (3,), (3,) arrays
        Displacement of the frame (m) and rotation vector that turns it (rad), in that frame.

    Raises
    ------
    ModelError
        The document is not XML or has no such joint.
    """
    if not (np.any(origin) or np.any(tilt)):
        return urdf
    start, old = part_text(urdf, joint, 'joint', 'origin')
    written = [_value(old, 'origin', key) for key in ('xyz', 'rpy')]
    xyz, rpy = (np.array([float(x) for x in each[2].split()]) if each else np.zeros(3) for each in written)
    rotation = pinocchio.rpy.rpyToMatrix(*rpy)
    place, turn = xyz + rotation @ origin, pinocchio.rpy.matrixToRpy(rotation @ exp(tilt)) if np.any(tilt) else rpy
    xyz_text, rpy_text = (' '.join(f'{value:.12g}' for value in each) for each in (place, turn))
    return f'{urdf[:start]}<origin xyz="{xyz_text}" rpy="{rpy_text}"/>{urdf[start + len(old) :]}'


def joints_moved(urdf: str, before: RobotModel, after: RobotModel) -> str:
    """Return a URDF of one robot with the joints' frames of another that differs from it in these."""
    back = np.swapaxes(before.rotations, -1, -2)
    origins, tilts = rotate(back, after.positions - before.positions), log(back @ after.rotations)
    for name, origin, tilt in zip(before.joint_names, origins, tilts, strict=True):
        if max(np.abs(origin).max(), np.abs(tilt).max()) > _SAME:
            urdf = displace_joint(urdf, name, origin, tilt)
    return urdf


def _with_values(text: str, parameters: Array) -> str:
    """Return an <inertial> with other values; empty where it lacks one."""
    rpy = _value(text, 'origin', 'rpy')
    values = [float(each) for each in rpy[2].split()] if rpy else [0.0, 0.0, 0.0]
    rotation = pinocchio.rpy.rpyToMatrix(*values)
    # In the axes that the <origin> turns to.
    inertia = vec(rotation.T @ unvec(parameters[4:]) @ rotation)
    size = float(np.sum(np.abs(inertia)))
    changes = [('mass', 'value', parameters[:1], float(parameters[0])), ('origin', 'xyz', parameters[1:4], 1.0)]
    changes += [('inertia', name, inertia[k : k + 1], size) for k, name in enumerate(_INERTIA)]
    for tag, attribute, numbers, unit in changes:
        place = _value(text, tag, attribute)
        if place is None:
            return ''
        begin, end, old = place
        text = text[:begin] + _written(numbers, old, unit) + text[end:]
    return text


def _value(text: str, tag: str, attribute: str) -> tuple[int, int, str] | None:
    """Return where an attribute's value begins and ends, and the value; None where no such attribute is."""
    bare = _COMMENT.sub(lambda found: ' ' * len(found[0]), text)
    found = re.search(rf'<{tag}\s(?:[^>]*\s)?{attribute}\s*=\s*(["\'])(.*?)\1', bare, re.DOTALL)
    return (found.start(2), found.end(2), found[2]) if found else None


def _written(numbers: Array, old: str, size: float) -> str:
    """Return an attribute's value with other numbers; those that are the same stay as they were written."""
    new = iter(numbers.tolist())

    def number(found: re.Match[str]) -> str:
        value = next(new)
        return found[0] if abs(value - float(found[0])) <= _SAME * size else f'{value:.10g}'

    return re.sub(r'\S+', number, old)
