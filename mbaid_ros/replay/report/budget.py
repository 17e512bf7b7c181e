"""The error budget: a stacked bar a parameter, the figures, and what would help."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import (
    PARAMETERS,
    SENSOR_NOISE,
    ErrorBudget,
    percent,
    short,
)
from mbaid_ros.core.unknowns.catalogue import remedy_text
from mbaid_ros.replay.report.markup import paragraph, table, text

_OTHERS = 'all others'
_NAMED = 6  # causes beside sensor noise that have a colour of their own
_LEAST = 0.01  # share of any parameter, for a cause to be named
_ROOM = 0.05  # share that a number fits into
# More data help little where ten times as many leave this much of the standard deviation.
_TIMES, _LITTLE = 10, 0.7

# Okabe and Ito's colours with an ink that can be read on each; sensor noise is grey, and what is left is hatched.
_COLOURS = (
    ('#0072b2', '#ffffff'),
    ('#e69f00', '#000000'),
    ('#009e73', '#000000'),
    ('#cc79a7', '#000000'),
    ('#56b4e9', '#000000'),
    ('#d55e00', '#000000'),
)
STYLE = """
.budget { display: grid; grid-template-columns: max-content 1fr; gap: .3rem .7rem; align-items: center;
  margin: .7rem 0 .5rem; font-size: .93rem; }
.bar { display: flex; height: 1.35rem; background: var(--panel); border-radius: .2rem; overflow: hidden; }
.bar i, .key i { font-style: normal; font-size: .78rem; line-height: 1.35rem; text-align: center; overflow: hidden;
  print-color-adjust: exact; -webkit-print-color-adjust: exact; }
.bar i + i { box-shadow: inset 2px 0 var(--page); }
.key { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; margin: .5rem 0 .9rem; padding: 0; list-style: none;
  font-size: .87rem; }
.key li { display: flex; gap: .45rem; align-items: flex-start; overflow-wrap: anywhere; min-width: 0; }
.key i { flex: none; width: 1.35rem; height: 1.35rem; border-radius: .2rem; }
.told { overflow-wrap: anywhere; }
.shares td:first-child { min-width: 9.5rem; }
.noise { background: var(--faint); }
.others { background: repeating-linear-gradient(45deg, var(--line) 0 4px, var(--faint) 4px 6px); }
""" + '\n'.join(
    f'.cause{place} {{ background: {colour}; color: {ink}; }}' for place, (colour, ink) in enumerate(_COLOURS, 1)
)


def section(final: Estimate) -> str:
    """Return the section on an estimate; empty where it has no budget."""
    budget = final.budget
    known = np.zeros(len(PARAMETERS), dtype=bool) if budget is None else np.all(np.isfinite(budget.shares), axis=1)
    if budget is None or not known.any():
        return ''
    named = _ordered(budget)[:_NAMED]
    told = [paragraph(sentence, 'told') for sentence in _sentences(budget, final.std)]
    if not named:
        return ''.join(('<h3>Error budget</h3>', paragraph('All of the variance is sensor noise.'), *told))
    labels, shares = _shown(budget, named)
    content = (
        '<h3>Error budget</h3>',
        paragraph(
            'What makes the variance of each parameter: sensor noise, and what of the robot is not exactly known.'
        ),
        _bars(labels, shares, known),
        _key(labels),
        *told,
        _figures(labels, shares, known),
        _every(budget, known),
    )
    return ''.join(content)


def _ordered(budget: ErrorBudget) -> list[int]:
    """Return the places of the causes beside sensor noise, those that make most of any parameter first."""
    largest = np.max(np.nan_to_num(budget.shares), axis=0)
    largest[budget.causes.index(SENSOR_NOISE)] = 0.0
    return [int(place) for place in np.argsort(-largest, kind='stable') if largest[place] >= _LEAST]


def _shown(budget: ErrorBudget, named: list[int]) -> tuple[list[str], Array]:
    """Return the labels of what is shown, and the (10, l) shares: sensor noise, the causes named, and all others."""
    places = [budget.causes.index(SENSOR_NOISE), *named]
    shares = np.maximum(budget.shares[:, places], 0.0)
    rest = np.maximum(1.0 - shares.sum(axis=1), 0.0)
    labels = [SENSOR_NOISE, *(f'{place} {short(budget.causes[cause])}' for place, cause in enumerate(named, 1))]
    return [*labels, _OTHERS], np.column_stack((shares, rest))


def _class(place: int, labels: list[str]) -> str:
    return {0: 'noise', len(labels) - 1: 'others'}.get(place, f'cause{place}')


def _bars(labels: list[str], shares: Array, known: Array) -> str:
    """Return the bars; what a cause's colour means, its number says too."""
    rows = []
    for name, row in zip(np.array(PARAMETERS)[known], shares[known], strict=True):
        parts = [
            f'<i class="{_class(place, labels)}" style="width:{100.0 * share:.2f}%">'
            f'{place if 0 < place < len(labels) - 1 and share >= _ROOM else ""}</i>'
            for place, share in enumerate(row)
            if share > 0.0
        ]
        said = ', '.join(
            f'{label} {percent(share)}' for label, share in zip(labels, row, strict=True) if share >= _LEAST
        )
        bar = f'<div class="bar" role="img" aria-label="{text(f"{name}: {said}")}">{"".join(parts)}</div>'
        rows.append(f'<span>{name}</span>{bar}')
    return f'<div class="budget">{"".join(rows)}</div>'


def _key(labels: list[str]) -> str:
    entries = []
    for place, label in enumerate(labels):
        number, _, name = label.partition(' ') if 0 < place < len(labels) - 1 else ('', '', label)
        entries.append(f'<li><i class="{_class(place, labels)}">{number}</i><span>{text(name)}</span></li>')
    return f'<ul class="key">{"".join(entries)}</ul>'


def _figures(labels: list[str], shares: Array, known: Array) -> str:
    """Return the figures: a row a cause, a column a parameter that is determined, per cent."""
    names = np.array(PARAMETERS)[known].tolist()
    rows = [
        [label, *(f'{100.0 * share:.1f}' for share in column)]
        for label, column in zip(labels, shares[known].T, strict=True)
    ]
    content = table(('share [%]', *names), rows)
    return f'<div class="shares">{content}</div>'


def _every(budget: ErrorBudget, known: Array) -> str:
    """Return the figures of all causes that make anything of a parameter, folded; nothing where they are shown."""
    places = _ordered(budget)
    if len(places) <= _NAMED:
        return ''
    table_ = _figures([short(budget.causes[place]) for place in places], budget.shares[:, places], known)
    return f'<details><summary>All {len(places)} causes of {percent(_LEAST)} or more</summary>{table_}</details>'


def _sentences(budget: ErrorBudget, std: Array) -> list[str]:
    """Return what each dominant cause is, and what more data would not improve."""
    told = []
    for cause, groups in budget.dominant(std).items():
        names = _joined(list(groups))
        shares = _joined([percent(share) for share in groups.values()])
        told.append(f'{names[0].upper()}{names[1:]}: {shares} of the variance is {remedy_text(cause)}.')
    if resting := budget.resting():
        told.append(
            f'The intervals rest on what this motion cannot check: {resting}. They hold if these are as declared; if '
            'one is not, no residual shows it.'
        )
    left = budget.left_of_std(_TIMES)
    little = [name for name, share in zip(PARAMETERS, left, strict=True) if share >= _LITTLE]
    if little:
        gain = percent(1.0 - float(np.nanmin(left[left >= _LITTLE])))
        told.append(
            f'More data of the same motion hardly improve {listing(little)}: {_TIMES} times as many would lower the '
            f'standard deviation by {gain} at most.'
        )
    return told


def _joined(words: list[str]) -> str:
    return f'{", ".join(words[:-1])} and {words[-1]}' if len(words) > 1 else words[0]
