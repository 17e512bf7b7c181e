"""Statistics of many runs: how large errors are, and whether the reported uncertainties are right."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri, ndtri

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PARAMETERS, UNITS, Estimate
from mbaid_ros.replay.json_output import plain, shaped, shaped_std

# The result of a run: plain numbers, texts, lists and dictionaries, as JSON has them.
Result = dict[str, Any]
FAILED = 'failed'  # status of a run without a result
BAND = 0.95
QUANTILE = float(ndtri(0.5 * (1.0 + BAND)))  # standard deviations either side that contain 95 %
_REASONS = 5  # failed runs that the text names


def mean(values: Array) -> Array:
    """Return the means over the runs, the first axis, without NaN; NaN where there is nothing else."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # a column of nothing but NaN
        return np.asarray(np.nanmean(values, axis=0)) if len(values) else np.full(values.shape[1:], np.nan)


def rmse(error: Array) -> Array:
    """Return the root mean square over the runs, the first axis, of errors that are no NaN."""
    return np.sqrt(mean(error**2))


def coverage(error: Array, std: Array) -> Array:
    """Return the share of the runs, the first axis, with the truth within the 95 % interval, where there is one."""
    known = np.isfinite(error) & np.isfinite(std)
    return mean(np.where(known, np.abs(error) < QUANTILE * std, np.nan))


def nees(estimate: Estimate, truth: Array) -> float:
    """Return the normalised estimation error squared against the truth (10,), a determined parameter: 1 is expected."""
    known = np.isfinite(estimate.std) & np.isfinite(estimate.parameters)
    if not np.any(known):
        return np.nan
    deviation = estimate.std[known]
    error = (estimate.parameters - truth)[known] / deviation
    correlation = estimate.covariance[np.ix_(known, known)] / deviation / deviation[:, None]
    return float(error @ np.linalg.solve(correlation, error)) / len(error)


def nees_band(freedom: int) -> tuple[float, float]:
    """Return the interval of 95 % of the mean NEES of right covariances, of so many determined parameters in all."""
    # chdtri: quantiles of the chi-square distribution from above.
    tails = (0.5 * (1.0 + BAND), 0.5 * (1.0 - BAND))
    low, high = (float(chdtri(freedom, tail)) / freedom if freedom else np.nan for tail in tails)
    return low, high


@dataclass(frozen=True)
class CaseStatistics:
    """One case over all its seeds and motions."""

    name: str  # of each group of the campaign
    choices: Mapping[str, str]  # of each group of the campaign
    statuses: Mapping[str, int]  # number of runs that ended with each
    rmse: Array  # (10,) root mean square error in the order of PARAMETERS; NaN where no run determined it
    mean_std: Array  # (10,) mean of the reported standard deviations
    inside: Array  # (10,) share of the runs with the truth inside the reported 95 % interval
    determined: Array  # (10,) share of the runs in which the parameter was determined
    nees: float  # mean over the runs of `nees`
    nees_band: tuple[float, float]  # of such means


def statistics(results: Iterable[Result]) -> list[CaseStatistics]:
    """Return the statistics of every case, in the order in which they first occur."""
    by_case: dict[str, list[Result]] = {}
    for result in results:
        name = ' '.join(f'{group}={choice}' for group, choice in result['case'].items()) or 'all runs'
        # Of each result only what counts: together they may not fit in memory.
        kept: Result = {key: result[key] for key in ('case', 'status', 'nees') if key in result}
        kept['numbers'] = np.array([_ten(result.get(key)) for key in ('estimate', 'truth', 'std')])
        by_case.setdefault(name, []).append(kept)
    return [_case(name, own) for name, own in by_case.items()]


def _case(name: str, results: Sequence[Result]) -> CaseStatistics:
    made = [result for result in results if result['status'] != FAILED]
    estimate, truth, std = np.array([result['numbers'] for result in made]).reshape(-1, 3, 10).swapaxes(0, 1)
    squared = np.array([result['nees'] for result in made if result['nees'] is not None])
    error = estimate - truth
    return CaseStatistics(
        name=name,
        choices=results[0]['case'],
        statuses=dict(sorted(Counter(result['status'] for result in results).items())),
        rmse=rmse(error),
        mean_std=mean(std),
        inside=coverage(error, std),
        determined=mean(np.isfinite(estimate) * 1.0),
        nees=float(np.mean(squared)) if len(squared) else np.nan,
        nees_band=nees_band(int(np.sum(np.isfinite(estimate) & np.isfinite(std)))),
    )


def _ten(values: Mapping[str, Any] | None) -> Array:
    """Return mass, com and inertia as (10,), NaN where there is none."""
    if values is None:
        return np.full(10, np.nan)
    ten = (values['mass'], *values['com'], *(values['inertia'][name] for name in PARAMETERS[4:]))
    return np.array(ten, dtype=float)


def as_json(cases: Sequence[CaseStatistics], results: Iterable[Result]) -> dict[str, Any]:
    """Return the statistics as scripts read them; None for unknown values."""
    return {
        'runs': _count(cases),
        'inconsistent': _count(cases, 'inconsistent'),
        'failed': [{'run': result['run'], 'reason': result['reason']} for result in _failed(results)],
        'cases': [
            {
                'case': dict(case.choices),
                'statuses': dict(case.statuses),
                'rmse': shaped_std(case.rmse),
                'mean_std': shaped_std(case.mean_std),
                'inside_95': shaped_std(case.inside),
                'determined': shaped(case.determined),
                'nees': plain(case.nees),
                'nees_band_95': plain(case.nees_band),
            }
            for case in cases
        ],
    }


def table(cases: Sequence[CaseStatistics], results: Iterable[Result]) -> str:
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
    failed = _failed(results)
    rows += ['', f'{_count(cases)} runs, {len(failed)} of them failed, {_count(cases, "inconsistent")} inconsistent']
    rows += [f'  run {result["run"]}: {result["reason"]}' for result in failed[:_REASONS]]
    if len(failed) > _REASONS:
        rows.append(f'  ... ({len(failed) - _REASONS} more)')
    return '\n'.join(rows[1:])


def _row(case: CaseStatistics, index: int) -> str:
    mean_std, inside = case.mean_std[index], 100.0 * case.inside[index]
    std = f'{mean_std:.3g}' if np.isfinite(mean_std) else '-'
    percent = f'{inside:.1f} %' if np.isfinite(inside) else '-'
    share = f'{100.0 * case.determined[index]:.1f} %'
    return f'  {PARAMETERS[index]:6} {case.rmse[index]:>10.3g} {std:>10} {percent:>12} {share:>11}  {UNITS[index]}'


def _count(cases: Sequence[CaseStatistics], status: str = '') -> int:
    """Return how many runs ended with a status; all of them by default."""
    return sum(count for case in cases for name, count in case.statuses.items() if name == (status or name))


def _failed(results: Iterable[Result]) -> list[Result]:
    return [result for result in results if result['status'] == FAILED]
