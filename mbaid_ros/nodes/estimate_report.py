"""What the estimator says in /diagnostics of its estimate: the numbers, how good they are, and what may be wrong."""

from __future__ import annotations

from collections.abc import Sequence

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.budget import MAIN_CAUSES, UNCHECKED
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS, UNITS
from mbaid_ros.core.results.rounding import rounded
from mbaid_ros.core.sensor_levels import SensorLevels
from mbaid_ros.nodes.sample_report import ERROR, OK, STALE, WARN, Report, Values
from mbaid_ros.nodes.state import State
from mbaid_ros.nodes.terminal import NEXT

_CAUSES = 3  # that are told

_LEVEL_OF_STATUS = {
    'waiting': WARN,
    'estimating': OK,
    'converged': OK,
    'not_identifiable': WARN,
    'inconsistent': ERROR,
}


def estimate_report(state: State) -> Report:
    """Return what is to be told of the last estimate."""
    estimate = state.estimate
    if estimate is None:
        return WARN, f'waiting: {state.halted.partition(":")[0]}' if state.halted else 'waiting', []
    causes = [cause for cause, _ in estimate.likely_causes[:_CAUSES]]
    values: Values = [
        ('stale', bool(state.stale)),
        ('method', estimate.method),
        ('stage', estimate.stage),
        ('phase', state.session.robot.phase if state.session else ''),
        ('known bodies', (state.session.robot.calibrated if state.session else '') or 'as in the robot description'),
        ('time (s)', f'{estimate.time:.3f}'),
        ('samples', estimate.samples),
        ('residual', f'{estimate.residual:.3g}'),
        ('identifiable', listing(name for name, known in zip(PARAMETERS, estimate.identifiable, strict=True) if known)),
        *_parameters(estimate),
        *((f'likely cause {index + 1}', cause) for index, cause in enumerate(causes)),
        (NEXT, state.advice),
        *_plan(state),
        (MAIN_CAUSES, '' if estimate.budget is None else estimate.budget.told(estimate.std)),
        (UNCHECKED, '' if estimate.budget is None else estimate.budget.resting()),
        ('linear momentum (N s)', numbers(estimate.momentum[:3])),
        ('angular momentum (N m s)', numbers(estimate.momentum[3:])),
        *_noise(estimate.noise),
        *((f'warning {index + 1}', warning) for index, warning in enumerate(estimate.warnings)),
    ]
    level = _LEVEL_OF_STATUS[estimate.status]
    text = estimate.status.replace('_', ' ')
    if estimate.warnings:
        text = f'{text}: likely cause: {causes[0]}' if causes else f'{text}: {estimate.warnings[0]}'
        level = max(level, WARN)
    if state.stale:
        return STALE, f'{text}; stale: {state.stale}', values
    return level, text, values


def _plan(state: State) -> Values:
    """Return what the motion on ~/motion comes to."""
    if state.plan is None:
        return []
    reached, verdict = state.plan
    return [('plan reaches what is wanted', reached), ('plan', verdict)]


def _noise(levels: SensorLevels | None) -> Values:
    """Return how noisy each sensor is declared to be, and how noisy its readings are."""
    if levels is None:
        return []
    return [(f'noise of {name} ({unit})', text) for name, unit, text in levels.shown()]


def _parameters(estimate: Estimate) -> Values:
    rows: Values = []
    for name, unit, value, std in zip(PARAMETERS, UNITS, estimate.parameters, estimate.std, strict=True):
        shown, band = rounded(value, std)
        spread = f' +- {band} (95 %)' if band else ''
        rows.append((f'{name} ({unit})', f'{shown}{spread}' if shown else 'not determined'))
    return rows


def numbers(values: Sequence[float] | Array) -> str:
    """Return numbers as they are told, apart from each other by a space."""
    return ' '.join(f'{value:.6g}' for value in values)
