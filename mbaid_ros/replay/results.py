"""The result of a replay, and its sources: estimates, times of arrival, the last pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from mbaid_ros.cdr import Packets
from mbaid_ros.core.capture.known_momentum import Capture
from mbaid_ros.core.geometry import Array, rotation_from_quaternion
from mbaid_ros.core.results.estimate import CapturePhase, Estimate
from mbaid_ros.core.results.published_inertia import Debris
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.samples import Stamps
from mbaid_ros.core.sensors.levels import SensorLevels
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.messages.fields import joint_state_shape, odometry_shape, positions_of
from mbaid_ros.replay import provenance
from mbaid_ros.replay.holdout import Holdout
from mbaid_ros.session.model_summary import ModelSummary

HISTORY_LIMIT = 5_000
Record = TypeVar('Record', Estimate, SensorLevels)

_NAME_LISTS = 64  # of joints, of which the last message is kept


@dataclass(frozen=True)
class TopicStatistics:
    """The messages of a topic: full names, number, and rate in Hz (NaN for fewer than two)."""

    topic: str
    type: str
    messages: int
    rate: float


@dataclass(frozen=True)
class Pose:
    """Rotation (3, 3) base to odometry axes, position (3,) m of the base, and joint positions (n,) of the model."""

    base_rotation: Array
    base_position: Array
    joint_position: Array


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
    pose: Pose | None = None  # the last one, None where the bag holds none
    settings: Mapping[str, object] = field(default_factory=dict)  # every parameter of the estimator with its value
    debris: Debris | None = None  # the captured body alone, None where not asked for or not determined
    phase: CapturePhase = 'post_capture'  # in which the bag ends
    capture: Capture | None = None
    missing_joints: tuple[str, ...] = ()  # for want of which most of the joint states could not be used
    survey: ModelSummary | None = None  # the model summary, None where there is none
    made_by: provenance.MadeBy | None = None
    # SHA-256 of each file of the bag, by its name; None for one that is too large
    files: Mapping[str, str | None] = field(default_factory=dict)
    posterior: Posterior | None = None  # from which the next motion is planned; None where the method has none
    advice: str = ''  # the motion that would help most, in words; empty where none is needed or known
    holdout: Holdout | None = None  # how well the rest predicts the last part of the run; None where not asked for

    @property
    def reached(self) -> bool:
        """Whether there is an estimate: at least one parameter is determined."""
        return self.final.status != 'waiting' and bool(np.any(self.final.identifiable))

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the model, so that no number must be trusted."""
        return self.final.contradicted

    @property
    def all_warnings(self) -> list[str]:
        """Every warning once, the estimator's first."""
        return list(dict.fromkeys((*self.final.warnings, *self.warnings)))


class History:
    """A sequence of estimates of any length, thinned evenly to at most `limit`, in bounded memory."""

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
            self._kept.append(_compact(estimate))
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


def _compact(estimate: Estimate) -> Estimate:
    """Return an estimate without its error budget, whose arrays are copies: views would keep those of all windows."""
    noise = estimate.noise
    return replace(_copied(estimate), budget=None, noise=None if noise is None else _copied(noise))


def _copied(record: Record) -> Record:
    copies: dict[str, Any] = {name: part.copy() for name, part in vars(record).items() if isinstance(part, np.ndarray)}
    return replace(record, **copies)


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

    def statistics(self, topic: str, type_name: str, messages: int) -> TopicStatistics:
        """Return the statistics of a topic whose bag claims a number of messages."""
        rate = (messages - 1) / self.span if self.span > 0.0 else float('nan')
        return TopicStatistics(topic, type_name, messages, rate)


class LastPose:
    """The last pose of a robot in a stream of messages, unsynchronised: each joint's and the base's last reading."""

    def __init__(self, model: RobotModel, prefix: str = '') -> None:
        self._model = model
        self._carriers = {prefix + link.name: link for link in model.links if link.body == 0}
        self._joint_state: dict[tuple[str, ...], Any] = {}  # the last message of each list of names
        self._odometry: Any = None

    def add_joint_states(self, messages: Sequence[Any]) -> None:
        """Take JointStates in order, of all joints or of some."""
        last = {joint_state_shape(message): message for message in _ends(messages)}
        for shape, message in last.items():
            if shape.names in self._joint_state or len(self._joint_state) < _NAME_LISTS:
                self._joint_state[shape.names] = message

    def add_odometry(self, messages: Sequence[Any]) -> None:
        """Take Odometry in order, of the base link or of links fixed to it."""
        own = (message for message in reversed(_ends(messages)) if self._carrier(message) is not None)
        self._odometry = next(own, self._odometry)

    def _carrier(self, odometry: Any) -> Link | None:
        return self._carriers.get(odometry_shape(odometry).child_frame_id.lstrip('/'))

    def pose(self) -> Pose | None:
        """Return the pose, None while a joint or the base has none."""
        positions: dict[str, float] = {}
        for message in self._joint_state.values():
            positions.update(positions_of(message))
        link = None if self._odometry is None else self._carrier(self._odometry)
        angles = self._model.positions_from(positions)
        if link is None or not np.all(np.isfinite(angles)):
            return None
        numbers = odometry_shape(self._odometry).columns([self._odometry])[1][0]
        position, quaternion = numbers[:3], numbers[3:7]
        if not np.all(np.isfinite(position)) or not np.all(np.abs(quaternion) < 2.0):
            return None
        if not 0.5 < np.sum(quaternion**2) < 2.0:
            return None
        rotation = rotation_from_quaternion(quaternion) @ link.rotation.T
        return Pose(rotation, position - rotation @ link.position, angles)


def _ends(messages: Sequence[Any]) -> Sequence[Any]:
    """Return of messages in order those that may be the last of their shape; packets together have one shape."""
    return messages[-1:] if isinstance(messages, Packets) else messages
