"""Write the tables of measured/speed.md: processor time over that of the work which no such program can avoid.

Measured pairs alternate on the same machine under the same load; medians are given.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.bags import ROBOT, make_bag
from benchmarks.data import CONFIG
from benchmarks.frame import Frame, number, provenance, table
from benchmarks.speed_live import live_runs
from demo_graph import assigned
from mbaid_ros.cli import EXIT_NOT_DETERMINED
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build, values_of

HERE = Path(__file__).parent / 'benchmarks'
METHODS = ('difference', 'trajectory')
_RATE, _SHORT = 1000.0, 10.0  # Hz, of each topic of the live runs; s
# Parameters beside those of servicer7_estimator.yaml, which declares a robot that is exactly its URDF.
_DEFAULTS = values_of(build(EstimatorConfig, {}))
VARIANTS: dict[str, Mapping[str, object]] = {
    **{method: {'method': method} for method in METHODS},
    'trajectory, every model error among the unknowns': {
        'method': 'trajectory',
        **{name: _DEFAULTS[name] for name in EXACT},
    },
}
# Wrongly declared noise contradicts the data: the filter searches for a start and for causes, again and again.
_CONTRADICTED = {'method': 'trajectory', 'noise.joint_position': 1e-5, 'noise.base_position': 3e-4}
# The executable that `ros2 run` starts is these two lines with a shebang.
_PROGRAM = [sys.executable, '-c', 'import sys; from mbaid_ros.replay.start import replay; sys.exit(replay())']


@dataclass(frozen=True)
class Cost:
    """Costs of a process."""

    wall: float  # s
    cpu: float  # s
    memory: float  # MB, its peak


def main() -> None:
    """Measure the chosen parts."""
    frame = Frame(__doc__, 'measured/speed.md', minutes=60.0, seconds=30.0, repeats=5, parts='replay, live, start')
    arguments = frame.arguments
    parts: dict[str, Callable[[Path], str]] = {
        'replay': lambda folder: _replays(folder, arguments.minutes, arguments.repeats),
        'live': lambda folder: _live(folder, arguments.seconds, arguments.repeats),
        'start': lambda folder: _starts(folder, arguments.repeats),
    }
    for name, part in parts.items():
        if name in arguments.parts:
            with TemporaryDirectory() as folder:
                text = part(Path(folder))
            note = f'medians of {arguments.repeats}, load average {os.getloadavg()[2]:.0f} at the end'
            print(text, flush=True)
            frame.write(**{name: f'{text}\n\n{provenance(note)}'})


def _replays(folder: Path, minutes: float, repeats: int) -> str:
    bag = folder / 'long'
    make_bag(bag, minutes)
    floor, costs = [], {name: list[Cost]() for name in VARIANTS}
    for _ in range(repeats):
        floor.append(_measured([sys.executable, str(HERE / 'speed_floor.py'), str(bag)]))
        for name, parameters in VARIANTS.items():
            costs[name].append(_measured(_replay(bag, parameters)))
    rows = []
    for name, each in costs.items():
        ratio = _middle([cost.cpu / least.cpu for cost, least in zip(each, floor, strict=True)])
        cost, least = _median(each), _median(floor)
        seconds = (number(cost.cpu, 1), number(least.cpu, 1))
        rows.append([name, ratio, *seconds, number(cost.memory), number(least.memory)])
    header = ['method', 'ratio', 'replay, s', 'floor, s', 'peak, MB', 'floor, MB']
    return f'A bag of {minutes:g} min at 100 Hz:\n\n{table(header, rows)}'


def _live(folder: Path, seconds: float, repeats: int) -> str:
    variants = {**VARIANTS, 'trajectory, contradicted: searches for start and causes': _CONTRADICTED}
    rows = []
    for name, pairs in live_runs(variants, folder, _RATE, seconds, repeats).items():
        shares = [
            [1e3 * float(np.percentile(run.latencies, share)) for run, _ in pairs] for share in (50.0, 99.0, 100.0)
        ]
        ratio = _middle([run.cpu / bare.cpu for run, bare in pairs])
        rows.append([name, ratio, *(_middle(each, '.1f') for each in shares), str(sum(run.lost for run, _ in pairs))])
    header = ['method', 'ratio', 'p50, ms', 'p99, ms', 'longest, ms', 'lost']
    return f'Two topics at {_RATE:g} Hz each for {seconds:g} s:\n\n{table(header, rows)}'


def _starts(folder: Path, repeats: int) -> str:
    bag = folder / 'short'
    make_bag(bag, _SHORT / 60.0)
    commands = {'`replay --help`': [*_PROGRAM, '--help']}
    commands |= {f'replay of 10 s, {method}': _replay(bag, VARIANTS[method]) for method in METHODS}
    rows = []
    for name, command in commands.items():
        cost = _median([_measured(command) for _ in range(repeats)])
        rows.append([name, number(cost.wall), number(cost.cpu), number(cost.memory)])
    return table(['', 'wall, s', 'processor, s', 'peak, MB'], rows)


def _replay(bag: Path, parameters: Mapping[str, object]) -> list[str]:
    files = ['--model', str(CONFIG / f'{ROBOT}.urdf'), '--params', str(CONFIG / f'{ROBOT}_estimator.yaml')]
    return [*_PROGRAM, str(bag), *files, *assigned(parameters)]


def _measured(command: Sequence[str]) -> Cost:
    program = [sys.executable, str(HERE / 'speed_measured.py'), *command]
    run = subprocess.run(program, stdout=subprocess.PIPE, text=True, check=False)
    if run.returncode not in {0, EXIT_NOT_DETERMINED}:
        raise RuntimeError(f'exit code {run.returncode} of {" ".join(command)}')
    return Cost(**json.loads(run.stdout))


def _median(costs: Sequence[Cost]) -> Cost:
    return Cost(*(float(np.median([getattr(cost, name) for cost in costs])) for name in ('wall', 'cpu', 'memory')))


def _middle(values: Sequence[float], form: str = '.2f') -> str:
    """Return median and range of values, one a pair."""
    return f'{np.median(values):{form}} ({min(values):{form}} to {max(values):{form}})'


if __name__ == '__main__':
    main()
