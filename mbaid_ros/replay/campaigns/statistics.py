"""What the runs of a campaign say together, case by case."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS, UNITS
from mbaid_ros.replay.campaigns.make import FAILED, Result
from mbaid_ros.replay.campaigns.monte_carlo import coverage, mean, nees_band, rmse
from mbaid_ros.replay.campaigns.then import ThenStatistics
from mbaid_ros.replay.jsonable import number, numbers, shaped, shaped_std

_REASONS = 5  # failed runs that the text names


@dataclass(frozen=True)
class CaseStatistics:
    """One case over all its seeds and motions.

    Attributes
    ----------
    name : its choices
    choices : of each group of the campaign
    statuses : number of runs that ended with each
    rmse : (10,) root mean square error in the order of PARAMETERS; NaN where no run determined it
    mean_std : (10,) mean of the reported standard deviations
    inside : (10,) share of the runs with the truth inside the reported 95 % interval
    determined : (10,) share of the runs in which the parameter was determined
    nees : mean over the runs of the squared error in the metric of the covariance, a parameter: 1 is expected
    nees_band : that 95 % of such means lie in if the covariance is right
    then : medians of what the motions that follow come to; None where none does
    """

    name: str
    choices: Mapping[str, str]
    statuses: Mapping[str, int]
    rmse: Array
    mean_std: Array
    inside: Array
    determined: Array
    nees: float
    nees_band: tuple[float, float]
    then: ThenStatistics | None = None


def statistics(results: Sequence[Result]) -> list[CaseStatistics]:
    """Return the statistics of every case, in the order in which they first occur."""
    by_case: dict[str, list[Result]] = {}
    for result in results:
        name = ' '.join(f'{group}={choice}' for group, choice in result['case'].items()) or 'all runs'
        by_case.setdefault(name, []).append(result)
    return [_case(name, own) for name, own in by_case.items()]


def _case(name: str, results: Sequence[Result]) -> CaseStatistics:
    made = [result for result in results if result['status'] != FAILED]
    estimate, truth, std = (np.array([_ten(result[key]) for result in made]).reshape(-1, 10) for key in _VALUES)
    nees = np.array([result['nees'] for result in made if result['nees'] is not None])
    error = estimate - truth
    return CaseStatistics(
        name=name,
        choices=results[0]['case'],
        statuses=dict(sorted(Counter(result['status'] for result in results).items())),
        rmse=rmse(error),
        mean_std=mean(std),
        inside=coverage(error, std),
        determined=mean(np.isfinite(estimate) * 1.0),
        nees=float(np.mean(nees)) if len(nees) else np.nan,
        nees_band=nees_band(int(np.sum(np.isfinite(estimate) & np.isfinite(std)))),
        then=ThenStatistics.of([result['then'] for result in made if 'then' in result]),
    )


_VALUES = ('estimate', 'truth', 'std')


def _ten(values: Mapping[str, Any] | None) -> Array:
    """Return mass, com and inertia as (10,), NaN where there is none."""
    if values is None:
        return np.full(10, np.nan)
    ten = (values['mass'], *values['com'], *(values['inertia'][name] for name in PARAMETERS[4:]))
    return np.array(ten, dtype=float)


def as_json(cases: Sequence[CaseStatistics], results: Sequence[Result]) -> dict[str, Any]:
    """Return the statistics as scripts read them; what is not known is None."""
    return {
        'runs': len(results),
        'inconsistent': _inconsistent(results),
        'failed': [{'run': result['run'], 'reason': result['reason']} for result in _failed(results)],
        'cases': [
            {
                'case': dict(case.choices),
                'statuses': dict(case.statuses),
                'rmse': shaped_std(case.rmse),
                'mean_std': shaped_std(case.mean_std),
                'inside_95': shaped_std(case.inside),
                'determined': shaped(numbers(case.determined)),
                'nees': number(case.nees),
                'nees_band_95': [number(limit) for limit in case.nees_band],
                **({} if case.then is None else {'then': case.then.as_json()}),
            }
            for case in cases
        ],
    }


def table(cases: Sequence[CaseStatistics], results: Sequence[Result]) -> str:
    """Return the statistics for a terminal."""
    rows = []
    for case in cases:
        statuses = ', '.join(f'{count} {status}' for status, count in case.statuses.items())
        rows += ['', f'{case.name}: {sum(case.statuses.values())} runs, {statuses}']
        known = np.flatnonzero(np.isfinite(case.rmse))
        if len(known):
            rows.append(f'  {"":6} {"RMSE":>10} {"mean std":>10} {"inside 95 %":>12} {"determined":>11}')
        rows += [_row(case, index) for index in known]
        if np.isfinite(case.nees):
            low, high = case.nees_band
            rows.append(f'  NEES a parameter {case.nees:.3g}; {low:.3g} to {high:.3g} if the covariance is right')
        if case.then is not None:
            rows.append(f'  {case.then}')
    failed = _failed(results)
    rows += ['', f'{len(results)} runs, {len(failed)} of them failed, {_inconsistent(results)} inconsistent']
    rows += [f'  run {result["run"]}: {result["reason"]}' for result in failed[:_REASONS]]
    if len(failed) > _REASONS:
        rows.append(f'  ... ({len(failed) - _REASONS} more)')
    return '\n'.join(rows[1:])


def _row(case: CaseStatistics, index: int) -> str:
    std, inside = (
        f'{value:{form}}' if np.isfinite(value) else '-'
        for value, form in ((case.mean_std[index], '.3g'), (100.0 * case.inside[index], '.1f'))
    )
    share = f'{100.0 * case.determined[index]:.1f} %'
    percent = f'{inside} %' if inside != '-' else inside
    return f'  {PARAMETERS[index]:6} {case.rmse[index]:>10.3g} {std:>10} {percent:>12} {share:>11}  {UNITS[index]}'


def _inconsistent(results: Sequence[Result]) -> int:
    """Return the number of runs whose data contradict the model."""
    return sum(result['status'] == 'inconsistent' for result in results)


def _failed(results: Sequence[Result]) -> list[Result]:
    return [result for result in results if result['status'] == FAILED]
