"""What the estimator says in /diagnostics of the messages that it takes: how many are used, and why others are not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import MAIN_CAUSES, PARAMETERS, UNCHECKED, UNITS, rounded
from mbaid_ros.core.sensors.levels import SensorLevels
from mbaid_ros.nodes.state import State
from mbaid_ros.nodes.watch import NEXT
from mbaid_ros.session import Session, doubts, explain, obstacles

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)

Values = list[tuple[str, object]]
Report = tuple[bytes, str, Values]


class SampleReport:
    """Tells what has become of the messages since it told the last time.

    Attributes
    ----------
    reasons : why messages of the time before the last report were not used; empty: they were, or none came
    """

    def __init__(self) -> None:
        self.reasons = ''
        self._used = 0
        self._dropped: Counter[str] = Counter()
        self._replaced: Counter[str] = Counter()

    def of(self, state: State, *, heard: bool) -> Report:
        """Return the report; `heard` is whether anything has come since the last one."""
        session = state.session
        values: Values = [(f'not taken, {reason}', count) for reason, count in sorted(state.ignored.items())]
        self.reasons = ''
        if session is None:
            return WARN, 'no sample can be used without a robot description', values
        since = self._since(session)
        values += [
            ('used', session.used),
            *((f'dropped, {cause}', count) for cause, count in sorted(session.dropped.items())),
            *((f'not used wholly, {cause}', count) for cause, count in sorted(session.replaced.items())),
        ]
        values += [(f'reason {index + 1}', reason) for index, reason in enumerate(remarks(session))]
        if session.problem:
            return ERROR, session.problem, values
        if state.halted:
            return WARN, state.halted, values
        used, dropped, replaced = since
        self.reasons = '; '.join([*explain(session, dropped), *obstacles(session)])
        return (*self._told(session, used, dropped.total(), replaced, heard=heard), values)

    def _since(self, session: Session) -> tuple[int, Counter[str], Counter[str]]:
        """Return what has been used, dropped and replaced since the last call, or since the session began anew."""
        used, dropped, replaced = session.used, session.dropped, session.replaced
        restarted = used < self._used or any(
            now[cause] < count
            for now, before in ((dropped, self._dropped), (replaced, self._replaced))
            for cause, count in before.items()
        )
        if restarted:
            self._used, self._dropped, self._replaced = 0, Counter(), Counter()
        recent = used - self._used, dropped - self._dropped, replaced - self._replaced
        self._used, self._dropped, self._replaced = used, dropped, replaced
        return recent

    def _told(
        self, session: Session, used: int, lost: int, replaced: Counter[str], *, heard: bool
    ) -> tuple[bytes, str]:
        """Return level and message from what has been used, lost and replaced since the last report."""
        if not used and self.reasons and heard:
            return ERROR, f'nothing used, {lost} messages dropped since the last report: {self.reasons}'
        if replaced:
            reasons = '; '.join(filter(None, [self.reasons, *explain(session, replaced)]))
            told = f'{used} samples used, {lost} messages dropped and {replaced.total()} not used wholly'
            return WARN, f'{told} since the last report: {reasons}'
        if lost:
            return WARN, f'{used} samples used, {lost} messages dropped since the last report: {self.reasons}'
        doubtful = doubts(session)
        return WARN if doubtful or not session.used else OK, '; '.join([f'{session.used} used', *doubtful])


def complaints(session: Session) -> list[str]:
    """Return everything that was or is in the way of using messages, one sentence each."""
    return [*(f'messages dropped: {reason}' for reason in explain(session, session.dropped)), *obstacles(session)]


def remarks(session: Session) -> list[str]:
    """Return complaints, and what of messages that were used was not, one sentence each."""
    partly = (f'messages not used wholly: {reason}' for reason in explain(session, session.replaced))
    return [*complaints(session), *partly]


_CAUSES = 3  # that are told

_LEVEL_OF_STATUS = {
    'waiting': WARN,
    'estimating': OK,
    'converged': OK,
    'not_identifiable': WARN,
    'inconsistent': ERROR,
}


def estimate_report(state: State) -> Report:
    """Return what is to be told of the last estimate."""
    estimate = state.estimate
    if estimate is None:
        return WARN, f'waiting: {state.halted.partition(":")[0]}' if state.halted else 'waiting', []
    causes = [cause for cause, _ in estimate.likely_causes[:_CAUSES]]
    values: Values = [
        ('stale', bool(state.stale)),
        ('method', estimate.method),
        ('stage', estimate.stage),
        ('phase', state.session.robot.phase if state.session else ''),
        ('known bodies', (state.session.robot.calibrated if state.session else '') or 'as in the robot description'),
        ('time (s)', f'{estimate.time:.3f}'),
        ('samples', estimate.samples),
        ('residual', f'{estimate.residual:.3g}'),
        ('identifiable', listing(name for name, known in zip(PARAMETERS, estimate.identifiable, strict=True) if known)),
        *_parameters(estimate),
        *((f'likely cause {index + 1}', cause) for index, cause in enumerate(causes)),
        (NEXT, state.advice),
        *_plan(state),
        (MAIN_CAUSES, '' if estimate.budget is None else estimate.budget.told(estimate.std)),
        (UNCHECKED, '' if estimate.budget is None else estimate.budget.resting()),
        ('linear momentum (N s)', numbers(estimate.momentum[:3])),
        ('angular momentum (N m s)', numbers(estimate.momentum[3:])),
        *_noise(estimate.noise),
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


def _plan(state: State) -> Values:
    """Return what the motion on ~/motion comes to."""
    if state.plan is None:
        return []
    reached, verdict = state.plan
    return [('plan reaches what is wanted', reached), ('plan', verdict)]


def _noise(levels: SensorLevels | None) -> Values:
    """Return how noisy each sensor is declared to be, and how noisy its readings are."""
    if levels is None:
        return []
    return [(f'noise of {name} ({unit})', text) for name, unit, text in levels.shown()]


def _parameters(estimate: Estimate) -> Values:
    rows: Values = []
    for name, unit, value, std in zip(PARAMETERS, UNITS, estimate.parameters, estimate.std, strict=True):
        shown, band = rounded(value, std)
        spread = f' +- {band} (95 %)' if band else ''
        rows.append((f'{name} ({unit})', f'{shown}{spread}' if shown else 'not determined'))
    return rows


def numbers(values: Sequence[float] | Array) -> str:
    """Return numbers as they are told, apart from each other by a space."""
    return ' '.join(f'{value:.6g}' for value in values)
