"""Write measured/model-errors.md: robots that are not their URDF, coverage and errors over the attainable ones.

--seeds is for rows with all errors; other rows have 0.4 times as many.
"""

import numpy as np

from benchmarks.frame import Frame, median_and_most, number, percent, statuses
from benchmarks.model_errors import Outcome, Variant, monte_carlo, run

ROBOTS = ('servicer7', 'ets7', 'table1')
_OTHERS = 0.4  # of the seeds, for rows without all errors


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/model-errors.md', seeds=50)
    variants = sorted(
        (variant for robot in ROBOTS for variant in monte_carlo(robot)), key=lambda variant: variant.name != 'all'
    )
    chosen = frame.chosen(variants, lambda variant: f'{variant.robot}, {variant.name}')
    files = {variant: f'{variant.robot}-{variant.name}' for variant in chosen}
    seeds = frame.arguments.seeds
    counts = {each: seeds if each.name == 'all' else round(_OTHERS * seeds) or 1 for each in chosen}
    frame.tabulate(_HEADER, frame.outcomes(Outcome, run, files, counts), _row)


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
        median_and_most(outcome.over_bound(outcome.error)),
        median_and_most(outcome.over_bound(outcome.robots_own)),
        statuses(outcome.status),
    ]


_HEADER = (
    *('robot, errors', 'robots', 'coverage', 'by parameter', 'largest error', 'NEES', 'its 95 % band', 'NIS'),
    *('RMSE / bound', 'draw / bound', 'status'),
)


if __name__ == '__main__':
    main()
