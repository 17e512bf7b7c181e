"""Sections of a run's page: the error budget, noise, the captured body, and the capture."""

from __future__ import annotations

import math

import numpy as np

from mbaid_ros.core.contracts import remedy_text
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.noise import CHANNELS, NoiseLevels
from mbaid_ros.core.noise import UNITS as CHANNEL_UNITS
from mbaid_ros.core.results.estimate import PARAMETERS, SENSOR_NOISE, UNITS, ErrorBudget, Estimate, percent, short
from mbaid_ros.errors import listing
from mbaid_ros.replay.report.markup import PLUS_MINUS, estimates, folded, listed, number, paragraph, table, text
from mbaid_ros.replay.whole_run import Run

SHOWN_UNITS = tuple(unit.replace('^2', '\N{SUPERSCRIPT TWO}') for unit in UNITS)
MOMENTUM = ('linear x', 'linear y', 'linear z', 'angular x', 'angular y', 'angular z')
MOMENTUM_UNITS = (*('N s',) * 3, *('N m s',) * 3)
_MOTION = ('velocity x', 'velocity y', 'velocity z', 'spin x', 'spin y', 'spin z')
_MOTION_UNITS = (*('m/s',) * 3, *('rad/s',) * 3)

_OTHERS = 'all others'
_NAMED = 6  # causes beside sensor noise that have a colour of their own in the style of the page
_LEAST = 0.01  # share of any parameter, for a cause to be named
_SEVERAL = 2  # sensors, that are compared
_ROOM = 0.05  # share that a number fits into
# More data help little where ten times as many leave this much of the standard deviation.
_TIMES, _LITTLE = 10, 0.7


def error_budget(final: Estimate) -> str:
    """Return a stacked bar a parameter, the figures, and remedies; empty if there is no budget."""
    budget = final.budget
    if budget is None:
        return ''
    known = np.all(np.isfinite(budget.shares), axis=1)
    if not known.any():
        return ''
    ordered = _ordered(budget)
    sentences = [paragraph(sentence, 'sentence') for sentence in _sentences(budget, final.std)]
    if not ordered:
        return ''.join(('<h3>Error budget</h3>', paragraph('All of the variance is sensor noise.'), *sentences))
    labels, shares = _shown(budget, ordered[:_NAMED])
    words = 'The variance of each parameter by source: sensor noise, and the uncertain parts of the robot.'
    parts = ['<h3>Error budget</h3>', paragraph(words), _bars(labels, shares, known), _key(labels), *sentences]
    parts.append(_figures(labels, shares, known))
    if len(ordered) > _NAMED:
        every = _figures([short(budget.causes[place]) for place in ordered], budget.shares[:, ordered], known)
        parts.append(folded(f'All {len(ordered)} causes of {percent(_LEAST)} or more', every))
    return ''.join(parts)


def _ordered(budget: ErrorBudget) -> list[int]:
    """Return the places of the causes beside sensor noise, those that make most of any parameter first."""
    largest = np.max(np.nan_to_num(budget.shares), axis=0)
    largest[budget.causes.index(SENSOR_NOISE)] = 0.0
    return [int(place) for place in np.argsort(-largest, kind='stable') if largest[place] >= _LEAST]


def _shown(budget: ErrorBudget, named: list[int]) -> tuple[list[str], Array]:
    """Return labels and (10, l) shares: sensor noise, the causes named, and all others."""
    places = [budget.causes.index(SENSOR_NOISE), *named]
    shares = np.maximum(budget.shares[:, places], 0.0)
    rest = np.maximum(1.0 - shares.sum(axis=1), 0.0)
    labels = [SENSOR_NOISE, *(f'{place} {short(budget.causes[cause])}' for place, cause in enumerate(named, 1))]
    return [*labels, _OTHERS], np.column_stack((shares, rest))


def _class(place: int, labels: list[str]) -> str:
    return {0: 'noise', len(labels) - 1: 'others'}.get(place, f'cause{place}')


def _bars(labels: list[str], shares: Array, known: Array) -> str:
    """Return the bars; beside its colour a cause has a number."""
    rows = []
    for name, row in zip(np.array(PARAMETERS)[known], shares[known], strict=True):
        parts = [
            f'<i class="{_class(place, labels)}" style="width:{100.0 * share:.2f}%">'
            f'{place if 0 < place < len(labels) - 1 and share >= _ROOM else ""}</i>'
            for place, share in enumerate(row)
            if share > 0.0
        ]
        words = ', '.join(
            f'{label} {percent(share)}' for label, share in zip(labels, row, strict=True) if share >= _LEAST
        )
        bar = f'<div class="bar" role="img" aria-label="{text(f"{name}: {words}")}">{"".join(parts)}</div>'
        rows.append(f'<span>{name}</span>{bar}')
    return f'<div class="budget">{"".join(rows)}</div>'


def _key(labels: list[str]) -> str:
    entries = []
    for place, label in enumerate(labels):
        mark, _, name = label.partition(' ') if 0 < place < len(labels) - 1 else ('', '', label)
        entries.append(f'<li><i class="{_class(place, labels)}">{mark}</i><span>{text(name)}</span></li>')
    return f'<ul class="key">{"".join(entries)}</ul>'


def _figures(labels: list[str], shares: Array, known: Array) -> str:
    """Return the figures: a row a cause, a column a parameter that is determined, per cent."""
    rows = [
        [label, *(f'{100.0 * share:.1f}' for share in column)]
        for label, column in zip(labels, shares[known].T, strict=True)
    ]
    return f'<div class="shares">{table(("share [%]", *np.array(PARAMETERS)[known].tolist()), rows)}</div>'


def _sentences(budget: ErrorBudget, std: Array) -> list[str]:
    """Return the dominant causes in words, and which parameters more data would not improve."""
    sentences = []
    for cause, groups in budget.dominant(std).items():
        names = _joined(list(groups))
        shares = _joined([percent(share) for share in groups.values()])
        sentences.append(f'{names[0].upper()}{names[1:]}: {shares} of the variance is due to {remedy_text(cause)}.')
    if unobservable := budget.unobservable():
        sentences.append(
            f'Unobservable with this motion: {unobservable}. The intervals are valid if these are as specified; no '
            'residual shows whether they are.'
        )
    left = budget.left_of_std(_TIMES)
    little = [name for name, share in zip(PARAMETERS, left, strict=True) if share >= _LITTLE]
    if little:
        gain = percent(1.0 - float(np.nanmin(left[left >= _LITTLE])))
        sentences.append(
            f'More data of the same motion hardly improve {listing(little)}: {_TIMES} times as many would lower the '
            f'standard deviation by {gain} at most.'
        )
    return sentences


def _joined(words: list[str]) -> str:
    return f'{", ".join(words[:-1])} and {words[-1]}' if len(words) > 1 else words[0]


def noise(levels: NoiseLevels | None) -> str:
    """Return the declared and the estimated noise of each sensor; nothing of no run."""
    if levels is None:
        return ''
    rows = [
        (name.replace('_', ' '), *('' if math.isnan(each) else f'{each:.2g}' for each in pair), unit)
        for name, *pair, unit in zip(CHANNELS, levels.declared, levels.estimated, CHANNEL_UNITS, strict=True)
    ]
    head = ('sensor', 'set', 'estimated', 'unit')
    return '<h3>Noise of a reading</h3>' + table(head, rows) + listed(levels.differences())


def sensors(run: Run) -> str:
    """Return rate, use and fit of each sensor of the base; nothing where odometry is the only one."""
    if len(run.sensors) < _SEVERAL:
        return ''
    rows = [
        (
            each.name,
            number(each.rate, 3),
            str(each.used),
            ', '.join(f'{count} {cause}' for cause, count in each.dropped.items()),
            *('' if math.isnan(value) else f'{value:.2f}' for value in (each.residual, each.share)),
        )
        for each in run.sensors
    ]
    head = ('sensor of the base', 'Hz', 'used', 'dropped', 'residual', 'share of chi-square')
    return '<h3>Sensors of the base</h3>' + table(head, rows)


def captured_body(run: Run) -> str:
    """Return the captured body alone, where that was asked for."""
    if run.debris is None:
        return ''
    rows = estimates(PARAMETERS, run.debris.parameters, run.debris.std, SHOWN_UNITS)
    note = (
        f"The captured body alone, in the frame of link '{run.target_link}': the estimate minus the <inertial> of that "
        'link in the robot description.'
    )
    return (
        '<h3>Captured body</h3>' + table(('parameter', 'estimate', PLUS_MINUS, 'unit'), rows) + paragraph(note, 'note')
    )


def before_the_capture(run: Run) -> str:
    """Return the momentum of robot and captured body before the capture, where the bag holds one."""
    capture = run.capture
    if capture is None:
        return ''
    head = ('before the capture', 'captured body', PLUS_MINUS, 'robot alone', PLUS_MINUS, 'unit')
    body, chaser = _bands(capture.momentum, capture.covariance), [('', '')] * 6
    sentence = f'Captured at {capture.time:.4g} s. Odometry frame; angular momentum about its origin. '
    if capture.chaser is None:
        sentence += 'Nothing was measured before it.'
    else:
        chaser = _bands(capture.chaser.momentum, capture.chaser.covariance)
        sentence += (
            'Until then the momentum of the known model was constant with a residual of '
            f'{capture.chaser.residual:.2f} standard deviations, over {capture.chaser.samples} samples.'
        )
    columns = zip(MOMENTUM, body, chaser, MOMENTUM_UNITS, strict=True)
    rows = [(name, *ours, *theirs, unit) for name, ours, theirs, unit in columns]
    content = '<h3>Capture</h3>' + table(head, rows) + paragraph(sentence, 'note')
    motion = np.concatenate((capture.velocity, capture.spin))
    if not np.all(np.isfinite(motion)):
        return content
    moved = [(name, number(value, 4), unit) for name, value, unit in zip(_MOTION, motion, _MOTION_UNITS, strict=True)]
    note = 'Velocity of its centre of mass and its spin before the capture, from its momentum and the estimate.'
    return content + table(('captured body', 'estimate', 'unit'), moved) + paragraph(note, 'note')


def _bands(momentum: Array, covariance: Array) -> list[tuple[str, str]]:
    rows = estimates(MOMENTUM, momentum, np.sqrt(np.diag(covariance)), MOMENTUM_UNITS)
    return [(value, band) for _, value, band, _ in rows]
