"""What the estimator says in /diagnostics of the messages that it takes: how many are used, and why others are not."""

from __future__ import annotations

from collections import Counter

from diagnostic_msgs.msg import DiagnosticStatus

from mbaid_ros.nodes.state import State
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
