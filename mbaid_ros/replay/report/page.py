"""The page of runs: verdict first, then the table, the curves, the data, the settings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.results.estimate import PARAMETERS, determined
from mbaid_ros.parameters import values_of
from mbaid_ros.replay import provenance
from mbaid_ros.replay.json_output import events
from mbaid_ros.replay.read_back import Truth
from mbaid_ros.replay.report import figures
from mbaid_ros.replay.report.markup import (
    NO_NUMBER,
    PLUS_MINUS,
    estimates,
    figure,
    folded,
    listed,
    number,
    page,
    paragraph,
    table,
    text,
)
from mbaid_ros.replay.report.tables import (
    MOMENTUM,
    MOMENTUM_UNITS,
    SHOWN_UNITS,
    before_the_capture,
    captured_body,
    error_budget,
    noise,
    sensors,
)
from mbaid_ros.replay.text import likely_causes, method, offered_repair, verdict
from mbaid_ros.replay.whole_run import Run

_GOOD = {'converged', 'estimating'}


def html(runs: Sequence[Run], truths: Sequence[Truth | None] = ()) -> str:
    """Return the page on one or several replays, with the truth of each run where it is known."""
    known = [*truths, *[None] * (len(runs) - len(truths))]
    sections = [
        f'<section class="run">{_section(run, truth, f"run {place}")}</section>'
        for place, (run, truth) in enumerate(zip(runs, known, strict=True))
    ]
    return page('Inertia identification', [*sections, _foot(runs)])


def _section(run: Run, truth: Truth | None, name: str) -> str:
    sentence = verdict(run)
    problem = '' if truth is None else truth.why_not(run.target_link)
    matching = None if problem else truth
    look = 'wrong' if run.contradicted else 'good' if run.reached and run.final.status in _GOOD else 'bad'
    parts = [
        f'<h2><code>{text(run.bag)}</code></h2>',
        '' if run.model_summary is None else listed(run.model_summary.lines, 'model'),
        paragraph(
            f'{sentence[0].upper()}{sentence[1:]}.{_disturbed(run)}{_accuracy(run, matching)}', f'verdict {look}'
        ),
        _causes(run),
        listed([*run.all_warnings, problem] if problem else run.all_warnings, 'warnings'),
        '<h3>Estimate</h3>',
        _parameters(run, matching),
        '' if run.holdout is None else paragraph(f'{run.holdout.sentence.capitalize()}.', 'sentence'),
        '' if run.contradicted else error_budget(run.final),
        paragraph(f'Assumed: {run.assumption}.', 'sentence') if run.assumption else '',
        paragraph(f'The motion that would help most: {run.advice}.', 'sentence') if run.advice else '',
        captured_body(run),
        before_the_capture(run),
        *_curves(run, matching, name),
        '<h3>What arrived</h3>',
        _data(run),
        noise(run.final.noise),
        sensors(run),
        '<h3>Settings</h3>',
        _settings(run),
    ]
    return '\n'.join(part for part in parts if part)


def _causes(run: Run) -> str:
    lines = [f'{line[0].upper()}{line[1:]}' for line in likely_causes(run)]
    if not lines:
        return ''
    words = 'Candidate causes, the likeliest first. Each is tried alone, so several may have one origin.'
    offer = ''.join(paragraph(f'Option {each}.', 'sentence') for each in offered_repair(run))
    return paragraph(words) + listed(lines, 'causes') + offer


def _disturbed(run: Run) -> str:
    """Return when the momentum changed; nothing if the data contradict the model."""
    times = '' if run.contradicted else ', '.join(f'{event.time:.4g} s' for event in run.final.events)
    return f' An external force changed the momentum: {times}.' if times else ''


def _accuracy(run: Run, truth: Truth | None) -> str:
    """Return how far from the truth the worst parameter is."""
    if truth is None or not run.reached or run.contradicted:
        return ''
    sigmas = np.abs(run.final.parameters - truth.parameters) / run.final.std
    if np.all(np.isnan(sigmas)):
        return ''
    worst = int(np.nanargmax(sigmas))
    name = PARAMETERS[worst]
    return f' Largest deviation from the truth beside the bag: {name}, {sigmas[worst]:.1f} standard deviations.'


def _parameters(run: Run, truth: Truth | None) -> str:
    final = run.final
    head = ['parameter', 'estimate', PLUS_MINUS, 'unit', 'identifiable']
    columns = estimates(PARAMETERS, final.parameters, final.std, SHOWN_UNITS)
    rows = [[*row, 'yes' if known else 'no'] for row, known in zip(columns, final.identifiable, strict=True)]
    if truth is not None:
        head += ['truth', 'error', 'error / std']
        for row, value, std, true in zip(rows, final.parameters, final.std, truth.parameters, strict=True):
            error = value - true
            row += [number(true), number(error, 2), f'{error / std:+.1f}' if np.isfinite(error / std) else NO_NUMBER]
    where = (
        f"Centre of mass in the frame of link '{run.target_link}', inertia about it in that link's axes. "
        f'{final.samples} samples over {final.time:.4g} s, method {method(final)}, status {final.status}.'
    )
    if run.contradicted:
        where = f'Do not use the numbers or the intervals. {where}'
    return table(head, rows, 'untrusted' if run.contradicted else '') + paragraph(where, 'note')


def _curves(run: Run, truth: Truth | None, name: str) -> list[str]:
    if len(run.history) < 2:
        return []
    parts = []
    if any(np.any(np.isfinite(estimate.parameters)) for estimate in run.history):
        caption = 'Shaded: 95 % band.' + (' Dotted: truth.' if truth is not None else '')
        parts += ['<h3>Convergence</h3>', figure(figures.convergence(run, truth, name), caption)]
    if momentum := figures.momentum(run, truth, name):
        caption = 'Odometry frame; angular momentum about its origin. Shaded: 95 % band.' if run.reached else ''
        title = 'Total momentum and residual' if run.reached else 'Residual'
        parts += [f'<h3>{title}</h3>', figure(momentum, caption), _momentum(run) if run.reached else '', _events(run)]
    if swing := figures.swing(run, name):
        caption = 'From the least to the highest deflection in each window, as estimated then.'
        parts += ['<h3>Passive joints</h3>', figure(swing, caption)]
    caption = 'Filled: the data so far determine the parameter.'
    return [*parts, '<h3>Identifiability</h3>', figure(figures.identifiability(run, name), caption)]


def _momentum(run: Run) -> str:
    values, stds = run.final.momentum, np.sqrt(np.diag(run.final.momentum_covariance))
    known = np.concatenate([determined(values[part], stds[part]) for part in (slice(0, 3), slice(3, 6))])
    values, stds = np.where(known, values, np.nan), np.where(known, stds, np.nan)
    rows = estimates(MOMENTUM, values, stds, MOMENTUM_UNITS)
    return table(('momentum', 'estimate', PLUS_MINUS, 'unit'), rows)


def _events(run: Run) -> str:
    rows = [
        (f'{each["t"]:.4g}', each['kind'], _triple(each['linear']), _triple(each['angular']), each['cause'])
        for each in events(run)
    ]
    return table(('time [s]', 'event', 'linear [N s]', 'angular [N m s]', 'cause'), rows) if rows else ''


def _triple(values: Sequence[float | None]) -> str:
    return f'({", ".join(NO_NUMBER if value is None else f"{value:.3g}" for value in values)})'


def _data(run: Run) -> str:
    rows = [(each.topic, each.type, str(each.messages), number(each.rate, 4)) for each in run.topics]
    content = table(('topic', 'type', 'messages', 'rate [Hz]'), rows)
    content += paragraph(
        f'{run.used} joint states have odometry around them; {run.final.samples} of them are in the estimate.'
    )
    if not run.dropped:
        return content + paragraph('No message was dropped.')
    return content + table(
        ('not used because', 'messages'), [(cause, str(count)) for cause, count in run.dropped.items()]
    )


def _settings(run: Run) -> str:
    defaults = values_of(EstimatorConfig())
    rows: dict[bool, list[tuple[str, str]]] = {True: [], False: []}
    for name, value in run.settings.items():
        shown = ', '.join(map(str, value)) if isinstance(value, tuple) else str(value)
        rows[value == defaults.get(name)].append((name, shown))
    head = ('parameter', 'value')
    content = table(head, rows[False]) if rows[False] else paragraph('Every parameter has its default value.')
    if not rows[True]:
        return content
    return content + folded(f'{len(rows[True])} parameters with their defaults', table(head, rows[True]))


def _foot(runs: Sequence[Run]) -> str:
    """Return the packages, the command and the files that made the page."""
    lines = [f'Made by {", ".join(f"{name} {version}" for name, version in provenance.versions())}.']
    lines += dict.fromkeys(line for run in runs if run.made_by for line in provenance.in_words(run.made_by))
    lines += [line for run in runs for line in provenance.files_in_words(run.bag, run.files)]
    return f'<footer>{"".join(paragraph(line, "note") for line in lines)}</footer>'
