"""What the runs in orbit, with wheels and with a thruster have come to, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from benchmarks.orbit.runs import CIRCLES, DURATIONS, FRAMES, PACES, PLACES, circle_at
from benchmarks.orbit.simulated import STRONGER, TURN
from benchmarks.orbit.store import stored
from benchmarks.pages import provenance, table
from mbaid_ros.core.results.parameters import BAND

_CLAIMED = ('converged', 'estimating')
_WRONG = float(chi2.isf(1e-3, 10))  # NEES that one run in a thousand exceeds
_ORBIT = 'set orbit.mean_motion'
_WHEELS = 'wheels'
_WHEELS_READ = {
    '': 'none',
    'names': 'by names',
    'stored': 'by stored momentum',
    'unread': 'not read',
    'off': 'by names, inertia 5 % off, declared',
    'off, exact': 'by names, inertia 5 % off, exact',
}
_THRUSTERS = {
    '': 'none',
    'right': 'as commanded',
    'right, prior': 'as commanded, may be off',
    'off, prior': 'off, may be off',
    'off': 'off, taken as commanded',
}

Line = dict[str, Any]


def tables(store: Path) -> dict[str, str]:
    """Return the tables of what a file holds, by part, each with a line that says where it is from."""
    lines = stored(store)
    parts = {'grid': _grid, 'undeclared': _undeclared, 'circle': _circle, 'wheels': _wheels, 'thruster': _thruster}
    held = {part for part in parts if any(line['part'] == part for line in lines)}
    return {part: f'{make(lines)}\n\n{_made_by(part, lines)}' for part, make in parts.items() if part in held}


def _made_by(part: str, lines: Iterable[Line]) -> str:
    own = [line for line in lines if line['part'] == part]
    seeds = [len({line['seed'] for line in own if line.get('seconds', seconds) == seconds}) for seconds in DURATIONS]
    words = f'{seeds[0]} seeds' if seeds[1] in {0, seeds[0]} else f'{seeds[0]} seeds of a minute, {seeds[1]} of five'
    return provenance(words, f'scripts/benchmark_orbit.py {part}')


def _grid(lines: Iterable[Line]) -> str:
    header = ('motion', 'frame', 'where', 'runs', 'coverage', 'NEES', 'RMSE over that in no orbit', 'status')
    rows = []
    for seconds, pace in product(DURATIONS, PACES):
        these = [line for line in lines if _is(line, part='grid', seconds=seconds, pace=pace)]
        free = {line['seed']: line for line in these if not line['frame']}
        for frame, place in (('', 'at'), *product(FRAMES, PLACES)):
            own = [line for line in these if _is(line, frame=frame, place=place) and line['seed'] in free]
            if own:
                where = (frame or 'no orbit', place if frame else '-')
                rows.append((f'{seconds:.0f} s, {pace}', *where, *_figures(own, free)))
    covered = _covered([line for line in lines if line['part'] == 'grid'])
    return f'{table(header, rows, words=True)}\n\nAll together {covered:.1f} % are covered.'


def _undeclared(lines: Iterable[Line]) -> str:
    header = ('motion', 'frame', 'where', 'runs', 'status', 'coverage of those that claim one', 'wrong', 'named first')
    rows = []
    these = [line for line in lines if line['part'] == 'undeclared']
    for seconds, pace, frame, place in product(DURATIONS, PACES, FRAMES, PLACES):
        own = [line for line in these if _is(line, seconds=seconds, pace=pace, frame=frame, place=place)]
        if own:
            rows.append((f'{seconds:.0f} s, {pace}', frame, place, *_told_of(own)))
    first = f'The orbit is named first in {sum(map(_named_first, these))} of {len(these)} runs'
    wrong = sum(map(_silently_wrong, these))
    return f'{table(header, rows, words=True)}\n\n{first}; {wrong or "none"} is silently wrong.'


def _circle(lines: Iterable[Line]) -> str:
    header = ('motion', 'frame', 'where', 'runs', 'coverage', 'NEES', 'RMSE over that of a circle', 'status')
    rows = []
    these = [line for line in lines if line['part'] == 'circle']
    for seconds, pace, frame, place in product(DURATIONS, PACES, FRAMES, PLACES):
        some = [line for line in these if _is(line, seconds=seconds, pace=pace, frame=frame)]
        free = {line['seed']: line for line in some if line['place'] == circle_at(place, CIRCLES[0])}
        for where in (circle_at(place, case) for case in CIRCLES):
            own = [line for line in some if line['place'] == where and line['seed'] in free]
            if own:
                rows.append((f'{seconds:.0f} s, {pace}', frame, where, *_figures(own, free)))
    return table(header, rows, words=True)


def _told_of(own: list[Line]) -> tuple[str, ...]:
    """Return how many runs there are, their status, coverage, how many are silently wrong, and how many name it."""
    claimed = [line for line in own if line['status'] in _CLAIMED]
    covered = f'{_covered(claimed):.0f} %' if claimed else '-'
    wrong, named = sum(map(_silently_wrong, own)), sum(map(_named_first, own))
    return str(len(own)), _status(own), covered, str(wrong), f'{named} of {len(own)}'


def _silently_wrong(line: Line) -> bool:
    return line['status'] in _CLAIMED and line['nees'] is not None and line['nees'] > _WRONG


def _named_first(line: Line) -> bool:
    return _ORBIT in ''.join(line['named'][:1])


def _wheels(lines: Iterable[Line]) -> str:
    header = ('wheels', 'runs', 'coverage', 'NEES', 'RMSE over that without', 'status', 'named')
    rows = []
    these = [line for line in lines if line['part'] == 'wheels']
    free = {line['seed']: line for line in these if not line['frame']}
    for how, words in _WHEELS_READ.items():
        own = [line for line in these if line['frame'] == how and line['seed'] in free]
        if own:
            named = sum(any(_WHEELS in cause for cause in line['named'][:2]) for line in own)
            rows.append((words, *_figures(own, free), f'{named} of {len(own)}'))
    return table(header, rows, words=True)


def _thruster(lines: Iterable[Line]) -> str:
    header = ('thruster', 'runs', 'coverage', 'NEES', 'RMSE over that without', 'status', 'scale', 'turn')
    rows = []
    these = [line for line in lines if line['part'] == 'thruster']
    free = {line['seed']: line for line in these if not line['frame']}
    for how, words in _THRUSTERS.items():
        own = [line for line in these if line['frame'] == how and line['seed'] in free]
        if own:
            rows.append((words, *_figures(own, free), *_found(own)))
    return table(header, rows, words=True)


def _found(own: list[Line]) -> tuple[str, str]:
    """Return the largest errors of scale and turn, the latter in degrees, each with its standard deviation."""
    known = [line for line in own if 'scale' in line]
    if not known:
        return '-', '-'
    strength, turn = (STRONGER, np.radians(TURN)) if 'off' in own[0]['frame'] else (1.0, 0.0)
    # What there is of the force along its command, and across it.
    scale = max(abs(line['scale'] - strength * np.cos(turn)) for line in known)
    off = max(float(np.abs(np.array(line['turn']) - [strength * np.sin(turn), 0.0, 0.0]).max()) for line in known)
    stds = [_mean(known, lambda line: line['scale_std']), _mean(known, lambda line: float(np.max(line['turn_std'])))]
    return f'{scale:.4f} ({stds[0]:.4f})', f'{np.degrees(off):.2f}° ({np.degrees(stds[1]):.2f}°)'


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
    within = [np.abs(line['error']) < BAND * np.array(line['std']) for line in lines if line['error'] is not None]
    return 100.0 * float(np.mean(within)) if within else float('nan')


def _status(lines: list[Line]) -> str:
    counts = Counter(line['status'] for line in lines)
    return ', '.join(f'{count} {status}' for status, count in counts.most_common())
