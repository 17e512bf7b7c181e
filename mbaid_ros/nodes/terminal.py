"""An estimate as text: a screen that is as wide as the terminal, or one line. Only printable characters get through."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

from mbaid_ros.cli import one_line
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.budget import MAIN_CAUSES, ErrorBudget
from mbaid_ros.core.results.parameters import PARAMETERS, UNITS
from mbaid_ros.core.results.rounding import rounded

NARROWEST = 20  # columns
ESTIMATE, NEXT = 'estimate', 'next'  # a status of /diagnostics, and its key of what motion would help most
_DECADES = 3.0  # an empty bar is a relative standard deviation of 100 %, a full one 0.1 %
_COLUMNS_WITHOUT_BAR = 36


def screen(message: Any, topic: str, width: int, sign: str = '\N{PLUS-MINUS SIGN}', advice: str = '') -> list[str]:
    """Return an estimate as lines of at most `width` columns.

    Parameters
    ----------
    message : mbaid_msgs/InertiaEstimate
    topic : where it came from
    width : columns of the terminal
    sign : plus-minus, as the terminal can show it
    advice : what motion would help most
    """
    values, stds = numbers(message)
    lines = [
        one_line(topic),
        f'{_status(message)}: {one_line(message.header.frame_id)}',
        f'{_span(message):.1f} s, {message.samples} samples, {_method(message)}',
        f'{"":16} {sign}95 %',
    ]
    progress = certainty(values, stds)
    for name, unit, value, std, share in zip(PARAMETERS, UNITS, values, stds, progress, strict=True):
        lines.append(_row(name, unit, (value, std), share, width, sign))
    lines += ['', _momentum('P', 'N s', message.linear_momentum), _momentum('L', 'N m s', message.angular_momentum)]
    if math.isfinite(message.residual):
        lines.append(f'residual {message.residual:.2f} (1 is as expected)')
    if mostly := budget(message):
        lines += textwrap.wrap(f'{MAIN_CAUSES}: {mostly}', max(width, NARROWEST), subsequent_indent='  ')
    if advice:
        lines += textwrap.wrap(f'{NEXT}: {one_line(advice)}', max(width, NARROWEST), subsequent_indent='  ')
    for warning in message.warnings:
        lines += textwrap.wrap(f'! {one_line(warning)}', max(width, NARROWEST), subsequent_indent='  ')
    return [line[:width].rstrip() for line in lines]


def line(message: Any, sign: str = '\N{PLUS-MINUS SIGN}', advice: str = '') -> str:
    """Return an estimate as one line."""
    values, stds = numbers(message)
    parts = [f'{_span(message):.1f} s', _status(message)]
    for name, unit, value, std in zip(PARAMETERS, UNITS, values, stds, strict=True):
        shown, band = rounded(value, std)
        if shown:
            parts.append(f'{name} {shown}{f" {sign}{band}" if band else ""} {unit}')
    if mostly := budget(message):
        parts.append(f'{MAIN_CAUSES}: {mostly}')
    if advice:
        parts.append(f'{NEXT}: {advice}')
    if message.warnings:
        parts.append('! ' + '; '.join(message.warnings))
    return one_line(', '.join(parts))


def numbers(message: Any) -> tuple[Array, Array]:
    """Return the ten parameters of a message and their standard deviations; NaN where not known."""
    inertia = message.inertia
    tensor = (getattr(inertia, name) for name in PARAMETERS[4:])
    values = np.array([inertia.m, inertia.com.x, inertia.com.y, inertia.com.z, *tensor], dtype=float)
    known = np.asarray(message.identifiable, dtype=bool)
    stds = np.asarray(message.standard_deviation, dtype=float)
    return np.where(known, values, np.nan), np.where(known, stds, np.nan)


def budget(message: Any) -> str:
    """Return what makes most of the variances, in a few words; empty where the message does not tell."""
    causes, shares = tuple(message.budget_causes), np.asarray(message.budget_shares, dtype=float)
    if not causes or len(shares) != len(PARAMETERS) * len(causes):
        return ''
    return one_line(ErrorBudget(causes, shares.reshape(len(PARAMETERS), -1)).told(numbers(message)[1]))


def certainty(values: Array, stds: Array) -> Array:
    """Return how far each parameter has come, 0 to 1, by its standard deviation on a logarithmic scale.

    The mass counts relative to itself, the CoM to a metre, the inertia to its largest moment.
    """
    moments = np.abs(values[[4, 7, 9]])
    largest = float(np.nanmax(moments)) if np.any(np.isfinite(moments)) else 1.0
    sizes = np.array([abs(values[0]), *[1.0] * 3, *[largest] * 6])
    with np.errstate(divide='ignore', invalid='ignore'):
        share = -np.log10(stds / sizes) / _DECADES
    return np.nan_to_num(np.clip(share, 0.0, 1.0), nan=0.0)


def _row(name: str, unit: str, number: tuple[float, float], share: float, width: int, sign: str) -> str:
    value, band = rounded(*number)
    if not value:
        return f'{name:<5} {"-":>10}'
    spread = f'{sign}{band}' if band else ''
    text = f'{name:<5} {value:>10} {spread:<9} {unit:<6}'
    room = min(width - _COLUMNS_WITHOUT_BAR, 30)
    if room < 3 or not spread:
        return text
    filled = round(share * room)
    return f'{text} [{"#" * filled}{"." * (room - filled)}]'


def _momentum(symbol: str, unit: str, vector: Any) -> str:
    shown = ' '.join(f'{value:.4g}' if math.isfinite(value) else '-' for value in (vector.x, vector.y, vector.z))
    return f'{symbol} {shown} {unit}'


def _status(message: Any) -> str:
    stale = ' (stale)' if message.stale else ''
    return one_line(message.status).replace('_', ' ') + stale


def _method(message: Any) -> str:
    stage = '' if message.stage in {'', message.method} else f' (stage {message.stage})'
    return one_line(f'{message.method}{stage}')


def _span(message: Any) -> float:
    return float(message.span.sec) + 1e-9 * float(message.span.nanosec)


def drawn(lines: Sequence[str], height: int) -> str:
    """Return what makes a terminal show lines in place of what was there, without colour and without flicker."""
    shown = list(lines[: max(height - 1, 1)])
    return '\x1b[H' + ''.join(f'{text}\x1b[K\n' for text in shown) + '\x1b[J'
