"""Monte Carlo over disturbances: pulses, constant forces and wrong known bodies, with and without what allows for them.

usage: benchmark_disturbances.py [--seeds N] [--cases C ...] [--methods M ...] [--processes N] [--store FOLDER]
       [--output FOLDER]
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.data import CONFIG, LEVELS, MAXIMUM_GAP, kernel, motion, readings
from benchmarks.pages import number, percent, provenance, table

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))

from floating import Push, float_freely, still  # noqa: E402 - of the tests
from mbaid_ros.config.estimator import EstimatorConfig  # noqa: E402
from mbaid_ros.config.files import load_parameter_file  # noqa: E402
from mbaid_ros.config.parameters import build  # noqa: E402
from mbaid_ros.config.simulator import SimulatorConfig  # noqa: E402
from mbaid_ros.core.geometry import Array  # noqa: E402
from mbaid_ros.core.identifier import Identifier  # noqa: E402
from mbaid_ros.core.robot.inertia import physical  # noqa: E402
from mbaid_ros.core.robot.kernel import MomentumKernel  # noqa: E402
from mbaid_ros.core.robot.known_errors import body_sizes  # noqa: E402
from mbaid_ros.core.simulation.motion import Sinusoids  # noqa: E402
from mbaid_ros.core.simulation.run import Truth, total_momentum  # noqa: E402
from mbaid_ros.session import make_estimator  # noqa: E402
from mbaid_ros.simulated_run import make_motion  # noqa: E402

ROBOT, LEVEL, SECONDS = 'servicer7', 'mid', 60.0
_SEEDS = 50
_PULSED = 30.0  # s
_DIRECTIONS = np.array([2.0, -2.0, 1.0]) / 3.0, np.array([1.0, 2.0, -2.0]) / 3.0
_PULSE = np.concatenate((1.0 * _DIRECTIONS[0], 0.5 * _DIRECTIONS[1]))  # N s, N m s
_FORCE = np.concatenate((0.01 * _DIRECTIONS[0], 0.01 * _DIRECTIONS[1]))  # N, N m
_METHODS = ('difference', 'trajectory')
_ARRAYS = ('error', 'std', 'noticed', 'events')
_KEPT_EVERY = 10  # runs
_QUANTILE = 1.959964  # of 95 %


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    case : what disturbs: a key of CASES
    option : what allows for it
    settings : parameters of the estimator
    methods : that have the option
    """

    case: str
    option: str
    settings: Mapping[str, object] = field(default_factory=dict)
    methods: tuple[str, ...] = _METHODS

    @property
    def name(self) -> str:
        """Short, for files."""
        return f'{self.case}-{self.option}'.replace(' ', '_').replace('%', 'percent')


def _links(std: float, mode: str) -> dict[str, object]:
    return {'known_links.relative_std': std, 'known_links.mode': mode}


CASES = {
    'none': 'undisturbed',
    'pulse': f'pulse of 1 N s and 0.5 N m s at {_PULSED:g} s',
    'inertial': '10 mN and 10 mN m, inertial axes',
    'body': '10 mN and 10 mN m, base axes',
    'links 1 %': 'known bodies off by 1 %',
    'links 5 %': 'known bodies off by 5 %',
}
ROWS = (
    Row('none', 'plain'),
    Row('none', 'force inertial', {'disturbance.constant': 'inertial'}),
    Row('none', 'force body', {'disturbance.constant': 'body'}),
    Row('pulse', 'plain'),
    *(
        row
        for axes in ('inertial', 'body')
        for row in (
            Row(axes, 'not allowed for', {'trajectory.adapt': False}, ('trajectory',)),
            Row(axes, 'found'),
            Row(axes, 'given', {'disturbance.constant': axes}),
        )
    ),
    *(
        row
        for share in (0.01, 0.05)
        for row in (
            Row(f'links {100.0 * share:.0f} %', 'taken for exact'),
            Row(f'links {100.0 * share:.0f} %', 'considered', _links(share, 'consider'), ('difference',)),
            Row(f'links {100.0 * share:.0f} %', 'estimated', _links(share, 'estimate')),
        )
    ),
)


@dataclass(frozen=True)
class Outcome:
    """What S runs of a row said at their end.

    Attributes
    ----------
    error, std : (S, 10); NaN where not determined
    noticed : (S,) s, when the first event was reported; NaN for none
    events : (S,) number of them at the end
    """

    error: Array
    std: Array
    noticed: Array
    events: Array


def main() -> int:
    """Run the benchmark and return the exit code."""
    arguments = _parse()
    rows = [row for row in ROWS if row.case in arguments.cases or row.name == 'none-plain']
    # Simulated here, once; the workers inherit it.
    for case in {row.case for row in rows}:
        disturbed(case)
    wanted = [(row, method) for method in arguments.methods for row in rows if method in row.methods]
    results: dict[tuple[str, str], Outcome] = {}
    with (
        tqdm(total=len(wanted) * arguments.seeds, unit=' runs', disable=None, leave=False) as bar,
        ProcessPoolExecutor(arguments.processes) as pool,
    ):
        for row, method in wanted:
            results[method, row.name] = _runs(row, method, arguments, pool, bar)
    lines = _table(wanted, results)
    print(lines)
    if arguments.output:
        command = f'scripts/{Path(__file__).name} {" ".join(sys.argv[1:])}'.strip()
        arguments.output.mkdir(parents=True, exist_ok=True)
        (arguments.output / 'disturbances.md').write_text(_page(lines, command), encoding='utf-8')
    return 0


@cache
def disturbed(case: str) -> Truth:
    """Return the true motion of a case."""
    robot = kernel(ROBOT)
    config = build(SimulatorConfig, load_parameter_file(CONFIG / f'{ROBOT}_simulator.yaml', 'simulator'))
    joints = make_motion(config, robot.model)
    if not isinstance(joints, Sinusoids):
        raise TypeError(f'{ROBOT} does not move by sinusoids')
    if case.startswith('links'):
        return disturbed('none')
    start = total_momentum(robot.model, motion(ROBOT)[:1])[0]
    pulse = (_PULSED, _PULSE) if case == 'pulse' else (np.inf, np.zeros(6))
    return float_freely(robot, joints, start, SECONDS, _push(case) if case in ('inertial', 'body') else still, pulse)


def _push(axes: str) -> Push:
    def act(_time: float, rotation: Array, position: Array) -> Array:
        turn = rotation if axes == 'body' else np.eye(3)
        force, torque = turn @ _FORCE[:3], turn @ _FORCE[3:]
        return np.concatenate((force, np.cross(position, force) + torque))

    return act


def _known(case: str, seed: int) -> MomentumKernel:
    """Return the robot as it is believed to be."""
    robot = kernel(ROBOT)
    if not case.startswith('links'):
        return robot
    share = 0.01 * float(case.split()[1])
    sizes = np.array([body_sizes(body) if body[0] > 0.0 else np.zeros(10) for body in robot.known])
    return robot.corrected(share * np.random.default_rng([seed, 2]).normal(size=sizes.shape) * sizes)


def _run(work: tuple[Row, str, int]) -> tuple[Array, Array, float, int]:
    row, method, seed = work
    noise = LEVELS[LEVEL]
    values = {'method': method, **{f'noise.{name}': value for name, value in vars(noise).items()}, **row.settings}
    config = build(EstimatorConfig, values)
    identifier = Identifier(make_estimator(config, _known(row.case, seed)), config.window, MAXIMUM_GAP)
    history = identifier.push(*readings(disturbed(row.case), noise, seed))
    last = history[-1]
    noticed = next((estimate.time for estimate in history if estimate.events), np.nan)
    return last.parameters - physical(kernel(ROBOT).target.parameters), last.std, noticed, len(last.events)


def _runs(row: Row, method: str, arguments: argparse.Namespace, pool: ProcessPoolExecutor, bar: Any) -> Outcome:
    """Return all runs of a row: those in the store, and those that it lacks."""
    file = None if arguments.store is None else arguments.store / f'{method}-{row.name}.npz'
    parts = []
    if file is not None and file.is_file():
        with np.load(file) as arrays:
            parts = [tuple(arrays[name] for name in _ARRAYS)]
    done = min(len(parts[0][0]), arguments.seeds) if parts else 0
    bar.update(done)
    for first in range(done, arguments.seeds, _KEPT_EVERY):
        seeds = range(first, min(first + _KEPT_EVERY, arguments.seeds))
        found = []
        for result in pool.map(_run, [(row, method, seed) for seed in seeds]):
            found.append(result)
            bar.update(1)
        parts.append(tuple(np.array(values) for values in zip(*found, strict=True)))
        if file is not None:
            arguments.store.mkdir(parents=True, exist_ok=True)
            arrays = (np.concatenate(values) for values in zip(*parts, strict=True))
            np.savez(file, **dict(zip(_ARRAYS, arrays, strict=True)))
    return Outcome(*(np.concatenate(values)[: arguments.seeds] for values in zip(*parts, strict=True)))


def _rmse(outcome: Outcome) -> Array:
    # A parameter that some runs leave open is judged by the others.
    count = np.sum(np.isfinite(outcome.error), axis=0)
    return np.asarray(np.sqrt(np.nansum(outcome.error**2, axis=0) / np.maximum(count, 1)))


def _table(wanted: list[tuple[Row, str]], results: Mapping[tuple[str, str], Outcome]) -> str:
    header = [
        'case',
        'method',
        'allowed for',
        'RMSE over undisturbed',
        'worst',
        'std',
        'covered',
        'least',
        'events',
        'by',
    ]
    lines = []
    order = list(CASES)
    for row, method in sorted(wanted, key=lambda item: order.index(item[0].case)):
        outcome, plain = results[method, row.name], results[method, 'none-plain']
        ratio = _rmse(outcome) / _rmse(plain)
        known = np.isfinite(outcome.std)
        widened = np.sqrt(np.nanmean(outcome.std**2, axis=0) / np.nanmean(plain.std**2, axis=0))
        inside = np.where(known, np.abs(outcome.error) < _QUANTILE * outcome.std, np.nan)
        share = np.nanmean(inside, axis=0)
        noticed = outcome.noticed[np.isfinite(outcome.noticed)]
        lines.append(
            [
                CASES[row.case],
                method,
                row.option,
                number(float(np.median(ratio))),
                number(float(np.max(ratio))),
                number(float(np.median(widened))),
                percent(float(np.nanmean(share))),
                percent(float(np.nanmin(share))),
                f'{np.mean(outcome.events):.1f} in {percent(len(noticed) / len(outcome.noticed))}',
                f'{np.max(noticed):.1f} s' if len(noticed) else '-',
            ]
        )
    return table(header, lines)


def _page(lines: str, command: str) -> str:
    return f"""# When something disturbs

{ROBOT}, {LEVEL} noise, {SECONDS:g} s. RMSE of the ten parameters over those of the same method undisturbed: median and
worst. `std` is the median widening of the reported standard deviations: what more unknowns cost by themselves.
`covered` is the share of the 95 % intervals that hold the truth, `least` that of the worst parameter. `events` is their
mean number and the share of the runs with any; `by` is when the last run reported its first. Known bodies are wrong by
another draw in each run: relative to mass, to mass times the larger of distance and radius of gyration, and to the mean
moment of inertia.

{lines}

{provenance(command)}
"""


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seeds', type=int, metavar='N', default=_SEEDS, help=f'runs of each row (default: {_SEEDS})')
    parser.add_argument('--cases', nargs='+', choices=list(CASES), default=list(CASES))
    parser.add_argument('--methods', nargs='+', choices=_METHODS, default=list(_METHODS))
    parser.add_argument('--processes', type=int, metavar='N', default=os.cpu_count(), help='default: one a core')
    parser.add_argument('--store', type=Path, metavar='FOLDER', help='keep finished runs there, and go on from them')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write disturbances.md there')
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
