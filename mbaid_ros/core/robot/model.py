"""The robot as arrays: links, joints, kinematics, the plane of its motion."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array, cross, exp, rotate, skew, unvec, vec
from mbaid_ros.core.robot.urdf import (
    Inertial,
    Limit,
    Transmission,
    captured_stderr,
    on_one_line,
    read_description,
    transmission,
    tree_of,
)
from mbaid_ros.core.samples import ArrayRecord, Samples
from mbaid_ros.errors import ModelError, ParameterError, listing

_JOINT = 'joint: '  # before the name of a joint in pinocchio's document
_COMPLAINTS = 2  # of the parser that an error repeats: the place and the element
_PARALLEL = 1e-9  # by which the cosine of axes of one direction may differ from 1 (4.5e-5 rad): rounding of URDF angles
# Deviations of a window's mean, of all three axes together, from which the base leaves the plane: no noise does.
_SIGNIFICANT = 6.0
_OUT_OF_PLANE = 0.05  # rad/s, of a gyro alone: no bias is as large
_LEAVING, _STAYS = 0.1, 0.01  # part of the motion in the plane, and m (N s), of what leaves it


def configurations(model: RobotModel, position: Array) -> Array:
    """Return pinocchio's configurations (..., nq) of joints at (..., n) rad or m, the base at the origin.

    The first seven numbers are the base's; a joint that turns without limits is (cos, sin).
    """
    turning = np.array(model.continuous, dtype=bool)
    places = 7 + np.cumsum(1 + turning) - (1 + turning)
    found = np.zeros((*position.shape[:-1], 7 + len(turning) + int(turning.sum())))
    found[..., 6] = 1.0
    found[..., places] = np.where(turning, np.cos(position), position)
    found[..., places[turning] + 1] = np.sin(position[..., turning])
    return found


@dataclass(frozen=True)
class Link:
    """A link of the URDF and where it sits on its moving body."""

    name: str  # the URDF's
    body: int  # index of the moving body that carries it (0 is the base)
    # rotation, position: (3, 3), (3,) m, of the link's frame in the body's frame
    rotation: Array
    position: Array
    parameters: Array  # (10,) standard inertial parameters (m, h, I_o) in the link's frame: kg, kg m, kg m^2


@dataclass(frozen=True)
class RobotModel:
    """A free-floating tree of rigid bodies.

    Body 0 is the base; joint j moves body j + 1. Links joined by fixed joints belong to one body.
    """

    name: str  # the URDF's robot name
    urdf: str  # the document
    document: str  # the part of it that floats, without massless <inertial>s
    joint_names: tuple[str, ...]  # names of the n movable joints, in the order of every joint array
    parents: tuple[int, ...]  # (n,) index of the body that carries joint j
    # rotations, positions: (n, 3, 3), (n, 3) m, frame of joint j in its parent body's frame
    rotations: Array
    positions: Array
    axes: Array  # (n, 3) unit axis of joint j in its own frame
    # prismatic, continuous: (n,) True where joint j slides, where it turns without limits
    prismatic: tuple[bool, ...]
    continuous: tuple[bool, ...]
    limits: tuple[Limit, ...]  # (n,) of each joint
    transmission: Transmission  # which joints follow others
    links: tuple[Link, ...]  # every link of the URDF that the floating one carries
    described_joints: tuple[str, ...] = ()  # every joint of the URDF, fixed ones included
    dropped: tuple[str, ...] = ()  # a line, with the reason, for everything of the URDF that is left out

    @property
    def base_link(self) -> str:
        """Name of the link that floats, whose frame the odometry locates."""
        return self.links[0].name

    @property
    def joints(self) -> int:
        """Number n of movable joints."""
        return len(self.joint_names)

    @cached_property
    def independent_joints(self) -> tuple[str, ...]:
        """Names of the joints that follow no other: sensors must measure these."""
        return tuple(self.joint_names[place] for place in self.transmission.independent)

    @cached_property
    def last_link(self) -> str:
        """Name of the default target: the last link with an inertia on the body furthest from the base."""
        depth = [0]
        for parent in self.parents:
            depth.append(depth[parent] + 1)
        massive = [link for link in self.links if link.parameters[0] > 0.0] or list(self.links)
        # Of several that are fixed to each other the last one holds the debris.
        return max(enumerate(massive), key=lambda place: (depth[place[1].body], place[1].body, place[0]))[1].name

    def link(self, name: str) -> Link:
        """Return a link by name; ModelError if the URDF has no such link."""
        for link in self.links:
            if link.name == name:
                return link
        raise ModelError(f"link '{name}' is not in the robot description; links: {listing(x.name for x in self.links)}")

    def body_parameters(self, without: str | Collection[str] = ()) -> Array:
        """Return the (n + 1, 10) standard parameters of the moving bodies, each in its own frame.

        `without` names unknown links, whose URDF entries must not enter an estimate.
        """
        omitted = {without} if isinstance(without, str) else set(without)
        parameters = np.zeros((self.joints + 1, 10))
        for link in self.links:
            if link.name not in omitted:
                parameters[link.body] += express(link.parameters, link.rotation, link.position)
        return parameters


def express(parameters: Array, rotation: Array, position: Array) -> Array:
    """Return standard parameters (..., 10) (m, h, I_o) in another frame, I_o about its origin.

    Parameters
    ----------
    parameters : (..., 10) in the link's frame
    rotation, position : (..., 3, 3), (..., 3) m, the link's frame in the new frame
    """
    mass = parameters[..., :1]
    moment = rotate(rotation, parameters[..., 1:4])
    inertia = rotation @ unvec(parameters[..., 4:]) @ np.swapaxes(rotation, -1, -2)
    # Steiner about the new origin: I - [r]x[h]x - [h]x[r]x - m [r]x[r]x.
    lever, first = skew(position), skew(moment)
    coupling = lever @ first
    inertia = inertia - coupling - np.swapaxes(coupling, -1, -2) - mass[..., None] * (lever @ lever)
    expressed = np.empty((*inertia.shape[:-2], 10))
    expressed[..., :1] = mass
    expressed[..., 1:4] = moment + mass * position
    expressed[..., 4:] = vec(inertia)
    return expressed


def load_model(urdf: str, base_link: str = '') -> RobotModel:
    """Return the robot of a URDF's text.

    `base_link` names the link that floats; empty means the root, or the link on a root 'world'.

    Raises ModelError: The document cannot be used; the message names the link, joint or value.
    """
    description = read_description(urdf, base_link)
    model = _built(description.text)
    names = tuple(model.names[2:])
    count = model.njoints - 2  # without pinocchio's universe and the free-flyer
    placements = [model.jointPlacements[index + 2] for index in range(count)]
    axes = np.array([description.axes[name] for name in names], dtype=float).reshape(count, 3)
    return RobotModel(
        name=model.name,
        urdf=urdf,
        document=description.text,
        joint_names=names,
        parents=tuple(model.parents[index + 2] - 1 for index in range(count)),
        rotations=np.array([placement.rotation for placement in placements]).reshape(count, 3, 3),
        positions=np.array([placement.translation for placement in placements]).reshape(count, 3),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        prismatic=tuple(model.joints[index + 2].shortname().startswith('JointModelP') for index in range(count)),
        continuous=tuple(model.joints[index + 2].nq == 2 for index in range(count)),
        limits=tuple(description.limits[name] for name in names),
        transmission=transmission(names, description.mimics),
        links=_links(model, description.inertials),
        described_joints=description.joints,
        dropped=description.dropped,
    )


def parse(model: RobotModel) -> pinocchio.Model:
    """Return pinocchio's free-flying model of a robot, without gravity; mimic joints are independent."""
    return _built(model.document)


def _built(document: str) -> pinocchio.Model:
    complaints: list[str] = []
    try:
        with captured_stderr(complaints):
            model = pinocchio.buildModelFromXML(_with_unique_joint_names(document), pinocchio.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        reason = (
            ' '.join(('; '.join(complaints[:_COMPLAINTS]) or str(error)).replace(_JOINT, '').split())
            or 'no reason given'
        )
        raise ModelError(f'the robot description is not a valid URDF: {reason}') from error
    model.gravity.setZero()
    for place, name in enumerate(model.names):
        model.names[place] = name.removeprefix(_JOINT)
    return model


def _with_unique_joint_names(text: str) -> str:
    """Return a document whose joints are named as no link is, nor a part that pinocchio adds ('root_joint')."""
    robot = tree_of(text)
    for joint in robot.findall('joint'):
        joint.set('name', _JOINT + joint.get('name', ''))
        mimic = joint.find('mimic')
        if mimic is not None:
            mimic.set('joint', _JOINT + mimic.get('joint', ''))
    return on_one_line(ET.tostring(robot, encoding='unicode'))


def _links(model: pinocchio.Model, inertials: dict[str, Inertial]) -> tuple[Link, ...]:
    return tuple(
        Link(
            name=frame.name,
            body=int(frame.parentJoint) - 1,
            rotation=frame.placement.rotation.copy(),
            position=frame.placement.translation.copy(),
            parameters=_standard(inertials.get(frame.name)),
        )
        for frame in model.frames
        if frame.type == pinocchio.FrameType.BODY
    )


def _standard(inertial: Inertial | None) -> Array:
    """Return (m, h, I_o) in the link's frame."""
    if inertial is None:
        return np.zeros(10)
    about_com = np.concatenate(([inertial.mass], np.zeros(3), inertial.inertia))
    return express(about_com, pinocchio.rpy.rpyToMatrix(*inertial.rpy), np.array(inertial.xyz))


def displaced(model: RobotModel, origins: Array, tilts: Array) -> RobotModel:
    """Return a robot with displaced joints, (n, 3), (n, 3) as in ModelErrors."""
    return replace(
        model, positions=model.positions + rotate(model.rotations, origins), rotations=model.rotations @ exp(tilts)
    )


@dataclass(frozen=True)
class Configuration(ArrayRecord):
    """Poses and joint twists at N samples."""

    rotation: Array  # (N, n + 1, 3, 3) body to odometry axes
    position: Array  # (N, n + 1, 3) m, body origins relative to the base origin
    joint_twist: Array  # (N, n, 6) unit twist (u, w) of each joint at the base origin (Jacobian columns)

    def link_pose(self, link: Link) -> tuple[Array, Array]:
        """Return rotation (N, 3, 3) and position (N, 3) of a link's frame."""
        rotation = self.rotation[:, link.body]
        return rotation @ link.rotation, self.position[:, link.body] + rotate(rotation, link.position)


def sensor_link(model: RobotModel, frame: str, prefix: str, parameter: str, passive: Collection[str] = ()) -> Link:
    """Return the link that a sensor is on, by the name of its frame.

    Raises ParameterError: There is no such link, or passive joints, which nothing reads, move it.

    Parameters
    ----------
    prefix : before the names of links in frame names
    parameter : that names the frame
    passive : names of these joints
    """
    links = {prefix + link.name: link for link in model.links}
    ancestors, loose = Kinematics(model).ancestors, [name in passive for name in model.joint_names]
    moved = [bool(ancestors[body] @ loose) for body in range(len(ancestors))]
    accepted = [name for name, link in links.items() if not moved[link.body]]
    if frame not in accepted:
        why = ', which a joint of flexible.joints moves' if frame in links else ''
        raise ParameterError(f"parameter '{parameter}' is '{frame[:60]}'{why}; accepted: {listing(accepted)}")
    return links[frame]


class Kinematics:
    """The vectorised kinematics of one robot.

    Attributes
    ----------
    axes : (n, 3) axis of each joint in its parent body's frame
    ancestors : (n + 1, n) 1 where joint j moves body b, else 0
    across : (n, 3, 2) two unit vectors normal to each joint's axis and to each other, in the joint's own frame
    """

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        count = model.joints
        self._sliding = np.flatnonzero(model.prismatic)
        # Joint j's rotation in its parent is A + sin(q) B + cos(q) C: Rodrigues with the constant placement in front.
        generator = skew(model.axes)
        square = generator @ generator
        turns = ~np.array(model.prismatic, dtype=bool).reshape(count, 1, 1)
        self._constant = model.rotations @ (np.eye(3) + np.where(turns, square, 0.0))
        self._sine = np.where(turns, model.rotations @ generator, 0.0)
        self._cosine = np.where(turns, -model.rotations @ square, 0.0)
        self.axes = rotate(model.rotations, model.axes)
        self._fixed = np.stack((model.positions, self.axes), axis=-1)
        self.ancestors = np.zeros((count + 1, count))
        for joint, parent in enumerate(model.parents):
            self.ancestors[joint + 1] = self.ancestors[parent]
            self.ancestors[joint + 1, joint] = 1.0
        self.across = _normal_axes(model.axes)

    @property
    def before(self) -> Array:
        """1 where joint k moves the body that joint j is on, else 0, (n, n) [j, k]."""
        return self.ancestors[list(self.model.parents)]

    def configure(self, base_rotation: Array, joint_position: Array) -> Configuration:
        """Return poses and joint twists for base to odometry axes (N, 3, 3) and joints (N, n), rad or m."""
        model = self.model
        count, joints = joint_position.shape
        angle = joint_position[..., None, None]
        # Each joint's rotation, position and axis in the axes of its parent body: turned in one product.
        local = np.empty((count, joints, 3, 5))
        local[..., :3] = self._constant + np.sin(angle) * self._sine + np.cos(angle) * self._cosine
        local[..., 3:] = self._fixed
        frames = np.empty((count, joints + 1, 3, 5))
        frames[:, 0, :, :3] = base_rotation
        for joint, parent in enumerate(model.parents):
            np.matmul(frames[:, parent, :, :3], local[:, joint], out=frames[:, joint + 1])
        rotation, place, axis = frames[..., :3].copy(), frames[:, 1:, :, 3], frames[:, 1:, :, 4]
        if len(self._sliding):
            place += axis * np.where(model.prismatic, joint_position, 0.0)[..., None]
        position = np.zeros((count, joints + 1, 3))
        for joint, parent in enumerate(model.parents):
            np.add(position[:, parent], place[:, joint], out=position[:, joint + 1])
        twist = np.zeros((count, joints, 6))
        twist[..., :3], twist[..., 3:] = cross(position[:, 1:], axis), axis
        if len(self._sliding):
            twist[:, self._sliding, :3], twist[:, self._sliding, 3:] = axis[:, self._sliding], 0.0
        return Configuration(rotation, position, twist)

    def body_twists(self, configuration: Configuration, joint_velocity: Array, base_twist: Array) -> Array:
        """Return the twist (u, w) of every body at the base origin (paper, eq. 1), (N, n + 1, 6).

        Parameters
        ----------
        configuration : of the same N samples
        joint_velocity : (N, n) rad/s or m/s
        base_twist : (N, 6) of the base link's origin, odometry axes
        """
        return base_twist[:, None] + self.ancestors @ (configuration.joint_twist * joint_velocity[..., None])


def _normal_axes(axis: Array) -> Array:
    """Return (n, 3, 2) two orthonormal columns normal to each of (n, 3) unit vectors."""
    across = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = across - np.sum(across * axis, axis=1, keepdims=True) * axis
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack((first, cross(axis, first)), axis=2)


@dataclass(frozen=True)
class Plane:
    """The plane of motion in a link's frame, which it never leaves, since all joints turn about its normal."""

    normal: Array  # (3,) unit vector
    axes: Array  # (2, 3) orthonormal, in the plane; axes of the link where the normal is one of them

    @property
    def basis(self) -> Array:
        """Orthonormal (10, 4): (m, first moment in the plane (2), moment about the normal) in (m, h, I_o)."""
        about = vec(self.normal[:, None] * self.normal)
        basis = np.zeros((10, 4))
        basis[0, 0] = 1.0
        basis[1:4, 1:3] = self.axes.T
        basis[4:10, 3] = about / np.linalg.norm(about)
        return basis


class PlaneDetector:
    """Decides from mechanism and motion whether a robot moves in a plane; once spatial, it stays so.

    Parameters
    ----------
    model : RobotModel
    tilt : standard deviation of the base's axes in the frame that its poses locate, rad: as that turns about the
        normal of the table, the axes read are seen to tilt by up to twice their error

    Attributes
    ----------
    planar : whether it does, so far
    """

    def __init__(self, model: RobotModel, tilt: float = 0.0) -> None:
        self.model, self._tilt = model, tilt
        self._axis = _common_axis(model)
        self._normal: Array | None = None
        self._place: Array | None = None  # m, where a body without joints was first
        self.planar = self._axis is not None

    @property
    def normal(self) -> Array | None:
        """Of the plane of motion, (3,) in odometry axes; None for a spatial motion."""
        return self._normal if self.planar else None

    def update(self, window: Samples) -> None:
        """Take the next window's samples."""
        if not self.planar or self._axis is None:
            return
        normals = rotate(window.base_rotation, self._axis)
        mean = np.mean(normals, axis=0)
        if self._normal is None:
            self._normal = mean / np.linalg.norm(mean)
        count = len(window)
        rate = np.mean(window.base_angular_velocity, axis=0)
        tilt_std = np.sqrt(np.trace(np.mean(window.pose_covariance[:, 3:, 3:], axis=0)) / count)
        rate_std = np.sqrt(np.trace(np.mean(window.twist_covariance[:, 3:, 3:], axis=0)) / count)
        tilt = np.linalg.norm(np.cross(self._normal, mean))
        out_of_plane = np.linalg.norm(rate - self._normal * (self._normal @ rate))
        # The reference normal has the first window's noise: twice the variance. A rate of NaN is not measured.
        turns_out = out_of_plane > _SIGNIFICANT * np.hypot(rate_std, self._tilt * np.linalg.norm(rate))
        # Nor is an orientation with a covariance of NaN, but integrated: then the gyro decides, despite its bias.
        tilts = tilt > _SIGNIFICANT * np.sqrt(2.0) * np.hypot(tilt_std, self._tilt)
        if np.isnan(tilt_std) and window.further.shape[1] and count > 1:
            turned = (window.further[-1, :3] - window.further[0, :3]) / (window.time[-1] - window.time[0])
            tilts = np.linalg.norm(turned - self._axis * (self._axis @ turned)) > _OUT_OF_PLANE
        self.planar = not (tilts or turns_out or (not self.model.joints and self._leaves(window)))

    def _leaves(self, window: Samples) -> bool:
        """Return whether a body without joints, whose axis is assumed, moves along it or is pushed so."""
        assert self._normal is not None, 'there was a window before'
        if self._place is None:
            self._place = window.base_position[0]
        across = np.eye(3) - np.outer(self._normal, self._normal)
        vectors = np.concatenate((window.base_position - self._place, window.impulse[:, :3]))
        inside = vectors @ across
        inside, outside = (np.linalg.norm(each, axis=1).reshape(2, -1) for each in (inside, vectors - inside))
        return bool(np.any(outside.max(axis=1) > _LEAVING * inside.max(axis=1) + _STAYS))

    def plane(self, link: Link) -> Plane | None:
        """Return the plane in a link's frame, None for a spatial motion."""
        if self._axis is None or not self.planar:
            return None
        kinematics = Kinematics(self.model)
        configuration = kinematics.configure(np.eye(3)[None], np.zeros((1, self.model.joints)))
        normal = configuration.link_pose(link)[0][0].T @ self._axis
        along = np.argmax(np.abs(normal))
        if abs(normal[along]) > 1.0 - _PARALLEL:
            return Plane(normal, np.delete(np.eye(3), along, axis=0))
        return Plane(normal, np.linalg.svd(normal[None])[2][1:])

    def plane_of_body(self, body: int) -> Plane:
        """Return the plane in a moving body's frame; ValueError for a spatial motion."""
        plane = self.plane(Link('', body, np.eye(3), np.zeros(3), np.zeros(10)))
        if plane is None:
            raise ValueError('a spatial motion has no plane')
        return plane

    def equation_selection(self) -> Array:
        """Return the (k, 6) selection Pi of the equations Pi (P, L) that hold, k = 3 in a plane, else 6."""
        if not self.planar or self._normal is None:
            return np.eye(6)
        first = np.cross(self._normal, np.eye(3)[int(np.argmin(np.abs(self._normal)))])
        first /= np.linalg.norm(first)
        selection = np.zeros((3, 6))
        selection[0, :3] = first
        selection[1, :3] = np.cross(self._normal, first)
        selection[2, 3:] = self._normal
        return selection


def _common_axis(model: RobotModel) -> Array | None:
    """Return the axis, in the base frame, that all joints turn about (or slide at right angles to), if there is one.

    A body without joints may be on a table: then it turns about z alone.
    """
    if not model.joints:
        return np.array([0.0, 0.0, 1.0])
    kinematics = Kinematics(model)
    # Two postures: axes that happen to be parallel in one are not so in the other.
    angles = np.array([np.zeros(model.joints), np.linspace(0.3, 1.1, model.joints)])
    twists = kinematics.configure(np.broadcast_to(np.eye(3), (2, 3, 3)), angles).joint_twist
    slides = np.array(model.prismatic)
    turning = twists[:, ~slides, 3:].reshape(-1, 3)
    if not len(turning):
        return None
    axis: Array = turning[0]
    parallel = np.all(np.abs(np.abs(turning @ axis) - 1.0) < _PARALLEL)
    across = np.all(np.abs(twists[:, slides, :3] @ axis) < _PARALLEL)
    return axis if parallel and across else None
