"""Faults that are plain in the readings or in the robot description: found before any filter runs, and named first.

`CHECKS` has a row for each symptom. Its test returns the first reading at which the symptom is certain, with one line
for the user. The result does not depend on how the readings are cut into calls.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.diagnosis.stamps import StampPattern
from mbaid_ros.core.geometry import Array, Flags, Integers
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.status import Reason, Severity, with_reasons
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import BaseStream, JointStream, Stamps

_FEWEST = 10  # readings with a symptom, from which it is no accident
_SOURCES = 0.02  # share of readings from another source: single outliers, which are dropped, are fewer
_SPIKE = 50.0  # standard deviations, and times the motion over two readings, of a step to another source and back
_QUARTER = 0.5 * np.pi  # rad between two readings: of a half turn the direction is not known
_FAR = 1000.0  # rad, that no arm turns by, in degrees neither
_MOST_STEPS = 0.5  # share of such steps: outliers and turns of wrapped angles are fewer
_COARSE = 10.0  # rad or m, range of whole numbers from which they are no positions
_HEAVY = 0.01  # share of the robot's mass, from which a link's inertia matters
_POSITION = 1e-3  # m, noise of the base's position, at most
_REACH = 10.0  # times the robot's size, that no link's radius of gyration reaches
_CERTAIN = 1e6  # log-likelihood that such a cause counts as: more than a filter finds for any other


@dataclass
class _Readings:
    """The readings of one kind of message: the latest two, and the findings of earlier ones."""

    joints: tuple[int, ...]
    stamps: StampPattern
    last: Array | None = None
    count: int = 0
    spikes: int = 0
    whole: Flags | None = None
    range: tuple[Array, Array] | None = None
    rates: bool = False  # whether the latest ones have velocities
    fast: Integers | None = None  # steps of more than a quarter turn, by joint


class PlainFaults:
    """Follows joint readings as they arrive, and names faults that need no model.

    Parameters
    ----------
    model : RobotModel
    noise : rad or m, standard deviation of a joint position
    """

    def __init__(self, model: RobotModel, noise: float) -> None:
        self._model, self._noise = model, noise
        self._kinds: dict[tuple[int, ...], _Readings] = {}
        self._base = StampPattern('the poses of the base', _POSITION)
        described = _inertia(model)
        self._found: dict[str, tuple[int, Reason]] = {}  # by symptom: from which stamp on (ns), and the reason
        if described:
            self._found['inertia'] = (np.iinfo(np.int64).min, Reason(described, 'note', _CERTAIN))

    def add(self, streams: Mapping[tuple[int, ...], JointStream], base: BaseStream | None = None) -> None:
        """Add readings (N, k), by the joints that they are of, and of the base, in the order of arrival."""
        if base is not None and len(base.stamp):
            self._follow(self._base, base.stamp, base.position)
        count = len(self._model.independent_joints)
        for kind, stream in streams.items():
            columns = [column for column, joint in enumerate(kind) if joint < count]
            if columns:
                own = tuple(kind[column] for column in columns)
                readings = self._kinds.setdefault(kind, _Readings(own, StampPattern('the joint states', self._noise)))
                readings.rates |= bool(np.isfinite(stream.velocity[:, columns]).any())
                self._check(readings, stream.stamp, stream.position[:, columns])
                self._follow(readings.stamps, stream.stamp, stream.position[:, columns])

    def applied(self, estimate: Estimate) -> Estimate:
        """Return an estimate with the reasons that were plain by its end, the gravest first."""
        reasons = [reason for since, reason in self._found.values() if since <= estimate.stamp]
        if not reasons:
            return estimate
        explained = with_reasons(estimate, reasons)
        plain = tuple(reason.text for reason in reasons)
        return replace(explained, warnings=(*plain, *(text for text in explained.warnings if text not in plain)))

    def _follow(self, pattern: StampPattern, stamp: Stamps, position: Array) -> None:
        """Look at the stamps; wrong ones are a cause where anything is wrong."""
        for symptom, since, text in pattern.add(stamp, position):
            self._found.setdefault(symptom, (since, Reason(text, 'note', _CERTAIN)))

    def _check(self, readings: _Readings, stamp: Stamps, position: Array) -> None:
        joined = position if readings.last is None else np.concatenate((readings.last, position))
        for symptom, (severity, check) in CHECKS.items():
            if symptom not in self._found:
                place, text = check(self._model, self._noise, readings, joined, len(position))
                if text:
                    self._found[symptom] = (int(stamp[place]), Reason(text, severity, _CERTAIN))
        lowest, highest = _range(readings, position)
        readings.range = lowest[-1], highest[-1]
        readings.count += len(position)
        readings.last = joined[-2:]


Check = Callable[[RobotModel, float, _Readings, Array, int], tuple[int, str]]


def _two_sources(model: RobotModel, noise: float, readings: _Readings, joined: Array, new: int) -> tuple[int, str]:
    """Test for readings far from both neighbours, which agree with each other: another publisher's."""
    if len(joined) < 3:
        return 0, ''
    step = np.diff(joined, axis=0)
    slides = np.array(model.prismatic)[model.transmission.independent[list(readings.joints)]]
    step -= np.where(slides, 0.0, 2.0 * np.pi * np.round(step / (2.0 * np.pi)))  # angles may be wrapped
    there, back = step[:-1], step[1:]
    counts = joined == np.round(joined)  # of an encoder, which flip by one
    spike = np.minimum(np.abs(there), np.abs(back)) > _SPIKE * (noise + np.abs(there + back))
    spike &= ~(counts[:-2] & counts[1:-1] & counts[2:])
    late = min(new, len(spike))  # each spike is known with the reading after it
    seen = readings.spikes + np.cumsum(np.any(spike[-late:], axis=1))
    readings.spikes = int(seen[-1])
    number = readings.count + new - late + 1 + np.arange(late)
    certain = np.flatnonzero((seen >= _FEWEST) & (seen >= _SOURCES * number))
    if not len(certain):
        return 0, ''
    row = len(spike) - late + int(certain[0])
    joint = int(np.argmax(np.abs(there[row]) * spike[row])) if spike[row].any() else int(np.argmax(np.abs(there[row])))
    name, unit = _named(model, readings, joint)
    return new - late + int(certain[0]), (
        f'joint states come from two sources that contradict each other, {name} by {abs(there[row, joint]):.2g} '
        f'{unit}: stop one of the publishers, or give each a topic of its own'
    )


def _range(readings: _Readings, position: Array) -> tuple[Array, Array]:
    """Return the lowest and highest of all readings up to each of the new ones, (N, k)."""
    low, high = readings.range or (position[0], position[0])
    return np.minimum(np.minimum.accumulate(position), low), np.maximum(np.maximum.accumulate(position), high)


def _ticks(model: RobotModel, _noise: float, readings: _Readings, joined: Array, new: int) -> tuple[int, str]:
    """Test for whole numbers over a wide range: counts of an encoder, or degrees."""
    position = joined[len(joined) - new :]
    whole = np.ones(position.shape[1], dtype=bool) if readings.whole is None else readings.whole
    wholes = np.logical_and.accumulate((position == np.round(position)) & whole, axis=0)
    lowest, highest = _range(readings, position)
    readings.whole = wholes[-1]
    wide = wholes & (highest - lowest > _COARSE)
    enough = (readings.count + 1 + np.arange(new) >= _FEWEST)[:, None]
    places = np.flatnonzero(np.any(wide & enough, axis=1))
    if not len(places):
        return 0, ''
    row = int(places[0])
    joint = int(np.argmax(wide[row]))
    name, unit = _named(model, readings, joint)
    return row, (
        f'{name} reads whole numbers, from {lowest[row, joint]:.0f} to {highest[row, joint]:.0f}: encoder ticks or '
        f'degrees, not {unit}; convert them in the driver'
    )


def _too_fast(model: RobotModel, _noise: float, readings: _Readings, joined: Array, new: int) -> tuple[int, str]:
    """Test for joints without a velocity that turn by more than a quarter from one reading to the next."""
    if readings.rates or len(joined) < 2:  # wrapped readings stay within a turn, those of wheels go on and on
        return 0, ''
    step = np.diff(joined, axis=0)
    slides = np.array(model.prismatic)[model.transmission.independent[list(readings.joints)]]
    wrapped = step - 2.0 * np.pi * np.round(step / (2.0 * np.pi))
    before = np.zeros(step.shape[1], dtype=np.int64) if readings.fast is None else readings.fast
    late = min(new, len(step))
    extent = np.subtract(*_range(readings, joined[-late:])[::-1])
    turns = ((np.abs(wrapped[-late:]) > _QUARTER) & (extent < 2.0 * np.pi)) | (
        (np.abs(step[-late:]) > np.pi) & (extent > _FAR)
    )
    fast = before + np.cumsum(turns & ~slides, axis=0)
    readings.fast = fast[-1]
    number = (readings.count + new - late + 1 + np.arange(late))[:, None]
    certain = (fast >= _FEWEST) & (fast > _MOST_STEPS * number)
    places = np.flatnonzero(np.any(certain, axis=1))
    if not len(places):
        return 0, ''
    row = int(places[0])
    name, _ = _named(model, readings, int(np.argmax(certain[row])))
    return new - late + row, (
        f'{name} turns by more than a quarter from one reading to the next: how far is not known without its velocity; '
        'publish velocities, or read it more often'
    )


# By symptom: how grave it is, and its test. Readings that contradict each other make any estimate inconsistent.
CHECKS: Mapping[str, tuple[Severity, Check]] = {
    'two sources': ('conflict', _two_sources),
    'ticks': ('conflict', _ticks),
    'too fast': ('conflict', _too_fast),
}


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


def _named(model: RobotModel, readings: _Readings, column: int) -> tuple[str, str]:
    """Return name and unit of the joint in a column of readings."""
    joint = readings.joints[column]
    slides = model.prismatic[model.transmission.independent[joint]]
    return model.independent_joints[joint], 'm' if slides else 'rad'
