"""Recorded runs of ReDySim's floating-base module, read from a clone of github.com/naveen13m/ReDySim_Floating_Base.

A folder of it has a robot by modified Denavit-Hartenberg parameters (inputs.m) and its motion at 10 Hz (timevar.dat,
statevar.dat): base position, angles about z, x and y, joint angles, and the rates of all. It has no torques.
"""

import re
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from benchmarks.data import RATE
from mbaid_ros.core.geometry import Array, rotate_back
from mbaid_ros.simulation.simulation import Truth

FOLDERS = {'redysim_planar': 'ForDyn', 'redysim_spatial': 'InvDyn'}
_BODY = (
    '<link name="{0}"><inertial><origin xyz="{1[0]} {1[1]} {1[2]}"/><mass value="{2}"/>'
    '<inertia ixx="{3[0]}" iyy="{3[1]}" izz="{3[2]}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
_JOINT = (
    '<joint name="joint{0}" type="continuous"><parent link="{1}"/><child link="link{0}"/><axis xyz="0 0 1"/>'
    '<origin xyz="{2[0]} {2[1]} {2[2]}" rpy="{3} 0 0"/></joint>'
)


def urdf(folder: Path) -> str:
    """Return the robot description of a folder's inputs.m."""
    values = _inputs((folder / 'inputs.m').read_text(encoding='latin-1'))
    centre = np.stack([values[name] for name in ('dx', 'dy', 'dz')], axis=1)
    inertia = np.stack([values[name] for name in ('Icxx', 'Icyy', 'Iczz')], axis=1)
    parts, names = [], ['base_link', *(f'link{number}' for number in range(1, len(centre)))]
    for number, name in enumerate(names):
        parts.append(_BODY.format(name, centre[number], values['m'][number], inertia[number]))
        if number:
            a, b, twist = (values[key][number] for key in ('a', 'b', 'alp'))
            origin = (a, -b * np.sin(twist), b * np.cos(twist))
            parts.append(_JOINT.format(number, names[number - 1], origin, twist))
    return f'<robot name="redysim">{"".join(parts)}</robot>'


def motion(folder: Path) -> Truth:
    """Return the motion of a folder: cubic splines through positions and rates."""
    states = np.loadtxt(folder / 'statevar.dat')
    joints = (states.shape[1] - 13) // 2
    spline = CubicHermiteSpline(
        np.loadtxt(folder / 'timevar.dat'), states[:, : 6 + joints], states[:, 6 + joints : 12 + 2 * joints]
    )
    time = np.arange(round(float(spline.x[-1]) * RATE) + 1) / RATE
    value, rate = spline(time), spline(time, 1)
    rotation = Rotation.from_euler('ZXY', value[:, 3:6])
    (_, sine_x, sine_y), (_, cosine_x, cosine_y) = np.sin(value[:, 3:6].T), np.cos(value[:, 3:6].T)
    about_z, about_x, about_y = rate[:, 3:6].T
    angular = (
        about_x * cosine_y - about_z * sine_y * cosine_x,
        about_y + about_z * sine_x,
        about_x * sine_y + about_z * cosine_y * cosine_x,
    )
    return Truth(
        time=time,
        joint_position=value[:, 6:],
        joint_velocity=rate[:, 6:],
        joint_effort=np.full((len(time), joints), np.nan),
        base_position=value[:, :3],
        base_orientation=rotation.as_quat(),
        base_linear_velocity=rotate_back(rotation.as_matrix(), rate[:, :3]),
        base_angular_velocity=np.stack(angular, axis=1),
    )


def _inputs(text: str) -> dict[str, Array]:
    """Return the vectors of inputs.m: of assignments of lists, of halves of vectors, and of single elements."""
    values: dict[str, Array] = {}
    for line in text.splitlines():
        for name, index, right in re.findall(r'(\w+)(?:\((\d+)\))?\s*=\s*(\[.*?\]|[^;\[\]]+)', line.partition('%')[0]):
            if index:
                values[name][int(index) - 1] = _term(right.strip(), values)
            elif right.startswith('['):
                values[name] = np.array([_term(each, values) for each in re.split(r'[\s;,]+', right.strip('[]; '))])
            elif right.startswith('zeros'):
                values[name] = np.zeros(len(values['m']))
            elif right.partition('/')[0] in values:
                values[name] = _term(right, values)
    return values


def _term(text: str, values: dict[str, Array]) -> Array:
    """Return a number, pi, a vector, or an element of one, or the quotient of two."""
    above, _, below = text.partition('/')
    element = re.fullmatch(r'(\w+)\((\d+)\)', above)
    if element:
        value = values[element[1]][int(element[2]) - 1]
    else:
        value = values[above] if above in values else np.pi if above == 'pi' else float(above)
    return np.asarray(value / float(below or 1.0))
