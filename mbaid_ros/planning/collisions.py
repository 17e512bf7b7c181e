"""Whether the robot touches itself: the collision shapes of its URDF, meshes as their hulls, by pinocchio and coal."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree import ElementTree as ET

import coal
import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel, configurations, parse
from mbaid_ros.core.robot.urdf import captured_stderr, tree_of, triple
from mbaid_ros.errors import ModelError, listing

ReadMesh = Callable[[str], Array]

INSTANTS = 60  # of a motion, at which distances are asked for


def no_mesh(name: str) -> Array:
    """Refuse a mesh, where no files are read.

    Raises ModelError: Always.
    """
    raise ModelError(f"the file of mesh '{name}' is not looked for")


class Collisions:
    """The collision shapes of a robot, and which of them must not come near each other.

    Shapes of one body, and of bodies that a joint joins, are not compared: these touch by design. Neither are pairs
    that touch where a motion begins.

    Raises ModelError: A shape that is no mesh cannot be read.

    Parameters
    ----------
    clearance : m, that shapes keep from each other
    start : (n,) joint positions where motions begin
    mesh : reads the vertices (V, 3) of a mesh by the name of its file, or raises ModelError

    Attributes
    ----------
    notes : omitted shapes, a line each
    """

    def __init__(self, model: RobotModel, clearance: float, start: Array, mesh: ReadMesh) -> None:
        text, meshes = _without_meshes(model.document)
        self._robot = parse(model)
        self._shapes = _read(self._robot, text)
        notes = self._add(meshes, mesh)
        self._data = self._robot.createData()
        self._model = model
        self._clearance = clearance
        self._pair_up(model)
        self.shapes = len(self._shapes.geometryObjects)
        self._geometry = pinocchio.GeometryData(self._shapes)
        touching = self._near(start)
        if touching:
            names = dict.fromkeys(map(self._named, touching))
            notes.append(f'touch where the motion begins, and are not compared: {listing(names)}')
            self._leave_out(touching)
        self.notes = tuple(notes)

    @property
    def pairs(self) -> int:
        """Number of pairs of shapes that are compared."""
        return len(self._shapes.collisionPairs)

    def clear(self, positions: Array) -> bool:
        """Return whether nothing comes near anything at (T, n) joint positions."""
        return not self.pairs or all(not self._near(position, first_only=True) for position in positions)

    def _add(self, meshes: list[tuple[str, ET.Element]], read: ReadMesh) -> list[str]:
        """Add the hulls of meshes by link, and return in a line which cannot be read, and why the first cannot."""
        reason = ''
        left_out: list[str] = []
        for number, (link, shape) in enumerate(meshes):
            try:
                hull = _hull(shape, read)
            except ModelError as error:
                left_out, reason = [*left_out, link], reason or str(error)
                continue
            frame = self._robot.getFrameId(link)
            joint, place = self._robot.frames[frame].parentJoint, self._robot.frames[frame].placement
            name = f'{link}_mesh{number}'
            self._shapes.addGeometryObject(
                pinocchio.GeometryObject(name, joint, frame, place * _placement(shape), hull)
            )
        names = listing(list(dict.fromkeys(left_out)))
        return [f'collision meshes of {names} are left out: {reason}'] if left_out else []

    def _pair_up(self, model: RobotModel) -> None:
        shapes = self._shapes.geometryObjects
        bodies = [int(shape.parentJoint) - 1 for shape in shapes]
        joined = {(parent, joint + 1) for joint, parent in enumerate(model.parents)}
        for first in range(len(shapes)):
            for second in range(first + 1, len(shapes)):
                ends = tuple(sorted((bodies[first], bodies[second])))
                if ends[0] != ends[1] and ends not in joined:
                    self._shapes.addCollisionPair(pinocchio.CollisionPair(first, second))

    def _near(self, position: Array, *, first_only: bool = False) -> list[int]:
        """Return which pairs are nearer than allowed at (n,) joint positions, or the first of them."""
        self._place(position)
        found = []
        for index in range(self.pairs):
            distance = pinocchio.computeDistance(self._shapes, self._geometry, index).min_distance
            if distance < self._clearance or distance <= 0.0:
                found.append(index)
                if first_only:
                    break
        return found

    def _named(self, index: int) -> str:
        """Return a pair by its links; pinocchio numbers shapes: hand_0."""
        pair = self._shapes.collisionPairs[index]
        first, second = (self._shapes.geometryObjects[each].name for each in (pair.first, pair.second))
        return f'{first.rpartition("_")[0]} and {second.rpartition("_")[0]}'

    def _leave_out(self, pairs: list[int]) -> None:
        kept = [(pair.first, pair.second) for k, pair in enumerate(self._shapes.collisionPairs) if k not in pairs]
        self._shapes.removeAllCollisionPairs()
        for first, second in kept:
            self._shapes.addCollisionPair(pinocchio.CollisionPair(first, second))
        self._geometry = pinocchio.GeometryData(self._shapes)

    def _place(self, position: Array) -> None:
        configuration = configurations(self._model, position)
        pinocchio.updateGeometryPlacements(self._robot, self._data, self._shapes, self._geometry, configuration)


def _read(robot: pinocchio.Model, text: str) -> pinocchio.GeometryModel:
    """Return the collision shapes of a robot description.

    Raises ModelError: One of them cannot be read; pinocchio would leave it out.
    """
    complaints: list[str] = []
    try:
        with captured_stderr(complaints):
            shapes = pinocchio.buildGeomFromUrdfString(robot, text, pinocchio.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        complaints.append(str(error))
        shapes = None
    given = sum(len(link.findall('collision')) for link in tree_of(text).iter('link'))
    if shapes is None or len(shapes.geometryObjects) != given:
        reason = ' '.join('; '.join(complaints).split()) or 'no reason given'
        raise ModelError(f'a collision shape of the robot description cannot be read: {reason}')
    return shapes


def _without_meshes(text: str) -> tuple[str, list[tuple[str, ET.Element]]]:
    """Return a robot description without the collision shapes that are meshes, and these with their links."""
    robot = tree_of(text)
    meshes = []
    for link in robot.iter('link'):
        for shape in link.findall('collision'):
            if shape.find('geometry/mesh') is not None:
                link.remove(shape)
                meshes.append((link.get('name', ''), shape))
    return ET.tostring(robot, encoding='unicode'), meshes


def _hull(shape: ET.Element, read: ReadMesh) -> coal.ConvexBase:
    """Return the convex hull of a mesh.

    Raises ModelError: The mesh cannot be read, or has no volume.
    """
    from scipy.spatial import ConvexHull  # noqa: PLC0415 - robots without meshes start sooner

    element = shape.find('geometry/mesh')
    assert element is not None, 'a shape without a mesh is none of these'
    name = element.get('filename', '')
    corners = read(name) * triple('a collision mesh has the', element, 'scale', '1 1 1')
    try:
        outer = corners[ConvexHull(corners).vertices]
    except (ValueError, RuntimeError) as error:  # coal would end the process
        raise ModelError(f"mesh '{name}' has no hull: it is flat, or has no vertices") from error
    points = coal.StdVec_Vec3s()
    points.extend(list(outer))
    return coal.ConvexBase.convexHull(points, False, 'Qt')  # noqa: FBT003 - without its triangles


def _placement(shape: ET.Element) -> pinocchio.SE3:
    """Return where a shape is in its link's frame."""
    xyz, rpy = (
        np.array(triple('a collision shape has the origin', shape.find('origin'), key)) for key in ('xyz', 'rpy')
    )
    return pinocchio.SE3(pinocchio.rpy.rpyToMatrix(*rpy), xyz)
