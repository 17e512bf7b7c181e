"""Write the table of docs/robustness.md: the effect of defects of the input on the estimate, and the warnings."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / 'scripts'), str(ROOT / 'test')]

import defects  # noqa: E402 - from the tests, which are no package
from benchmarks.data import target  # noqa: E402
from benchmarks.frame import Frame, table  # noqa: E402
from defects import JOINTS, ODOMETRY, Arrival, arrivals, changed, estimates  # noqa: E402
from mbaid_ros.core.geometry import unvec  # noqa: E402
from mbaid_ros.core.results.estimate import Estimate  # noqa: E402
from mbaid_ros.session import intake_warnings  # noqa: E402

ROBOT, SECONDS = 'servicer7', 60.0
METHODS = ('difference', 'trajectory')
PLACE, QUATERNION = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.2, -0.3, 0.9]) / np.sqrt(0.95)


@dataclass(frozen=True)
class Case:
    """A row of the table: a defect, and the parameters that the user sets for it."""

    name: str
    spoil: Callable[[list[Arrival]], list[Arrival]]
    parameters: dict[str, object] = field(default_factory=dict)


def nothing(messages: list[Arrival]) -> list[Arrival]:
    """Return the messages as they are."""
    return messages


def unequal(_messages: list[Arrival]) -> list[Arrival]:
    """Return the run sampled unevenly: joints at 100 Hz, odometry at 30 Hz, both with a jitter of 2 ms."""
    generator = np.random.default_rng(5)
    times = []
    for rate in (100.0, 30.0):
        even = np.arange(0.0, SECONDS - 0.05, 1.0 / rate)
        shaken = even + generator.uniform(0.0, 0.004, len(even))
        times.append(np.unique(np.round(shaken * defects.FINE)) / defects.FINE)
    return arrivals(ROBOT, SECONDS, 1, *times)


def poses_alone(messages: list[Arrival]) -> list[Arrival]:
    """Return the messages without any velocity."""
    return changed(JOINTS, defects.no_rates)(changed(ODOMETRY, defects.no_twist)(messages))


def half(messages: list[Arrival]) -> list[Arrival]:
    """Return the messages of one of two publishers of joints."""
    return [one for one in defects.in_halves(messages) if one.topic == ODOMETRY or len(one.message.name) == 4]


CASES = [
    Case('none', nothing),
    Case('rates of 100 and 30 Hz, jitter 2 ms', unequal),
    Case('gaps of 50 ms and of 300 ms in the odometry', defects.with_gaps),
    Case('joint states in bursts of 20', defects.in_bursts),
    Case('every tenth message up to 30 ms late', defects.out_of_order(3, 0.03)),
    Case('every third message twice', defects.repeated),
    Case('30 % of the messages lost', defects.lost(3, 0.3)),
    Case('the first 10 s twice (a loop)', lambda messages: [*messages[:2000], *messages]),
    Case('joint states stamped 20 ms late', changed(JOINTS, defects.shifted(0.02))),
    Case('no joint velocities', changed(JOINTS, defects.no_rates)),
    Case('no twist', changed(ODOMETRY, defects.no_twist)),
    Case('no velocity at all', poses_alone),
    Case('joints permuted, others among them', changed(JOINTS, defects.permuted_and_extra)),
    Case('two publishers of half the joints each', defects.in_halves),
    Case('angles that wrap', changed(JOINTS, defects.wrapped)),
    Case('quaternions of length 1.05, either sign', changed(ODOMETRY, defects.odd_quaternion)),
    Case(
        'pose and twist of a marker',
        defects.of_marker(PLACE, QUATERNION, 'marker'),
        {'marker.position': PLACE.tolist(), 'marker.orientation': QUATERNION.tolist()},
    ),
    Case('a marker without a declared place', defects.of_marker(PLACE, QUATERNION, 'marker')),
    Case('the twist declared in the wrong frame', nothing, {'twist_frame': 'inertial'}),
    Case('half of the joints missing', half),
]


def errors(estimate: Estimate) -> str:
    """Return the relative errors of mass and inertia."""
    truth = target(ROBOT)
    difference, inertia = estimate.parameters - truth, np.linalg.norm(unvec(truth[4:]))
    parts = abs(difference[0]) / truth[0], np.linalg.norm(unvec(difference[4:])) / inertia
    return ', '.join('-' if np.isnan(part) else f'{100.0 * part:.2g} %' for part in parts)


def main() -> None:
    """Write the table."""
    frame = Frame(__doc__, 'robustness.md')
    header = ['defect']
    for method in METHODS:
        header += [f'{method}: error of mass, inertia', 'shift', 'status']
    clean, undisturbed, rows = arrivals(ROBOT, SECONDS, 1), dict[str, Estimate](), list[list[str]]()
    for case in CASES:
        cells, warnings = [case.name], list[str]()
        for method in METHODS:
            history, session = estimates(ROBOT, case.spoil(clean), {'method': method, **case.parameters}, 2000)
            warnings += intake_warnings(session)
            if not history:
                cells += ['none', '-', 'waiting']
                continue
            last = history[-1]
            warnings += last.warnings
            reference = undisturbed.setdefault(method, last)
            shift = np.abs(last.parameters - reference.parameters) / np.maximum(last.std, reference.std)
            largest = f'{np.nanmax(shift):.2g}' if np.any(np.isfinite(shift)) else '-'
            cells += [errors(last), largest, last.status.replace('_', ' ')]
        rows.append([*cells, '; '.join(f'"{text}"' for text in dict.fromkeys(warnings)) or '-'])
        print(' | '.join(rows[-1]), flush=True)
    frame.write(defects=table([*header, 'warnings'], rows, words=True))


if __name__ == '__main__':
    main()
