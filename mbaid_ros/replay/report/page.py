"""The page: verdict first, then the table, the courses, the robot, the data, the settings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros import limits
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import values_of
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.core.results.estimate import determined
from mbaid_ros.core.results.parameters import PARAMETERS, rounded
from mbaid_ros.replay import provenance
from mbaid_ros.replay.report import budget, figures, noise
from mbaid_ros.replay.report.captured import MOMENTUM, MOMENTUM_UNITS, before_the_capture, captured_body
from mbaid_ros.replay.report.comparison import comparison
from mbaid_ros.replay.report.drawing import drawing
from mbaid_ros.replay.report.markup import NO_NUMBER, PLUS_MINUS, STYLE, figure, listed, number, paragraph, table, text
from mbaid_ros.replay.report.scene import scene
from mbaid_ros.replay.result_json import events
from mbaid_ros.replay.result_text import likely_causes, method, verdict
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.truth import Truth
from mbaid_ros.replay.versions import versions

_GOOD = {'converged', 'estimating'}


def html(runs: Sequence[Run], truths: Sequence[Truth | None] = ()) -> str:
    """Return the page on one or several replays.

    Parameters
    ----------
    runs : in the order they are to be shown
    truths : of each run, where it is known
    """
    known = [*truths, *[None] * (len(runs) - len(truths))]
    sections = [
        f'<section class="run">{_section(run, truth, f"run {place}")}</section>'
        for place, (run, truth) in enumerate(zip(runs, known, strict=True))
    ]
    if len(runs) > 1:
        sections.insert(0, comparison(runs, known))
    body = '\n'.join(sections)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>Inertia identification</title>\n<style>{STYLE}{budget.STYLE}</style>\n</head>\n'
        f'<body>\n<h1>Inertia identification</h1>\n{body}\n{_foot(runs)}\n</body>\n</html>\n'
    )


def _section(run: Run, truth: Truth | None, name: str) -> str:
    sentence = verdict(run)
    matching = truth if truth is not None and not truth.why_not(run.target_link) else None
    parts = [
        f'<h2><code>{text(run.bag)}</code></h2>',
        '' if run.survey is None else listed(run.survey.lines, 'model'),
        paragraph(
            f'{sentence[0].upper()}{sentence[1:]}.{_disturbed(run)}{_accuracy(run, matching)}',
            f'verdict {_look(run)}',
        ),
        _causes(run),
        listed(_notes(run, truth), 'warnings'),
        '<h3>Estimate</h3>',
        _parameters(run, matching),
        '' if run.contradicted else budget.section(run.final),
        paragraph(f'What motion would help most: {run.advice}.', 'told') if run.advice else '',
        captured_body(run),
        before_the_capture(run),
        *_courses(run, matching, name),
        '<h3>The robot in its last pose</h3>',
        _robot(run, name),
        '<h3>What arrived</h3>',
        _data(run, name),
        noise.section(run.final.noise),
        '<h3>Settings</h3>',
        _settings(run),
    ]
    return '\n'.join(part for part in parts if part)


def _causes(run: Run) -> str:
    """Return what may be wrong: not all of it, but one or another."""
    if not run.likeliest:
        return ''
    words = 'What may be wrong, the likeliest first. Each is tried alone, so that several may be faces of one mistake.'
    return paragraph(words) + listed([f'{line[0].upper()}{line[1:]}' for line in likely_causes(run)], 'causes')


def _look(run: Run) -> str:
    """Return the look of the verdict on a run."""
    if run.contradicted:
        return 'wrong'
    return 'good' if run.reached and run.final.status in _GOOD else 'bad'


def _disturbed(run: Run) -> str:
    """Return when something changed the momentum; data that contradict the model do not tell."""
    if run.contradicted:
        return ''
    times = ', '.join(f'{event.time:.4g} s' for event in run.final.events)
    return f' The momentum was changed from outside: {times}.' if times else ''


def _accuracy(run: Run, truth: Truth | None) -> str:
    """Return how far from the truth the worst parameter is."""
    if truth is None or not run.reached or run.contradicted:
        return ''
    error = np.abs(run.final.parameters - truth.parameters)
    sigmas = error / run.final.std
    if np.all(np.isnan(sigmas)):
        return ''
    worst = int(np.nanargmax(sigmas))
    name = PARAMETERS[worst]
    return f' Furthest from the truth that came with the bag is {name}, by {sigmas[worst]:.1f} standard deviations.'


def _notes(run: Run, truth: Truth | None) -> list[str]:
    problem = '' if truth is None else truth.why_not(run.target_link)
    return [*run.all_warnings, problem] if problem else run.all_warnings


def _parameters(run: Run, truth: Truth | None) -> str:
    final = run.final
    head = ['parameter', 'estimate', PLUS_MINUS, 'unit', 'identifiable']
    rows = [
        [parameter, *rounded(value, std, NO_NUMBER), unit, 'yes' if known else 'no']
        for parameter, unit, value, std, known in zip(
            PARAMETERS, figures.SHOWN_UNITS, final.parameters, final.std, final.identifiable, strict=True
        )
    ]
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
        where = f'Not to be trusted, nor are the intervals. {where}'
    return table(head, rows, 'untrusted' if run.contradicted else '') + paragraph(where, 'note')


def _courses(run: Run, truth: Truth | None, name: str) -> list[str]:
    if len(run.history) < 2:
        return []
    parts = []
    if any(np.any(np.isfinite(estimate.parameters)) for estimate in run.history):
        caption = 'Shaded: 95 % band.' + (' Dotted: truth.' if truth is not None else '')
        parts += ['<h3>Convergence</h3>', figure(figures.convergence(run, truth, name), caption)]
    momentum = figures.momentum(run, truth, name)
    if momentum:
        caption = 'In the odometry frame, angular about its origin. Shaded: 95 % band.' if run.reached else ''
        parts += [
            f'<h3>{"Total momentum and residual" if run.reached else "Residual"}</h3>',
            figure(momentum, caption),
            _momentum(run) if run.reached else '',
            _events(run),
        ]
    caption = 'Filled: the data so far determine the parameter.'
    return [*parts, '<h3>Identifiability</h3>', figure(figures.identifiability(run, name), caption)]


def _momentum(run: Run) -> str:
    values, stds = run.final.momentum, np.sqrt(np.diag(run.final.momentum_covariance))
    known = np.concatenate([determined(values[part], stds[part]) for part in (slice(0, 3), slice(3, 6))])
    values, stds = np.where(known, values, np.nan), np.where(known, stds, np.nan)
    rows = [
        (name, *rounded(value, std, NO_NUMBER), unit)
        for name, unit, value, std in zip(MOMENTUM, MOMENTUM_UNITS, values, stds, strict=True)
    ]
    return table(('momentum', 'estimate', PLUS_MINUS, 'unit'), rows)


def _events(run: Run) -> str:
    rows = [
        (
            f'{event["t"]:.4g}',
            str(event['kind']),
            _triple(event['linear']),
            _triple(event['angular']),
            str(event['cause']),
        )
        for event in events(run)
    ]
    return table(('time [s]', 'event', 'linear [N s]', 'angular [N m s]', 'cause'), rows) if rows else ''


def _triple(values: Sequence[float | None]) -> str:
    return f'({", ".join(NO_NUMBER if value is None else f"{value:.3g}" for value in values)})'


def _robot(run: Run, name: str) -> str:
    try:
        found = scene(run)
    except MbaidError as error:
        return paragraph(f'Not drawn: {error}', 'note')
    if found is None:
        return paragraph('Not drawn: the bag holds no pose that can be read.', 'note')
    body = found.body
    caption = 'In odometry axes, the origin in the base link. '
    if body is None:
        caption += f"The centre of mass of '{run.target_link}' is not known."
    elif body.complete:
        caption += 'Cross: centre of mass with its 95 % region. Ellipsoid: the uniform body of the same inertia.'
    else:
        caption += 'Cross: centre of mass, a coordinate that is not known drawn as 0. Circle: radius of gyration.'
    if not found.solids:
        caption += ' The robot description holds no boxes, cylinders or spheres to draw; meshes are left out.'
    elif len(found.solids) == limits.SHAPES_DRAWN:
        caption += f' Of the shapes in the robot description, at most {limits.SHAPES_DRAWN} are drawn.'
    return figure(drawing(found, name), caption)


def _data(run: Run, name: str) -> str:
    topics = [
        (
            topic.topic,
            topic.type,
            str(topic.messages),
            number(topic.rate, 4),
            str(len(topic.gaps)),
            _longest(topic.gaps),
        )
        for topic in run.topics
    ]
    content = table(('topic', 'type', 'messages', 'rate [Hz]', 'gaps', 'longest gap'), topics)
    drawn = figures.arrival(run, name)
    content += figure(drawn) if drawn else ''
    content += paragraph(
        f'{run.used} joint states have odometry around them; {run.final.samples} of them are in the estimate.'
    )
    if run.dropped:
        rows = [(cause, str(count)) for cause, count in run.dropped.items()]
        return content + table(('not used because', 'messages'), rows)
    return content + paragraph('No message was dropped.')


def _longest(gaps: Sequence[tuple[float, float]]) -> str:
    if not gaps:
        return NO_NUMBER
    begin, length = max(gaps, key=lambda gap: gap[1])
    return f'{length:.3g} s at {begin:.4g} s'


def _settings(run: Run) -> str:
    defaults = values_of(EstimatorConfig())
    changed = [(name, _shown(value)) for name, value in run.settings.items() if value != defaults.get(name)]
    same = [(name, _shown(value)) for name, value in run.settings.items() if value == defaults.get(name)]
    head = ('parameter', 'value')
    content = table(head, changed) if changed else paragraph('Every parameter has its default value.')
    if same:
        content += (
            f'<details><summary>{len(same)} parameters with their defaults</summary>{table(head, same)}</details>'
        )
    return content


def _shown(value: object) -> str:
    return ', '.join(map(str, value)) if isinstance(value, tuple) else str(value)


def _foot(runs: Sequence[Run]) -> str:
    """Return what made the page: the packages, the command, the files."""
    made = dict.fromkeys(run.made_by for run in runs if run.made_by is not None)
    lines = [f'Made by {", ".join(f"{name} {number}" for name, number in versions())}.']
    lines += [line for each in made for line in provenance.in_words(each)]
    lines += [line for run in runs for line in provenance.files_in_words(run.bag, run.files)]
    return f'<footer>{"".join(paragraph(line, "note") for line in lines)}</footer>'
