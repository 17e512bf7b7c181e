"""A robot that is not its URDF, with a document of its own: whatever reads URDF can then move it."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import ModelErrors, with_bodies
from mbaid_ros.core.robot.urdf_output import replace_inertial


def true_robot(model: RobotModel, errors: ModelErrors, fixed: Sequence[str] = ()) -> RobotModel:
    """Return the robot that has these errors: its bodies and its joints' frames, as `with_bodies` and `displaced` say.

    Zeros and mount are no part of it: they are in what its sensors say. Without errors it is the same object.

    Parameters
    ----------
    model : RobotModel, as its URDF says
    errors : ModelErrors
    fixed : links that are exact
    """
    if not any(np.any(block) for block in (errors.bodies, errors.origins, errors.tilts)):
        return model
    text = _displaced(model, errors.origins, errors.tilts)
    changed = with_bodies(model, errors.bodies, fixed)
    for link, before in zip(changed.links, model.links, strict=True):
        if link is not before:
            text = replace_inertial(text, link.name, physical(link.parameters))
    return load_model(text, model.base_link)


def _displaced(model: RobotModel, origins: Array, tilts: Array) -> str:
    """Return the document with the joints' <origin> elsewhere."""
    document = ET.fromstring(model.urdf)
    elements = {element.get('name'): element for element in document.findall('joint')}
    for name, origin, tilt in zip(model.joint_names, origins, tilts, strict=True):
        _displace(elements[name], origin, tilt)
    return ET.tostring(document, encoding='unicode')


def _displace(joint: ET.Element, origin: Array, tilt: Array) -> None:
    place = joint.find('origin')
    if place is None:
        place = ET.SubElement(joint, 'origin')
    xyz, rpy = (np.array([float(part) for part in place.get(key, '0 0 0').split()]) for key in ('xyz', 'rpy'))
    rotation = pinocchio.rpy.rpyToMatrix(*rpy)
    if origin.any():
        place.set('xyz', _written(xyz + rotation @ origin))
    if tilt.any():
        place.set('rpy', _written(pinocchio.rpy.matrixToRpy(rotation @ exp(tilt))))


def _written(values: Array) -> str:
    # repr is the shortest text that reads back as the same number.
    return ' '.join(map(repr, values.tolist()))
