"""Random robots and random states, as URDF text and arrays: what the identities are tested on."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core import geometry
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import Storage

KINDS = ('revolute', 'continuous', 'prismatic', 'fixed')


def random_inertial(rng: np.random.Generator) -> str:
    """Return the <inertial> of a random rigid body: a cloud of point masses, hence physical."""
    points = rng.normal(size=(12, 3)) * rng.uniform(0.1, 0.6, 3)
    masses = rng.uniform(0.2, 5.0, 12)
    mass = masses.sum()
    com = masses @ points / mass
    offsets = points - com
    inertia = -np.einsum('k,kij->ij', masses, geometry.skew(offsets) @ geometry.skew(offsets))
    rpy = rng.uniform(-1.0, 1.0, 3)
    names = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
    elements = ' '.join(
        f'{name}="{value!r}"' for name, value in zip(names, geometry.vec(inertia).tolist(), strict=True)
    )
    return (
        f'<inertial><origin xyz="{_text(com)}" rpy="{_text(rpy)}"/><mass value="{float(mass)!r}"/>'
        f'<inertia {elements}/></inertial>'
    )


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


def random_state(rng: np.random.Generator, joints: int, count: int) -> tuple[Array, Array, Array, Array]:
    """Return joint positions (N, n), joint velocities (N, n), base rotations (N, 3, 3), base twists (N, 6)."""
    return (
        rng.uniform(-2.0, 2.0, (count, joints)),
        rng.normal(size=(count, joints)),
        geometry.exp(rng.normal(size=(count, 3))),
        rng.normal(size=(count, 6)),
    )


def _link(index: int) -> str:
    return f'link{index}' if index else 'base_link'


def _text(values: Array) -> str:
    return ' '.join(repr(float(value)) for value in values)


def random_storage(rng: np.random.Generator, model: RobotModel) -> Storage:
    """Return two wheels in one body, one in another, and a momentum that is told in the axes of a link."""
    wheels = Storage()
    for count in (2, 1):
        axes = rng.normal(size=(count, 3))
        link = model.links[int(rng.integers(len(model.links)))]
        names = [f'wheel{wheels.count + index}' for index in range(count)]
        unit = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        wheels += Storage.wheels(link, names, unit, rng.uniform(0.5, 2.0, count).tolist(), 0.1)
    return wheels + Storage.published(model.link(model.last_link), 0.1)
