"""Faults that are plain in readings, in their stamps or in the robot description: named before any filter runs.

Stamps are looked at in the order of arrival: batches stamped on arrival, and clocks that were set. No result depends on
how the readings are cut into calls.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from mbaid_ros.core.diagnosis.joint_faults import CHECKS, Found, JointFaults
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.status import Reason, with_reasons
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import BaseStream, JointStream, Stamps

_ZEROS = 10  # poses of zeros, from which tracking had not begun
_HEAVY = 0.01  # share of the robot's mass, from which a link's inertia matters
_POSITION, _ORIENTATION = 1e-3, 1e-4  # m, rad, noise of the base's poses
_REACH = 10.0  # times the robot's size, that no link's radius of gyration reaches
_CERTAIN = 1e6  # log-likelihood that such a cause counts as: more than a filter finds for any other
_AT_ONCE = 300  # readings that are looked at together at most
_SKIPPED = 10  # intervals, before which the mean is not known
_PATTERN = 60  # intervals that show a pattern
_SHORT, _BATCHED = 0.2, 0.4  # part of the mean interval that is short; share of such ones: of random ones it is a fifth
_STEP = 50_000_000  # ns, that a clock is set by at least: less is jitter, or messages that overtake each other
_LONGEST = 200_000_000  # ns between readings around a step: of slower ones the motion is not known
_EVEN = 0.5  # part of the usual interval, that those around a step differ by: others are no regular stamps
_GAP = 5.0  # usual intervals that make a gap
_STEADY, _MISSING = 0.2, 0.3  # part by which the speed changes over a gap, and of its motion that is there at most
_PLAIN = 50.0  # standard deviations that a gap's motion should be at least
_AROUND = 6  # readings that a step is looked at with, before and after


class PlainFaults:
    """Follows joint readings as they arrive, and names faults that need no model.

    Parameters
    ----------
    model : RobotModel
    noise : rad or m, standard deviation of a joint position
    """

    def __init__(self, model: RobotModel, noise: float) -> None:
        self._model, self._noise = model, noise
        self._kinds: dict[tuple[int, ...], tuple[JointFaults, StampPattern]] = {}
        self._waiting: list[tuple[Mapping[tuple[int, ...], JointStream], BaseStream | None]] = []
        self._count = 0  # of these readings
        self._base = StampPattern('the poses of the base', _POSITION)
        self._zeros: int | None = 0  # poses at the begin; None once there are others
        self._found: dict[str, tuple[int, Reason]] = {}  # by symptom: from which stamp on (ns), and the reason
        if described := _inertia(model):
            self.name('inertia', np.iinfo(np.int64).min, described)

    def add(self, streams: Mapping[tuple[int, ...], JointStream], base: BaseStream | None = None) -> None:
        """Take readings (N, k), by the joints that they are of, and of the base, in the order of arrival.

        They are looked at before the next estimate, or when there are many: few cost as much as many.
        """
        self._waiting.append((streams, base))
        self._count += sum(len(each.stamp) for each in (*streams.values(), base) if each is not None)
        if self._count >= _AT_ONCE:
            self._inspect()

    def _inspect(self) -> None:
        """Look at the readings that wait."""
        waiting, self._waiting, self._count = self._waiting, [], 0
        poses = [base for _, base in waiting if base is not None and len(base.stamp)]
        if poses:
            base = BaseStream.concatenate(poses)
            turns = _POSITION / _ORIENTATION * base.rotation.reshape(-1, 9)
            self._name_all(self._base.add(base.stamp, np.concatenate((base.position, turns), axis=1)))
            self._begin(base)
        count = len(self._model.independent_joints)
        for kind in dict.fromkeys(kind for streams, _ in waiting for kind in streams):
            columns = [column for column, joint in enumerate(kind) if joint < count]
            stream = JointStream.concatenate([streams[kind] for streams, _ in waiting if kind in streams])
            if columns and len(stream.stamp):
                if kind not in self._kinds:
                    joints = JointFaults(self._model, [kind[column] for column in columns], self._noise)
                    self._kinds[kind] = joints, StampPattern('the joint states', self._noise)
                joints, stamps = self._kinds[kind]
                own = JointStream(stream.stamp, stream.position[:, columns], stream.velocity[:, columns])
                self._name_all(joints.add(own))
                self._name_all(stamps.add(own.stamp, own.position))

    def applied(self, estimate: Estimate) -> Estimate:
        """Return an estimate with the reasons that were plain by its end, the gravest first."""
        self._inspect()
        reasons = [reason for _, (since, reason) in sorted(self._found.items(), key=_rank) if since <= estimate.stamp]
        if not reasons:
            return estimate
        explained = with_reasons(estimate, reasons[::-1])  # the last one leads the causes
        plain = tuple(reason.text for reason in reasons)
        return replace(explained, warnings=(*plain, *(text for text in explained.warnings if text not in plain)))

    def _begin(self, base: BaseStream) -> None:
        """Look at how poses begin: those of zeros, before what locates the base has seen it, end at once."""
        if self._zeros is None:
            return
        away = np.maximum(np.abs(base.position).max(axis=1), np.abs(base.rotation - np.eye(3)).max(axis=(1, 2)))
        self._zeros += int(np.argmax(away > 0.0)) if away.any() else len(away)
        if away.any():
            first = int(np.argmax(away > 0.0))
            if self._zeros >= _ZEROS and away[first] > _ORIENTATION:
                text = (
                    f'the first {self._zeros} poses of the base are zero: tracking had not begun; read the bag with '
                    '--start, or start the estimator later'
                )
                self.name('zeros', int(base.stamp[first]), text)
            self._zeros = None

    def name(self, symptom: str, since: int, text: str) -> None:
        """Name a fault that is plain from a stamp (ns) on: a cause where anything is wrong."""
        severity = CHECKS[symptom].severity if symptom in CHECKS else 'note'
        if symptom not in self._found or since < self._found[symptom][0]:
            self._found[symptom] = since, Reason(text, severity, _CERTAIN)

    def _name_all(self, found: Iterable[Found]) -> None:
        for each in found:
            self.name(*each)


def _rank(found: tuple[str, tuple[int, Reason]]) -> tuple[bool, int]:
    """Return the order of a symptom: the gravest first, then as in the table."""
    symptom, (_, reason) = found
    return reason.severity == 'note', list(CHECKS).index(symptom) if symptom in CHECKS else -1


def _inertia(model: RobotModel) -> str:
    """Return which link has an inertia that no body of its mass and the robot's size has; empty if none."""
    masses = np.array([link.parameters[0] for link in model.links])
    size = max(float(np.sum(np.linalg.norm(model.positions, axis=1))), 0.1)
    for link, mass in zip(model.links, masses.tolist(), strict=True):
        if mass <= 0.0 or mass < _HEAVY * float(masses.sum()):
            continue
        offset = link.parameters[1:4] / mass
        trace = float(link.parameters[[4, 7, 9]].sum() - 2.0 * mass * offset @ offset)  # of the inertia about the CoM
        if trace <= 1e-12 * mass:
            return f"link '{link.name}' has {mass:.4g} kg and no inertia: correct it in the robot description"
        radius = np.sqrt(0.5 * trace / mass)
        if radius > _REACH * size:
            return (
                f"link '{link.name}' has {mass:.4g} kg and the inertia of a body of {radius:.3g} m: correct its "
                '<inertia> in the robot description'
            )
    return ''


class StampPattern:
    """Follows the stamps of one kind of messages; the result does not depend on how they are cut into calls.

    Parameters
    ----------
    what : the messages, in words
    noise : standard deviation of the positions, rad or m
    """

    def __init__(self, what: str, noise: float) -> None:
        self._what, self._noise = what, noise
        self._first, self._count, self._short = 0, 0, 0
        self._stamp: Stamps = np.zeros(0, dtype=np.int64)
        self._position: Array = np.zeros((0, 0))

    def add(self, stamp: Stamps, position: Array) -> Iterator[Found]:
        """Add readings (N,), (N, k), in the order of arrival; yield the faults of their stamps."""
        if not len(stamp):
            return
        if not self._count:
            self._first, self._position = int(stamp[0]), position[:0]
        begin = self._count - len(self._stamp)  # number of the first of the readings that are kept
        yield from self._batches(stamp)
        self._stamp = np.concatenate((self._stamp, stamp))
        self._position = np.concatenate((self._position, position))
        interval = np.diff(self._stamp)
        usual = np.maximum(_STEP, _GAP * np.concatenate((interval[:1], interval[:-1])))
        for place in np.flatnonzero((interval < -_STEP) | (interval > usual)).tolist():
            if _AROUND - 1 <= place <= len(interval) - _AROUND and begin + place > _PATTERN:
                yield from self._step(place, (int(self._stamp[place]) - self._first) / (begin + place))
        keep = 2 * _AROUND - 1
        self._stamp, self._position = self._stamp[-keep:], self._position[-keep:]

    def _batches(self, stamp: Stamps) -> Iterator[Found]:
        """Yield that most messages are stamped right after each other, and then none for long."""
        joined = np.concatenate((self._stamp[-1:], stamp))
        interval = np.diff(joined)
        number = self._count + 1 + np.arange(len(stamp))  # readings up to each
        mean = (stamp - self._first) / np.maximum(number - 1, 1)
        interval = np.concatenate((np.full(len(stamp) - len(interval), np.iinfo(np.int64).max), interval))
        short = self._short + np.cumsum((interval < _SHORT * mean) & (interval > 0) & (number > _SKIPPED))
        self._count, self._short = int(number[-1]), int(short[-1])
        batched = np.flatnonzero((number > _PATTERN) & (short > _BATCHED * number))
        if len(batched):
            size = 1.0 / max(1.0 - short[batched[0]] / (number[batched[0]] - _SKIPPED), 0.01)
            text = (
                f'{self._what} come in batches of about {size:.0f}, stamped right after each other: stamped on '
                'arrival, not when they were measured; stamp them in the driver'
            )
            yield f'batches: {self._what}', int(stamp[batched[0]]), text

    def _step(self, place: int, usual: float) -> Iterator[Found]:
        """Yield that a clock was set between the reading at a place and the next one; `usual` interval in ns."""
        around = np.diff(self._stamp[place - _AROUND + 1 : place + _AROUND + 1]).astype(float)
        step = float(around[_AROUND - 1])
        around = np.delete(around, _AROUND - 1)
        if np.any(around > _LONGEST) or np.any(np.abs(around - usual) > _EVEN * usual):
            return
        at = 1e-9 * (int(self._stamp[place]) - self._first)
        since = int(max(self._stamp[place], self._stamp[place + _AROUND]))  # windows before a step back are out already
        if step < 0.0:
            back = 1e-9 * (float(np.mean(around)) - step)
            text = (
                f'the stamps of {self._what} went back by {back:.2g} s at {at:.1f} s: a clock was set; readings '
                'stamped twice are left out, later ones are wrong if no other clock was set'
            )
            yield f'set back: {self._what}', since, text
        elif self._goes_on(place, step):
            text = f'the stamps of {self._what} went forward by {1e-9 * step:.2g} s at {at:.1f} s without the motion: '
            yield f'set forward: {self._what}', since, f'{text}a clock was set'

    def _goes_on(self, place: int, step: float) -> bool:
        """Return whether the readings around a gap (ns) move as if it were none."""
        stamp, position = self._stamp.astype(float), self._position
        before, after = (
            (position[one] - position[other]) / (stamp[one] - stamp[other])
            for one, other in ((place, place - _AROUND + 1), (place + _AROUND, place + 1))
        )
        speed = 0.5 * (before + after)
        steady = np.abs(after - before) < _STEADY * np.abs(speed)
        expected = np.abs(speed * step)
        moved = np.abs(position[place + 1] - position[place])
        plain = steady & (expected > _PLAIN * self._noise)
        return bool(np.any(plain)) and bool(np.all(moved[plain] < _MISSING * expected[plain]))
