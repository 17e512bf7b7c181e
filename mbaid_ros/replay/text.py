"""A replay's result as text for a terminal, and its sentences, which the report shows, too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from mbaid_ros.cli import one_line
from mbaid_ros.config.estimator_parameters import ConvergenceConfig
from mbaid_ros.core.capture import Capture
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.method import FIRST_STAGE
from mbaid_ros.core.repair import Setting, leading_repair
from mbaid_ros.core.results.estimate import MAIN_CAUSES, PARAMETERS, UNITS, UNOBSERVABLE, WITHHELD, Estimate, rounded
from mbaid_ros.core.results.verdict import imprecise
from mbaid_ros.core.samples import JOINT_MISSING
from mbaid_ros.errors import listing
from mbaid_ros.replay.whole_run import Run
from mbaid_ros.session.repairing import admitted, obstacles

_NO_WINDOW = 'the data contain no complete window'
_EVENTS = 5  # that a terminal shows


def texts(runs: Sequence[Run]) -> str:
    """Return the results for a terminal: each model summary that is new, then each run's table."""
    parts = []
    for run, before in zip(runs, (None, *runs), strict=False):
        if run.model_summary is not None and (before is None or run.model_summary != before.model_summary):
            parts.append('\n'.join(map(one_line, run.model_summary.lines)))
        parts.append(summary(run))
    return '\n\n'.join(parts)


def summary(run: Run) -> str:
    """Return the result as a table for a terminal."""
    final = run.final
    rows = [one_line(f'{run.bag}: {verdict(run)}'), '']
    rows += _parameter_lines(final.parameters, final.std)
    rows += _debris_lines(run)
    if run.capture is not None:
        rows += _capture_lines(run.capture)
    label = '' if np.all(np.isnan(final.std)) else '; ± 95 %'
    rows.append(f'  {final.samples} samples, {final.time:.3g} s, method {method(final)}{label}')
    if final.budget is not None and not run.contradicted:
        budget = {MAIN_CAUSES: final.budget.main_causes(final.std), UNOBSERVABLE: final.budget.unobservable()}
        rows += [f'  {what}: {one_line(causes)}' for what, causes in budget.items() if causes]
    rows += [f'  assumed: {run.assumption}'] if run.assumption else []
    rows += [f'  next: {run.advice}'] if run.advice else []
    rows += [] if run.holdout is None else [f'  {run.holdout.sentence}']
    rows += [] if run.contradicted else [f'  passive joint: {one_line(str(joint))}' for joint in final.flexible]
    rows += [] if final.noise is None else [f'  noise: {line}' for line in final.noise.differences()]
    rows += [f'  {one_line(line)}' for line in (*_event_lines(run), *likely_causes(run), *offered_repair(run))]
    return '\n'.join([*rows, *(f'  warning: {one_line(warning)}' for warning in run.all_warnings)])


def _parameter_lines(parameters: Array, stds: Array) -> list[str]:
    lines = []
    for name, unit, value, std in zip(PARAMETERS, UNITS, parameters, stds, strict=True):
        shown, band = rounded(value, std)
        spread = f' ± {band}' if band else ''
        lines.append(f'  {name:6} {shown:>13}{spread} {unit}' if shown else f'  {name:6} not determined')
    return lines


def _debris_lines(run: Run) -> list[str]:
    """Return the captured body alone where it was asked for."""
    if run.debris is None:
        return ['  captured body alone: not determined'] if run.settings.get('debris.report') else []
    head = f"  captured body alone, in the frame of {one_line(run.target_link)}, less that link's <inertial>:"
    return [head, *_parameter_lines(run.debris.parameters, run.debris.std)]


def _event_lines(run: Run) -> list[str]:
    if run.contradicted:
        return []
    found = run.final.events
    lines = [f'event: {event}' for event in found[:_EVENTS]]
    return lines + ([f'and {len(found) - _EVENTS} more events'] if len(found) > _EVENTS else [])


def likely_causes(run: Run) -> list[str]:
    """Return the likely causes of a contradiction; each would explain the data by itself."""
    return [
        f'likely cause {place}: {cause} (alone, log-likelihood {gain:+.0f})'
        for place, (cause, gain) in enumerate(run.final.likely_causes[:3], 1)
    ]


def _capture_lines(capture: Capture) -> list[str]:
    rows = [f'  captured at {capture.time:.6g} s; before that the captured body had']
    std = np.sqrt(np.diag(capture.covariance))
    for kind, part, unit in (('linear', slice(0, 3), 'N s'), ('angular', slice(3, 6), 'N m s')):
        values = ', '.join(with_band(*pair, digits=4) for pair in zip(capture.momentum[part], std[part], strict=True))
        rows.append(f'  {kind} momentum ({values}) {unit}')
    if capture.tracked is not None:
        used, (misfit, numbers) = capture.tracked.flight.used, capture.misfit
        agreement = f'chi-square {misfit:.3g} of {numbers}' if numbers else 'left out'
        rows.append(f'  its motion by {used} poses, compared with conservation across the capture: {agreement}')
    return rows


def with_band(value: float, std: float, none: str = 'not determined', digits: int = 6) -> str:
    """Return a value with its 95 % band, as far as they are known."""
    shown, band = rounded(value, std, digits=digits)
    return f'{shown} ± {band}' if band else shown or none


def method(estimate: Estimate) -> str:
    """Return the method of an estimate, and the stage where that is another."""
    if estimate.stage in {'', estimate.method}:
        return estimate.method
    return f'{estimate.method} (stage {estimate.stage})'


def verdict(run: Run) -> str:
    """Return the result in one sentence, which begins with the repairs that it rests on."""
    repairs = run.final.repairs
    if not repairs:
        return _verdict(run)
    made = f'repaired: {"; ".join(f"{each.cause} ({each.how})" for each in repairs)}'
    return f'{made}; {"all the same, " if run.contradicted else ""}{_verdict(run)}'


def offered_repair(run: Run) -> list[str]:
    """Return that option --repair would take the leading cause into account, where it would."""
    leading = leading_repair(run.final.likely_causes, run.final.remedies)
    if leading is None:
        return []
    settings = cast('Mapping[str, Setting]', run.settings)
    found = admitted(leading, settings)
    if found is None or settings['repair'] or obstacles(settings):
        return []
    return [f'--repair takes the leading cause into account ({found.how}), and goes on']


def _verdict(run: Run) -> str:
    missing = ', '.join(name for name, known in zip(PARAMETERS, run.final.identifiable, strict=True) if not known)
    rest = f'; not determined by this motion: {missing}' if missing else ''
    if run.final.status == 'inconsistent':
        why = 'robot description, noise values or conservation of momentum are not as assumed'
        return f'the data contradict the model, so the numbers of {run.target_link} must not be trusted: {why}'
    if not run.reached or run.phase != 'post_capture':
        return f'no estimate of {run.target_link}: {_why_none(run)}'
    if run.final.status == 'converged':
        return f'the inertia of {run.target_link} is identified{rest}'
    limit = float(cast('float', run.settings.get('convergence.relative_std', ConvergenceConfig().relative_std)))
    wide = listing(imprecise(run.final, limit))
    return (
        f'the inertia of {run.target_link} is estimated; numbers and intervals are valid; '
        f'standard deviations above {100.0 * limit:.3g} %: {wide}{rest}'
    )


def _why_none(run: Run) -> str:
    if run.phase != 'post_capture':
        time = run.settings.get('capture.time')
        return 'the data end before the capture: capture.time ' + (f'puts it at {time:g} s' if time else 'is not given')
    if run.final.status == 'waiting':
        if run.missing_joints:
            return f'{_NO_WINDOW}; {JOINT_MISSING}: {listing(run.missing_joints)}'
        return next(iter(run.all_warnings), _NO_WINDOW)  # a window may have been there before the run started again
    if FIRST_STAGE in run.final.warnings:
        return FIRST_STAGE
    return WITHHELD if run.contradicted else 'the motion does not determine any of its parameters'
