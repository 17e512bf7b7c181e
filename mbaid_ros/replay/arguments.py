"""The offline executables' entry points: their arguments; the working modules are imported after `--help`."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path

from mbaid_ros.cli import ArgumentParser, number, run
from mbaid_ros.replay.inputs import Inputs

FORMATS = ('urdf-link', 'urdf', 'mjcf', 'mjcf-body', 'basilisk-hub', 'basilisk-effector', 'ccsds-acm', 'json')


def _start(name: str, parser: Callable[[], ArgumentParser], command: str, argv: Sequence[str] | None = None) -> int:
    """Run `module:function` of this package on the arguments and return the exit code, which the help explains.

    The arguments hold the words that they were parsed from as `argv`.
    """

    def body(words: list[str]) -> int:
        arguments = parser().parse(words)
        arguments.argv = words
        module, _, function = command.partition(':')
        code: int = getattr(import_module(f'mbaid_ros.replay.{module}'), function)(arguments)
        return code

    return run(body, argv, name)


def _replay_parser() -> ArgumentParser:
    from mbaid_ros.parameters import METHODS  # noqa: PLC0415 - other executables start sooner without it

    parser = ArgumentParser(
        'replay',
        'Identify the inertia of a link from recorded bags, as the estimator node does from live topics.\n'
        'Exit code: 0 an estimate was reached, 2 bad input, 3 the data do not determine an estimate, 4 the data\n'
        'contradict the model: do not trust the numbers. Of several bags the worst counts: 2, then 4, then 3.',
        'ros2 run mbaid_ros replay run1 --model robot.urdf --target gripper --report run1.html',
    )
    add = parser.add_argument
    _add_model(parser)
    add('--target', metavar='LINK', help='link to identify (default: the last with an inertia, furthest from the base)')
    _add_parameters(parser, "the estimator node's ROS parameter file")
    add('--method', metavar='METHOD', help=f'identification method: {", ".join(METHODS)}')
    _add_bags(parser)
    _add_topics(parser)
    _add_results(parser)
    add('--truth', metavar='JSON', help='truth for the report (default: truth.json beside each bag)')
    add('--output', metavar='BAG', help='write the estimates as messages into a new bag')
    words = 'take the leading cause of a contradiction into account, and start the bag again'
    add('--repair', action='store_true', help=words)
    words = 'write the parameters that give the same result, with what --repair has found'
    add('--params-output', metavar='YAML', help=words)
    words = 'predict the last part of each bag from the rest (in the report of a minute or more: 0.2)'
    add('--holdout', type=_fraction, metavar='FRACTION', help=words)
    words = 'runs of one robot and target: each goes on from what the bags before it have taught'
    add('--continue', dest='continues', action='store_true', help=words)
    _add_processes(parser)
    return parser


def _simulate_parser() -> ArgumentParser:
    parser = ArgumentParser(
        'simulate',
        'Simulate a free-floating robot and write its sensor messages to an MCAP bag.',
        'ros2 run mbaid_ros simulate --model config/table1.urdf --params config/table1_simulator.yaml --output table1\n'
        '  a minute of the robot as the folder table1: an MCAP bag, and the truth in truth.json',
    )
    add = parser.add_argument
    add('--model', metavar='URDF', help='robot description (or the parameter robot_description_file)')
    _add_parameters(parser, 'parameter file of the simulator node')
    add('--duration', type=number(0.0, 's', exclusive=True), metavar='S', help='length of the run, s')
    add('--trajectory', metavar='YAML', help='let the joints follow a JointTrajectory, as plan --yaml writes it')
    add('--seed', type=_whole(0), metavar='N', help='seed of the sensor noise')
    add('--output', type=Path, default=Path('simulation'), metavar='BAG', help='folder to make')
    add('--truth', type=Path, metavar='JSON', help='file of the truth, instead of BAG/truth.json')
    return parser


def _plan_parser() -> ArgumentParser:
    parser = ArgumentParser(
        'plan',
        'Plan the joint motion that reduces the uncertainty of a run most, or the shortest one that reaches a wanted\n'
        'precision, within the limits of the joints (URDF) and of the base.\n'
        'It moves nothing. The parameters plan.* set the wanted precision and the limits: relative_std, duration,\n'
        'joint_velocity, joint_acceleration, base_rotation, base_translation, base_rate, deflection, stuck, ...\n'
        'Ctrl-C takes the best motion so far.\n'
        'Exit code: 0 the motion reaches the precision, 2 bad input, 3 no motion within the limits does: the best is\n'
        'written, 4 the data of the run contradict the model.',
        'ros2 run mbaid_ros plan run1 --model robot.urdf --params estimator.yaml -p plan.base_rotation:=0.035 '
        '--yaml motion.yaml',
    )
    add = parser.add_argument
    add(
        'bag', metavar='BAG', help='the run to continue: rosbag2 folder (MCAP or sqlite3), or a bare .mcap or .db3 file'
    )
    _add_slice(parser)
    _add_model(parser)
    _add_parameters(parser, "the estimator node's parameter file")
    _add_topics(parser)
    add('--yaml', metavar='FILE', help='write the motion for ros2 topic pub and simulate --trajectory')
    add('--output', metavar='BAG', help='write the motion as a message into a new bag')
    _add_json(parser, 'the plan')
    return parser


def _calibrate_parser() -> ArgumentParser:
    parser = ArgumentParser(
        'calibrate',
        'Calibrate bodies, joints and odometry mount of a free-floating robot from motions with an empty hand. The\n'
        'URDF is the start; known_links.*, known_joints.* and odometry_mount.* specify how well it is known.\n'
        'Exit code: 0 calibrated, 2 bad input, 3 the data do not determine the bodies, 4 the data contradict the\n'
        'model: no --output is written.',
        'ros2 run mbaid_ros calibrate before --model robot.urdf --params calibrate.yaml --output calibrated.urdf',
    )
    add = parser.add_argument
    _add_model(parser, 'the robot description, with the CAD values')
    add('--unknown', nargs='+', metavar='LINK', help='links to calibrate (default: every link with an <inertial>)')
    _add_parameters(parser, "the estimator's parameter file; its section 'calibrate' overrides, and has unknown_links")
    _add_bags(parser)
    _add_topics(parser)
    _add_results(parser, 'the result with its covariance')
    add('--output', metavar='URDF', help='write the robot description with the calibrated values')
    return parser


def _campaign_parser() -> ArgumentParser:
    parser = ArgumentParser(
        'campaign',
        'Simulate and identify many times over seeds, motions, robots, noise and methods, on all cores or a cluster.\n'
        'After an interruption the same command continues with the missing runs.\n'
        'Exit code: 0 every run was made, 2 bad input, 3 some failed.',
        'ros2 run mbaid_ros campaign config/table1_campaign.yaml --output table1_campaign',
    )
    add = parser.add_argument
    add(
        'campaign',
        metavar='YAML',
        help='seeds, motions, robots and cases, and the parameters of simulator and estimator',
    )
    add('--output', metavar='FOLDER', help="folder of the results (default: the YAML's name without its ending)")
    add('--scheduler', metavar='ADDRESS', help='a Dask cluster that makes the runs, like tcp://10.0.0.1:8786')
    add('--retry-failed', action='store_true', help='repeat failed runs')
    _add_processes(parser)
    return parser


def _export_parser() -> ArgumentParser:
    parser = ArgumentParser(
        'export',
        'Write an identified body as URDF link, whole URDF, MuJoCo model or body, Basilisk parameters, CCSDS attitude\n'
        'message or plain JSON.\n'
        'Exit code: 0 written, 2 bad input, 3 the data do not determine the body, 4 they contradict the model.',
        'ros2 run mbaid_ros export run1.json --format mjcf --output captured.xml',
    )
    add = parser.add_argument
    add('input', metavar='FILE', help='a result of replay --json, or a bag with estimates (the last one counts)')
    add('--format', choices=FORMATS, default=FORMATS[0], help='default: %(default)s')
    add('--output', metavar='FILE', help='default: standard output')
    add('--model', metavar='URDF', help='the robot description: for the whole robot (urdf, mjcf) and for --fill')
    add('--result', type=_whole(1), default=1, metavar='N', help='number of a result in a JSON of several (default: 1)')
    add('--topic', default='', metavar='TOPIC', help='topic of the estimates, if a bag has several estimators')
    add('--debris', action='store_true', help='write the captured body alone (from a run with debris.report: true)')
    add('--principal', action='store_true', help='write the inertia in its principal axes')
    add('--equivalent', choices=('box', 'ellipsoid'), help='add a uniform body with the same inertia')
    add('--fill', action='store_true', help='take undetermined numbers from the link in --model')
    return parser


def _noise_parser() -> ArgumentParser:
    parser = ArgumentParser(
        'noise_at_rest',
        'Measure the noise of the sensors in a bag recorded with braked joints and a drifting base, and print it as a\n'
        'parameter file. Each value is the standard deviation about a cubic in time, of the noisiest axis or joint.\n'
        'If joints move, the longest part at rest is used, with a warning.\n'
        'Exit code: 0 printed, 2 bad input, or joints that rest for less than five seconds.',
        'ros2 run mbaid_ros noise_at_rest rest_run > noise.yaml',
    )
    add = parser.add_argument
    add('bag', metavar='BAG', help='rosbag2 folder (MCAP or sqlite3), or a bare .mcap or .db3 file')
    _add_location(parser)
    parser.set_defaults(stored_momentum='', imu='', thrust='', target_pose='')
    _add_slice(parser)
    return parser


def _add_model(parser: ArgumentParser, words: str = 'the robot description') -> None:
    parser.add_argument('--model', required=True, metavar='URDF', help=words)


def _add_parameters(parser: ArgumentParser, words: str) -> None:
    add = parser.add_argument
    add('--params', metavar='YAML', help=words)
    add('-p', dest='assignments', action='append', default=[], metavar='NAME:=VALUE', help='set one parameter')


def _add_json(parser: ArgumentParser, words: str) -> None:
    parser.add_argument('--json', metavar='FILE', help=f'write {words} as JSON; - for standard output')


def _add_results(parser: ArgumentParser, words: str = 'the result') -> None:
    _add_json(parser, words)
    parser.add_argument('--report', metavar='HTML', help='write a report')


def _add_processes(parser: ArgumentParser) -> None:
    cores = len(os.sched_getaffinity(0))  # that this process may use
    words = 'parallel processes (default: one a core)'
    parser.add_argument('--processes', type=_whole(1), default=cores, metavar='N', help=words)


def _add_bags(parser: ArgumentParser) -> None:
    words = 'rosbag2 folder (MCAP or sqlite3), or a bare .mcap or .db3 file'
    parser.add_argument('bags', nargs='+', metavar='BAG', help=words)
    _add_slice(parser)


def _add_slice(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add('--start', dest='slice_start', type=number(0.0, 's'), metavar='S', help="begin, s from the bag's first message")
    words = "end, s from the bag's first message"
    add('--end', dest='slice_end', type=number(0.0, 's', exclusive=True), metavar='S', help=words)


def _add_location(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add('--joint-states', default=Inputs.joint_states, metavar='TOPIC', help='default: %(default)s')
    add('--odom', default='', metavar='TOPIC', help='Odometry that locates the base (default: /odom)')
    add(
        '--pose',
        default='',
        metavar='TOPIC',
        help='poses in place of Odometry: PoseStamped, PoseWithCovarianceStamped, TransformStamped, or TFMessage with '
        'pose.tf_child_frame (default: /pose, if there is no /odom)',
    )


def _add_topics(parser: ArgumentParser) -> None:
    _add_location(parser)
    add = parser.add_argument
    stored = 'momentum of wheels or gyros, Vector3Stamped (default: /stored_momentum, if recorded)'
    add('--stored-momentum', default='', metavar='TOPIC', help=stored)
    add('--imu', default='', metavar='TOPIC', help='Imu, used with imu.noise_density (default: /imu, if recorded)')
    poses = 'poses of the target before its capture, PoseStamped, PoseWithCovarianceStamped or Odometry (default: '
    add('--target-pose', default='', metavar='TOPIC', help=f'{poses}/target_pose, if recorded)')
    add('--thrust', default='', metavar='TOPIC', help='commanded thrust, WrenchStamped (default: /thrust, if recorded)')


def _fraction(text: str) -> float:
    """Return an argument that is a part of a whole, as argparse takes it."""
    value = number()(text)
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError(f"'{text}' is not accepted; accepted: a number > 0 and < 1")
    return value


def _whole(least: int) -> Callable[[str], int]:
    """Return an argparse type: a whole number from `least` on."""

    def convert(text: str) -> int:
        if not (text.isascii() and text.isdigit() and int(text) >= least):
            raise argparse.ArgumentTypeError(f"'{text}' is not accepted; accepted: a whole number >= {least}")
        return int(text)

    return convert


replay = partial(_start, 'replay', _replay_parser, 'replay:replay')
simulate = partial(_start, 'simulate', _simulate_parser, 'simulate:simulate')
plan = partial(_start, 'plan', _plan_parser, 'plan:plan')
calibrate = partial(_start, 'calibrate', _calibrate_parser, 'calibrate:calibrate')
campaign = partial(_start, 'campaign', _campaign_parser, 'campaigns.campaign:make_campaign')
export = partial(_start, 'export', _export_parser, 'export:export')
noise_at_rest = partial(_start, 'noise_at_rest', _noise_parser, 'noise_at_rest:print_noise')
