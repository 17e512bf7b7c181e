"""What the executable `calibrate` does with its arguments."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from mbaid_ros.calibration.calibrate import CalibrationSettings, calibrate
from mbaid_ros.calibration.result import Calibration
from mbaid_ros.calibration.unknowns import LinkPrior
from mbaid_ros.cli import EXIT_INCONSISTENT, EXIT_NOT_DETERMINED, one_line
from mbaid_ros.config.calibration import NODE, CalibrationParameters, calibration_parameters
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.core.errors import DataError, ModelError, ParameterError, listing
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.urdf_edit import change_inertial, displace_joint
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.files import as_utf8, write_text
from mbaid_ros.replay.calibrated import Calibrated, as_json, why_not
from mbaid_ros.replay.calibrated_text import summary
from mbaid_ros.replay.feed import progress_bar
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.motions import BagMotions, read_motions
from mbaid_ros.session import storage, with_surroundings

STDOUT = '-'


def calibrate_bags(arguments: argparse.Namespace) -> int:
    """Do what the arguments ask for and return the exit code."""
    _check_outputs(arguments)
    parameters = _parameters(arguments)
    urdf = read_robot_description(arguments.model)
    kernel = make_kernel(load_model(urdf, parameters.estimator.base_link), parameters)
    settings = make_settings(kernel, parameters)
    inputs = Inputs.of(arguments, parameters.estimator)
    motions = [_motions(bag, parameters, urdf, inputs) for bag in arguments.bags]
    for motion in motions:
        if not motion.runs:
            raise DataError(f"bag '{motion.bag}' holds no complete window; {'; '.join(motion.warnings)}")
    calibration = calibrate(kernel, [windows for each in motions for windows in each.runs], settings)
    result = Calibrated(calibration, tuple(motions), kernel, parameters)
    reason = why_not(result)
    if reason:
        print(f'mbaid_ros calibrate: {one_line(reason)}', file=sys.stderr)
        return EXIT_NOT_DETERMINED
    _write_results(result, urdf, arguments)
    return EXIT_INCONSISTENT if result.contradicted else 0


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse before the long work what could not be written after it."""
    for option in ('json', 'report', 'output'):
        path = getattr(arguments, option)
        if path is None or (option == 'json' and path == STDOUT):
            continue
        if not path or not Path(path).parent.is_dir() or Path(path).is_dir():
            raise ParameterError(f"--{option} '{path}' cannot be written; accepted: a file in a folder that exists")
    model, output = Path(arguments.model), arguments.output
    if output and model.is_file() and Path(output).is_file() and model.samefile(output):
        raise ParameterError(f"--output '{output}' is the model itself; accepted: another file")


def _parameters(arguments: argparse.Namespace) -> CalibrationParameters:
    """Return the parameters of the file, those of the command line over them."""
    values = load_parameter_file(arguments.params, NODE) if arguments.params else {}
    if arguments.unknown is not None:
        values['unknown_links'] = arguments.unknown
    return calibration_parameters(values)


def make_kernel(model: RobotModel, parameters: CalibrationParameters) -> MomentumKernel:
    """Return the momentum of a robot with the unknown links that the parameters name.

    Raises
    ------
    ModelError
        There is no link to calibrate, or not the one that is named.
    ParameterError
        A link is named twice.
    """
    names = parameters.calibration.unknown_links
    if not names:
        names = tuple(link.name for link in model.links if link.parameters[0] > 0.0)
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ParameterError(f'--unknown names {listing(twice)} twice; accepted: each link once')
    if not names:
        raise ModelError('no link of the robot description has an <inertial>; accepted: one at least')
    return MomentumKernel(model, *names).storing(storage(parameters.estimator.wheels, model))


def make_settings(kernel: MomentumKernel, parameters: CalibrationParameters) -> CalibrationSettings:
    """Return what the calibration is told of noise and priors.

    Raises
    ------
    ModelError
        A prior is about a link that the robot does not have.
    ParameterError
        A prior is about a link that is not calibrated.
    """
    names = [link.name for link in kernel.unknown]
    for link in parameters.calibration.prior.links.own:
        if kernel.model.link(link).name not in names:
            raise ParameterError(
                f'prior.links.{link} is given, but {link} is not calibrated; accepted: {listing(names)}'
            )
    priors = [parameters.prior(name) for name in names]
    return CalibrationSettings(
        noise=parameters.estimator.noise.declared,
        priors=tuple(LinkPrior(each.mass_relative_std, each.com_std, each.inertia_relative_std) for each in priors),
        uncertainty=_uncertainty(kernel.model, parameters),
        window=parameters.estimator.window,
        gyro=parameters.estimator.imu.noise_density,
        orientation_measured=not parameters.estimator.imu.alone or parameters.estimator.imu.orientation,
    )


def _uncertainty(model: RobotModel, parameters: CalibrationParameters) -> Uncertainty:
    """Return what the parameters say of joints, mount, wheels, thrusters, stamps and momentum."""
    prior, estimator, joints = parameters.calibration.prior, parameters.estimator, model.joints
    every = ([prior.zero_std] * joints, [prior.origin_std] * joints, [prior.axis_std] * joints)
    return with_surroundings(estimator, model, every, (prior.mount_position_std, prior.mount_orientation_std))


def _motions(bag: str, parameters: CalibrationParameters, urdf: str, inputs: Inputs) -> BagMotions:
    with progress_bar(bag) as progress:
        return read_motions(bag, parameters.estimator, urdf, inputs, progress)


def calibrated_urdf(urdf: str, calibration: Calibration) -> str:
    """Return a robot description with the calibrated links and joint frames."""
    for link in calibration.links:
        urdf = change_inertial(urdf, link.name, link.parameters)
    names = calibration.mechanism.kernel.model.joint_names
    for name, origin, tilt in zip(names, *calibration.displacements, strict=True):
        urdf = displace_joint(urdf, name, origin, tilt)
    return urdf


def _write_results(result: Calibrated, urdf: str, arguments: argparse.Namespace) -> None:
    text = json.dumps(as_json(result), allow_nan=False, ensure_ascii=False) + '\n'
    if arguments.output and not result.contradicted:
        write_text(arguments.output, calibrated_urdf(urdf, result.calibration))
    if arguments.json and arguments.json != STDOUT:
        write_text(arguments.json, text)
    if arguments.report:
        from mbaid_ros.replay.report.calibration import html  # noqa: PLC0415 - only a report needs what it imports

        write_text(arguments.report, html(result))
    if arguments.json == STDOUT:
        sys.stdout.write(as_utf8(text))
    else:
        print(summary(result))
        if not result.contradicted:
            _tell_what_goes_on_from_it(arguments)


def _tell_what_goes_on_from_it(arguments: argparse.Namespace) -> None:
    """Say how an estimation is given what has been found: robot and covariance belong together."""
    output = one_line(arguments.output or '')
    if output and arguments.json:
        told = f'with known_links.calibration {one_line(arguments.json)}'
        print(f'replay and estimator go on from it: {output}, {told}')
    elif output:
        print(f'how well {output} is known is kept by --json FILE alone, for known_links.calibration')
