"""Which variants are run, with how many seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tqdm import tqdm

from benchmarks.model_errors.runs import Outcome, run
from benchmarks.model_errors.variant import Variant, ladder, monte_carlo
from benchmarks.store import completed

EXAMPLE = 'servicer7'  # whose defects are drawn one at a time
ALL = 'all'
SECTIONS = ('robots', 'ladder')


def plan(sections: Sequence[str], robots: Sequence[str], seeds: tuple[int, int, int]) -> dict[Variant, int]:
    """Return variants and how many seeds each is run with.

    Parameters
    ----------
    sections : of SECTIONS
    robots : names
    seeds : of each robot with all blocks on, of its other rows, and of each step of the ladder
    """
    whole, others, steps = seeds
    wanted: dict[Variant, int] = {}
    if 'robots' in sections:
        each = [variant for robot in robots for variant in monte_carlo(robot)]
        # What matters most first.
        each.sort(key=lambda variant: variant.name != ALL)
        wanted |= {variant: whole if variant.name == ALL else others for variant in each}
    if 'ladder' in sections and EXAMPLE in robots:
        wanted |= {variant: steps for _, _, variant in ladder(EXAMPLE)}
    return {variant: count for variant, count in wanted.items() if count}


def outcomes(wanted: dict[Variant, int], processes: int, store: Path | None) -> Iterator[tuple[Variant, Outcome]]:
    """Run, and yield what each variant has come to.

    Parameters
    ----------
    wanted : variants and numbers of seeds
    processes : that work at the same time
    store : folder that keeps finished runs; those that it holds are not made again
    """
    with (
        tqdm(total=sum(wanted.values()), unit=' runs', disable=None, leave=False) as bar,
        ProcessPoolExecutor(processes) as pool,
    ):
        for variant, seeds in wanted.items():
            file = None if store is None else store / variant.file_name
            # On the ladder the estimator is told of robots that are drawn from elsewhere: there is no bound.
            work = [(variant, seed, 'ladder' not in variant.name) for seed in range(seeds)]
            yield variant, completed(Outcome, file, work, run, pool, bar)
