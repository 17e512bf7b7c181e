"""The whole job on a live ROS 2 graph: a simulated servicer identifies the debris it holds, beside the truth.

usage: demo.py [--duration S] [--speed R] [--output FOLDER]    (`make demo` runs it with everything set up)

The simulator, the estimator and the recorder run as processes of their own. The recorded bag is then replayed for the
report. Exit code: 0 if every parameter came within 1 % of the truth, else 1.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from demo_graph import (  # it chooses the graph, before rclpy begins
    CONFIG,
    PATIENCE,
    ROOT,
    Processes,
    Spectator,
    running,
)
from mbaid_ros.cli import ArgumentParser, number, one_line, run
from mbaid_ros.core.errors import DataError

TOLERANCE = 1.0  # %, of the truth
ROW_PERIOD = 2.0  # s of simulated time between two rows of the table

# What the planar motion of the paper's case determines: name, unit, decimals, where it is in a geometry_msgs/Inertia.
PARAMETERS: tuple[tuple[str, str, int, Callable[[Any], float]], ...] = (
    ('mass', 'kg', 2, lambda inertia: inertia.m),
    ('x_c', 'm', 4, lambda inertia: inertia.com.x),
    ('y_c', 'm', 4, lambda inertia: inertia.com.y),
    ('Izz', 'kg m^2', 1, lambda inertia: inertia.izz),
)
COLUMN = 24
# Sensors as good as an attitude control needs them: one standard deviation of a sample.
NOISE = {
    'joint_position': 1e-5,  # rad
    'joint_velocity': 1e-4,  # rad/s
    'base_position': 1e-4,  # m
    'base_orientation': 1e-5,  # rad
    'base_linear_velocity': 1e-4,  # m/s
    'base_angular_velocity': 1e-5,  # rad/s
}


def errors(inertia: Any, truth: Any) -> list[float]:
    """Return the error of each parameter in % of its true value; NaN where it is not determined."""
    return [100.0 * (value(inertia) / value(truth) - 1.0) for _, _, _, value in PARAMETERS]


def heading(truth: Any) -> str:
    """Return the head of the table: names with units, and the truth."""
    names = ''.join(f'{f"{name} ({unit})":>{COLUMN}}' for name, unit, _, _ in PARAMETERS)
    values = ''.join(f'{value(truth):>{COLUMN - 11}.{digits}f}{"":11}' for _, _, digits, value in PARAMETERS)
    return f'{"time":>8}  {"status":<16}{names}\n{"":8}  {"truth":<16}{values}'.rstrip()


def row(estimate: Any, truth: Any) -> str:
    """Return a line of the table: the estimate, and how far it is from the truth."""
    seconds = estimate.span.sec + 1e-9 * estimate.span.nanosec
    cells = ''
    for (_, _, digits, value), error in zip(PARAMETERS, errors(estimate.inertia, truth), strict=True):
        known = f'{value(estimate.inertia):.{digits}f} {error:+8.2f} %'
        cells += f'{"-" if math.isnan(error) else known:>{COLUMN}}'
    return f'{seconds:6.1f} s  {estimate.status.replace("_", " "):<16}{cells}'.rstrip()


def watch(processes: Processes, bag: Path, duration: float, speed: float) -> tuple[Any, Any]:
    """Run the graph, print the estimate as it converges, and return the last estimate and the truth."""
    processes.start('estimator', '--ros-args', '--params-file', CONFIG / 'table1_estimator.yaml')
    processes.start('recorder', '--ros-args', '-p', f'output:={bag}')
    spectator = Spectator(processes)
    spectator.wait(lambda: spectator.estimates, 'the estimator')
    spectator.wait(lambda: spectator.recorded('/estimator/estimate'), 'the recorder')
    parameters = {
        'robot_description_file': CONFIG / 'table1.urdf',
        'duration': duration,
        'real_time_factor': speed,
        **{f'noise.{channel}': value for channel, value in NOISE.items()},
    }
    assigned = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    simulator = processes.start('simulator', '--ros-args', '--params-file', CONFIG / 'table1_simulator.yaml', *assigned)
    spectator.wait(lambda: spectator.truths, 'the simulator')
    stamped = spectator.truths[0]
    truth = stamped.inertia
    print(heading(truth), flush=True)
    due, last, printed = ROW_PERIOD, None, None
    while simulator.poll() is None or spectator.estimates:
        spectator.wait(lambda: spectator.estimates or simulator.poll() is not None, 'an estimate')
        for estimate in spectator.estimates:
            if estimate.status != 'waiting':
                last = estimate
                if estimate.span.sec + 1e-9 * estimate.span.nanosec >= due - 0.1:
                    due, printed = due + ROW_PERIOD, estimate
                    print(row(estimate, truth), flush=True)
        spectator.estimates.clear()
    if last is not None and last is not printed:
        print(row(last, truth))
    if last is None:
        raise DataError(f'no estimate in {duration:g} s')
    return last, stamped


def judge(estimate: Any, truth: Any) -> str:
    """Return what is wrong with an estimate; empty if every parameter is close enough to the truth."""
    wrong = []
    for (name, _, _, _), error in zip(PARAMETERS, errors(estimate.inertia, truth), strict=True):
        if math.isnan(error):
            wrong.append(f'{name} is not determined')
        elif abs(error) >= TOLERANCE:
            wrong.append(f'{name} is off by {error:+.2f} %')
    return ', '.join(wrong)


def write_truth(path: Path, truth: Any) -> None:
    """Write what the simulator published as the truth, as `replay --truth` reads it."""
    content = {
        'target_link': truth.header.frame_id,
        'mass': truth.inertia.m,
        'com': [truth.inertia.com.x, truth.inertia.com.y, truth.inertia.com.z],
        'inertia': {name: getattr(truth.inertia, name) for name in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')},
    }
    path.write_text(json.dumps(content, indent=2) + '\n', encoding='utf-8')


def replay(processes: Processes, bag: Path, truth: Path, report: Path) -> None:
    """Make the report from the recorded bag."""
    processes.start(
        'replay', bag, '--model', CONFIG / 'table1.urdf', '--params', CONFIG / 'table1_estimator.yaml',
        '--truth', truth, '--report', report, '--json', report.with_suffix('.json'),
    )  # fmt: skip
    processes.wait('replay', 3 * PATIENCE)


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the arguments."""
    parser = ArgumentParser('demo.py', (__doc__ or '').split('\n', maxsplit=1)[0], 'scripts/demo.py --duration 20')
    parser.add_argument('--duration', type=number(0.0, 's', exclusive=True), default=30.0, metavar='S')
    parser.add_argument('--speed', type=number(0.0, exclusive=True), default=2.5, metavar='R')
    parser.add_argument('--output', type=Path, default=ROOT / 'demo_output', metavar='FOLDER')
    return parser.parse(argv)


def main(argv: list[str]) -> int:
    """Run the demo and return the exit code."""
    arguments = parse(argv)
    begin = time.monotonic()
    folder: Path = arguments.output
    bag, report = folder / 'demo_bag', folder / 'report.html'
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(bag, ignore_errors=True)
    print(
        "The paper's servicer floats with debris in its hand; link4, arm end and debris, is to be identified.\n"
        f'Simulator, estimator and recorder run as ROS 2 nodes, {arguments.speed:g} times as fast as real time.\n'
    )
    try:
        with running(folder) as processes:
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            estimate, truth = watch(processes, bag, arguments.duration, arguments.speed)
            processes.stop('estimator')
            processes.stop('recorder')
            write_truth(folder / 'truth.json', truth)
            replay(processes, bag, folder / 'truth.json', report)
            try_shutdown()
        print(f'\nrecorded  {bag}\nreport    {report}')
        wrong = judge(estimate, truth.inertia)
    except DataError as error:
        wrong = str(error)
    if wrong:
        print(f'demo failed: {one_line(wrong)}', file=sys.stderr)
        return 1
    print(f'Every parameter is within {TOLERANCE:g} % of the truth ({time.monotonic() - begin:.0f} s in all).')
    return 0


if __name__ == '__main__':
    sys.exit(run(main, name='demo'))
