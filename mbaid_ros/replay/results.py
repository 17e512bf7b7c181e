"""What a replay leads to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from mbaid_ros.core.capture import Capture, Phase
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.publication import Debris
from mbaid_ros.core.sensors.levels import SensorLevels
from mbaid_ros.replay import provenance
from mbaid_ros.session import ModelSummary

HISTORY_LIMIT = 5_000
Record = TypeVar('Record', Estimate, SensorLevels)


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
    survey: ModelSummary | None = None
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
        """Whether the data contradict the model: what comes out, if anything does, must not be trusted."""
        return self.final.contradicted

    @property
    def likeliest(self) -> tuple[tuple[str, float], ...]:
        """What may be wrong where the data contradict the model, the likeliest first, with its log-likelihood."""
        return self.final.likely_causes

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
            self._kept.append(_alone(estimate))
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


def _alone(estimate: Estimate) -> Estimate:
    """Return an estimate to keep: without its error budget, which is told of the last one only, and sharing no memory.

    The numbers of windows that are worked on together are views of arrays of all of them: each would keep all.
    """
    noise = estimate.noise
    return replace(_copied(estimate), budget=None, noise=None if noise is None else _copied(noise))


def _copied(record: Record) -> Record:
    """Return a dataclass with its arrays copied."""
    copies: dict[str, Any] = {name: part.copy() for name, part in vars(record).items() if isinstance(part, np.ndarray)}
    return replace(record, **copies)
