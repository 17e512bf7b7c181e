"""Write the tables of docs/robustness.md: what defects of the input do to the estimate, and what is said of them.

usage: robustness.py [--seeds N] [--processes N] [--store FOLDER]    (with `install/setup.bash` sourced)
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / 'scripts'), str(ROOT / 'test')]

import defects  # noqa: E402 - from the tests, which are no package
from benchmarks.driver import Driver, add_run_arguments, driving, parser_of  # noqa: E402
from benchmarks.pages import replace_marked  # noqa: E402
from benchmarks.store import Runs  # noqa: E402
from defects import JOINTS, ODOMETRY, Arrival, arrivals, changed, estimates  # noqa: E402
from mbaid_ros.core.geometry import Array, unvec  # noqa: E402
from mbaid_ros.core.results.estimate import Estimate  # noqa: E402
from mbaid_ros.core.robot.momentum import physical  # noqa: E402
from mbaid_ros.replay.campaigns.monte_carlo import QUANTILE  # noqa: E402
from mbaid_ros.session import intake_warnings  # noqa: E402
from simulated import robot  # noqa: E402

PAGE, WRITER = ROOT / 'docs' / 'robustness.md', 'scripts/robustness.py'
ROBOT, SECONDS = 'servicer7', 60.0
SEEDS = {'difference': 150, 'trajectory': 50}  # of the table of many runs
METHODS = tuple(SEEDS)
DELAY = 0.02  # s
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
    Case('joint states stamped 20 ms late', changed(JOINTS, defects.shifted(DELAY)), {}),
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


RUNS = [
    ('undisturbed', nothing),
    ('no velocity at all', poses_alone),
    ('30 % of the messages lost', defects.lost(3, 0.3)),
    ('joint states stamped 20 ms late', changed(JOINTS, defects.shifted(DELAY))),
]


@dataclass(frozen=True)
class Ends(Runs):
    """What a run, or many runs, ended with: as in Estimate."""

    parameters: Array
    std: Array
    time_offset: Array
    time_offset_std: Array


def end(work: tuple[int, str, int]) -> Estimate:
    """Return what a run ends with: of RUNS which, method, seed."""
    run, method, seed = work
    spoiled = RUNS[run][1](arrivals(ROBOT, SECONDS, 100 + seed))
    return estimates(ROBOT, spoiled, {'method': method}, 2000)[0][-1]


def runs_table(seeds: dict[str, int], driver: Driver) -> str:
    """Return the statistics of many runs with some defects, of so many seeds by method."""
    numbers = ', '.join(f'{count} seeds for `{method}`' for method, count in seeds.items())
    told = (
        f'The same motion with noise of its own in each run, {numbers}, after 60 s. RMSE: the median over the ten '
        'parameters, relative to the undisturbed runs. Within 95 %: how often the truth is within the reported '
        'interval. Delay: mean and largest error of the time offset that is estimated along.'
    )
    rows = [
        told,
        '',
        '| method | input | RMSE | within 95 %: mean, least, most | delay, ms | error, standard deviations |',
    ]
    rows.append('|---|---|---|---|---|---|')
    for method in METHODS:
        plain = np.ones(10)
        for run, (name, _) in enumerate(RUNS):
            work = [(run, method, seed) for seed in range(seeds[method])]
            found = driver.completed(Ends, f'robustness-{method}-{run}', work, end)
            error = found.parameters - truth()
            rmse = np.sqrt(np.mean(error**2, axis=0))
            plain = rmse if run == 0 else plain
            inside = np.mean(np.abs(error) < QUANTILE * found.std, axis=0)
            true = DELAY if 'late' in name else 0.0
            deviation = (found.time_offset - true) / found.time_offset_std
            cells = (
                method,
                name,
                f'{np.median(rmse / plain):.2f}',
                f'{inside.mean():.2f}, {inside.min():.2f}, {inside.max():.2f}',
                f'{1e3 * found.time_offset.mean():.3f}',
                f'{np.sqrt(np.mean(deviation**2)):.2f}, {np.max(np.abs(deviation)):.1f}',
            )
            rows.append(f'| {" | ".join(cells)} |'.replace('nan', '-'))
            print(rows[-1], flush=True)
    return '\n'.join(rows)


def main() -> None:
    """Write both tables."""
    parser = parser_of(__doc__)
    add_run_arguments(parser, SEEDS)
    arguments = parser.parse_args()
    seeds = dict.fromkeys(SEEDS, arguments.seeds) if arguments.seeds else SEEDS
    with driving(len(RUNS) * sum(seeds.values()), arguments.processes, arguments.store) as driver:
        replace_marked(PAGE, 'runs', WRITER, runs_table(seeds, driver))
    replace_marked(PAGE, 'defects', WRITER, defects_table())


if __name__ == '__main__':
    main()
