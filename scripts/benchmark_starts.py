"""Write measured/starts.md: motions that are hard to start with, and whether an estimate is ever wrong."""

import numpy as np

from benchmarks.frame import PUBLISHED, Frame, number, percent, statuses
from benchmarks.honesty.conditions import STARTS
from benchmarks.honesty.runs import FAR, Outcome, run


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/starts.md', seeds=100, method='trajectory')
    method = frame.arguments.method
    names = [condition.name for condition in frame.chosen(STARTS, lambda condition: condition.name)]
    frame.tabulate(_HEADER, frame.outcomes(Outcome, run, {(name, method): f'{method}-{name}' for name in names}), _row)


def _row(row: tuple[str, str], outcome: Outcome) -> list[str]:
    ended = np.isin(outcome.status, PUBLISHED) & np.any(np.isfinite(outcome.error), axis=1)
    given = ended[:, None] & np.isfinite(outcome.error) & (outcome.std > 0.0)
    last = np.abs(np.divide(outcome.error, outcome.std, out=np.zeros(outcome.error.shape), where=given))
    worst = np.maximum(outcome.worst, outcome.young)
    wrong = np.flatnonzero(worst > FAR)
    started = outcome.first[np.isfinite(outcome.first)]
    median, latest = (np.median(started), np.max(started)) if len(started) else (np.nan, np.nan)
    return [
        row[0].removeprefix('start: '),
        str(len(outcome)),
        percent(float(np.mean(ended))),
        statuses(outcome.status),
        f'{number(float(median), 1)}, {number(float(latest), 1)}',
        number(float(np.max(worst)), 1),
        str(len(wrong)),
        str(int(np.sum(np.max(last, axis=1) > FAR))),
        ', '.join(str(seed) for seed in wrong[:5]) or '-',
    ]


_HEADER = (
    *('motion', 'runs', 'estimate by the end', 'last status', 'first, s: median, latest', 'largest error ever'),
    *('beyond 5 ever', 'at the end', 'seeds beyond 5'),
)


if __name__ == '__main__':
    main()
