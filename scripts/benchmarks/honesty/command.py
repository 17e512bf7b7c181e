"""What the scripts over conditions share: arguments, and the runs spread over processes."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tqdm import tqdm

from benchmarks.honesty.condition import Condition
from benchmarks.honesty.runs import Outcome, run, run_file
from benchmarks.store import completed
from mbaid_ros.config.trajectory import METHODS


def parsed(description: str, conditions: Sequence[Condition], seeds: int, page: str) -> argparse.Namespace:
    """Return the arguments, the conditions that are chosen among them.

    Parameters
    ----------
    description : of the script
    conditions : all that there are
    seeds : runs of each where nobody says
    page : name of the file that is written
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('--seeds', type=int, metavar='N', default=seeds, help=f'runs of each row (default: {seeds})')
    parser.add_argument('--rows', metavar='PATTERN', default='', help="regular expression, as 'sensors: ' or 'mrad'")
    parser.add_argument('--method', choices=METHODS, default='trajectory')
    parser.add_argument('--processes', type=int, metavar='N', default=2, help='default: 2')
    parser.add_argument('--store', type=Path, metavar='FOLDER', help='keep finished runs there, and go on from them')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help=f'write {page} there')
    arguments = parser.parse_args()
    try:
        pattern = re.compile(arguments.rows)
    except re.error as error:
        parser.error(f"--rows is '{arguments.rows}', {error}; accepted: a regular expression")
    arguments.conditions = [one for one in conditions if pattern.search(f'{one.group}: {one.name}')]
    if not arguments.conditions:
        parser.error(f"--rows is '{arguments.rows}'; accepted: what is in one of the {len(conditions)} names")
    return arguments


def outcomes(arguments: argparse.Namespace) -> Iterator[tuple[Condition, Outcome]]:
    """Yield what the runs of each condition said, as soon as they are made."""
    with (
        tqdm(total=len(arguments.conditions) * arguments.seeds, unit=' runs', disable=None, leave=False) as bar,
        ProcessPoolExecutor(arguments.processes) as pool,
    ):
        for condition in arguments.conditions:
            file = arguments.store and run_file(arguments.store, condition.name, arguments.method)
            work = [(condition.name, arguments.method, seed) for seed in range(arguments.seeds)]
            yield condition, completed(Outcome, file, work, run, pool, bar)


def write(arguments: argparse.Namespace, page: str, text: str) -> None:
    """Write a page, where one is asked for."""
    if arguments.output:
        arguments.output.mkdir(parents=True, exist_ok=True)
        (arguments.output / page).write_text(text, encoding='utf-8')


def command(arguments: argparse.Namespace) -> str:
    """Return how the script was called, for its page: what the numbers depend on."""
    rows = f" --rows '{arguments.rows}'" if arguments.rows else ''
    return f'scripts/{Path(sys.argv[0]).name} --seeds {arguments.seeds} --method {arguments.method}{rows}'
