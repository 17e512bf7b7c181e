"""Write the tables of docs/robustness.md: what defects of the input do to the estimate, and what is said of them.

usage: robustness.py [SEEDS]    (default 50, of the runs with poses alone; with `install/setup.bash` sourced)
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))

import defects  # noqa: E402 - from the tests, which are no package
from defects import JOINTS, ODOMETRY, Arrival, arrivals, changed, estimates  # noqa: E402
from mbaid_ros.core.geometry import Array, unvec  # noqa: E402
from mbaid_ros.core.results.estimate import Estimate  # noqa: E402
from mbaid_ros.core.robot.inertia import physical  # noqa: E402
from mbaid_ros.session import intake_warnings  # noqa: E402
from simulated import robot  # noqa: E402

PAGE = ROOT / 'docs' / 'robustness.md'
ROBOT, SECONDS = 'servicer7', 60.0
METHODS = ('difference', 'trajectory')
PLACE, QUATERNION = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.2, -0.3, 0.9]) / np.sqrt(0.95)
MARKER: dict[str, object] = {'marker.position': PLACE.tolist(), 'marker.orientation': QUATERNION.tolist()}


@dataclass(frozen=True)
class Case:
    """A row of the table: what goes wrong, and the parameters that the user sets for it."""

    name: str
    spoil: Callable[[list[Arrival]], list[Arrival]]
    parameters: dict[str, object]


def unequal(_messages: list[Arrival]) -> list[Arrival]:
    """Return the run sampled unevenly: joints at 100 Hz, odometry at 30 Hz, both with a jitter of 2 ms."""
    generator = np.random.default_rng(5)
    times = []
    for rate in (100.0, 30.0):
        even = np.arange(0.0, SECONDS - 0.05, 1.0 / rate)
        shaken = even + generator.uniform(0.0, 0.004, len(even))
        times.append(np.unique(np.round(shaken * defects.FINE)) / defects.FINE)
    return arrivals(ROBOT, SECONDS, 1, *times)


def nothing(messages: list[Arrival]) -> list[Arrival]:
    """Return the messages as they are."""
    return messages


def poses_alone(messages: list[Arrival]) -> list[Arrival]:
    """Return the messages without any velocity."""
    return changed(JOINTS, defects.no_rates)(changed(ODOMETRY, defects.no_twist)(messages))


def looped(messages: list[Arrival]) -> list[Arrival]:
    """Return the first ten seconds, and then the run."""
    return [*messages[:2000], *messages]


CASES = [
    Case('none', nothing, {}),
    Case('rates of 100 and 30 Hz, jitter 2 ms', unequal, {}),
    Case('gaps of 50 ms and of 300 ms in the odometry', defects.with_gaps, {}),
    Case('joint states in bursts of 20', defects.in_bursts, {}),
    Case('every tenth message up to 30 ms late', defects.out_of_order(3, 0.03), {}),
    Case('every third message twice', defects.repeated, {}),
    Case('30 % of the messages lost', defects.lost(3, 0.3), {}),
    Case('the first 10 s twice (a loop)', looped, {}),
    Case('joint states stamped 20 ms late', changed(JOINTS, defects.shifted(0.02)), {}),
    Case('no joint velocities', changed(JOINTS, defects.no_rates), {}),
    Case('no twist', changed(ODOMETRY, defects.no_twist), {}),
    Case('no velocity at all', poses_alone, {}),
    Case('joints permuted, others among them', changed(JOINTS, defects.permuted_and_extra), {}),
    Case('two publishers of half the joints each', defects.in_halves, {}),
    Case('angles that wrap', changed(JOINTS, defects.wrapped), {}),
    Case('quaternions of length 1.05, either sign', changed(ODOMETRY, defects.odd_quaternion), {}),
    Case('pose and twist of a marker', defects.of_marker(PLACE, QUATERNION, 'marker'), MARKER),
    Case('a marker, its place not given', defects.of_marker(PLACE, QUATERNION, 'marker'), {}),
    Case('the twist declared in the wrong frame', nothing, {'twist_frame': 'inertial'}),
    Case('half of the joints missing', lambda messages: half(defects.in_halves(messages)), {}),
]


def half(messages: list[Arrival]) -> list[Arrival]:
    """Return the messages of one of two publishers of joints."""
    return [one for one in messages if one.topic == ODOMETRY or len(one.message.name) == 4]


def truth() -> Array:
    """Return the true ten parameters."""
    model = robot(ROBOT)
    return physical(model.link(model.last_link).parameters)


def errors(estimate: Estimate) -> str:
    """Return the errors of mass and inertia."""
    difference, inertia = estimate.parameters - truth(), np.linalg.norm(unvec(truth()[4:]))
    parts = abs(difference[0]) / truth()[0], np.linalg.norm(unvec(difference[4:])) / inertia
    return ', '.join('-' if np.isnan(part) else f'{100.0 * part:.2g} %' for part in parts)


def defects_table() -> str:
    """Return the table of defects."""
    rows = ['| defect | ' + ' | '.join(f'{m}: error of mass, inertia | shift | status' for m in METHODS) + ' | said |']
    rows.append('|---|' + '---|' * (3 * len(METHODS) + 1))
    clean = arrivals(ROBOT, SECONDS, 1)
    undisturbed: dict[str, Estimate] = {}
    for case in CASES:
        cells, said = [case.name], []
        for method in METHODS:
            history, session = estimates(ROBOT, case.spoil(clean), {'method': method, **case.parameters}, 2000)
            said += intake_warnings(session)
            if not history:
                cells += ['none', '-', 'waiting']
                continue
            last = history[-1]
            said += last.warnings
            reference = undisturbed.setdefault(method, last)
            shift = np.abs(last.parameters - reference.parameters) / np.maximum(last.std, reference.std)
            told = f'{np.nanmax(shift):.2g}' if np.any(np.isfinite(shift)) else '-'
            cells += [errors(last), told, last.status.replace('_', ' ')]
        texts = list(dict.fromkeys(said))
        cells.append('; '.join(f'"{text}"' for text in texts) or '-')
        rows.append('| ' + ' | '.join(cells) + ' |')
        print(rows[-1], flush=True)
    return '\n'.join(rows)


def poses_table(seeds: int) -> str:
    """Return the statistics of runs without velocities."""
    told = (
        f'The same motion with {seeds} seeds, method trajectory, after 60 s: RMSE, and how often the truth is within '
        'the reported 95 % interval.'
    )
    head = '| input | RMSE of mass | RMSE of inertia | within 95 %: mean, least of the ten parameters |'
    rows = [told, '', head, '|---|---|---|---|']
    for name, spoil in (('with velocities', nothing), ('poses and joint positions alone', poses_alone)):
        found = [
            estimates(ROBOT, spoil(arrivals(ROBOT, SECONDS, 100 + seed)), {'method': 'trajectory'}, 2000)[0][-1]
            for seed in range(seeds)
        ]
        error = np.array([estimate.parameters for estimate in found]) - truth()
        inside = np.mean(np.abs(error) < 1.96 * np.array([estimate.std for estimate in found]), axis=0)
        mass = np.sqrt(np.mean(error[:, 0] ** 2)) / truth()[0]
        squares = np.sum(unvec(error[:, 4:]) ** 2, axis=(1, 2))
        inertia = np.sqrt(np.mean(squares)) / np.linalg.norm(unvec(truth()[4:]))
        cells = name, f'{100 * mass:.2g} %', f'{100 * inertia:.2g} %', f'{inside.mean():.2f}, {inside.min():.2f}'
        rows.append(f'| {" | ".join(cells)} |')
        print(rows[-1], flush=True)
    return '\n'.join(rows)


def write(name: str, table: str) -> None:
    """Put a table between its marks in the page."""
    marks = f'<!-- {name}: written by scripts/robustness.py -->\n', f'<!-- end of {name} -->'
    text = PAGE.read_text(encoding='utf-8')
    pattern = re.escape(marks[0]) + '.*?' + re.escape(marks[1])
    PAGE.write_text(
        re.sub(pattern, lambda _: f'{marks[0]}{table}\n{marks[1]}', text, flags=re.DOTALL), encoding='utf-8'
    )


if __name__ == '__main__':
    write('poses', poses_table(int(sys.argv[1]) if len(sys.argv) > 1 else 50))
    write('defects', defects_table())
