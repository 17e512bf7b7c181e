"""The executable `calibrate`: bodies, joints and mount from motions in bags; its JSON form, which scripts rely on."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from mbaid_ros.calibration.calibration import CalibrationSettings
from mbaid_ros.calibration.calibration import calibrate as estimate_bodies
from mbaid_ros.calibration.result import Calibration, LinkResult
from mbaid_ros.calibration.unknowns import JOINT_UNKNOWNS, LINK_UNKNOWNS, MOUNT_UNKNOWNS
from mbaid_ros.cli import EXIT_INCONSISTENT, EXIT_NOT_DETERMINED, one_line
from mbaid_ros.config.calibration_file import NODE, calibration_parameters
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import given_parameters, read_robot_description
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import KnownLinksConfig, link_deviations, relative_factor
from mbaid_ros.core.passive import springs
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.core.robot.model import Link, RobotModel, displaced, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.robot.urdf import displace_joint, replace_inertial
from mbaid_ros.core.wheels import storage
from mbaid_ros.errors import DataError, ModelError, ParameterError, listing
from mbaid_ros.files import write_text
from mbaid_ros.replay.calibration_text import Calibrated, summary, why_not
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.json_output import passive_joints, plain, shaped, shaped_momentum
from mbaid_ros.replay.one_bag import read_motions
from mbaid_ros.replay.writers import check_outputs, write_results
from mbaid_ros.session.catalogue import declaration
from mbaid_ros.session.robot import declared_mass

CALIBRATED, INCONSISTENT = 'calibrated', 'inconsistent'
_INERTIA = PARAMETERS[4:]


def calibrate(arguments: argparse.Namespace) -> int:
    """Calibrate by the arguments, write the results, and return the exit code."""
    check_outputs(arguments, 'output')
    model, output = Path(arguments.model), arguments.output
    if output and model.is_file() and Path(output).is_file() and model.samefile(output):
        raise ParameterError(f"--output '{output}' is the model itself; accepted: another file")
    values = given_parameters(arguments, 'estimator', NODE)
    if arguments.unknown is not None:
        values['unknown_links'] = arguments.unknown
    config, names = calibration_parameters(values)
    urdf = read_robot_description(arguments.model)
    kernel = _kernel(load_model(urdf, config.base_link), config, names)
    settings = _settings(kernel, config)
    inputs = Inputs.from_arguments(arguments, config)
    motions = [read_motions(bag, config, urdf, inputs) for bag in arguments.bags]
    for motion in motions:
        if not motion.runs:
            raise DataError(f"bag '{motion.bag}' contains no complete window; {'; '.join(motion.warnings)}")
    calibration = estimate_bodies(kernel, [windows for each in motions for windows in each.runs], settings)
    result = Calibrated(calibration, tuple(motions), kernel, config)
    reason = why_not(result)
    if reason:
        print(f'mbaid_ros calibrate: {one_line(reason)}', file=sys.stderr)
        return EXIT_INCONSISTENT if result.unsolvable else EXIT_NOT_DETERMINED
    if output and not result.contradicted:
        write_text(output, _calibrated_urdf(urdf, calibration))
    write_results(arguments, _as_json(result), lambda: _text(result, arguments), lambda: _page(result))
    return EXIT_INCONSISTENT if result.contradicted else 0


def _page(result: Calibrated) -> str:
    from mbaid_ros.replay.report.calibration_page import calibration_page  # noqa: PLC0415 - matplotlib takes a while

    return calibration_page(result)


def _text(result: Calibrated, arguments: argparse.Namespace) -> str:
    """Return the result for a terminal, and how an estimation uses it: robot and covariance belong together."""
    text, output = summary(result), one_line(arguments.output or '')
    if not output or result.contradicted:
        return text
    if arguments.json:
        hint = f'with known_links.calibration {one_line(arguments.json)}'
        return f'{text}\nreplay and estimator go on from it: {output}, {hint}'
    return f'{text}\n--json FILE keeps the uncertainty of {output}, for known_links.calibration'


def _kernel(model: RobotModel, config: EstimatorConfig, names: tuple[str, ...]) -> MomentumKernel:
    """Return the momentum of a robot with the unknown links of some names; of none, with all that have an inertia."""
    if not names:
        names = tuple(link.name for link in model.links if link.parameters[0] > 0.0)
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ParameterError(f'--unknown names {listing(twice)} twice; accepted: each link once')
    if not names:
        raise ModelError('no link of the robot description has an <inertial>; accepted: one at least')
    kernel = MomentumKernel(model, *names).with_storage(storage(config.wheels, model))
    return kernel.with_springs(springs(config.flexible, model))


def _settings(kernel: MomentumKernel, estimator: EstimatorConfig) -> CalibrationSettings:
    """Return noise and priors, which are the estimator's; refuse those of a link that the robot does not have."""
    model = kernel.model
    for link in estimator.known_links.links:
        model.link(link)
    total = declared_mass(estimator.known_links)
    circle = replace(estimator.orbit, undeclared_rate=0.0, undeclared_eccentricity=0.0)  # no orbit but the declared one
    return CalibrationSettings(
        noise=estimator.noise.declared,
        priors=tuple(_link_prior(link, estimator.known_links) for link in kernel.unknown),
        declared=replace(
            declaration(replace(estimator, orbit=circle), kernel),
            total_mass=None if total is None else replace(total, with_target=True),
        ),
        window=estimator.window,
        orientation_measured=estimator.oriented,
    )


def _link_prior(link: Link, known: KnownLinksConfig) -> Array | None:
    """Return the factor (10, e) of a link's prior covariance, the very one of the estimator; None without a prior."""
    if link.parameters[0] <= 0.0:
        return None
    if link.name in known.links:
        return link_deviations(link.parameters, known, known.links[link.name]).factor(link.parameters)
    if known.relative_std == 0.0:
        raise ParameterError(
            f"parameter 'known_links.relative_std' is 0, which makes {link.name} exact; accepted: above 0, or "
            f'known_links.{link.name}, or a link left out of --unknown'
        )
    return relative_factor(link.parameters, known.relative_std)


def _calibrated_urdf(urdf: str, calibration: Calibration) -> str:
    for link in calibration.links:
        urdf = replace_inertial(urdf, link.name, link.parameters)
    names = calibration.kernel.model.joint_names
    for name, origin, tilt in zip(names, *calibration.displacements, strict=True):
        urdf = displace_joint(urdf, name, origin, tilt)
    return urdf


def _as_json(result: Calibrated) -> dict[str, Any]:
    """Return the result as scripts read it; None for unknown values."""
    calibration = result.calibration
    model, links = result.kernel.model, result.kernel.unknown
    bags = [motion.bag for motion in result.motions for _ in motion.runs]
    return {
        'status': INCONSISTENT if result.contradicted else CALIBRATED,
        'bags': [motion.bag for motion in result.motions],
        'links': {link.name: _link(link) for link in calibration.links},
        'joints': _joints(calibration),
        'odometry_mount': {
            'orientation': calibration.mount[:3].tolist(),
            'orientation_std': calibration.stds[-6:-3].tolist(),
            'position': calibration.mount[3:].tolist(),
            'position_std': calibration.stds[-3:].tolist(),
        },
        'thrusters': [plain(vars(each)) for each in calibration.thrusters],
        'flexible': passive_joints(calibration.flexible),
        'covariance': {
            'order': [
                *(f'{link.name}.{number}' for link in links for number in LINK_UNKNOWNS),
                *(f'{name}.{number}' for name in model.joint_names for number in JOINT_UNKNOWNS),
                *(f'odometry_mount.{number}' for number in MOUNT_UNKNOWNS),
            ],
            'values': calibration.values.tolist(),
            'matrix': calibration.block_covariance.tolist(),
        },
        'identifiability': {'determined': calibration.determined},
        'scale': {'relative_std': calibration.scale_std},
        'momentum': [
            {'bag': bag, **shaped_momentum(value, covariance)}
            for bag, value, covariance in zip(bags, calibration.momentum, calibration.momentum_covariance, strict=True)
        ],
        'residual': calibration.residual,
        'samples': calibration.samples,
        'span_s': calibration.span,
        'planar': calibration.planar,
        'joints_at_rest': list(calibration.at_rest),
        'warnings': list(result.warnings),
    }


def _link(link: LinkResult) -> dict[str, Any]:
    ratios = link.ratios
    columns = {'cad': link.cad, 'estimate': link.parameters, 'std': link.std, 'prior_std': link.prior_std}
    columns |= {'learnt': link.variance_reduction, 'moved': link.shift_in_prior_stds}
    return {
        **{name: shaped(values) for name, values in columns.items()},
        'inertia_ratios': {  # over the trace
            'of_trace': dict(zip(_INERTIA, ratios.elements.tolist(), strict=True)),
            'std': dict(zip(_INERTIA, ratios.std.tolist(), strict=True)),
            'principal': ratios.principal.tolist(),
            'principal_std': ratios.principal_std.tolist(),
            'scale_relative_std': ratios.scale_std,
        },
        'stayed_at_cad': [name for name, stayed in zip(PARAMETERS, link.is_prior, strict=True) if stayed],
        'consistency_correction': link.consistency_correction,
    }


def _joints(calibration: Calibration) -> dict[str, Any]:
    """Return each joint's deviation from the URDF, and its frame on the body that carries it."""
    before = calibration.kernel.model
    after = displaced(before, *calibration.displacements)
    stds = calibration.stds[len(calibration.theta) : -6].reshape(-1, 6)
    names = 'zero', 'zero_std', 'origin_moved', 'origin_std', 'axis_tilted', 'axis_std', 'position', 'rotation'
    origins, tilts = calibration.displacements
    columns = (calibration.joints[:, 0], stds[:, 0], origins, stds[:, 1:4], tilts, stds[:, 4:])
    rows = zip(*columns, after.positions, after.rotations, strict=True)
    return {
        joint: plain(dict(zip(names, row, strict=True))) for joint, row in zip(before.joint_names, rows, strict=True)
    }
