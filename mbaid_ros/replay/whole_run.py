"""The result of a replay, its check on data that were not used, and its sources: estimates and times of arrival."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mbaid_ros.core.capture import Capture
from mbaid_ros.core.filter.posterior import Posterior
from mbaid_ros.core.results.estimate import CapturePhase, Estimate
from mbaid_ros.core.samples import Stamps
from mbaid_ros.core.target import Debris
from mbaid_ros.session.explanation import SensorRow
from mbaid_ros.session.model_summary import ModelSummary

HISTORY_LIMIT = 5_000
DEFAULT_FRACTION = 0.2  # of a run, that the report predicts from the rest
LONG_ENOUGH = 59.0  # s: in a fifth of a shorter run there are too few windows for a ratio to within a tenth
# Times the standard deviation: beyond it the model does not predict, below it the noise is not as large as specified.
_FAR, _NEAR = 1.5, 0.5


@dataclass(frozen=True)
class TopicStatistics:
    """The messages of a topic: full names, number, and rate in Hz (NaN for fewer than two)."""

    topic: str
    type: str
    messages: int
    rate: float


def topic_statistics(topic: str, type_name: str, messages: int, span: float) -> TopicStatistics:
    """Return the statistics of a topic, of a number of messages within a time, s."""
    return TopicStatistics(topic, type_name, messages, (messages - 1) / span if span > 0.0 else float('nan'))


@dataclass(frozen=True)
class Holdout:
    """How well the model predicts data that the estimate had not seen."""

    fraction: float  # of the run, at its end, that is predicted
    begin: float  # s since the first sample, of that part
    # error of the prediction over its standard deviation, root mean square; NaN where the rest leads to no solution, or
    # the target changes afterwards, or the run contradicts its model and the unknowns have adapted
    ratio: float
    contradicted: bool = False  # whether the run contradicts its model

    @property
    def sentence(self) -> str:
        """Return it in one line."""
        what = f'holdout: the last {100.0 * self.fraction:.3g} %, predicted from the rest'
        if math.isnan(self.ratio):
            why = 'the model is contradicted' if self.contradicted else f'no one solution from {self.begin:.3g} s on'
            return f'{what}: not judged, {why}'
        if self.ratio > _FAR:
            meaning = 'the model does not predict them'
        else:
            meaning = 'the model predicts them' if self.ratio > _NEAR else 'the noise is smaller than specified'
        return f'{what}: errors {self.ratio:.2f} times their standard deviation (1 is ideal); {meaning}'


def holdout_of(history: Sequence[Estimate], fraction: float) -> Holdout | None:
    """Return how well the last part of a run is predicted from the rest; None of an empty run.

    Innovations are independent where the model is right, so the sum of their normalised squares over the last windows
    is the squared distance of all those data together from their prediction by the estimate before them. What acts by
    a mechanism, as the slope of a table, is predicted with; a random walk is not, as it follows anything. The unknowns
    of a wrong robot adapt as well: it then predicts, so of a run that contradicts its model no small ratio is given.

    Parameters
    ----------
    history : estimates of method `trajectory`, in order
    fraction : of the run
    """
    if not history:
        return None
    last = history[-1]
    begin = (1.0 - fraction) * last.time
    before = max((each for each in history if each.time <= begin), key=lambda each: each.time, default=None)
    changed = any(event.kind == 'target_changed' and event.time > begin for event in last.events)
    if before is None or changed or before.innovations.shape != last.innovations.shape or not last.innovations.size:
        return Holdout(fraction, begin, math.nan, last.contradicted)
    squares, count = (last.innovations - before.innovations).T
    ratio = float(np.sqrt(np.min(squares / count))) if np.all(count > 0.0) and np.all(squares > 0.0) else math.nan
    adapted = last.contradicted and ratio <= _FAR
    return Holdout(fraction, begin, math.nan if adapted else ratio, last.contradicted)


@dataclass(frozen=True)
class Run:
    """The result of replaying a bag."""

    bag: str  # path as the user gave it
    target_link: str  # link whose inertia was identified
    final: Estimate
    history: tuple[Estimate, ...]  # estimates in order, thinned evenly to at most HISTORY_LIMIT
    topics: tuple[TopicStatistics, ...]  # the inputs
    used: int  # number of samples the estimator was given
    dropped: Mapping[str, int]  # messages that were not used, by cause
    warnings: tuple[str, ...]  # of the bag and of the run, one line each
    urdf: str = ''  # text of the robot description
    settings: Mapping[str, object] = field(default_factory=dict)  # every parameter of the estimator with its value
    debris: Debris | None = None  # the captured body alone, None where not asked for or not determined
    phase: CapturePhase = 'post_capture'  # in which the bag ends
    capture: Capture | None = None
    missing_joints: tuple[str, ...] = ()  # for want of which most of the joint states could not be used
    model_summary: ModelSummary | None = None  # the model summary, None where there is none
    made_by: dict[str, Any] | None = None  # `provenance.made_by`
    # SHA-256 of each file of the bag, by its name; None for one that is too large
    files: Mapping[str, str | None] = field(default_factory=dict)
    posterior: Posterior | None = None  # from which the next motion is planned; None where the method has none
    advice: str = ''  # the motion that would help most, in words; empty where none is needed or known
    holdout: Holdout | None = None  # how well the rest predicts the last part of the run; None where not asked for
    sensors: tuple[SensorRow, ...] = ()  # that measure the base

    @property
    def reached(self) -> bool:
        """Whether there is an estimate: at least one parameter is determined."""
        return self.final.status != 'waiting' and bool(np.any(self.final.identifiable))

    @property
    def assumption(self) -> str:
        """What no data can show: momentum is conserved in any unit of mass.

        Empty without numbers, or where a weighing, thrust or the momentum of wheels gives the unit.
        """
        given = ('known_links.total_mass', 'known_links.calibration', 'wheels.names', 'wheels.momentum_frame')
        scaled = any(self.settings.get(name) for name in given) or bool(np.any(self.final.impulse != 0.0))
        if self.model_summary is None or not self.reached or self.contradicted or scaled:
            return ''
        return (
            f'mass and inertia are in proportion to the {self.model_summary.mass:.6g} kg of the robot description: '
            'weigh the robot, and set known_links.total_mass'
        )

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the model, so that no number must be trusted."""
        return self.final.contradicted

    @property
    def all_warnings(self) -> list[str]:
        """Every warning once: the estimator's first, but after what most messages of a run without numbers lack."""
        starved = not self.reached and max(self.dropped.values(), default=0) > self.used
        both = (self.warnings, self.final.warnings) if starved else (self.final.warnings, self.warnings)
        return list(dict.fromkeys((*both[0], *both[1])))


class History:
    """The estimates of a run of any length, thinned evenly to at most `limit`, in bounded memory.

    Times that go back are those of another run, as after stamps that jump back: it begins anew.
    """

    def __init__(self, limit: int = HISTORY_LIMIT) -> None:
        self._limit = limit
        self._clear()

    def _clear(self) -> None:
        self._stride = 1
        self._count = 0
        self._kept: list[Estimate] = []
        self._ends_with_last = False  # whether the last one is among these
        self.last: Estimate | None = None

    def add(self, estimate: Estimate) -> None:
        """Take the next estimate."""
        if self.last is not None and estimate.time < self.last.time:
            self._clear()
        self._ends_with_last = self._count % self._stride == 0
        if self._ends_with_last:
            self._kept.append(_compact(estimate))
            if len(self._kept) > self._limit:
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


def _compact(estimate: Estimate) -> Estimate:
    """Return an estimate without error budget and noise, with copied arrays: views would keep those of all windows."""
    copies: dict[str, Any] = {
        name: part.copy() for name, part in vars(estimate).items() if isinstance(part, np.ndarray)
    }
    return replace(estimate, **copies, budget=None, noise=None)


class Arrivals:
    """The number of messages of a topic, and when the first and the last one were recorded, ns."""

    def __init__(self) -> None:
        self.count, self._first, self._last = 0, 0, 0

    def add(self, times: Stamps) -> None:
        """Take the times of messages, (N,) ns."""
        if len(times):
            self._first = self._first if self.count else int(times[0])
            self.count, self._last = self.count + len(times), int(times[-1])

    @property
    def span(self) -> float:
        """Time from the first message to the last, s."""
        return 1e-9 * (self._last - self._first)
