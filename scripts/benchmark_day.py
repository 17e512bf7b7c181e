"""Write measured/endurance.md: processor time, memory and estimates of a day of 100 Hz data, hour by hour.

The motion repeats exactly every minute, with fresh noise. The identification takes half a second at a time, as a live
node does. Exit code 1: an update took more than 1.2 times as long in the last hour as in the first one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.data import DURATION, NOISE, endless_motion, kernel, momentum_of, sensed, target
from benchmarks.frame import Frame, number, provenance, resident, table
from benchmarks.methods import Identification
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.simulation.sensors import Sensors

ROBOT = 'servicer7'
_PART = 50  # samples at a time
_LARGEST_RATIO = 1.2
_HEADER = (
    *('hour', 'update, ms', 'memory, MB', 'mass: std, ppm', 'error, ppm', 'largest error, std', 'residual'),
    'alarms',
)


@dataclass(frozen=True)
class Hour:
    """One hour of the run."""

    hour: int  # from 1
    update_time: float  # s, mean over its updates
    memory: float  # MB, resident at its end
    estimate: Estimate  # the last one
    updates: int
    events: int  # disturbances reported, although there is none


def main() -> int:
    """Run the day."""
    frame = Frame(__doc__, 'measured/endurance.md', hours=24, method='difference')
    hours, method = [], frame.arguments.method
    for hour in _hours(method, frame.arguments.hours):
        hours.append(hour)
        print(' | '.join(_row(hour)), flush=True)
    last, ratio = hours[-1], hours[-1].update_time / hours[0].update_time
    errors = last.estimate.parameters - target(ROBOT)
    columns = zip(PARAMETERS, target(ROBOT), errors, last.estimate.std, strict=True)
    rows = [[name, f'{value:.6g}', f'{error:.1e}', f'{std:.1e}'] for name, value, error, std in columns]
    section = _SECTION.format(
        hours=len(hours),
        updates=sum(hour.updates for hour in hours),
        provenance=provenance(),
        ratio=ratio,
        growth=last.memory - hours[0].memory,
        alarms=sum(hour.events for hour in hours),
        hourly=table(_HEADER, map(_row, hours)),
        worst=_largest(last.estimate),
        final=table(['parameter', 'true value, SI', 'error', 'reported std'], rows),
    )
    print(section)
    frame.write(**{method: section})
    return int(ratio > _LARGEST_RATIO)


def _hours(method: str, count: int) -> Iterator[Hour]:
    truth = endless_motion(ROBOT)
    identifier = Identification(kernel(ROBOT), NOISE, momentum_of(ROBOT, truth)).identifier(method)
    sensors = Sensors(NOISE, seed=0)
    known: set[tuple[str, float]] = set()
    for hour in range(count):
        spent, history, events = 0.0, [Estimate(method, 'waiting')], set(known)
        updates = 0
        for minute in range(60):
            later = replace(truth, time=truth.time + (hour * 60 + minute) * DURATION)
            for start in range(0, len(later), _PART):
                streams = sensed(later[start : start + _PART], sensors, NOISE)
                begin = time.process_time()
                estimates = identifier.push(*streams)
                spent += time.process_time() - begin
                updates += len(estimates)
                events |= {(event.kind, event.time) for each in estimates for event in each.events}
                history = estimates[-1:] or history
        yield Hour(hour + 1, spent / updates, resident(), history[-1], updates, len(events - known))
        known = events


def _largest(estimate: Estimate) -> float:
    errors = np.abs(estimate.parameters - target(ROBOT)) / estimate.std
    return float(np.nanmax(errors)) if np.isfinite(errors).any() else np.nan


def _row(hour: Hour) -> list[str]:
    mass = target(ROBOT)[0]
    return [
        str(hour.hour),
        f'{1e3 * hour.update_time:.2f}',
        f'{hour.memory:.1f}',
        number(1e6 * float(hour.estimate.std[0] / mass), 1),
        number(1e6 * float(hour.estimate.parameters[0] / mass - 1.0), 1),
        number(_largest(hour.estimate), 1),
        number(hour.estimate.residual, 4),
        str(hour.events),
    ]


_SECTION = """\
{hours} hours of `servicer7`, *mid* noise: {updates} updates. {provenance}

An update took {ratio:.2f} times as long in the last hour as in the first one; resident memory changed by {growth:.1f}
MB after the first hour. {alarms} disturbances were reported, although there is none.

{hourly}

At the end, error and reported standard deviation; the largest error is {worst:.1f} standard deviations:

{final}"""


if __name__ == '__main__':
    sys.exit(main())
