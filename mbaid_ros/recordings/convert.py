"""The executable `convert`: logs that others made of real hardware, and anybody's CSV, as bags."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from mbaid_ros import cli
from mbaid_ros.errors import ParameterError

if TYPE_CHECKING:  # --help needs none of it
    from mbaid_ros.recordings.recording import Recording

FORMATS = ('tudelft-throw', 'spot-2021', 'spot-2023', 'spot-captures', 'air-bearing-thrusters', 'iss-mimic', 'csv')
# The format that an option is for.
_OPTIONS = {
    'commands': 'spot-2021',
    'columns': 'csv',
    'object': 'tudelft-throw',
    'dead_reckon': 'tudelft-throw',
    'start': 'iss-mimic',
    'end_hour': 'iss-mimic',
}
# Formats without options: module and function.
_OF_THE_LOG_ALONE = {
    'spot-2023': ('spot', 'read_spot_2023'),
    'spot-captures': ('spot_captures', 'read_spot_capture'),
    'air-bearing-thrusters': ('air_bearing', 'read_air_bearing_thrusters'),
}

_DESCRIPTION = """\
Make an MCAP bag of a log. If the format has them, the folder also gets robot.urdf, with the source of every number,
estimator.yaml, with parameters for replay, and truth.json or weighed.json.

  tudelft-throw *.BFL or CSV of TU Delft's throwing device: gyro, accelerometer and flywheel in free flight, no pose
  spot-2021     *__stitched.mat of Carleton University's SPOT: planar chaser, commanded arm, thrusters off
  spot-2023     ExpLog* of the same chaser: measured arm, thrusters on nearly always
  spot-captures Kirk_Phase3_*__stitched.mat of the same chaser: captures of a tracked body, thrusters off
  air-bearing-thrusters
                real_test_data.csv of a body on a table that eight thrusters move
  iss-mimic     folder with a day of the space station's telemetry: attitude, rates, gyros' torque, array joints
  csv           any table; --columns assigns its columns

Exit code: 0 written, 2 bad input."""
_EXAMPLE = 'ros2 run mbaid_ros convert csv run.csv --columns columns.yaml --output run'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable: 0 if it wrote a bag, 2 after a user's error."""
    return cli.run(_convert, argv, 'convert')


def _convert(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    from mbaid_ros.recordings.recording import write_recording  # noqa: PLC0415 - takes a while

    recording = _read(arguments)
    begin, end = recording.span
    begin = begin if arguments.begin is None else arguments.begin
    end = end if arguments.end is None else arguments.end
    if not begin < end:
        raise ParameterError(f'--from {begin:g} s is not before --to {end:g} s')
    output = arguments.output if arguments.output is not None else Path(arguments.log.stem)
    count = write_recording(recording.between(begin, end), output)
    for note in recording.notes:
        print(f'mbaid_ros convert: note: {cli.one_line(note)}', file=sys.stderr)
    print(f'{count} messages: {cli.one_line(str(output))}')
    return 0


def _read(arguments: argparse.Namespace) -> Recording:
    for option, form in _OPTIONS.items():
        if getattr(arguments, option) is not None and arguments.format != form:
            raise ParameterError(f'--{option.replace("_", "-")} is for {form}, not for {arguments.format}')
    if arguments.format == 'iss-mimic':
        from mbaid_ros.recordings.iss import read_iss  # noqa: PLC0415

        if arguments.start is None or arguments.end_hour is None or not arguments.start < arguments.end_hour:
            raise ParameterError('iss-mimic needs --start H before --end H, in hours as its files count')
        return read_iss(arguments.log, arguments.start, arguments.end_hour)
    if arguments.format == 'csv':
        if arguments.columns is None:
            raise ParameterError('csv needs --columns YAML, which assigns the columns (docs/how-to/bench-logs.md)')
        from mbaid_ros.recordings.csv_log import read_csv  # noqa: PLC0415

        return read_csv(arguments.log, arguments.columns)
    if arguments.format == 'tudelft-throw':
        from mbaid_ros.recordings.throws import read_tudelft_throw  # noqa: PLC0415

        return read_tudelft_throw(arguments.log, arguments.object or '', dead_reckoned=bool(arguments.dead_reckon))
    if arguments.format == 'spot-2021':
        from mbaid_ros.recordings.spot import read_spot_2021  # noqa: PLC0415

        return read_spot_2021(arguments.log, arguments.commands)
    module, name = _OF_THE_LOG_ALONE[arguments.format]
    read: Callable[[Path], Recording] = getattr(import_module(f'mbaid_ros.recordings.{module}'), name)
    return read(arguments.log)


def _parser() -> cli.ArgumentParser:
    parser = cli.ArgumentParser('convert', _DESCRIPTION, _EXAMPLE)
    add = parser.add_argument
    add('format', choices=FORMATS, metavar='FORMAT', help=', '.join(FORMATS))
    add('log', type=Path, metavar='LOG', help='the file')
    add('--output', type=Path, metavar='BAG', help="folder to make (default: the log's name, here)")
    add('--from', dest='begin', type=cli.number(unit='s'), metavar='S', help="first time, s (default: the format's)")
    add('--to', dest='end', type=cli.number(unit='s'), metavar='S', help="last time, s (default: the format's)")
    add('--start', type=cli.number(unit='h'), metavar='H', help='iss-mimic: begin, day of the year x 24 + hour')
    add('--end', dest='end_hour', type=cli.number(unit='h'), metavar='H', help='iss-mimic: end')
    add('--columns', type=Path, metavar='YAML', help='csv: assignment of the columns')
    add('--commands', type=Path, metavar='MAT', help="spot-2021: the arm's motion (default: in a folder above the log)")
    add(
        '--object',
        metavar='NAME',
        help="tudelft-throw: thrown object: device-only, proof-body, empty, a, b, c (default: from the folder's name)",
    )
    add(
        '--dead-reckon',
        action='store_true',
        default=None,
        help='tudelft-throw: also write /odom, integrated from gyro and accelerometer, in a falling frame',
    )
    return parser
