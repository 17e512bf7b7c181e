"""A day of 100 Hz data through the identification: time an update, resident memory, and the estimate, hour by hour.

usage: benchmark_day.py [--hours N] [--robot R] [--level L] [--method M] [--output FOLDER]

The data are made as they are needed: a motion that repeats exactly every minute, with fresh noise. They are handed over
half a second at a time, as a live node does.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from tqdm import tqdm

from benchmarks.data import DURATION, LEVELS, endless_motion, kernel, momentum_of, sensed
from benchmarks.driver import add_example_arguments, parser_of
from benchmarks.endurance import HEAD, ORDER, resident
from benchmarks.methods import METHODS, Identification
from benchmarks.pages import number, provenance, put_section, table
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth

_PART = 50  # samples handed over at a time
_MINUTES = 60  # an hour
_WANTED_RATIO = 1.2

_SECTION = """\
## Method `{method}`

{hours:g} hours of `{robot}`, {level} noise: {updates} updates. {provenance}

An update took {ratio:.2f} times as long in the last hour as in the first one; resident memory changed by
{growth:.1f} MB after the first hour. {alarms} disturbances were reported, where there was none.

{hourly}

At the end, error and reported standard deviation (over {parameters} parameters, the largest error is {worst:.1f}
standard deviations):

{final}
"""


@dataclass(frozen=True)
class Hour:
    """What one hour was like.

    Attributes
    ----------
    hour : number, from 1
    update_time : s, mean over its updates
    memory : MB, resident at its end
    estimate : the last one
    updates : number
    events : number of disturbances reported in it: nothing disturbs the run
    """

    hour: float
    update_time: float
    memory: float
    estimate: Estimate
    updates: int
    events: int


def main() -> int:
    """Run the day and return the exit code: 1 if updates became slower."""
    arguments = _parse()
    truth = physical(kernel(arguments.robot).target.parameters)
    hours: list[Hour] = []
    with tqdm(total=round(arguments.hours), unit=' h', disable=None, leave=False) as bar:
        for hour in _hours(arguments):
            hours.append(hour)
            bar.update()
            print(_hourly([hour], truth).splitlines()[-1], flush=True)
    print(_final(hours[-1].estimate, truth))
    if arguments.output:
        put_section(arguments.output / 'endurance.md', HEAD, _section(arguments, hours, truth), ORDER)
    return 0 if _ratio(hours) <= _WANTED_RATIO else 1


def _hours(arguments: argparse.Namespace) -> Iterator[Hour]:
    noise = LEVELS[arguments.level]
    truth = endless_motion(arguments.robot)
    task = Identification(kernel(arguments.robot), noise, momentum_of(arguments.robot, truth))
    identifier = task.identifier(arguments.method)
    sensors = Sensors(noise, seed=0)
    told: set[tuple[str, float]] = set()
    for hour in range(round(arguments.hours)):
        spent, updates, estimate = 0.0, 0, None
        events: set[tuple[str, float]] = set()
        for minute in range(_MINUTES):
            later = _later(truth, (hour * _MINUTES + minute) * DURATION)
            for start in range(0, len(later), _PART):
                streams = sensed(later[start : start + _PART], sensors, noise)
                begin = time.process_time()
                estimates = identifier.push(*streams)
                spent += time.process_time() - begin
                updates += len(estimates)
                events |= {(event.kind, event.time) for each in estimates for event in each.events}
                estimate = estimates[-1] if estimates else estimate
        if estimate is None:
            raise RuntimeError('an hour without an estimate')
        yield Hour(hour + 1, spent / updates, resident(), estimate, updates, len(events - told))
        told |= events


def _later(truth: Truth, shift: float) -> Truth:
    return replace(truth, time=truth.time + shift)


def _ratio(hours: list[Hour]) -> float:
    return hours[-1].update_time / hours[0].update_time


def _normalised(estimate: Estimate, truth: Array) -> Array:
    return (estimate.parameters - truth) / estimate.std


def _largest(estimate: Estimate, truth: Array) -> float:
    return max((abs(float(value)) for value in _normalised(estimate, truth) if math.isfinite(value)), default=math.nan)


def _hourly(hours: list[Hour], truth: Array) -> str:
    rows = [
        [
            f'{hour.hour:g}',
            f'{1e3 * hour.update_time:.2f}',
            f'{hour.memory:.1f}',
            number(1e6 * float(hour.estimate.std[0] / truth[0]), 1),
            number(1e6 * float(hour.estimate.parameters[0] / truth[0] - 1.0), 1),
            number(_largest(hour.estimate, truth), 1),
            number(hour.estimate.residual, 4),
            str(hour.events),
        ]
        for hour in hours
    ]
    header = [
        'hour',
        'update, ms',
        'memory, MB',
        'mass: std, ppm',
        'error, ppm',
        'largest error, std',
        'residual',
        'alarms',
    ]
    return table(header, rows)


def _final(estimate: Estimate, truth: Array) -> str:
    rows = [
        [name, f'{value:.6g}', f'{error:.1e}', f'{std:.1e}']
        for name, value, error, std in zip(PARAMETERS, truth, estimate.parameters - truth, estimate.std, strict=True)
    ]
    return table(['parameter', 'true value, SI', 'error', 'reported std'], rows)


def _section(arguments: argparse.Namespace, hours: list[Hour], truth: Array) -> str:
    last = hours[-1]
    return _SECTION.format(
        hours=arguments.hours,
        robot=arguments.robot,
        level=arguments.level,
        method=arguments.method,
        updates=sum(hour.updates for hour in hours),
        provenance=provenance(),
        ratio=_ratio(hours),
        growth=last.memory - hours[0].memory,
        alarms=sum(hour.events for hour in hours),
        hourly=_hourly(hours, truth),
        parameters=len(PARAMETERS),
        worst=_largest(last.estimate, truth),
        final=_final(last.estimate, truth),
    )


def _parse() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument('--hours', type=int, metavar='N', default=24)
    add_example_arguments(parser, METHODS, 'difference')
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
