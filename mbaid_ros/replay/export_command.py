"""What the executable `export` does with its arguments."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from mbaid_ros.cli import EXIT_INCONSISTENT, EXIT_NOT_DETERMINED, one_line, warn
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.results.physical_consistency import is_physical
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import physical, standard
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.files import as_utf8, write_text
from mbaid_ros.replay import formats
from mbaid_ros.replay.identified import Identified, read_identified

_PRINCIPAL = ('urdf-link', 'mjcf', 'mjcf-body', 'json')  # formats with axes of their own for the inertia
_SHAPES = {
    'urdf-link': (formats.BOX,),
    'mjcf': (formats.BOX, formats.ELLIPSOID),
    'mjcf-body': (formats.BOX, formats.ELLIPSOID),
    'json': (formats.BOX, formats.ELLIPSOID),
}


def export(arguments: argparse.Namespace) -> int:
    """Do what the arguments ask for and return the exit code."""
    _check(arguments)
    body = read_identified(arguments.input, arguments.result, arguments.topic, alone=arguments.debris)
    warn('export', body.notes)
    urdf = read_robot_description(arguments.model) if arguments.model else ''
    if arguments.fill:
        body = _filled(body, urdf)
    reason = _why_not(body, arguments)
    if reason:
        print(f'mbaid_ros export: {one_line(reason)}', file=sys.stderr)
        return EXIT_INCONSISTENT if body.contradicted else EXIT_NOT_DETERMINED
    text = _written(body, arguments, urdf)
    if arguments.output is None:
        sys.stdout.write(as_utf8(text))
    else:
        write_text(arguments.output, text)
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """Refuse options that contradict each other."""
    form, shape = arguments.format, arguments.equivalent
    if (form == 'urdf' or arguments.fill) and not arguments.model:
        raise ParameterError(f'{"--fill" if arguments.fill else "--format urdf"} needs --model URDF')
    if arguments.debris and (form == 'urdf' or arguments.fill):
        raise ParameterError(
            f'--debris is not for {"--fill" if arguments.fill else "--format urdf"}: the captured body is no link of it'
        )
    if arguments.principal and form not in _PRINCIPAL:
        raise ParameterError(f'--principal is not for --format {form}; accepted: {listing(_PRINCIPAL)}')
    if shape and shape not in _SHAPES.get(form, ()):
        fitting = [name for name, shapes in _SHAPES.items() if shape in shapes]
        raise ParameterError(f'--equivalent {shape} is not for --format {form}; accepted: {listing(fitting)}')
    output = arguments.output
    if output is not None and (not Path(output).parent.is_dir() or Path(output).is_dir()):
        raise ParameterError(f"--output '{output}' cannot be written; accepted: a file in a folder that exists")


def _filled(body: Identified, urdf: str) -> Identified:
    """Return the body with what is missing taken from its link in the robot description."""
    described = physical(load_model(urdf).link(body.link).parameters)
    return replace(body, parameters=np.where(np.isnan(body.parameters), described, body.parameters))


def _why_not(body: Identified, arguments: argparse.Namespace) -> str:
    """Return why a body cannot be written; empty if it can."""
    if arguments.format == 'json' and not (arguments.principal or arguments.equivalent):
        return ''
    if body.contradicted:
        return f"the data contradict the model of '{body.link}': not exported (--format json writes it)"
    if body.missing:
        hint = '' if arguments.fill else ' (--fill takes them from --model, --format json writes what there is)'
        return f"the data do not determine {listing(body.missing)} of '{body.link}'{hint}"
    if not is_physical(standard(body.parameters)):
        return f"no real body has the mass, centre of mass and inertia of '{body.link}': not exported"
    return ''


def _written(body: Identified, arguments: argparse.Namespace, urdf: str) -> str:
    principal, shape = arguments.principal, arguments.equivalent or ''
    if arguments.format == 'urdf':
        load_model(urdf).link(body.link)
        return replace_inertial(urdf, body.link, body.parameters)
    if arguments.format == 'urdf-link':
        return formats.urdf_link(body, in_principal_axes=principal, shape=shape)
    if arguments.format == 'mjcf':
        return formats.mjcf(body, in_principal_axes=principal, shape=shape)
    if arguments.format == 'mjcf-body':
        return formats.mjcf_body(body, in_principal_axes=principal, shape=shape)
    if arguments.format == 'json':
        return formats.plain_json(body, in_principal_axes=principal, shape=shape)
    return formats.basilisk(body, effector=arguments.format == 'basilisk-effector')
