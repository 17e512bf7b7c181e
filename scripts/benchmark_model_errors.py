"""Write docs/model-errors.md: robots that are not their URDF, coverage and errors over the attainable ones.

--seeds is for rows with all errors; other rows have 0.4 times as many.
"""

from __future__ import annotations

import numpy as np

from benchmarks.frame import Frame, number, percent, provenance, statuses, table
from benchmarks.model_errors.runs import Outcome, estimates, run
from benchmarks.model_errors.variant import STEPS, Variant, ladder, monte_carlo
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.budget import ErrorBudget
from mbaid_ros.core.results.parameters import PARAMETERS

ROBOTS, EXAMPLE = ('servicer7', 'ets7', 'table1'), 'servicer7'
_OTHERS = 0.4  # of the seeds, for rows without all errors
_LEAST = 0.01  # share of a variance that is worth a column


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'model-errors.md', seeds=50)
    variants = [variant for robot in ROBOTS for variant in monte_carlo(robot)]
    variants = [*sorted(variants, key=lambda one: one.name != 'all'), *(variant for _, _, variant in ladder(EXAMPLE))]
    work = {}
    for variant in frame.chosen(variants, lambda variant: f'{variant.robot}, {variant.name}'):
        seeds = frame.seeds if variant.name == 'all' else range(round(_OTHERS * len(frame.seeds)) or 1)
        # On the ladder the robots are not drawn from the priors: there is no bound.
        bounded = not variant.name.startswith('ladder')
        work[variant] = (f'{variant.robot}-{variant.name}', [(variant, seed, bounded) for seed in seeds])
    found: dict[Variant, Outcome] = {}
    for variant, outcome in frame.outcomes(Outcome, run, work):
        found[variant] = outcome
        print(' | '.join(_row(variant, outcome)), flush=True)
    drawn = [_row(variant, outcome) for variant, outcome in found.items() if not variant.name.startswith('ladder')]
    steps: dict[str, list[str]] = {}
    for name, _, variant in ladder(EXAMPLE):
        steps.setdefault(name, [name]).append(_step(found[variant]) if variant in found else '-')
    budget = estimates(next(monte_carlo(EXAMPLE)), 0)[-1].budget
    assert budget is not None, 'a run with all errors has a budget'
    frame.write(
        robots=f'{table(_HEADER, drawn)}\n\n{provenance()}',
        ladder=table(['drawn with', *(f'{step:g}' for step in STEPS)], steps.values()),
        budget=_budget(budget),
    )


def _row(variant: Variant, outcome: Outcome) -> list[str]:
    coverage, (size, name, seed), (nees, low, high) = outcome.coverage, outcome.largest, outcome.nees
    numbers, nis = bool(np.any(np.isfinite(coverage))), outcome.nis[np.isfinite(outcome.nis)]
    return [
        f'{variant.robot}, {variant.name}',
        str(len(outcome)),
        percent(float(np.nanmean(coverage))) if numbers else '-',
        f'{percent(float(np.nanmin(coverage)))} to {percent(float(np.nanmax(coverage)))}' if numbers else '-',
        f'{number(size, 1)} ({name}, seed {seed})' if numbers else '-',
        number(nees),
        f'{number(low)} to {number(high)}',
        number(float(np.mean(nis))) if len(nis) else '-',
        _ratio(outcome.over_bound(outcome.error)),
        _ratio(outcome.over_bound(outcome.robots_own)),
        statuses(outcome.status),
    ]


def _ratio(values: Array) -> str:
    if not np.any(np.isfinite(values)):
        return '-'
    return f'{number(float(np.nanmedian(values)))} ({number(float(np.nanmax(values)))})'


def _step(outcome: Outcome) -> str:
    covered = percent(float(np.nanmean(outcome.coverage))) if np.any(np.isfinite(outcome.coverage)) else '-'
    size, name, seed = outcome.largest
    return f'{number(size, 1)} ({name}, seed {seed}), {covered}, {statuses(outcome.status)}'


def _budget(budget: ErrorBudget) -> str:
    worth = [cause for cause, shares in zip(budget.causes, budget.shares.T, strict=True) if np.nanmax(shares) > _LEAST]
    rows = [[name, *(percent(budget.of(name, 0.0).get(cause, np.nan)) for cause in worth)] for name in PARAMETERS]
    return table(['', *worth], rows)


_HEADER = (
    *('robot, errors', 'robots', 'coverage', 'by parameter', 'largest error', 'NEES', 'its 95 % band', 'NIS'),
    *('RMSE / bound', 'draw / bound', 'status'),
)


if __name__ == '__main__':
    main()
