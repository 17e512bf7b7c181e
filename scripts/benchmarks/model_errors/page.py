"""The page docs/model-errors.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.model_errors.flywheel import MASS
from benchmarks.model_errors.plan import EXAMPLE
from benchmarks.model_errors.runs import Outcome
from benchmarks.model_errors.variant import DEFECTS, STEPS, Variant, ladder
from benchmarks.pages import number, percent, table
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.budget import ErrorBudget
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS

_LEAST = 0.01  # share of a variance that is worth a column

Outcomes = Mapping[Variant, Outcome]


def page(
    outcomes: Outcomes,
    wheel: Mapping[float, Sequence[tuple[Estimate, Array]]],
    budget: ErrorBudget,
    origin: str,
) -> str:
    """Return the page as Markdown.

    Parameters
    ----------
    outcomes : of all variants
    wheel : by standard deviation of the mass that is given, kg, estimates of the base with one flywheel
    budget : of one run
    origin : the line that says how the numbers were made
    """
    drawn = {variant: outcome for variant, outcome in outcomes.items() if 'ladder' not in variant.name}
    parts = [
        _INTRODUCTION,
        table(_HEADER, [row(variant, outcome) for variant, outcome in drawn.items()]),
        _LADDER.format(robot=EXAMPLE, seeds=_ladder_seeds(outcomes)),
        table(['drawn with', *(f'{step:g}' for step in STEPS)], _ladder(outcomes)),
        _WHEEL.format(mass=MASS),
        table(['mass given', 'runs', 'status', 'largest error', 'CoM std, mm', 'Ixx std, %'], _wheel(wheel)),
        _BUDGET.format(robot=EXAMPLE),
        _budget(budget),
        origin,
    ]
    return '\n\n'.join(part.strip('\n') for part in parts) + '\n'


_HEADER = (
    *('robot, what is off', 'robots', 'coverage', 'by parameter', 'largest error', 'NEES', 'its 95 % band', 'NIS'),
    *('RMSE / bound', 'draw / bound', 'status'),
)


def row(variant: Variant, outcome: Outcome) -> list[str]:
    """Return a variant's row of the first table."""
    coverage, (size, name, seed), (nees, low, high) = outcome.coverage, outcome.largest, outcome.nees
    numbers = bool(np.any(np.isfinite(coverage)))
    return [
        f'{variant.robot}, {variant.name}',
        str(len(outcome)),
        percent(float(np.nanmean(coverage))) if numbers else '-',
        f'{percent(float(np.nanmin(coverage)))} to {percent(float(np.nanmax(coverage)))}' if numbers else '-',
        f'{number(size, 1)} ({name}, seed {seed})' if numbers else '-',
        number(nees),
        f'{number(low)} to {number(high)}',
        number(float(np.nanmean(outcome.nis))) if np.any(np.isfinite(outcome.nis)) else '-',
        _ratio(outcome.over_bound),
        _ratio(outcome.drawn_over_bound),
        _statuses(outcome),
    ]


def _ratio(values: Array) -> str:
    if not np.any(np.isfinite(values)):
        return '-'
    return f'{number(float(np.nanmedian(values)))} ({number(float(np.nanmax(values)))})'


def _statuses(outcome: Outcome) -> str:
    counts = Counter(str(status).replace('_', ' ') for status in outcome.status)
    return ', '.join(f'{count} {status}' for status, count in counts.most_common())


def _ladder(outcomes: Outcomes) -> list[list[str]]:
    cells: dict[str, list[str]] = {}
    for name, _, variant in ladder(EXAMPLE):
        outcome = outcomes.get(variant)
        cells.setdefault(name, []).append('-' if outcome is None else _step(outcome))
    assert len(cells) == len(DEFECTS), 'a row for each'
    return [[name, *steps] for name, steps in cells.items()]


def _step(outcome: Outcome) -> str:
    covered = percent(float(np.nanmean(outcome.coverage))) if np.any(np.isfinite(outcome.coverage)) else '-'
    size, name, seed = outcome.largest
    return f'{number(size, 1)} ({name}, seed {seed}), {covered}, {_statuses(outcome)}'


def _ladder_seeds(outcomes: Outcomes) -> int:
    return min((len(outcome) for variant, outcome in outcomes.items() if 'ladder' in variant.name), default=0)


def _wheel(wheel: Mapping[float, Sequence[tuple[Estimate, Array]]]) -> list[list[str]]:
    rows = []
    for std, found in wheel.items():
        statuses = Counter(estimate.status.replace('_', ' ') for estimate, _ in found)
        errors = np.abs(np.array([z for _, z in found]))
        com = 1e3 * np.array([np.max(estimate.std[1:4]) for estimate, _ in found])
        inertia = 100.0 * np.array([estimate.std[4] / estimate.parameters[4] for estimate, _ in found])
        rows.append(
            [
                f'within {std:g} kg' if std else 'no',
                str(len(found)),
                ', '.join(f'{count} {status}' for status, count in statuses.most_common()),
                *(
                    number(float(np.nanmax(values)) if np.any(np.isfinite(values)) else np.nan)
                    for values in (errors, com, inertia)
                ),
            ]
        )
    return rows


def _budget(budget: ErrorBudget) -> str:
    worth = [cause for cause, shares in zip(budget.causes, budget.shares.T, strict=True) if np.nanmax(shares) > _LEAST]
    rows = [[name, *(percent(budget.of(name, 0.0).get(cause, np.nan)) for cause in worth)] for name in PARAMETERS]
    return table(['', *worth], rows)


_INTRODUCTION = """
# Robots that are not their URDF

Robots drawn as the simulator draws them (`model_errors.*`): links 1 % as a whole and each of their parameters 1 %
beside that ([trajectory.md](trajectory.md#a-known-body)), joint zeros 1 mrad, joint origins 1 mm, joint axes 1 mrad,
odometry mount 2 mm and 2 mrad, one standard deviation each; the target is exact. They move as the `*_simulator.yaml` of
`config/` says, with *mid* noise at 100 Hz, and method `trajectory` takes a minute of it with default parameters, told
the noise and how large the errors may be; a robot and its noise have one seed.

## Whether the intervals hold

- *all*: everything is off, and said to be; then one block alone, the others exact and said to be; then everything,
  with priors that are wrong: by a factor of two, or about the links, which are off by one factor each, *as a whole*, or
  *each number by itself*.
- *coverage*: of the 95 % intervals, the mean over the parameters, and the parameters with the fewest and the most. The
  parameters of one run are hardly independent (one wrong mass scales most of them): over twenty robots the mean
  itself is good to 5 % or so.
- *largest error*: in reported standard deviations. *NEES*, *NIS*: 1 is right; that band takes parameters for
  independent in the metric of their covariance, as they are.
- *RMSE / bound*: over the root mean square of what is attainable, median over the parameters (worst). The bound is the
  filter's own posterior for exact data of the same robot, all windows linearised at the truth
  (`scripts/benchmarks/model_errors/bound.py`), with priors that are right.
- *draw / bound*: the same of the error that these robots make by themselves to first order, without noise, start or a
  point that moves: what of the ratio before is the luck of so few draws. 1 or a little less is expected.

`table1` is drawn in its plane, as a table keeps it there; in one row it is not.
"""

_LADDER = """
## One defect at a time, that nobody has told of

`{robot}`, one defect, drawn with the standard deviation at the head of the column in the unit of the row; everything
else is exact. Default parameters. Largest error of {seeds} runs in standard deviations, coverage, status at
the end. Where what the windows see of a kind (the zeros of all joints, say) is further off than declared, the intervals
allow for as much in what they do not see, and a warning names the parameter
([trajectory.md](trajectory.md#verdict-coreverdict), eq. 7).
"""

_WHEEL = """
## What has to be given

A base of {mass:g} kg with one flywheel, which turns about its own centre and moves no mass: no motion tells how heavy
the base is. The robot is drawn as above: its wheel is a little out of balance, which tells the mass to some percent. A
mass that is given is off by as much as is said of it. How well the CoM can be known is where the odometry is mounted
(2 mm), the inertia how well the wheel's is known (1 %).
"""

_BUDGET = """
## An error budget

Where the variance of each parameter comes from in one run of `{robot}`, with all blocks on (seed 0; causes that make
more than 1 % of any):
"""
