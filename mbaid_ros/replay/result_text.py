"""What a replay leads to in words: the verdict, and a table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.cli import one_line
from mbaid_ros.core.capture import Capture
from mbaid_ros.core.errors import listing
from mbaid_ros.core.results.estimate import WITHHELD, Estimate
from mbaid_ros.core.results.parameters import MAIN_CAUSES, PARAMETERS, UNCHECKED, UNITS, rounded
from mbaid_ros.messages import JOINT_MISSING
from mbaid_ros.replay.results import Run

_EVENTS = 5  # that a terminal shows


def texts(runs: Sequence[Run]) -> str:
    """Return the results for a terminal: what each run takes the robot for, where that is new, then its table."""
    parts = []
    for run, before in zip(runs, (None, *runs), strict=False):
        if run.survey is not None and (before is None or run.survey != before.survey):
            parts.append('\n'.join(map(one_line, run.survey.lines)))
        parts.append(summary(run))
    return '\n\n'.join(parts)


def summary(run: Run) -> str:
    """Return the result as a table for a terminal."""
    rows = [one_line(f'{run.bag}: {verdict(run)}'), '']
    for name, unit, value, std in zip(PARAMETERS, UNITS, run.final.parameters, run.final.std, strict=True):
        shown, band = rounded(value, std)
        spread = f' ± {band}' if band else ''
        rows.append(f'  {name:6} {shown:>13}{spread} {unit}' if shown else f'  {name:6} not determined')
    if run.capture is not None:
        rows += _captured(run.capture)
    label = '' if np.all(np.isnan(run.final.std)) else '; ± 95 %'
    rows += [f'  {run.final.samples} samples, {run.final.time:.3g} s, method {method(run.final)}{label}']
    if run.final.budget is not None and not run.contradicted:
        told = {MAIN_CAUSES: run.final.budget.told(run.final.std), UNCHECKED: run.final.budget.resting()}
        rows += [f'  {what}: {one_line(causes)}' for what, causes in told.items() if causes]
    rows += [f'  next: {run.advice}'] if run.advice else []
    rows += [] if run.final.noise is None else [f'  noise: {line}' for line in run.final.noise.told()]
    rows += [f'  {one_line(line)}' for line in (*happened(run), *likely_causes(run))]
    return '\n'.join([*rows, *(f'  warning: {one_line(warning)}' for warning in run.all_warnings)])


def happened(run: Run) -> list[str]:
    """Return what happened to momentum or target; data that contradict the model do not tell."""
    if run.contradicted:
        return []
    events = run.final.events
    told = [f'event: {event}' for event in events[:_EVENTS]]
    return told + ([f'and {len(events) - _EVENTS} more events'] if len(events) > _EVENTS else [])


def likely_causes(run: Run) -> list[str]:
    """Return what may be wrong where the data contradict the model; each would explain them by itself."""
    return [
        f'likely cause {place}: {cause} (alone, log-likelihood {gain:+.0f})'
        for place, (cause, gain) in enumerate(run.likeliest[:3], 1)
    ]


def _captured(capture: Capture) -> list[str]:
    """Return the captured body's own momentum, for a terminal."""
    rows = [f'  {capture.calibrated}'] if capture.calibrated else []
    rows.append(f'  captured at {capture.time:.6g} s; before that the captured body had')
    std = np.sqrt(np.diag(capture.covariance))
    for kind, part, unit in (('linear', slice(0, 3), 'N s'), ('angular', slice(3, 6), 'N m s')):
        values = ', '.join(map(_with_spread, capture.momentum[part], std[part]))
        rows.append(f'  {kind} momentum ({values}) {unit}')
    return rows


def _with_spread(value: float, std: float) -> str:
    shown, band = rounded(value, std, digits=4)
    return f'{shown} ± {band}' if band else shown or 'not determined'


def method(estimate: Estimate) -> str:
    """Return the method of an estimate, and the stage where that is another."""
    if estimate.stage in {'', estimate.method}:
        return estimate.method
    return f'{estimate.method} (stage {estimate.stage})'


def verdict(run: Run) -> str:
    """Return the result in one sentence."""
    missing = ', '.join(name for name, known in zip(PARAMETERS, run.final.identifiable, strict=True) if not known)
    rest = f'; not determined by this motion: {missing}' if missing else ''
    if run.final.status == 'inconsistent':
        why = 'robot description, noise values or conservation of momentum are not as assumed'
        return f'the data contradict the model, so the numbers of {run.target_link} must not be trusted: {why}'
    if not run.reached or run.phase != 'post_capture':
        return f'no estimate of {run.target_link}: {_why_none(run)}'
    if run.final.status == 'converged':
        return f'the inertia of {run.target_link} is identified{rest}'
    return f'the inertia of {run.target_link} is estimated, but the estimate has not converged{rest}'


def _why_none(run: Run) -> str:
    """Return why there is no estimate."""
    if run.phase != 'post_capture':
        told = f'capture.time puts it at {time:g} s' if (time := run.settings.get('capture.time')) else 'none was told'
        return f'the data end before the capture: {told}'
    if run.final.status == 'waiting':
        why = f'; {JOINT_MISSING}: {listing(run.missing_joints)}' if run.missing_joints else ''
        return f'the data hold no complete window{why}'
    return WITHHELD if run.contradicted else 'the motion does not determine any of its parameters'
