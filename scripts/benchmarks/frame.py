"""Shared parts of the benchmarks: arguments, parallel runs that a folder keeps, tables, and the page in docs/."""

import argparse
import datetime as dt
import os
import platform
import re
import shlex
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from signal import SIG_DFL, SIGINT, signal
from typing import Any, TypeVar

import numpy as np
from tqdm import tqdm

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import ArrayRecord, SensorNoise

PUBLISHED = ('estimating', 'converged')  # statuses whose numbers count
_NOT_STATED = ('--output', '--processes', '--store', '--clones')  # arguments on which no number depends

Outcome = TypeVar('Outcome', bound='Runs')
Row = TypeVar('Row')


@dataclass(frozen=True)
class Runs(ArrayRecord):
    """Results of runs: each field of a subclass is an array with the runs as its leading axis."""

    @classmethod
    def of(cls: type[Outcome], array: Callable[[str], Array]) -> Outcome:
        """Return runs from a function that returns the array of each field."""
        arrays: dict[str, Any] = {item.name: array(item.name) for item in fields(cls)}
        return cls(**arrays)

    @classmethod
    def stack(cls: type[Outcome], runs: Sequence[object]) -> Outcome:
        """Return several runs, each of which has the fields without the leading axis."""
        return cls.of(lambda name: np.array([getattr(run, name) for run in runs]))


def completed(
    kind: type[Outcome], file: Path | None, seeds: range, run: Callable[[int], object], pool: Executor, bar: Any
) -> Callable[[], Outcome]:
    """Begin the runs of all seeds that a file lacks, and return the function that waits for them.

    Its results are the first ones from an .npz file if it holds any, the others made and added. `run` returns an object
    with the fields of `kind` for a seed; `bar` is of tqdm.
    """
    parts = []
    if file is not None and file.is_file():
        with np.load(file) as arrays:
            parts.append(kind.of(arrays.__getitem__))
    done = min(len(parts[0]), len(seeds)) if parts else 0
    bar.update(done)
    missing = pool.map(run, seeds[done:])

    def results() -> Outcome:
        for made in missing:
            bar.update(1)
            parts.append(kind.stack([made]))
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                unfinished = file.with_suffix('.part.npz')
                np.savez(unfinished, **vars(kind.concatenate(parts)))
                unfinished.replace(file)  # a stop while it is written leaves the last one whole
        return kind.concatenate(parts)[: len(seeds)]

    return results


class Frame:
    """The command line, the parallel runs and the page of one benchmark.

    The first line of the script's documentation is its help; `page` is the file in docs/ whose tables it writes;
    `seeds` is the default number of runs of each row, if it has seeds; `options` are defaults of further arguments.
    """

    def __init__(self, documentation: str | None, page: str, seeds: int | None = None, **options: float | str) -> None:
        self._parser = argparse.ArgumentParser(description=(documentation or '').partition('\n')[0])
        add = self._parser.add_argument
        if seeds is not None:
            add('--seeds', type=int, metavar='N', default=seeds, help='runs of each row (default: %(default)s)')
            add('--rows', metavar='PATTERN', default='', help='only rows that match this regular expression')
            add('--processes', type=int, metavar='N', default=os.cpu_count(), help='default: one a core')
            add('--store', type=Path, metavar='FOLDER', help='save finished runs there, and continue from them')
        for name, value in options.items():
            if isinstance(value, bool):
                add(f'--{name}', action='store_true', help='default: no')
            else:
                add(f'--{name}', type=type(value), default=value, help='default: %(default)s')
        add('--output', type=Path, metavar='FOLDER', help=f'write the tables of {page} there')
        self.arguments = self._parser.parse_args()
        self._page = page

    def chosen(self, rows: Iterable[Row], name: Callable[[Row], str]) -> list[Row]:
        """Return the rows whose names match --rows."""
        found = [row for row in rows if re.search(self.arguments.rows, name(row))]
        if not found:
            self._parser.error(f"--rows is '{self.arguments.rows}', and no row matches it")
        return found

    def outcomes(
        self,
        kind: type[Outcome],
        run: Callable[[Row, int], object],
        files: Mapping[Row, str],
        seeds: Mapping[Row, int] | None = None,
    ) -> Iterator[tuple[Row, Outcome]]:
        """Yield the results of each row as soon as they are complete.

        `files` has the rows with the names of their files in --store; `seeds` their numbers of seeds if not --seeds.
        """
        counts = seeds or dict.fromkeys(files, self.arguments.seeds)
        store: Path | None = self.arguments.store
        with (
            tqdm(total=sum(counts.values()), unit=' runs', disable=None, leave=False) as bar,
            ProcessPoolExecutor(self.arguments.processes, None, signal, (SIGINT, SIG_DFL)) as pool,  # Ctrl-C ends runs
        ):
            begun = {}
            for row, name in files.items():
                file = store and store / f'{re.sub(r"[^0-9A-Za-z+-]+", "_", name)}.npz'
                begun[row] = completed(kind, file, range(counts[row]), partial(run, row), pool, bar)
            try:
                for row, results in begun.items():
                    yield row, results()
            except (KeyboardInterrupt, BrokenProcessPool):
                sys.exit(f'stopped; {store} has the finished runs, and the same command goes on' if store
                         else 'stopped; nothing is kept without --store')  # fmt: skip
            finally:
                pool.shutdown(cancel_futures=True)

    def tabulate(
        self,
        header: Sequence[str],
        outcomes: Iterable[tuple[Row, Outcome]],
        line: Callable[[Row, Outcome], Sequence[str]],
        name: str = 'table',
        note: str = '',
    ) -> None:
        """Print a line of each result as soon as it is complete, and write them as a table with a note."""
        lines = []
        for row, outcome in outcomes:
            lines.append(line(row, outcome))
            print(' | '.join(lines[-1]), flush=True)
        self.write(**{name: f'{table(header, lines)}\n\n{provenance(note)}'})

    def write(self, **texts: str) -> None:
        """Replace the texts between the marks that the page has for their names, long tables by pictures."""
        if self.arguments.output is not None:
            from benchmarks.pictures import pictured  # noqa: PLC0415 - matplotlib is large, and memory is measured

            page = self.arguments.output / self._page
            for name, text in texts.items():
                replace_marked(page, name, pictured(text, page, name))


def replace_marked(page: Path, name: str, text: str) -> None:
    """Replace the text between the marks of a page for a name, which also has the name of this script."""
    writer = f'scripts/{Path(sys.argv[0]).name}'
    head, tail = f'<!-- {name}: written by {writer} -->\n', f'\n<!-- end of {name} -->'
    before, there, rest = page.read_text(encoding='utf-8').partition(head)
    _, closed, after = rest.partition(tail)
    assert there, f"{page} has marks for '{name}' by {writer}"
    assert closed, f"{page} has an end of '{name}'"
    page.write_text(before + head + text + tail + after, encoding='utf-8')


def table(header: Sequence[str], rows: Iterable[Sequence[str]], *, words: bool = False) -> str:
    """Return a Markdown table; the first column to the left, the others to the right unless they hold words."""
    lines = [header, ['---', *['---' if words else '---:'] * (len(header) - 1)], *rows]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def number(value: float, digits: int = 2) -> str:
    """Return a number for a table: a dash for NaN, no decimals from 100 on."""
    if not np.isfinite(value):
        return '-'
    if abs(value) >= 1e4:
        return f'{value:.0e}'.replace('e+0', 'e')
    return f'{value:.0f}' if abs(value) >= 100.0 else f'{value:.{digits}f}'


def percent(share: float) -> str:
    """Return a share in per cent, a dash for NaN."""
    return f'{100.0 * share:.0f} %' if np.isfinite(share) else '-'


def median_and_most(values: Array) -> str:
    """Return the median of some values with the largest one, a dash without any."""
    if not np.any(np.isfinite(values)):
        return '-'
    return f'{number(float(np.nanmedian(values)))} ({number(float(np.nanmax(values)))})'


def statuses(found: Iterable[Any]) -> str:
    """Return how often each status occurs."""
    return ', '.join(f'{count} {str(name).replace("_", " ")}' for name, count in Counter(found).most_common())


def declared(noise: SensorNoise) -> dict[str, object]:
    """Return the parameters that declare a noise, or give it to the simulator."""
    return {f'noise.{name}': value for name, value in vars(noise).items() if value}


def provenance(note: str = '') -> str:
    """Return the line with the command, machine and date of the numbers."""
    left, kept = iter(sys.argv[1:]), []
    for argument in left:
        name, _, value = argument.partition('=')
        if name not in _NOT_STATED:
            kept.append(shlex.quote(argument))
        elif not value:
            next(left, None)
    command = ' '.join((f'scripts/{Path(sys.argv[0]).name}', *kept))
    today = dt.datetime.now(tz=dt.timezone.utc).date().isoformat()
    return '; '.join(part for part in (f'Written by `{command}`', note, machine(), today) if part) + '.'


def machine() -> str:
    """Return processor, Python and NumPy."""
    named = re.search(r'model name\s*: (.*)', Path('/proc/cpuinfo').read_text(encoding='utf-8'))
    processor = named[1].strip() if named else platform.machine()
    return f'{processor}, one core a run, Python {platform.python_version()}, NumPy {np.__version__}'
