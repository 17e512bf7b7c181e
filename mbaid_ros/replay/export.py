"""The executable `export`: an identified body in other tools' forms; numbers read back as they are."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio

from mbaid_ros.cli import EXIT_INCONSISTENT, EXIT_NOT_DETERMINED, one_line, warn
from mbaid_ros.config.parameter_files import read_robot_description
from mbaid_ros.core.geometry import Array, quaternion_from_rotation, unvec, vec
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.core.robot.body import is_physical, physical, principal, standard
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.urdf import replace_inertial, tree_of
from mbaid_ros.errors import DataError, ParameterError, listing
from mbaid_ros.files import as_utf8, require_writable, write_text
from mbaid_ros.replay.acm import acm
from mbaid_ros.replay.json_output import matrix, shaped
from mbaid_ros.replay.provenance import sha256_of
from mbaid_ros.replay.read_back import Identified, read_identified
from mbaid_ros.replay.whole_run import Run


def ellipsoid_radii(mass: float, moments: Array) -> Array:
    """Return the (3,) semi-axes, m, of the uniform ellipsoid with principal moments I_x = m (b^2 + c^2) / 5.

    A body flatter than flat has a radius of 0.
    """
    return np.sqrt(5.0 * _second_moments(moments) / mass)


def box_sizes(mass: float, moments: Array) -> Array:
    """Return the (3,) edges, m, of the uniform box with principal moments I_x = m (b^2 + c^2) / 12; 0 at least."""
    return np.sqrt(12.0 * _second_moments(moments) / mass)


def _second_moments(moments: Array) -> Array:
    """Return the integrals of x^2, y^2, z^2 over the mass: (I_y + I_z - I_x) / 2 and so on."""
    return np.maximum(0.5 * np.sum(moments) - moments, 0.0)


BOX, ELLIPSOID = 'box', 'ellipsoid'
_PRINCIPAL = ('urdf-link', 'mjcf', 'mjcf-body', 'json')  # formats with axes of their own for the inertia
_SHAPES = {'urdf-link': (BOX,), **dict.fromkeys(('mjcf', 'mjcf-body', 'json'), (BOX, ELLIPSOID))}


def export(arguments: argparse.Namespace) -> int:
    """Write the body by the arguments and return the exit code."""
    _check(arguments)
    body = read_identified(arguments.input, arguments.result, arguments.topic, alone=arguments.debris)
    warn('export', body.notes)
    urdf = read_robot_description(arguments.model) if arguments.model else ''
    if arguments.model and body.robot_sha256 not in {'', sha256_of(arguments.model, urdf)}:
        raise ParameterError(
            f"'{arguments.input}' was made with another robot description than --model '{arguments.model}': give the "
            f'one with the SHA-256 {body.robot_sha256}, or replay with this one'
        )
    if urdf:
        body = _in_robot(body, urdf)
    if arguments.fill:  # from the link in the robot description
        described = physical(load_model(urdf).link(body.link).parameters)
        body = replace(body, parameters=np.where(np.isnan(body.parameters), described, body.parameters))
    reason = _why_not(body, arguments)
    if reason:
        print(f'mbaid_ros export: {one_line(reason)}', file=sys.stderr)
        return EXIT_INCONSISTENT if body.contradicted else EXIT_NOT_DETERMINED
    text = _written(body, arguments, urdf)
    if arguments.output is None:
        sys.stdout.write(as_utf8(text))
    else:
        write_text(arguments.output, text)
        written = f"the captured body in '{body.link}'" if arguments.debris else f"'{body.link}'"
        print(one_line(f'{arguments.output}: {written} as {arguments.format}'))
    return 0


def _in_robot(body: Identified, urdf: str) -> Identified:
    """Return a body of a link of the robot, where the frame of an estimate has its name after a `frame_prefix`."""
    names = [each.get('name', '') for each in tree_of(urdf).iter('link')]
    ends = [name for name in names if name and body.link.endswith(name)]
    if body.link in names or len(ends) != 1:
        return body
    warn('export', [f"frame '{body.link}' counts as link '{ends[0]}' with a frame_prefix"])
    return replace(body, link=ends[0])


def identified_urdf(run: Run) -> str:
    """Return the robot description of a run with the identified link.

    Raises DataError: The data contradict the model or do not determine all ten numbers, or no body has these.
    """
    final = run.final
    body = Identified(run.target_link, final.status, final.parameters, final.covariance, final.warnings)
    reason = _why_unusable(body)
    if reason:
        raise DataError(reason)
    return replace_inertial(run.urdf, body.link, body.parameters)


def _check(arguments: argparse.Namespace) -> None:
    """Refuse options that contradict each other."""
    form, shape = arguments.format, arguments.equivalent
    needs_model = '--fill' if arguments.fill else '--format urdf' if form == 'urdf' else ''
    if needs_model and not arguments.model:
        raise ParameterError(f'{needs_model} needs --model URDF')
    if arguments.model and not (needs_model or form == 'mjcf'):
        raise ParameterError(f'--model is not for --format {form} without --fill; accepted: urdf, mjcf')
    if arguments.debris and arguments.model:
        raise ParameterError('--debris is not for --model: the captured body is no link of the robot')
    if arguments.principal and form not in _PRINCIPAL:
        raise ParameterError(f'--principal is not for --format {form}; accepted: {listing(_PRINCIPAL)}')
    if shape and shape not in _SHAPES.get(form, ()):
        fitting = [name for name, shapes in _SHAPES.items() if shape in shapes]
        raise ParameterError(f'--equivalent {shape} is not for --format {form}; accepted: {listing(fitting)}')
    require_writable('--output', arguments.output)


def _why_not(body: Identified, arguments: argparse.Namespace) -> str:
    """Return why a body cannot be written; empty if it can."""
    if arguments.format == 'json' and not (arguments.principal or arguments.equivalent):
        return ''
    hint = ''
    if body.contradicted:
        hint = ' (--format json writes it)'
    elif body.missing and not arguments.fill:
        hint = ' (--fill takes them from --model, --format json writes the others)'
    reason = _why_unusable(body)
    return f'{reason}{hint}' if reason else ''


def _why_unusable(body: Identified) -> str:
    """Return why no other program can use a body; empty if it can."""
    if body.contradicted:
        return f"the data contradict the model of '{body.link}': not exported"
    if body.missing:
        return f"the data do not determine {listing(body.missing)} of '{body.link}'"
    if not is_physical(standard(body.parameters)):
        return f"no real body has the mass, centre of mass and inertia of '{body.link}': not exported"
    return ''


def _written(body: Identified, arguments: argparse.Namespace, urdf: str) -> str:
    form, in_principal_axes, shape = arguments.format, arguments.principal, arguments.equivalent or ''
    if form == 'urdf':
        load_model(urdf).link(body.link)
        return replace_inertial(urdf, body.link, body.parameters)
    if form.startswith('basilisk'):
        return _basilisk(body, effector=form == 'basilisk-effector')
    if form == 'ccsds-acm':
        return acm(body)
    if form == 'json':
        return _plain_json(body, in_principal_axes=in_principal_axes, shape=shape)
    options: dict[str, Any] = {'in_principal_axes': in_principal_axes, 'shape': shape}
    element = _urdf_link(body, **options) if form == 'urdf-link' else _mjcf_body(body.link, body.parameters, **options)
    if form == 'mjcf':
        element = _mjcf(element, body.link, load_model(urdf, body.base_link) if urdf else None)
    ET.indent(element)
    return ET.tostring(element, encoding='unicode') + '\n'


def _placed(parameters: Array, *, in_principal_axes: bool) -> tuple[Array, Array]:
    """Return the inertia (6,) about the CoM in the link's axes or its own, and (3, 3) those axes in the link's."""
    if not in_principal_axes:
        return parameters[4:], np.eye(3)
    moments, rotation = _principal_axes(parameters)
    return vec(np.diag(moments)), rotation


def _principal_axes(parameters: Array) -> tuple[Array, Array]:
    """Return principal moments and axes, in the order that keeps roll, pitch and yaw away from the gimbal lock."""
    found = principal(parameters)
    orders = [np.roll(np.arange(3), shift) for shift in range(3)]
    order = min(orders, key=lambda each: abs(found.axes[2, each[0]]))
    return found.moments[order], found.axes[:, order]


def _equivalent(parameters: Array, shape: str) -> tuple[Array, Array]:
    """Return edges of the uniform box or semi-axes of the ellipsoid (3,) m, and (3, 3) their axes in the link's."""
    moments, axes = _principal_axes(parameters)
    return (box_sizes if shape == BOX else ellipsoid_radii)(float(parameters[0]), moments), axes


def _urdf_link(body: Identified, *, in_principal_axes: bool, shape: str) -> ET.Element:
    """Return a <link> of a URDF; a box shows as its visual."""
    inertia, rotation = _placed(body.parameters, in_principal_axes=in_principal_axes)
    com = _spaced(body.parameters[1:4])
    link = ET.Element('link', name=_xml(body.link))
    inertial = ET.SubElement(link, 'inertial')
    ET.SubElement(inertial, 'origin', xyz=com, rpy=_spaced(_rpy(rotation)))
    ET.SubElement(inertial, 'mass', value=_exact(body.parameters[0]))
    ET.SubElement(inertial, 'inertia', dict(zip(PARAMETERS[4:], map(_exact, inertia), strict=True)))
    if shape:
        size, axes = _equivalent(body.parameters, shape)
        visual = ET.SubElement(link, 'visual')
        ET.SubElement(visual, 'origin', xyz=com, rpy=_spaced(_rpy(axes)))
        ET.SubElement(ET.SubElement(visual, 'geometry'), 'box', size=_spaced(size))
    return link


def _mjcf_body(name: str, parameters: Array, *, in_principal_axes: bool = False, shape: str = '') -> ET.Element:
    """Return the <body> of a MuJoCo model; an equivalent shape shows as a geom without mass."""
    body = ET.Element('body', name=_xml(name))
    if not parameters[0]:
        return body
    inertia, rotation = _placed(parameters, in_principal_axes=in_principal_axes)
    com = _spaced(parameters[1:4])
    if in_principal_axes:
        tensor = {'quat': _spaced(_wxyz(rotation)), 'diaginertia': _spaced(inertia[[0, 3, 5]])}
    else:
        tensor = {'fullinertia': _spaced(inertia[[0, 3, 5, 1, 2, 4]])}
    ET.SubElement(body, 'inertial', {'pos': com, 'mass': _exact(parameters[0]), **tensor})
    if shape:
        size, axes = _equivalent(parameters, shape)
        half = np.maximum(0.5 * size if shape == BOX else size, 1e-6)
        seen = {'type': shape, 'size': _spaced(half), 'pos': com, 'quat': _spaced(_wxyz(axes))}
        ET.SubElement(body, 'geom', {**seen, 'mass': '0', 'contype': '0', 'conaffinity': '0'})
    return body


def _mjcf(body: ET.Element, name: str, robot: RobotModel | None) -> ET.Element:
    """Return a model without gravity in which a body floats by itself, or as a link of a robot."""
    whole = ET.Element('mujoco', model=_xml(robot.name if robot else name))
    ET.SubElement(whole, 'compiler', angle='radian')
    ET.SubElement(whole, 'option', gravity='0 0 0')
    floating = _mjcf_tree(robot, name, body) if robot else body
    floating.insert(0, ET.Element('freejoint'))
    ET.SubElement(whole, 'worldbody').append(floating)
    if robot and not robot.transmission.direct:
        names, moved = [_xml(joint) for joint in robot.joint_names], robot.transmission
        following = ET.SubElement(whole, 'equality')
        for joint in sorted(set(range(robot.joints)) - set(moved.independent.tolist())):
            line = _spaced((moved.offset[joint], moved.multiplier[joint], 0.0, 0.0, 0.0))
            driver = names[moved.independent[moved.driver[joint]]]
            ET.SubElement(following, 'joint', joint1=names[joint], joint2=driver, polycoef=line)
    return whole


def _mjcf_tree(robot: RobotModel, target: str, identified: ET.Element) -> ET.Element:
    """Return the base link's <body> with all links in it, each a body of its own; the target is the identified one."""
    robot.link(target)
    carriers: list[ET.Element] = []  # of each moving body the link that its joint moves
    for link in robot.links:
        known = physical(link.parameters) if link.parameters[0] else link.parameters
        body = identified if link.name == target else _mjcf_body(link.name, known)
        joint = link.body - 1
        if link.body < len(carriers):  # fixed to one of those before
            rotation, position, parent = link.rotation, link.position, link.body
        elif carriers:
            rotation, position, parent = robot.rotations[joint], robot.positions[joint], robot.parents[joint]
            kind, axis = 'slide' if robot.prismatic[joint] else 'hinge', _spaced(robot.axes[joint])
            moving = ET.SubElement(body, 'joint', name=_xml(robot.joint_names[joint]), type=kind, axis=axis)
            ends = robot.limits[joint].lower, robot.limits[joint].upper
            if all(map(math.isfinite, ends)):
                moving.set('range', _spaced(ends))
        if carriers:
            body.set('pos', _spaced(position))
            body.set('quat', _spaced(_wxyz(rotation)))
            carriers[parent].append(body)
        if link.body == len(carriers):
            carriers.append(body)
    return carriers[0]


def _basilisk(body: Identified, *, effector: bool) -> str:
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
        f'{names[1]} = {com[:, None].tolist()}  # m, centre of mass\n'
        f'{names[2]} = {inertia.tolist()}  # kg m^2, about the centre of mass\n'
    )


def _plain_json(body: Identified, *, in_principal_axes: bool, shape: str) -> str:
    """Return everything that is known as JSON; a parameter that is not determined is null."""
    rows = matrix(body.covariance)
    content: dict[str, Any] = {
        'target_link': body.link,
        'status': body.status,
        **shaped(body.parameters),
        'covariance': None if rows is None else {'order': list(PARAMETERS), 'matrix': rows},
    }
    if in_principal_axes:
        found = principal(body.parameters)
        content['principal'] = {'moments': found.moments.tolist(), 'axes': found.axes.T.tolist()}
    if shape:
        size, axes = _equivalent(body.parameters, shape)
        content['equivalent'] = {'shape': shape, 'size': size.tolist(), 'axes': axes.T.tolist()}
    return json.dumps(content, indent=2, allow_nan=False) + '\n'


def _xml(name: str) -> str:
    """Return a name of characters that XML has; others are written out."""
    return ''.join(char if _is_xml(char) else char.encode('unicode_escape').decode('ascii') for char in name)


def _is_xml(char: str) -> bool:
    return char in '\t\n\r' or (char >= ' ' and not '\ud800' <= char <= '\udfff' and char not in '\ufffe\uffff')


def _exact(value: float) -> str:
    return repr(float(value))  # the shortest text that reads back as the same number


def _spaced(values: Sequence[float] | Array) -> str:
    return ' '.join(map(_exact, values))


def _rpy(rotation: Array) -> Array:
    return np.asarray(pinocchio.rpy.matrixToRpy(rotation)) + 0.0


def _wxyz(rotation: Array) -> Array:
    return quaternion_from_rotation(rotation)[[3, 0, 1, 2]]
