"""An identified body in the forms other tools take; every number written reads back as the same number."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio

from mbaid_ros.cli import one_line
from mbaid_ros.core.geometry import Array, quaternion_from_rotation, unvec, vec
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.robot.momentum import box_sizes, ellipsoid_radii, principal
from mbaid_ros.replay.identified import Identified

BOX, ELLIPSOID = 'box', 'ellipsoid'


@dataclass(frozen=True)
class Placed:
    """A complete body with the frame its inertia is written in.

    Attributes
    ----------
    link : name
    mass, com : kg, m in the link's frame
    rotation : (3, 3) of the inertia's axes in the link's frame
    inertia : (6,) about the CoM in those axes: xx, xy, xz, yy, yz, zz
    """

    link: str
    mass: float
    com: Array
    rotation: Array
    inertia: Array


def placed(body: Identified, *, in_principal_axes: bool) -> Placed:
    """Return a body with its inertia in the link's axes or in its own."""
    parameters = body.parameters
    rotation: Array = np.eye(3)
    inertia = parameters[4:]
    if in_principal_axes:
        moments, rotation = _well_placed(parameters)
        inertia = vec(np.diag(moments))
    return Placed(body.link, float(parameters[0]), parameters[1:4], rotation, inertia)


def _well_placed(parameters: Array) -> tuple[Array, Array]:
    """Return principal moments and axes, in the order that keeps roll, pitch and yaw away from the gimbal lock."""
    found = principal(parameters)
    orders = [np.roll(np.arange(3), shift) for shift in range(3)]
    order = min(orders, key=lambda each: abs(found.axes[2, each[0]]))
    return found.moments[order], found.axes[:, order]


def equivalent(parameters: Array, shape: str) -> tuple[Array, Array]:
    """Return the (3,) sizes of a uniform body of the same inertia, and its (3, 3) axes in the link's frame.

    Sizes are the edges of a box, or the semi-axes of an ellipsoid, m.
    """
    moments, axes = _well_placed(parameters)
    mass = float(parameters[0])
    return (box_sizes if shape == BOX else ellipsoid_radii)(mass, moments), axes


def urdf_link(body: Identified, *, in_principal_axes: bool = False, shape: str = '') -> str:
    """Return a <link> of a URDF; a box shows as its visual."""
    at = placed(body, in_principal_axes=in_principal_axes)
    elements = ' '.join(f'{name}="{_exact(value)}"' for name, value in zip(PARAMETERS[4:], at.inertia, strict=True))
    lines = [
        f'<link name={_attribute(at.link)}>',
        '  <inertial>',
        f'    <origin xyz="{_spaced(at.com)}" rpy="{_spaced(_rpy(at.rotation))}"/>',
        f'    <mass value="{_exact(at.mass)}"/>',
        f'    <inertia {elements}/>',
        '  </inertial>',
    ]
    if shape:
        size, axes = equivalent(body.parameters, shape)
        lines += [
            '  <visual>',
            f'    <origin xyz="{_spaced(at.com)}" rpy="{_spaced(_rpy(axes))}"/>',
            f'    <geometry><box size="{_spaced(size)}"/></geometry>',
            '  </visual>',
        ]
    return '\n'.join([*lines, '</link>', ''])


def mjcf(body: Identified, *, in_principal_axes: bool = False, shape: str = '') -> str:
    """Return a MuJoCo model with the body alone in it, floating freely; an equivalent shape shows as a geom."""
    first, *rest = _mjcf_lines(body, in_principal_axes=in_principal_axes, shape=shape)
    lines = [f'    {line}' for line in (first, '  <freejoint/>', *rest)]
    head = [f'<mujoco model={_attribute(body.link)}>', '  <option gravity="0 0 0"/>', '  <worldbody>']
    return '\n'.join([*head, *lines, '  </worldbody>', '</mujoco>', ''])


def mjcf_body(body: Identified, *, in_principal_axes: bool = False, shape: str = '') -> str:
    """Return the <body> of a MuJoCo model with its <inertial>, to be put into a model of one's own."""
    return '\n'.join([*_mjcf_lines(body, in_principal_axes=in_principal_axes, shape=shape), ''])


def _mjcf_lines(body: Identified, *, in_principal_axes: bool, shape: str) -> list[str]:
    """Return the lines of a <body>; an equivalent shape shows as a geom without mass."""
    at = placed(body, in_principal_axes=in_principal_axes)
    if in_principal_axes:
        tensor = f'quat="{_spaced(_wxyz(at.rotation))}" diaginertia="{_spaced(at.inertia[[0, 3, 5]])}"'
    else:
        tensor = f'fullinertia="{_spaced(at.inertia[[0, 3, 5, 1, 2, 4]])}"'
    lines = [
        f'<body name={_attribute(at.link)}>',
        f'  <inertial pos="{_spaced(at.com)}" mass="{_exact(at.mass)}" {tensor}/>',
    ]
    if shape:
        size, axes = equivalent(body.parameters, shape)
        half = 0.5 * size if shape == BOX else size
        lines.append(
            f'  <geom type="{shape}" size="{_spaced(np.maximum(half, 1e-6))}" pos="{_spaced(at.com)}" '
            f'quat="{_spaced(_wxyz(axes))}" mass="0" contype="0" conaffinity="0"/>'
        )
    return [*lines, '</body>']


def basilisk(body: Identified, *, effector: bool) -> str:
    """Return Python assignments with the names that Basilisk gives the parameters of a hub or of a spinning body."""
    mass, com, inertia = body.parameters[0], body.parameters[1:4], unvec(body.parameters[4:])
    names = ('mass', 'r_ScS_S', 'IPntSc_S') if effector else ('mHub', 'r_BcB_B', 'IHubPntBc_B')
    owner = (
        'spinningBodyOneDOFStateEffector.SpinningBodyOneDOFStateEffector(); its frame S is the frame of this link'
        if effector
        else 'the hub of spacecraft.Spacecraft(); its frame B is the frame of this link'
    )
    return (
        f'# Basilisk: {owner}.\n'
        f'link = {json.dumps(one_line(body.link))}\n'
        f'{names[0]} = {_exact(mass)}  # kg\n'
        f'{names[1]} = {_column(com)}  # m, centre of mass\n'
        f'{names[2]} = {[[float(v) for v in row] for row in inertia]}  # kg m^2, about the centre of mass\n'
    )


def plain_json(body: Identified, *, in_principal_axes: bool = False, shape: str = '') -> str:
    """Return everything that is known as JSON; what is not determined is null."""
    values = _nullable(body.parameters)
    content: dict[str, Any] = {
        'target_link': body.link,
        'status': body.status,
        'mass': values[0],
        'com': values[1:4],
        'inertia': dict(zip(PARAMETERS[4:], values[4:], strict=True)),
        'covariance': None
        if np.all(np.isnan(body.covariance))
        else {'order': list(PARAMETERS), 'matrix': [_nullable(row) for row in body.covariance]},
    }
    if in_principal_axes:
        found = principal(body.parameters)
        content['principal'] = {'moments': found.moments.tolist(), 'axes': found.axes.T.tolist()}
    if shape:
        size, axes = equivalent(body.parameters, shape)
        content['equivalent'] = {'shape': shape, 'size': size.tolist(), 'axes': axes.T.tolist()}
    return json.dumps(content, indent=2, allow_nan=False) + '\n'


def _attribute(name: str) -> str:
    """Return a name as an attribute's value with its quotes; characters that XML lacks are written out."""
    kept = ''.join(char if _is_xml(char) else char.encode('unicode_escape').decode('ascii') for char in name)
    return quoteattr(kept)


def _is_xml(char: str) -> bool:
    return char in '\t\n\r' or (char >= ' ' and not '\ud800' <= char <= '\udfff' and char not in '\ufffe\uffff')


def _exact(value: float) -> str:
    return repr(float(value))  # the shortest text that reads back as the same number


def _spaced(values: Sequence[float] | Array) -> str:
    return ' '.join(_exact(value) for value in values)


def _column(values: Array) -> list[list[float]]:
    return [[float(value)] for value in values]


def _nullable(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _rpy(rotation: Array) -> Array:
    return np.asarray(pinocchio.rpy.matrixToRpy(rotation)) + 0.0


def _wxyz(rotation: Array) -> Array:
    return quaternion_from_rotation(rotation)[[3, 0, 1, 2]]
