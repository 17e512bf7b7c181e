"""Random robots and states, and pinocchio as a peer to compare with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation, skew, vec
from mbaid_ros.core.robot.model import RobotModel, load_model, parse
from mbaid_ros.core.robot.momentum import Storage

KINDS = ('revolute', 'continuous', 'prismatic', 'fixed')
NORMAL = np.array([0.0, 0.0, 1.0])  # of the plane of planar robots


def random_inertial(rng: np.random.Generator) -> str:
    """Return the <inertial> of a random rigid body: a cloud of point masses, hence physical."""
    points = rng.normal(size=(12, 3)) * rng.uniform(0.1, 0.6, 3)
    masses = rng.uniform(0.2, 5.0, 12)
    mass = masses.sum()
    com = masses @ points / mass
    offsets = points - com
    inertia = -np.einsum('k,kij->ij', masses, skew(offsets) @ skew(offsets))
    rpy = rng.uniform(-1.0, 1.0, 3)
    names = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
    elements = ' '.join(f'{name}="{value!r}"' for name, value in zip(names, vec(inertia).tolist(), strict=True))
    return (
        f'<inertial><origin xyz="{_text(com)}" rpy="{_text(rpy)}"/><mass value="{float(mass)!r}"/>'
        f'<inertia {elements}/></inertial>'
    )


def two_links(first: str, second: str, end: str = '') -> str:
    """Return a base and two links in a row, which j1 and j2 move about or along z; j2 has also an end."""
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = ''.join(f'<link name="{name}">{inertial}</link>' for name in ('base_link', 'link1', 'link2'))
    rest = '<origin xyz="0.5 0 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/>'
    joints = ''.join(
        f'<joint name="j{place}" {kind}><parent link="{parent}"/><child link="link{place}"/>{rest}{more}</joint>'
        for place, kind, parent, more in ((1, first, 'base_link', ''), (2, second, 'link1', end))
    )
    return f'<robot name="two_links">{links}{joints}</robot>'


def random_urdf(rng: np.random.Generator, joints: int = 6, chain: bool = False) -> str:
    """Return a random tree (or chain) of bodies with all supported joint types."""
    parts = ['<robot name="random">', f'<link name="base_link">{random_inertial(rng)}</link>']
    for index in range(1, joints + 1):
        kind = KINDS[int(rng.integers(len(KINDS)))] if index > 1 else 'revolute'
        parent = index - 1 if chain else int(rng.integers(index))
        axis = rng.normal(size=3)
        limit = '<limit lower="-3" upper="3" effort="100" velocity="10"/>' if kind in {'revolute', 'prismatic'} else ''
        parts += [
            f'<link name="link{index}">{random_inertial(rng)}</link>',
            f'<joint name="joint{index}" type="{kind}"><parent link="{_link(parent)}"/><child link="link{index}"/>',
            f'<origin xyz="{_text(rng.uniform(-1, 1, 3))}" rpy="{_text(rng.uniform(-2, 2, 3))}"/>',
            f'<axis xyz="{_text(axis / np.linalg.norm(axis))}"/>{limit}</joint>',
        ]
    return '\n'.join([*parts, '</robot>'])


def spatial(seed: int) -> RobotModel:
    return load_model(random_urdf(np.random.default_rng(seed), joints=7))


def planar(seed: int) -> RobotModel:
    """Return a flat tree: joints turn about z, or slide across it, and every body is its own image in the plane."""
    model, rng = spatial(seed), np.random.default_rng([seed, 1])
    across = np.column_stack((rng.normal(size=(model.joints, 2)), np.zeros(model.joints)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    flat = np.array([1.0, 1.0, 0.0])
    symmetric = np.array([1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0])
    return replace(
        model,
        axes=np.where(np.array(model.prismatic)[:, None], across, NORMAL),
        rotations=exp(rng.uniform(-2.0, 2.0, (model.joints, 1)) * NORMAL),
        positions=flat * model.positions,
        links=tuple(
            replace(link, rotation=np.eye(3), position=flat * link.position, parameters=symmetric * link.parameters)
            for link in model.links
        ),
    )


def random_state(rng: np.random.Generator, joints: int, count: int) -> tuple[Array, Array, Array, Array]:
    """Return joint positions (N, n), joint velocities (N, n), base rotations (N, 3, 3), base twists (N, 6)."""
    return (
        rng.uniform(-2.0, 2.0, (count, joints)),
        rng.normal(size=(count, joints)),
        exp(rng.normal(size=(count, 3))),
        rng.normal(size=(count, 6)),
    )


def _link(index: int) -> str:
    return f'link{index}' if index else 'base_link'


def _text(values: Array) -> str:
    return ' '.join(repr(float(value)) for value in values)


def random_storage(rng: np.random.Generator, model: RobotModel) -> Storage:
    """Return two wheels in one body, one in another, and a momentum that is published in the axes of a link."""
    wheels = Storage()
    for count in (2, 1):
        axes = rng.normal(size=(count, 3))
        link = model.links[int(rng.integers(len(model.links)))]
        names = [f'wheel{wheels.count + index}' for index in range(count)]
        unit = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        wheels += Storage.from_wheels(link, names, unit, rng.uniform(0.5, 2.0, count).tolist(), 0.1)
    return wheels + Storage.from_published(model.link(model.last_link), 0.1)


@dataclass(frozen=True)
class Motion:
    """The state of N samples.

    Attributes
    ----------
    base_rotation : (N, 3, 3)
    joint_position, joint_velocity : (N, n)
    base_twist : (N, 6) of the base's origin, odometry axes
    """

    base_rotation: Array
    joint_position: Array
    joint_velocity: Array
    base_twist: Array


class Peer:
    """Pinocchio's model of a robot with its base's origin at the odometry's."""

    def __init__(self, model: RobotModel) -> None:
        self.model = parse(model)
        self.data = self.model.createData()
        self._continuous = model.continuous

    def to(self, motion: Motion, index: int) -> None:
        """Move to one sample: placements and velocities of all bodies."""
        rotation = motion.base_rotation[index]
        joints: list[float] = []
        for angle, turns in zip(motion.joint_position[index], self._continuous, strict=True):
            joints += [np.cos(angle), np.sin(angle)] if turns else [angle]
        position = np.concatenate((np.zeros(3), quaternion_from_rotation(rotation), joints))
        twist = motion.base_twist[index].reshape(2, 3)
        velocity = np.concatenate((rotation.T @ twist[0], rotation.T @ twist[1], motion.joint_velocity[index]))
        pinocchio.forwardKinematics(self.model, self.data, position, velocity)
        pinocchio.updateFramePlacements(self.model, self.data)
        pinocchio.centerOfMass(self.model, self.data, position)
        pinocchio.computeCentroidalMomentum(self.model, self.data)

    def placement(self, body: int) -> tuple[Array, Array]:
        """Return rotation and position of a body."""
        placement = self.data.oMi[body + 1]
        return placement.rotation.copy(), placement.translation.copy()

    def link(self, name: str) -> tuple[Array, Array]:
        """Return rotation and position of a link's frame."""
        placement = self.data.oMf[self.model.getFrameId(name)]
        return placement.rotation.copy(), placement.translation.copy()

    def twist(self, body: int) -> Array:
        """Return the twist (u, w) of a body at the base's origin, odometry axes."""
        return np.array(self.data.oMi[body + 1].act(self.data.v[body + 1]).vector)

    def momentum(self) -> Array:
        """Return (P, L) about the base's origin, odometry axes."""
        linear, angular = self.data.hg.linear, self.data.hg.angular
        return np.concatenate((linear, angular + np.cross(self.data.com[0], linear)))
