"""The state of the node `estimator`, and its description in words: for /diagnostics and for the log."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from mbaid_ros.cli import one_line
from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import MAIN_CAUSES, PARAMETERS, UNITS, UNOBSERVABLE, rounded
from mbaid_ros.nodes.subscriptions import LOST
from mbaid_ros.nodes.watch import NEXT
from mbaid_ros.session.explanation import doubts, explain, obstacles
from mbaid_ros.session.model_summary import ModelSummary
from mbaid_ros.session.session import Session

OK, WARN, ERROR, STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE

Values = list[tuple[str, object]]
Report = tuple[bytes, str, Values]

PATIENCE = 5.0  # s without the awaited messages, or of a motion that determines too little, before a log line
_CAUSES = 3  # likely causes in /diagnostics
_NUMBER = re.compile(r'\b\d+(\.\d+)?\b')
_ALARMING = {'inconsistent', 'not_identifiable'}
_LEVEL_OF_STATUS = {
    'waiting': WARN,
    'estimating': OK,
    'converged': OK,
    'not_identifiable': WARN,
    'inconsistent': ERROR,
}


@dataclass
class RunState:
    """The state of the node."""

    session: Session | None = None  # the run, None before the first usable robot description
    problem: str = ''  # why the last robot description was refused; empty if it was not
    estimate: Estimate | None = None  # the last one
    paused: bool = False  # True while the service ~/pause stops samples
    stale: str = ''  # why no estimate follows the last one; empty while one does
    advice: str = ''  # the most informative motion, in words; empty if none is needed or known
    ignored: Counter[str] = field(default_factory=Counter)  # messages not handed to a session, by reason
    lost: Mapping[str, int] = field(default_factory=dict)  # messages that have not come between others, by topic

    @property
    def halted(self) -> str:
        """That a user has stopped samples; empty while they are taken."""
        return 'paused: no samples are taken' if self.paused else ''

    @property
    def sample_counts(self) -> str:
        """How many of the received samples are in the estimate, and what was not received, in a sentence."""
        if self.session is None or self.estimate is None:
            return 'no sample is in an estimate'
        text = f'{self.estimate.samples} of {self.session.collected} samples are in the estimate'
        text += '' if self.estimate.samples == self.session.collected else ', those of complete windows'
        return '; '.join(
            [text, *(f'{count} messages on {topic} {LOST}' for topic, count in self.lost.items() if count)]
        )


class SampleReport:
    """The use of messages since the last report.

    Attributes
    ----------
    reasons : why messages were not used since the report before the last; empty if all were, or none came
    """

    def __init__(self) -> None:
        self.reasons = ''
        self._used = 0
        self._dropped: Counter[str] = Counter()
        self._replaced: Counter[str] = Counter()

    def report(self, state: RunState, *, heard: bool) -> Report:
        """Return the report; `heard` is whether anything has come since the last one."""
        session = state.session
        values: Values = [(f'not taken, {reason}', count) for reason, count in sorted(state.ignored.items())]
        self.reasons = ''
        if session is None:
            return WARN, 'no sample can be used without a robot description', values
        used, dropped, replaced = self._since(session)
        values += [
            ('used', session.used),
            *((f'dropped, {cause}', count) for cause, count in sorted(session.dropped.items())),
            *((f'partly used, {cause}', count) for cause, count in sorted(session.replaced.items())),
            *((f'reason {index + 1}', reason) for index, reason in enumerate(remarks(session, stuck=not used))),
        ]
        if state.halted:
            return WARN, state.halted, values
        self.reasons = '; '.join([*explain(session, dropped), *obstacles(session, stuck=not used)])
        lost = dropped.total()
        if not used and self.reasons and heard:
            return ERROR, f'nothing used, {lost} messages dropped since the last report: {self.reasons}', values
        if replaced or lost:
            partly = f' and {replaced.total()} partly used' if replaced else ''
            reasons = '; '.join(filter(None, [self.reasons, *explain(session, replaced)]))
            text = f'{used} samples used, {lost} messages dropped{partly} since the last report: {reasons}'
            return WARN, text, values
        doubtful = doubts(session)
        level = WARN if doubtful or not session.used else OK
        return level, '; '.join([f'{session.used} used', *doubtful]), values

    def _since(self, session: Session) -> tuple[int, Counter[str], Counter[str]]:
        """Return the used samples, dropped and replaced messages since the last call, or since a reset."""
        used, dropped, replaced = session.used, session.dropped, session.replaced
        reset = used < self._used or any(
            now[cause] < count
            for now, before in ((dropped, self._dropped), (replaced, self._replaced))
            for cause, count in before.items()
        )
        if reset:
            self._used, self._dropped, self._replaced = 0, Counter(), Counter()
        recent = used - self._used, dropped - self._dropped, replaced - self._replaced
        self._used, self._dropped, self._replaced = used, dropped, replaced
        return recent


def complaints(session: Session, *, stuck: bool = True) -> list[str]:
    """Return everything that was or is in the way of using messages, one sentence each; `stuck` as of `obstacles`."""
    dropped = (f'messages dropped: {reason}' for reason in explain(session, session.dropped))
    return [*dropped, *obstacles(session, stuck=stuck)]


def remarks(session: Session, *, stuck: bool) -> list[str]:
    """Return the complaints, and the unusable parts of used messages, one sentence each."""
    partly = (f'messages partly used: {reason}' for reason in explain(session, session.replaced))
    return [*complaints(session, stuck=stuck), *partly]


def estimate_report(state: RunState) -> Report:
    """Return the report on the last estimate."""
    estimate, robot = state.estimate, state.session.robot if state.session else None
    if estimate is None:
        return WARN, 'waiting: paused' if state.paused else 'waiting', []
    causes = [cause for cause, _ in estimate.likely_causes[:_CAUSES]]
    noise = estimate.noise.rows() if estimate.noise else []
    values: Values = [
        ('stale', bool(state.stale)),
        ('method', estimate.method),
        ('stage', estimate.stage),
        ('phase', robot.phase if robot else ''),
        ('time (s)', f'{estimate.time:.3f}'),
        ('samples', estimate.samples),
        ('residual', f'{estimate.residual:.3g}'),
        ('identifiable', listing(name for name, known in zip(PARAMETERS, estimate.identifiable, strict=True) if known)),
        *_parameters(estimate),
        *((f'likely cause {index + 1}', cause) for index, cause in enumerate(causes)),
        (NEXT, state.advice),
        (MAIN_CAUSES, '' if estimate.budget is None else estimate.budget.main_causes(estimate.std)),
        (UNOBSERVABLE, '' if estimate.budget is None else estimate.budget.unobservable()),
        ('linear momentum (N s)', numbers(estimate.momentum[:3])),
        ('angular momentum (N m s)', numbers(estimate.momentum[3:])),
        *((f'noise of {name} ({unit})', text) for name, unit, text in noise),
        *((f'warning {index + 1}', warning) for index, warning in enumerate(estimate.warnings)),
    ]
    level = _LEVEL_OF_STATUS[estimate.status]
    text = estimate.status.replace('_', ' ')
    if estimate.warnings:
        text = f'{text}: likely cause: {causes[0]}' if causes else f'{text}: {estimate.warnings[0]}'
        level = max(level, WARN)
    if state.stale:
        return STALE, f'{text}; stale: {state.stale}', values
    return level, text, values


def _parameters(estimate: Estimate) -> Values:
    rows: Values = []
    for name, unit, value, std in zip(PARAMETERS, UNITS, estimate.parameters, estimate.std, strict=True):
        shown, band = rounded(value, std)
        spread = f' +- {band} (95 %)' if band else ''
        rows.append((f'{name} ({unit})', f'{shown}{spread}' if shown else 'not determined'))
    return rows


def numbers(values: Sequence[float] | Array) -> str:
    """Return numbers for /diagnostics, separated by spaces."""
    return ' '.join(f'{value:.6g}' for value in values)


class RunLog:
    """The terminal output of the estimator: each thing once."""

    def __init__(self, log: Any) -> None:
        self._log = log
        self._warned: set[str] = set()
        self.begin()

    def begin(self, *, warned: bool = False) -> None:
        """Begin a run: lines about data may come again, warnings only if not `warned`."""
        if not warned:
            self._warned.clear()
        self._since = monotonic()
        self._status = ''
        self._logged_joints = False
        self._advised: set[str] = {''}

    def robot(self, summary: ModelSummary, method: str) -> None:
        """Log the summary of the robot description."""
        for line in (*summary.lines, f'method {method}'):
            self.event(line)
        for warning in summary.warnings:
            self._log.warning(one_line(warning))

    def joints(self, summary: ModelSummary) -> None:
        """Log, once messages have come, the joints that the robot description lacks."""
        if not self._logged_joints and summary.foreign:
            self.event(f'joints of the messages that the robot description lacks: {listing(summary.foreign)}')
        self._logged_joints = True

    def waiting(self, awaited: Sequence[str]) -> None:
        """Log awaited messages after a while, once for each likely reason; call it regularly."""
        if monotonic() - self._since > PATIENCE:
            for each in awaited:
                self.warn_once(f'waiting for {each}')

    def estimate(self, estimate: Estimate) -> None:
        """Log the first estimate, and each whose status differs from the last one's."""
        self._log.debug(
            f'window to {estimate.time:.3f} s: {estimate.status}, {estimate.samples} samples, residual '
            f'{estimate.residual:.3g}, {_method(estimate)}'
        )
        # Hardly any motion determines anything in its first seconds: no reason for alarm yet.
        early = estimate.status == 'not_identifiable' and estimate.time < PATIENCE and not estimate.contradicted
        if early or estimate.status in {'waiting', self._status}:
            return
        first, self._status = not self._status, estimate.status
        lead = 'first estimate, ' if first else ''
        text = one_line(f'{lead}{estimate.status.replace("_", " ")} after {estimate.time:.1f} s: {headline(estimate)}')
        # One call a level: rclpy ties a line of code to the level of its first call.
        if estimate.status in _ALARMING:
            self._log.warning(text)
        else:
            self._log.info(text)

    def warn_once(self, text: str) -> None:
        """Log a warning, unless it differs from an earlier one only in its numbers."""
        if _is_new(text, self._warned):
            self._log.warning(one_line(text))

    def advice(self, text: str) -> None:
        """Log the most informative motion, once for each joint and parameter."""
        if _is_new(text, self._advised):
            self.event(f'{NEXT}: {text}')

    def event(self, text: str) -> None:
        """Log an event: a reset, a pause, a capture."""
        self._log.info(one_line(text))


def _is_new(text: str, known: set[str]) -> bool:
    """Return whether a text differs from the known ones in more than numbers, and remember it."""
    key, before = _NUMBER.sub('#', text), len(known)
    known.add(key)
    return len(known) > before


def headline(estimate: Estimate) -> str:
    """Return mass and centre of mass with their 95 % bands, the residual, and the likely cause, in a line."""
    parts = []
    for index in range(4):
        value, band = rounded(float(estimate.parameters[index]), float(estimate.std[index]))
        if value:
            parts.append(f'{PARAMETERS[index]} {value}{f" ± {band}" if band else ""} {UNITS[index]}')
    if any('±' in part for part in parts):
        parts.append('± 95 %')
    parts += [f'residual {estimate.residual:.2g}', _method(estimate)]
    if estimate.likely_causes:
        parts.append(f'likely cause: {estimate.likely_causes[0][0]}')
    elif estimate.status in _ALARMING and estimate.warnings:
        parts.append(estimate.warnings[0])
    return ', '.join(parts)


def _method(estimate: Estimate) -> str:
    return estimate.method if estimate.stage in {'', estimate.method} else f'stage {estimate.stage}'
