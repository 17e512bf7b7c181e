"""How long `replay` takes, over reading and deserialising the same bag; and how long it takes to start."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from benchmarks.data import CONFIG
from benchmarks.speed_bag import ROBOT, make_bag
from mbaid_ros.cli import EXIT_NOT_DETERMINED
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build, values_of

HERE = Path(__file__).parent
METHODS = ('difference', 'trajectory')
# What servicer7_estimator.yaml says of a robot that is exactly its URDF, as it is by default.
MODEL_ERRORS = {name: values_of(build(EstimatorConfig, {}))[name] for name in EXACT}
# What is measured: the method, and other parameters than those of servicer7_estimator.yaml.
VARIANTS: dict[str, tuple[str, Mapping[str, object]]] = {
    'difference': ('difference', {}),
    'trajectory': ('trajectory', {}),
    'trajectory, every model error among the unknowns': ('trajectory', MODEL_ERRORS),
}
SHORT = 10.0 / 60.0  # min, of the bag whose first estimate is waited for


@dataclass(frozen=True)
class Cost:
    """What a process took.

    Attributes
    ----------
    wall, cpu : s
    memory : MB, its peak
    """

    wall: float
    cpu: float
    memory: float


def median(costs: Sequence[Cost]) -> Cost:
    """Return the medians."""
    return Cost(*(float(np.median([getattr(cost, name) for cost in costs])) for name in ('wall', 'cpu', 'memory')))


@dataclass(frozen=True)
class Pairs:
    """A process and its floor, measured in turn.

    Attributes
    ----------
    ratios : of the processor times, one a pair
    cost, floor : medians
    """

    ratios: tuple[float, ...]
    cost: Cost
    floor: Cost


def replays(folder: Path, minutes: float, repeats: int) -> dict[str, Pairs]:
    """Return, by variant, what a replay takes beside its floor.

    Parameters
    ----------
    folder : where the bag is made
    minutes : length of the bag
    repeats : number of pairs
    """
    bag = folder / 'long'
    make_bag(bag, minutes)
    costs: dict[str, list[Cost]] = {name: [] for name in ('floor', *VARIANTS)}
    for _ in range(repeats):
        costs['floor'].append(_measured([sys.executable, str(HERE / 'speed_floor.py'), str(bag)]))
        for name, variant in VARIANTS.items():
            costs[name].append(_measured(_replay(bag, *variant)))
    return {
        name: Pairs(
            tuple(cost.cpu / floor.cpu for cost, floor in zip(costs[name], costs['floor'], strict=True)),
            median(costs[name]),
            median(costs['floor']),
        )
        for name in VARIANTS
    }


def starts(folder: Path, repeats: int) -> dict[str, Cost]:
    """Return the medians of what the help, and a replay of 10 s with each method, take."""
    bag = folder / 'short'
    make_bag(bag, SHORT)
    commands = {
        'replay --help': [*_PROGRAM, '--help'],
        **{f'replay of 10 s, {method}': _replay(bag, method) for method in METHODS},
    }
    return {name: median([_measured(command) for _ in range(repeats)]) for name, command in commands.items()}


# The executable that `ros2 run` starts is these two lines with a shebang.
_PROGRAM = [sys.executable, '-c', 'import sys; from mbaid_ros.replay.replay import main; sys.exit(main())']


def assigned(values: Mapping[str, object]) -> list[str]:
    """Return the words of a command line that set parameters."""
    return [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]


def _replay(bag: Path, method: str, others: Mapping[str, object] = MappingProxyType({})) -> list[str]:
    files = ['--model', str(CONFIG / f'{ROBOT}.urdf'), '--params', str(CONFIG / f'{ROBOT}_estimator.yaml')]
    return [*_PROGRAM, str(bag), *files, '--method', method, *assigned(others)]


def _measured(command: Sequence[str]) -> Cost:
    run = subprocess.run(
        [sys.executable, str(HERE / 'speed_measured.py'), *command], stdout=subprocess.PIPE, text=True, check=False
    )
    if run.returncode not in {0, EXIT_NOT_DETERMINED}:
        raise RuntimeError(f'exit code {run.returncode} of {" ".join(command)}')
    return Cost(**json.loads(run.stdout))
