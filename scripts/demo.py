"""The whole job on a live ROS 2 graph: a simulated servicer identifies the debris it holds, beside the truth.

`make demo` runs it with everything set up. Simulator, estimator and recorder run as processes of their own; a replay of
the recorded bag makes the report. Exit code 0: every parameter came within 1 % of the truth, else 1.
"""

import json
import math
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from demo_graph import CONFIG, PATIENCE, ROOT, Demo, assigned, running
from mbaid_ros.cli import ArgumentParser, number, one_line, run
from mbaid_ros.errors import DataError

TOLERANCE = 1.0  # %, of the truth
ROW_PERIOD = 2.0  # s of simulated time between two rows of the table
LAST_WINDOWS = 1.0  # s before the end of the run, after which the last estimate comes
COLUMN = 24
# Parameters that a planar motion determines: name, unit, decimals, value of a geometry_msgs/Inertia.
PARAMETERS: tuple[tuple[str, str, int, Callable[[Any], float]], ...] = (
    ('mass', 'kg', 2, lambda inertia: inertia.m),
    ('x_c', 'm', 4, lambda inertia: inertia.com.x),
    ('y_c', 'm', 4, lambda inertia: inertia.com.y),
    ('Izz', 'kg m^2', 1, lambda inertia: inertia.izz),
)
# Sensors good enough for attitude control: one standard deviation of a sample.
NOISE = {
    'noise.joint_position': 1e-5,  # rad
    'noise.joint_velocity': 1e-4,  # rad/s
    'noise.base_position': 1e-4,  # m
    'noise.base_orientation': 1e-5,  # rad
    'noise.base_linear_velocity': 1e-4,  # m/s
    'noise.base_angular_velocity': 1e-5,  # rad/s
}


def errors(inertia: Any, truth: Any) -> list[float]:
    """Return the error of each parameter in % of its true value; NaN where it is not determined."""
    return [100.0 * (value(inertia) / value(truth) - 1.0) for _, _, _, value in PARAMETERS]


def row(estimate: Any, truth: Any) -> str:
    """Return a line of the table: the estimate with its errors."""
    cells = ''
    for (_, _, digits, value), error in zip(PARAMETERS, errors(estimate.inertia, truth), strict=True):
        known = f'{value(estimate.inertia):.{digits}f} {error:+8.2f} %'
        cells += f'{"-" if math.isnan(error) else known:>{COLUMN}}'
    return f'{seconds(estimate):6.1f} s  {estimate.status.replace("_", " "):<16}{cells}'.rstrip()


def seconds(estimate: Any) -> float:
    """Return the time since the first sample."""
    return float(estimate.span.sec + 1e-9 * estimate.span.nanosec)


def watch(demo: Demo, bag: Path, duration: float, speed: float) -> tuple[Any, Any]:
    """Run the graph, print the estimate as it converges, and return the last estimate and the truth."""
    nodes = [demo.start('estimator', '--params-file', CONFIG / 'table1_estimator.yaml')]
    nodes.append(demo.start('recorder', '-p', f'output:={bag}'))
    demo.wait(lambda: demo.estimates, 'the estimator')
    demo.wait(lambda: demo.recorded('/estimator/estimate'), 'the recorder')
    given = {'robot_description_file': CONFIG / 'table1.urdf', 'duration': duration, 'real_time_factor': speed}
    given |= {'wait_for_subscribers': 2, **NOISE}  # estimator and recorder
    simulator = demo.start('simulator', '--params-file', CONFIG / 'table1_simulator.yaml', *assigned(given))
    demo.wait(lambda: demo.truths, 'the simulator')
    truth = demo.truths[0].inertia
    names = ''.join(f'{f"{name} ({unit})":>{COLUMN}}' for name, unit, _, _ in PARAMETERS)
    values = ''.join(f'{value(truth):>{COLUMN - 11}.{digits}f}{"":11}' for _, _, digits, value in PARAMETERS)
    print(f'{"time":>8}  {"status":<16}{names}\n{"":8}  {"truth":<16}{values}'.rstrip(), flush=True)
    due, printed = ROW_PERIOD, None
    last: Any = None

    def is_over() -> bool:
        """Return whether no estimate is to come: the estimator may be behind the simulator."""
        return not simulator.running and (last is None or last.stale or seconds(last) > duration - LAST_WINDOWS)

    while demo.estimates or not is_over():
        demo.wait(lambda: demo.estimates or is_over(), 'an estimate')
        for estimate in [each for each in demo.estimates if each.status != 'waiting']:
            last = estimate
            if seconds(estimate) >= due - 0.1:
                due, printed = due + ROW_PERIOD, estimate
                print(row(estimate, truth), flush=True)
        demo.estimates.clear()
    if last is None:
        raise DataError(f'no estimate in {duration:g} s')
    if last is not printed:
        print(row(last, truth))
    demo.stop(*nodes)
    return last, demo.truths[0]


def judge(estimate: Any, truth: Any) -> str:
    """Return the faults of an estimate; empty if every parameter is close enough to the truth."""
    found = zip(PARAMETERS, errors(estimate.inertia, truth), strict=True)
    return ', '.join(
        f'{name} is not determined' if math.isnan(error) else f'{name} is off by {error:+.2f} %'
        for (name, *_), error in found
        if not abs(error) < TOLERANCE
    )


def replay(demo: Demo, bag: Path, truth: Any, report: Path) -> None:
    """Make the report from the recorded bag and the published truth."""
    file, inertia = report.with_name('truth.json'), truth.inertia
    content = {
        'target_link': truth.header.frame_id,
        'mass': inertia.m,
        'com': [inertia.com.x, inertia.com.y, inertia.com.z],
        'inertia': {name: getattr(inertia, name) for name in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')},
    }
    file.write_text(json.dumps(content, indent=2) + '\n', encoding='utf-8')
    outputs = ('--truth', file, '--report', report, '--json', report.with_suffix('.json'))
    model = ('--model', CONFIG / 'table1.urdf', '--params', CONFIG / 'table1_estimator.yaml')
    demo.ended(demo.graph.start('replay', bag, *model, *outputs), 3 * PATIENCE)


def main(argv: list[str]) -> int:
    """Run the demo and return the exit code."""
    parser = ArgumentParser('demo.py', (__doc__ or '').split('\n', maxsplit=1)[0], 'scripts/demo.py --duration 20')
    parser.add_argument('--duration', type=number(0.0, 's', exclusive=True), default=30.0, metavar='S')
    parser.add_argument('--speed', type=number(0.0, exclusive=True), default=2.5, metavar='R')
    parser.add_argument('--output', type=Path, default=ROOT / 'demo_output', metavar='FOLDER')
    arguments = parser.parse(argv)
    begin, folder = time.monotonic(), arguments.output
    bag, report = folder / 'demo_bag', folder / 'report.html'
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(bag, ignore_errors=True)
    print(
        "The paper's servicer floats with debris in its hand. The estimator identifies link4: arm end and debris.\n"
        'The motion is planar, so four of the ten parameters are observable.\n'
        f'Simulator, estimator and recorder run as ROS 2 nodes, {arguments.speed:g} times as fast as real time.\n'
    )
    try:
        with running() as made:
            demo = Demo(made)
            estimate, truth = watch(demo, bag, arguments.duration, arguments.speed)
            replay(demo, bag, truth, report)
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
