"""Whether the robot touches itself: the collision shapes of its URDF, by pinocchio and coal."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import pinocchio

from mbaid_ros.core.errors import ModelError, listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.configuration import configurations
from mbaid_ros.core.robot.model import RobotModel, parse
from mbaid_ros.core.robot.parser_words import kept_words
from mbaid_ros.core.robot.urdf import read_description

_DENSE = 60  # instants of a motion at which distances are asked for


class Collisions:
    """The collision shapes of a robot, and which of them must not come near each other.

    Shapes of one body, and of bodies that a joint joins, are not compared: these touch by design. Neither are pairs
    that touch where a motion begins.

    Parameters
    ----------
    model : RobotModel
    clearance : m, that shapes keep from each other
    start : (n,) joint positions where motions begin

    Attributes
    ----------
    notes : what is left out, a line each

    Raises
    ------
    ModelError
        A shape cannot be read.
    """

    def __init__(self, model: RobotModel, clearance: float, start: Array) -> None:
        text, meshes = _without_meshes(read_description(model.urdf, model.base_link).text)
        self._robot = parse(model.urdf, model.base_link)
        self._shapes = _read(self._robot, text)
        self._names = model.joint_names
        self._data = self._robot.createData()
        self._model = model
        self._clearance = clearance
        self._pair_up(model)
        notes = [f'collision meshes of {listing(meshes)} are left out: primitives alone are compared'] if meshes else []
        self.shapes = len(self._shapes.geometryObjects)
        self._geometry = pinocchio.GeometryData(self._shapes)
        touching = self._near(start)
        if touching:
            notes.append(f'touch where the motion begins, and are not compared: {listing(touching)}')
            self._leave_out(start)
        self.notes = tuple(notes)

    @property
    def pairs(self) -> int:
        """Number of pairs of shapes that are compared."""
        return len(self._shapes.collisionPairs)

    def clear(self, positions: Array) -> bool:
        """Tell whether nothing comes near anything at (T, n) joint positions."""
        return not self.pairs or all(not self._near(position, first_only=True) for position in positions)

    @property
    def instants(self) -> int:
        """How many instants of a motion to ask for."""
        return _DENSE

    def _pair_up(self, model: RobotModel) -> None:
        shapes = self._shapes.geometryObjects
        bodies = [int(shape.parentJoint) - 1 for shape in shapes]
        joined = {(parent, joint + 1) for joint, parent in enumerate(model.parents)}
        for first in range(len(shapes)):
            for second in range(first + 1, len(shapes)):
                ends = tuple(sorted((bodies[first], bodies[second])))
                if ends[0] != ends[1] and ends not in joined:
                    self._shapes.addCollisionPair(pinocchio.CollisionPair(first, second))

    def _near(self, position: Array, *, first_only: bool = False) -> list[str]:
        """Return the pairs that are nearer than allowed at (n,) joint positions, or the first of them."""
        self._place(position)
        found = []
        for index, pair in enumerate(self._shapes.collisionPairs):
            distance = pinocchio.computeDistance(self._shapes, self._geometry, index).min_distance
            if distance < self._clearance or distance <= 0.0:
                first, second = (self._shapes.geometryObjects[each].name for each in (pair.first, pair.second))
                found.append(f'{_link(first)} and {_link(second)}')
                if first_only:
                    break
        return list(dict.fromkeys(found))

    def _leave_out(self, position: Array) -> None:
        self._place(position)
        kept = []
        for index, pair in enumerate(self._shapes.collisionPairs):
            distance = pinocchio.computeDistance(self._shapes, self._geometry, index).min_distance
            if distance >= self._clearance and distance > 0.0:
                kept.append((pair.first, pair.second))
        self._shapes.removeAllCollisionPairs()
        for first, second in kept:
            self._shapes.addCollisionPair(pinocchio.CollisionPair(first, second))
        self._geometry = pinocchio.GeometryData(self._shapes)

    def _place(self, position: Array) -> None:
        configuration = configurations(self._model, self._robot, position)
        pinocchio.updateGeometryPlacements(self._robot, self._data, self._shapes, self._geometry, configuration)


def _read(robot: pinocchio.Model, text: str) -> pinocchio.GeometryModel:
    """Return the collision shapes of a robot description.

    Raises
    ------
    ModelError
        One of them cannot be read; pinocchio would leave it out.
    """
    complaints: list[str] = []
    try:
        with kept_words(complaints):
            shapes = pinocchio.buildGeomFromUrdfString(robot, text, pinocchio.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        complaints.append(str(error))
        shapes = None
    given = sum(len(link.findall('collision')) for link in ET.fromstring(text).iter('link'))
    if shapes is None or len(shapes.geometryObjects) != given:
        reason = ' '.join('; '.join(complaints).split()) or 'no reason given'
        raise ModelError(f'a collision shape of the robot description cannot be read: {reason}')
    return shapes


def _link(shape: str) -> str:
    """Return the link of a shape, which pinocchio numbers: hand_0."""
    return shape.rpartition('_')[0]


def _without_meshes(text: str) -> tuple[str, list[str]]:
    """Return a robot description without the collision shapes that are meshes, and the links that had some."""
    robot = ET.fromstring(text)
    links = []
    for link in robot.iter('link'):
        for shape in link.findall('collision'):
            if shape.find('geometry/mesh') is not None:
                link.remove(shape)
                links.append(link.get('name', ''))
    return ET.tostring(robot, encoding='unicode'), list(dict.fromkeys(links))
