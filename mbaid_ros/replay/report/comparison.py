"""Several bags side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import BAND, PARAMETERS, rounded
from mbaid_ros.replay.report.canvas import FIRST, TRUTH, entitle, new_axes, svg
from mbaid_ros.replay.report.figures import SHOWN_UNITS
from mbaid_ros.replay.report.markup import NO_NUMBER, figure, listed, number, table
from mbaid_ros.replay.result_text import verdict
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.truth import Truth

_DISAGREEMENT = 3.0  # standard deviations


def comparison(runs: Sequence[Run], truths: Sequence[Truth | None]) -> str:
    """Return the section that compares runs."""
    names = [f'({place})' for place in range(1, len(runs) + 1)]
    head = ['parameter', 'unit', *names, 'apart [std]']
    values = np.array([run.final.parameters for run in runs])
    stds = np.array([run.final.std for run in runs])
    apart = _apart(values, stds)
    rows = []
    for index, (parameter, unit) in enumerate(zip(PARAMETERS, SHOWN_UNITS, strict=True)):
        cells = [_cell(value, std) for value, std in zip(values[:, index], stds[:, index], strict=True)]
        rows.append([parameter, unit, *cells, number(apart[index], 2)])
    agreement = _agreement(apart, runs)
    legend = [f'{name} {run.bag}: {verdict(run)}' for name, run in zip(names, runs, strict=True)]
    parts = [
        '<section>',
        '<h2>Side by side</h2>',
        listed(legend),
        f'<p class="verdict {agreement[0]}">{agreement[1]}</p>',
    ]
    parts.append(table(head, rows))
    if np.any(np.isfinite(values)):
        parts.append(
            figure(_dots(values, stds, _common(truths)), 'Bars: 95 %. Dotted: truth, where all bags share it.')
        )
    return '\n'.join([*parts, '</section>'])


def _cell(value: float, std: float) -> str:
    shown, band = rounded(value, std)
    return f'{shown} \N{PLUS-MINUS SIGN} {band}' if band else shown or NO_NUMBER


def _apart(values: Array, stds: Array) -> Array:
    """Return the largest difference of each parameter between two runs, in standard deviations of the difference."""
    difference = np.abs(values[:, None] - values[None])
    spread = np.sqrt(stds[:, None] ** 2 + stds[None] ** 2)
    ratio = np.where(spread > 0.0, difference / np.where(spread > 0.0, spread, 1.0), np.nan)
    ratio[np.arange(len(values)), np.arange(len(values))] = np.nan
    ratio = ratio.reshape(-1, values.shape[1])
    return np.where(np.all(np.isnan(ratio), axis=0), np.nan, np.max(np.nan_to_num(ratio), axis=0))


def _agreement(apart: Array, runs: Sequence[Run]) -> tuple[str, str]:
    """Return the look and the sentence of the verdict on several runs."""
    wrong = [f'({place})' for place, run in enumerate(runs, start=1) if run.contradicted]
    if wrong:
        return 'wrong', f'The data of {listing(wrong)} contradict the model: numbers from them must not be trusted.'
    if len({run.target_link for run in runs}) > 1:
        return 'bad', 'The runs are about different links.'
    if np.all(np.isnan(apart)):
        return 'bad', 'The runs have no parameter with an uncertainty in common.'
    worst = int(np.nanargmax(apart))
    words = f'{PARAMETERS[worst]} differs most, by {apart[worst]:.1f} standard deviations'
    if apart[worst] > _DISAGREEMENT:
        return 'bad', f'The runs contradict each other: {words}.'
    return 'good', f'The runs agree: {words}.'


def _common(truths: Sequence[Truth | None]) -> Array | None:
    first = truths[0]
    if first is None:
        return None
    same = all(truth is not None and np.array_equal(truth.parameters, first.parameters) for truth in truths)
    return first.parameters if same else None


def _dots(values: Array, stds: Array, truth: Array | None) -> str:
    shown = [index for index in range(len(PARAMETERS)) if np.any(np.isfinite(values[:, index]))]
    columns = 2 if len(shown) <= 4 else 3
    figure_, axes = new_axes(-(-len(shown) // columns), columns, 1.6)
    places = np.arange(1, len(values) + 1)
    for axis, index in zip(axes, shown, strict=False):
        bars = BAND * np.nan_to_num(stds[:, index])
        axis.errorbar(places, values[:, index], bars, fmt='o', markersize=4, color=FIRST, capsize=3, linewidth=1.2)
        if truth is not None:
            axis.axhline(truth[index], color=TRUTH, linestyle=':', linewidth=1.3)
        axis.set_xticks(places, [f'({place})' for place in places])
        axis.set_xlim(0.4, len(values) + 0.6)
        entitle(axis, f'{PARAMETERS[index]} [{SHOWN_UNITS[index]}]')
    for axis in axes[len(shown) :]:
        axis.remove()
    return svg(figure_, 'comparison', 'The estimates of each bag with their 95 % bars')
