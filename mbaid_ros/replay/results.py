"""What a replay leads to, and its JSON form, which scripts rely on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from mbaid_ros.cli import one_line
from mbaid_ros.core.capture import Capture, Phase
from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.budget import MAIN_CAUSES
from mbaid_ros.core.results.debris import Debris
from mbaid_ros.core.results.estimate import PARAMETERS, UNITS, Estimate, Thruster
from mbaid_ros.core.results.rounding import rounded
from mbaid_ros.messages import JOINT_MISSING
from mbaid_ros.replay import provenance
from mbaid_ros.replay.jsonable import (
    matrix,
    number,
    numbers,
    shaped,
    shaped_budget,
    shaped_capture,
    shaped_debris,
    shaped_momentum,
    shaped_std,
)
from mbaid_ros.session import Survey

HISTORY_LIMIT = 5_000


@dataclass(frozen=True)
class TopicStatistics:
    """What was received on a topic.

    Attributes
    ----------
    topic, type : full names
    messages : number
    rate : Hz, NaN for fewer than two messages
    gaps : (begin, length), s, of the longest intervals without a message that stand out
    course : (time, rate), s and Hz, of equal pieces of the run
    """

    topic: str
    type: str
    messages: int
    rate: float
    gaps: tuple[tuple[float, float], ...] = ()
    course: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Pose:
    """Where the robot is at an instant.

    Attributes
    ----------
    base_rotation : (3, 3) base to odometry axes
    base_position : (3,) m
    joint_position : (n,) rad or m, in the order of the model's joints
    """

    base_rotation: Array
    base_position: Array
    joint_position: Array


@dataclass(frozen=True)
class Run:
    """A bag's way through the estimator.

    Attributes
    ----------
    bag : path as the user gave it
    target_link : link whose inertia was identified
    final : the last estimate
    history : estimates in order, thinned evenly to at most HISTORY_LIMIT
    topics : the inputs
    used : number of samples the estimator was given
    dropped : messages that were not used, by cause
    warnings : of the bag and of the run, one line each
    urdf : text of the robot description
    pose : the last one, None where the bag holds none
    settings : every parameter of the estimator with its value
    debris : the captured body alone, None where not asked for or not determined
    phase : in which the bag ends
    capture : what it tells, None where the bag holds none
    missing_joints : for want of which most of the joint states could not be used
    survey : what the run takes the robot for, None where nobody has looked
    made_by : which command, None where nobody asked
    state : what it has come to know, as the next motion is planned from; None where its method does not tell
    advice : what motion would help most, in words; empty where none is needed or known
    files : SHA-256 of each file of the bag, by its name; None for one that is too large
    """

    bag: str
    target_link: str
    final: Estimate
    history: tuple[Estimate, ...]
    topics: tuple[TopicStatistics, ...]
    used: int
    dropped: Mapping[str, int]
    warnings: tuple[str, ...]
    urdf: str = ''
    pose: Pose | None = None
    settings: Mapping[str, object] = field(default_factory=dict)
    debris: Debris | None = None
    phase: Phase = 'post_capture'
    capture: Capture | None = None
    missing_joints: tuple[str, ...] = ()
    survey: Survey | None = None
    made_by: provenance.MadeBy | None = None
    files: Mapping[str, str | None] = field(default_factory=dict)
    state: Mapping[str, Any] | None = None
    advice: str = ''

    @property
    def reached(self) -> bool:
        """Whether there is an estimate: at least one parameter is determined."""
        return self.final.status != 'waiting' and bool(np.any(self.final.identifiable))

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the model: what comes out must not be trusted."""
        return self.final.status == 'inconsistent'

    @property
    def all_warnings(self) -> list[str]:
        """Every warning once, the estimator's first."""
        return list(dict.fromkeys((*self.final.warnings, *self.warnings)))


class History:
    """Keeps a sequence of estimates of any length, thinned evenly, in bounded memory.

    Parameters
    ----------
    limit : int
        Most entries that `entries` returns.
    """

    def __init__(self, limit: int = HISTORY_LIMIT) -> None:
        self._limit = limit
        self._stride = 1
        self._count = 0
        self._kept: list[Estimate] = []
        self._ends_with_last = False  # whether the last one is among these
        self.last: Estimate | None = None

    def add(self, estimate: Estimate) -> None:
        """Take the next estimate."""
        self._ends_with_last = self._count % self._stride == 0
        if self._ends_with_last:
            # Only the last one's error budget is told of: it is most of what an estimate takes.
            self._kept.append(estimate if estimate.budget is None else replace(estimate, budget=None))
            if len(self._kept) > 2 * self._limit:
                self._kept = self._kept[::2]
                self._stride *= 2
        self._count += 1
        self.last = estimate

    def entries(self) -> tuple[Estimate, ...]:
        """Return at most `limit` estimates at equal distances, and the last one."""
        kept, step = self._kept, 1
        if len(kept) > self._limit - 1 and self._count > self._limit:
            step = -(-len(kept) // (self._limit - 1))
        thinned = kept[::step]
        if self._ends_with_last and (len(kept) - 1) % step == 0:
            return tuple(thinned)
        return tuple(thinned) if self.last is None else (*thinned, self.last)


def as_json(run: Run) -> dict[str, Any]:
    """Return the run as scripts read it; what is not known is None."""
    final = run.final
    return {
        'bag': run.bag,
        'method': final.method,
        'stage': final.stage or None,
        'target_link': run.target_link,
        'status': final.status,
        'estimate': shaped(numbers(final.parameters)),
        'std': shaped_std(final.std),
        'covariance': matrix(final.covariance),
        'error_budget': None if final.budget is None else shaped_budget(final.budget),
        'identifiable': shaped([bool(flag) for flag in final.identifiable]),
        'momentum': shaped_momentum(final.momentum, final.momentum_covariance),
        'time_offset': None
        if math.isnan(final.time_offset)
        else {'value': final.time_offset, 'std': number(final.time_offset_std)},
        'thrusters': [shaped_thruster(thruster) for thruster in final.thrusters],
        'events': events(run),
        'residual': number(final.residual),
        'causes': [{'cause': cause, 'gain': gain} for cause, gain in likeliest(run)],
        'capture': None if run.capture is None else shaped_capture(run.capture),
        'debris': None if run.debris is None else shaped_debris(run.debris),
        'samples': final.samples,
        'span_s': final.time,
        'warnings': run.all_warnings,
        'model': None if run.survey is None else asdict(run.survey),
        'made_by': None if run.made_by is None else provenance.as_json(run.made_by, run.settings, run.files),
        'state': run.state,
        'advice': run.advice or None,
        'history': [
            {
                't': estimate.time,
                'status': estimate.status,
                'estimate': shaped(numbers(estimate.parameters)),
                'std': shaped_std(estimate.std),
            }
            for estimate in run.history
        ],
    }


def shaped_thruster(found: Thruster) -> dict[str, Any]:
    """Return by how much a thruster is off its command."""
    return {
        'frame': found.frame,
        'scale': found.scale,
        'scale_std': found.scale_std,
        'turn': found.turn.tolist(),
        'turn_std': found.turn_std.tolist(),
        'delay': found.delay,
        'delay_std': found.delay_std,
    }


def likeliest(run: Run) -> tuple[tuple[str, float], ...]:
    """Return what may be wrong where the data contradict the model, the likeliest first, with its log-likelihood."""
    return run.final.causes if run.contradicted else ()


def events(run: Run) -> list[dict[str, Any]]:
    """Return the steps and ramps of the momentum that were found: t, kind, linear, angular, cause."""
    return [
        {
            't': event.time,
            'kind': event.kind,
            'linear': numbers(event.linear),
            'angular': numbers(event.angular),
            'cause': event.cause,
        }
        for event in run.final.events
    ]


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
    mostly = '' if run.final.budget is None else run.final.budget.told(run.final.std)
    rows += [f'  {MAIN_CAUSES}: {one_line(mostly)}'] if mostly else []
    rows += [f'  next: {run.advice}'] if run.advice else []
    rows += [f'  likely cause {place}: {one_line(cause)}' for place, (cause, _) in enumerate(likeliest(run)[:3], 1)]
    return '\n'.join([*rows, *(f'  warning: {one_line(warning)}' for warning in run.all_warnings)])


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
    if run.contradicted:
        why = 'momentum is not conserved as assumed'
        return f'the data contradict the model of {run.target_link}, so its numbers must not be trusted: {why}'
    if run.phase != 'post_capture':
        return f'no estimate of {run.target_link}: the data end before the capture'
    if run.final.status == 'waiting':
        why = f'; {JOINT_MISSING}: {listing(run.missing_joints)}' if run.missing_joints else ''
        return f'no estimate of {run.target_link}: the data hold no complete window{why}'
    if not run.reached:
        return f'no estimate of {run.target_link}: the motion does not determine any of its parameters'
    if run.final.status == 'converged':
        return f'the inertia of {run.target_link} is identified{rest}'
    return f'the inertia of {run.target_link} is estimated, but the estimate has not converged{rest}'
