"""What every Monte Carlo script shares: its arguments, its processes, and the runs that it keeps."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.data import LEVELS, ROBOTS
from benchmarks.store import Outcome, Work, completed


def parser_of(documentation: str | None) -> argparse.ArgumentParser:
    """Return a parser that says in its help what the first line of a script's documentation does."""
    return argparse.ArgumentParser(description=(documentation or '').partition('\n')[0])


def add_run_arguments(parser: argparse.ArgumentParser, seeds: object, default: int | None = None) -> None:
    """Add the arguments that `driving` takes, and the number of seeds.

    Parameters
    ----------
    parser : of a script
    seeds : what the help gives as default
    default : of the argument
    """
    add = parser.add_argument
    add('--seeds', type=int, metavar='N', default=default, help=f'runs of each case (default: {seeds})')
    add('--processes', type=int, metavar='N', default=os.cpu_count(), help='default: one a core')
    add('--store', type=Path, metavar='FOLDER', help='keep finished runs there, and go on from them')


def add_example_arguments(parser: argparse.ArgumentParser, methods: Collection[str], method: str) -> None:
    """Add the robot, the quality of its encoders and the method of one long run, and where its page goes.

    Parameters
    ----------
    parser : of a script
    methods : names
    method : that is the default
    """
    add = parser.add_argument
    add('--robot', choices=list(ROBOTS), default='servicer7')
    add('--level', choices=list(LEVELS), default='mid', help='encoder noise')
    add('--method', choices=list(methods), default=method)
    add('--output', type=Path, metavar='FOLDER', help='write endurance.md there')


@dataclass(frozen=True)
class Driver:
    """Makes runs, and keeps them.

    Attributes
    ----------
    pool : in which they are made
    bar : of tqdm, told of every run
    store : folder that keeps them; None keeps nothing
    """

    pool: Executor
    bar: Any
    store: Path | None

    def completed(self, kind: type[Outcome], name: str, work: Sequence[Work], run: Callable[[Work], object]) -> Outcome:
        """Return all of some runs, of which those that the store has under a name are not made again.

        Parameters
        ----------
        kind : of what is returned
        name : of the file
        work : what each run is given, one at least
        run : makes one and returns an object with the fields of `kind`
        """
        file = None if self.store is None else self.store / f'{name}.npz'
        return completed(kind, file, work, run, self.pool, self.bar)


@contextmanager
def driving(total: int, processes: int, store: Path | None) -> Iterator[Driver]:
    """Give a driver for so many runs; its processes inherit what was computed before, and end with the block."""
    with (
        tqdm(total=total, unit=' runs', disable=None, leave=False) as bar,
        ProcessPoolExecutor(processes) as pool,
    ):
        yield Driver(pool, bar, store)
