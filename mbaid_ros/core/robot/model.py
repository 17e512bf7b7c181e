"""A free-floating robot as arrays, read from its URDF by pinocchio."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio

from mbaid_ros.core.errors import ModelError, listing
from mbaid_ros.core.geometry import Array, exp, rotate, skew, unvec, vec
from mbaid_ros.core.robot.urdf import Inertial, Limit, Transmission, read_description, transmission
from mbaid_ros.core.robot.urdf_document import captured_stderr, on_one_line, tree_of


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


_JOINT = 'joint: '  # before the name of a joint in pinocchio's document
_COMPLAINTS = 2  # of the parser that an error repeats: the place and the element


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
