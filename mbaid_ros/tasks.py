"""Background work of a session: tasks in a fixed order, done in slices, taken over at fixed windows."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property
from typing import Any, TypeVar

Outcome = TypeVar('Outcome')
Work = Generator[int, None, Outcome]  # yields the cost of each piece, in steps of the filter; returns the outcome
SLICE = 30  # steps of the filter, about, in one slice: a few milliseconds
AT_ONCE = 10**9  # steps of a computation without limit
_STATE_SIZE = 96  # numbers of the state, for as many of which a step costs one more


class Kind(Enum):
    """Kinds of background work, in the order in which they run."""

    FIRST_STAGE = auto()
    NONLINEARITY = auto()
    NEWTON_STEP = auto()
    SEARCH = auto()
    CAUSES = auto()


@dataclass(eq=False)
class _Task:
    """A computation, and what follows from its outcome."""

    work: Work[Any]
    done: Callable[[Any], object]  # takes the outcome over
    cost: int  # of a step, for each that the computation counts
    budget: int  # steps left before the next window
    due: bool  # whether the next window needs what the budget pays for
    outcome: tuple[Any, ...] = ()  # of a computation that is over

    def run_slice(self) -> None:
        """Run one slice of the budget."""
        done = 0
        try:
            while done < min(self.budget, SLICE):
                done += self.cost * next(self.work)
        except StopIteration as end:
            self.outcome = (end.value,)
        self.budget = 0 if self.outcome else max(self.budget - done, 0)


class Tasks:
    """The background work of one estimator: at most one computation of each kind.

    Call `run_slice` between windows or not at all: `finish_due` completes what the next window needs.
    """

    def __init__(self) -> None:
        self._tasks: dict[Kind, _Task] = {}

    def begin(
        self,
        kind: Kind,
        work: Work[Outcome],
        done: Callable[[Outcome], object],
        *,
        size: int = 0,
        steps: int = 0,
        due: bool = True,
    ) -> None:
        """Begin a computation instead of any other of its kind.

        Parameters
        ----------
        done : takes its outcome over
        size : of the state; steps of a large one count more
        steps : budget until the next window
        due : whether that window needs them; otherwise `require` sets when the outcome is needed
        """
        self._tasks[kind] = _Task(work, done, 1 + size // _STATE_SIZE, steps, due)

    def cancel(self, *kinds: Kind) -> None:
        """Give up the computations of these kinds."""
        for kind in kinds:
            self._tasks.pop(kind, None)

    def is_under_way(self, kind: Kind) -> bool:
        """Return whether the outcome of a computation is still to come."""
        return kind in self._tasks

    def allot_steps(self, steps: int, *kinds: Kind) -> None:
        """Set the budget of these kinds until the next window."""
        for kind in kinds:
            if kind in self._tasks:
                self._tasks[kind].budget = steps

    def require(self, kind: Kind) -> None:
        """Let the next window need the outcome of a computation."""
        if kind in self._tasks:
            self._tasks[kind].due = True

    def run_slice(self) -> bool:
        """Run a slice of the first kind that has steps left; return whether any are left before the next window."""
        self._advance(lambda task: task.budget > 0)
        return any(task.budget > 0 for task in self._tasks.values())

    def finish_due(self) -> None:
        """Complete the work that the next window needs, and take its outcomes over."""
        while self._advance(lambda task: task.due and (task.budget > 0 or bool(task.outcome))):
            pass

    def _advance(self, which: Callable[[_Task], bool]) -> bool:
        """Run a slice of the first of these computations, and take its outcome over if that is due; whether any is."""
        kind = next((kind for kind in Kind if kind in self._tasks and which(self._tasks[kind])), None)
        if kind is None:
            return False
        task = self._tasks.pop(kind)  # a computation that raises is over
        task.run_slice()
        if task.outcome and task.due:
            task.done(task.outcome[0])
        else:
            self._tasks[kind] = task
        return True


def outcome_or_none(work: Work[Outcome], error: type[Exception]) -> Work[Outcome | None]:
    """Return the outcome of a computation; None where it raises this error."""
    with suppress(error):
        return (yield from work)
    return None


class Method:
    """What a method of identification has unless it has its own: no background work, and no posterior."""

    @cached_property
    def tasks(self) -> Tasks:
        """Its background work."""
        return Tasks()

    def posterior(self) -> None:
        """Return no posterior."""
        return
