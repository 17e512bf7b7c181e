"""What the runs in orbit and with wheels have come to, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.orbit.runs import DURATIONS, FRAMES, PACES, PLACES, stored

_CLAIMED = ('converged', 'estimating')
_BAND = 1.96
_ORBIT = 'set orbit.mean_motion'
_WHEELS = 'wheels'
_HOW = {
    '': 'none',
    'names': 'by names',
    'stored': 'by stored momentum',
    'unread': 'not read',
    'off': 'by names, inertia 5 % off, declared',
    'off, exact': 'by names, inertia 5 % off, exact',
}

Line = dict[str, Any]


def tables(store: Path) -> str:
    """Return the tables of what a file holds."""
    lines = stored(store)
    return '\n'.join((_grid(lines), _undeclared(lines), _wheels(lines)))


def _grid(lines: Iterable[Line]) -> str:
    rows = [
        '| motion | frame | where | runs | coverage | NEES | RMSE over that in no orbit | status |',
        '|---' * 8 + '|',
    ]
    for seconds in DURATIONS:
        for pace in PACES:
            these = [line for line in lines if _is(line, part='grid', seconds=seconds, pace=pace)]
            free = {line['seed']: line for line in these if not line['frame']}
            every = (('', 'at'), *((frame, place) for frame in FRAMES for place in PLACES))
            for frame, place in every:
                own = [line for line in these if _is(line, frame=frame, place=place) and line['seed'] in free]
                if own:
                    told = (frame or 'no orbit', place if frame else '-', *_figures(own, free))
                    rows.append(f'| {seconds:.0f} s, {pace} | ' + ' | '.join(told) + ' |')
    return '\n'.join(rows) + '\n'


def _undeclared(lines: Iterable[Line]) -> str:
    rows = [
        '| motion | frame | where | runs | status | coverage of those that claim one | named first |',
        '|---' * 7 + '|',
    ]
    for pace in PACES:
        for frame in FRAMES:
            for place in PLACES:
                own = [line for line in lines if _is(line, part='undeclared', pace=pace, frame=frame, place=place)]
                if own:
                    claimed = [line for line in own if line['status'] in _CLAIMED]
                    covered = f'{_covered(claimed):.0f} %' if claimed else '-'
                    named = sum(_ORBIT in ''.join(line['named'][:1]) for line in own)
                    told = (pace, frame, place, len(own), _status(own), covered, f'{named} of {len(own)}')
                    rows.append('| ' + ' | '.join(map(str, told)) + ' |')
    return '\n'.join(rows) + '\n'


def _wheels(lines: Iterable[Line]) -> str:
    rows = ['| wheels | runs | coverage | NEES | RMSE over that without | status | named |', '|---' * 7 + '|']
    these = [line for line in lines if line['part'] == 'wheels']
    free = {line['seed']: line for line in these if not line['frame']}
    for how, words in _HOW.items():
        own = [line for line in these if line['frame'] == how and line['seed'] in free]
        if own:
            named = sum(any(_WHEELS in cause for cause in line['named'][:2]) for line in own)
            told = (words, *_figures(own, free), f'{named} of {len(own)}')
            rows.append('| ' + ' | '.join(told) + ' |')
    return '\n'.join(rows) + '\n'


def _is(line: Line, **values: object) -> bool:
    return all(line[name] == value for name, value in values.items())


def _figures(own: list[Line], free: dict[int, Line]) -> tuple[str, ...]:
    """Return how many runs there are, their coverage, NEES, errors over those of the free ones, and status."""
    known = [line for line in own if line['error'] is not None and free[line['seed']]['error'] is not None]
    if not known:
        return str(len(own)), '-', '-', '-', _status(own)
    # Relative to what is claimed without: every parameter counts alike.
    squares = _mean(known, lambda line: _square(line, free))
    without = _mean(known, lambda line: _square(free[line['seed']], free))
    nees = _mean(known, lambda line: line['nees'])
    ratio = float(np.sqrt(squares / without))
    return str(len(own)), f'{_covered(known):.1f} %', f'{nees:.1f}', f'{ratio:.3f}', _status(own)


def _square(line: Line, free: dict[int, Line]) -> float:
    return float(np.mean((np.array(line['error']) / np.array(free[line['seed']]['std'])) ** 2))


def _mean(lines: list[Line], value: Callable[[Line], float]) -> float:
    return float(np.mean([value(line) for line in lines]))


def _covered(lines: list[Line]) -> float:
    within = [np.abs(line['error']) < _BAND * np.array(line['std']) for line in lines if line['error'] is not None]
    return 100.0 * float(np.mean(within)) if within else float('nan')


def _status(lines: list[Line]) -> str:
    counts = Counter(line['status'] for line in lines)
    return ', '.join(f'{count} {status}' for status, count in counts.most_common())
