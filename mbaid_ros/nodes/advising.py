"""What motion would help most, looked at now and then while the node runs."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

from mbaid_ros.nodes.state import State

_PERIOD = 5.0  # s, from one look to the next, at least
_SHARE = 0.01  # of the time that looks may take


class Advising:
    """Keeps what motion would help most in what the node knows.

    A look takes some hundredths of a second, and leaves the estimates as they are.

    Parameters
    ----------
    state : what the node knows
    tell : what is told of each advice, in a line
    """

    def __init__(self, state: State, tell: Callable[[str], None]) -> None:
        self._state = state
        self._tell = tell
        self._due = 0.0

    def look(self) -> None:
        """Look, if it is time to; call it when the estimates of a window have been told and nothing waits."""
        begin = monotonic()
        if begin < self._due:
            return
        self._state.advice = self._found()
        self._tell(self._state.advice)
        end = monotonic()
        self._due = end + max(_PERIOD, (end - begin) / _SHARE)

    def _found(self) -> str:
        session, estimate = self._state.session, self._state.estimate
        knowledge = None if session is None else session.knowledge()
        if session is None or knowledge is None or estimate is None or estimate.contradicted:
            return ''
        from mbaid_ros.session.planning import advice  # noqa: PLC0415 - takes a while, and is not needed to begin

        return advice(session.config, knowledge)
