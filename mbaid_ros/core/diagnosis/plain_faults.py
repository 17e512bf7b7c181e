"""Faults that are plain in the readings or in the robot description: found before any filter runs, and named first.

`CHECKS` has a row for each symptom: how grave it is, the share of a joint's readings that show it, its test and its
words. The result does not depend on how the readings are cut into calls.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mbaid_ros.core.diagnosis.stamps import Found, StampPattern
from mbaid_ros.core.geometry import Array, Flags, Integers
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.status import Reason, Severity, with_reasons
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import BaseStream, JointStream, Stamps
from mbaid_ros.core.sensors.turns import steps_of

_FEWEST = 10  # readings with a symptom, from which it is no accident
_SOURCES = 0.02  # share of readings from another source: single outliers, which are dropped, are fewer
_SPIKE = 50.0  # standard deviations, and times the motion over two readings, of a step to another source and back
_BETWEEN = 1.5  # times the interval before, that readings around one of another source are apart: else one is missing
_LATEST = 3  # readings that are kept: a spike shows with those around it, and their intervals with the one before
_STEP = 20.0  # standard deviations of a step after repeats: those of a coarse encoder are smaller
_QUARTER = 0.5 * np.pi  # rad between two readings: of a half turn the direction is not known
_AGREE = 1.0  # rad, that a wheel's step may differ from its velocity times the interval
_ROUND, _TURNING = 6.2, 0.05  # rad, a turn but for a reading's step, and the least step of a wheel that turns on and on
_WRAPPED = 2.1 * np.pi  # rad, range of wrapped angles at most
_FAR = 1000.0  # rad, that no arm turns by, in degrees neither
_MOST_STEPS = 0.5  # share of steps of a quarter turn: outliers and turns of wrapped angles are fewer
_COARSE = 10.0  # rad or m, range of whole numbers from which they are no positions
_BEYOND, _LONG = 2.0, 1.0  # times its limits that no joint reaches; m, that a prismatic one reads in millimetres
_HEAVY = 0.01  # share of the robot's mass, from which a link's inertia matters
_POSITION, _ORIENTATION = 1e-3, 1e-4  # m, rad, noise of the base's poses
_REACH = 10.0  # times the robot's size, that no link's radius of gyration reaches
_CERTAIN = 1e6  # log-likelihood that such a cause counts as: more than a filter finds for any other


@dataclass
class _Readings:
    """The readings of one kind of message: the latest ones, and what earlier ones have shown."""

    names: tuple[str, ...]
    slides: Flags  # whether each joint is prismatic
    wheels: Flags  # whether each turns without limits
    bounds: Array  # rad or m, far beyond the limits of each joint
    stamps: StampPattern
    last: JointStream | None = None
    count: int = 0
    shown: dict[str, Integers] = field(default_factory=dict)  # by symptom, how many of each joint's readings show it
    range: tuple[Array, Array] | None = None


@dataclass(frozen=True)
class _View:
    """The latest readings of k joints, with those before them: N in all, of which `new` are new."""

    stamp: Stamps
    position: Array  # (N, k)
    velocity: Array  # (N, k) NaN where none is given
    new: int
    lowest: Array  # (N, k) of all readings until each
    highest: Array
    slides: Flags
    wheels: Flags
    bounds: Array
    noise: float

    @cached_property
    def steps(self) -> tuple[Array, Array, Array]:
        """As of `steps_of`, (N - 1, k)."""
        return steps_of(JointStream(self.stamp, self.position, self.velocity))

    @cached_property
    def step(self) -> Array:
        """From each reading to the next, (N - 1, k); of wrapped angles the shorter way, of wheels off the velocity."""
        step, expected, _ = self.steps
        goes_on = self.slides | ((self.highest - self.lowest)[1:] > _WRAPPED)
        wheel = self.wheels & (np.abs(expected) > _QUARTER)
        return np.where(wheel, _shorter(step - expected), np.where(goes_on, step, _shorter(step)))

    @cached_property
    def spikes(self) -> tuple[Flags, Flags]:
        """As of `_spikes`, (N - 3, k) each."""
        return _spikes(self)


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
        self._zeros: int | None = 0  # poses at the begin; None once there are others
        self._found: dict[str, tuple[int, Reason]] = {}  # by symptom: from which stamp on (ns), and the reason
        if described := _inertia(model):
            self.name('inertia', np.iinfo(np.int64).min, described)

    def add(self, streams: Mapping[tuple[int, ...], JointStream], base: BaseStream | None = None) -> None:
        """Add readings (N, k), by the joints that they are of, and of the base, in the order of arrival."""
        found: list[Found] = []
        if base is not None and len(base.stamp):
            turns = _POSITION / _ORIENTATION * base.rotation.reshape(-1, 9)
            found += self._base.add(base.stamp, np.concatenate((base.position, turns), axis=1))
            self._begin(base)
        count = len(self._model.independent_joints)
        for kind, stream in streams.items():
            columns = [column for column, joint in enumerate(kind) if joint < count]
            if columns and len(stream.stamp):
                own = JointStream(stream.stamp, stream.position[:, columns], stream.velocity[:, columns])
                readings = self._kinds.setdefault(kind, self._nothing([kind[column] for column in columns]))
                self._check(readings, own)
                found += readings.stamps.add(own.stamp, own.position)
        for each in found:
            self.name(*each)

    def applied(self, estimate: Estimate) -> Estimate:
        """Return an estimate with the reasons that were plain by its end, the gravest first."""
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
            if self._zeros >= _FEWEST and away[first] > _ORIENTATION:
                text = (
                    f'the first {self._zeros} poses of the base are zero: tracking had not begun; read the bag with '
                    '--start, or start the estimator later'
                )
                self.name('zeros', int(base.stamp[first]), text)
            self._zeros = None

    def _nothing(self, joints: list[int]) -> _Readings:
        own = self._model.transmission.independent[joints]
        slides, wheels = (np.array(each, dtype=bool)[own] for each in (self._model.prismatic, self._model.continuous))
        limits = np.array([max(-each.lower, each.upper) for each in self._model.limits])[own]
        names = tuple(self._model.independent_joints[joint] for joint in joints)
        bounds = np.maximum(_BEYOND * limits, np.where(slides, _LONG, _WRAPPED))
        return _Readings(names, slides, wheels, bounds, StampPattern('the joint states', self._noise))

    def name(self, symptom: str, since: int, text: str) -> None:
        """Name a fault that is plain from a stamp (ns) on: a cause where anything is wrong."""
        self._found.setdefault(symptom, (since, Reason(text, 'note', _CERTAIN)))

    def _check(self, readings: _Readings, stream: JointStream) -> None:
        """Look at the positions; a symptom is certain at the reading that makes it frequent enough."""
        joined = stream if readings.last is None else stream.concatenate((readings.last, stream))
        low, high = readings.range or (joined.position[0], joined.position[0])
        lowest = np.minimum(np.minimum.accumulate(joined.position), low)
        highest = np.maximum(np.maximum.accumulate(joined.position), high)
        own = readings.slides, readings.wheels, readings.bounds, self._noise
        view = _View(joined.stamp, joined.position, joined.velocity, len(stream.stamp), lowest, highest, *own)
        for symptom, (severity, share, shows, words) in CHECKS.items():
            flags = shows(view)[-view.new :]
            seen = readings.shown.get(symptom, 0) + np.cumsum(flags, axis=0)
            number = readings.count + view.new - len(flags) + 1 + np.arange(len(flags))[:, None]
            certain = (seen >= _FEWEST) & (seen >= share * number)
            if symptom == 'ticks':
                certain &= (highest - lowest)[-view.new :] > _COARSE
            if len(flags):
                readings.shown[symptom] = seen[-1]
            if symptom not in self._found and np.any(certain):
                row = int(np.argmax(np.any(certain, axis=1)))
                place = len(joined.stamp) - len(flags) + row
                joint = int(np.argmax(certain[row]))
                unit = 'm' if readings.slides[joint] else 'rad'
                text = words(view, place, joint).format(name=readings.names[joint], unit=unit)
                self._found[symptom] = (int(joined.stamp[place]), Reason(text, severity, _CERTAIN))
        readings.count += view.new
        readings.range, readings.last = (lowest[-1], highest[-1]), joined[-_LATEST:]


def _spikes(view: _View) -> tuple[Flags, Flags]:
    """Return readings far from both neighbours, which agree with each other: of another source, and wrong ones.

    Those of another publisher come between the readings, wrong ones in place of one. They are known with the reading
    after them; the rows (N - 3, k) are of these.
    """
    if len(view.stamp) <= _LATEST:
        none = np.zeros((0, view.position.shape[1]), dtype=bool)
        return none, none
    there, back = view.step[:-1], view.step[1:]
    counts = view.position == np.round(view.position)  # of an encoder, which flip by one
    spike = np.minimum(np.abs(there), np.abs(back)) > _SPIKE * (view.noise + np.abs(there + back))
    spike &= ~(counts[:-2] & counts[1:-1] & counts[2:])
    spike &= ~(view.wheels & np.isnan(view.velocity[1:-1]))  # how far they turn is not known
    around, before = view.stamp[3:] - view.stamp[1:-2], view.stamp[1:-2] - view.stamp[:-3]
    # Where two sources send by turns, the reading before is a spike, too.
    between = ((around < _BETWEEN * before) | np.any(spike[:-1], axis=1))[:, None]
    return spike[1:] & between, spike[1:] & ~between


def _held(view: _View) -> Flags:
    """Return readings that are new after repeats while other joints were new; coarse encoders have small steps."""
    new = np.diff(view.position, axis=0) != 0.0
    far = (np.abs(view.step[2:]) > _STEP * view.noise) & (view.position[3:] != np.round(view.position[3:]))
    return np.asarray(far & new[2:] & ~new[1:-1] & ~new[:-2] & np.any(new[1:-1], axis=1, keepdims=True))


def _by(view: _View, place: int, joint: int) -> str:
    """Return the largest recent step of a joint."""
    return f'{np.max(np.abs(view.step[max(place - _LATEST, 0) : place, joint])):.2g}'


def _fast(view: _View) -> Flags:
    """Return steps of more than a quarter turn, of joints without a velocity, or that their velocity contradicts."""
    if len(view.stamp) < 2:
        return np.zeros((0, view.position.shape[1]), dtype=bool)
    # Wrapped readings stay within a turn, those of wheels go on and on.
    extent = (view.highest - view.lowest)[1:]
    step, expected, change = view.steps
    wrapped = np.abs(_shorter(step))
    turns = ((wrapped > _QUARTER) & (extent < _WRAPPED)) | ((np.abs(step) > np.pi) & (extent > _FAR))
    differs = view.wheels & (np.abs(expected) > _QUARTER) & (np.abs(_shorter(step - expected)) + change > _AGREE)
    return np.asarray(np.where(np.isnan(expected), turns & ~view.slides, differs))


def _turning(view: _View) -> Flags:
    """Return steps of wheels without a velocity: by whole turns more or less they would look the same."""
    unknown = view.wheels & np.isnan(view.velocity[1:]) & ((view.highest - view.lowest)[1:] > _ROUND)
    return np.asarray(unknown & (np.abs(view.step) > _TURNING))


def _shorter(angle: Array) -> Array:
    """Return angles without whole turns."""
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def _why_fast(view: _View, place: int, joint: int) -> str:
    """Return why the turns of a joint are not known."""
    if np.isnan(view.velocity[place, joint]):
        return (
            '{name} turns by more than a quarter from one reading to the next: how far is not known without its '
            'velocity; publish velocities, or read it more often'
        )
    return (
        'the velocity of {name} contradicts its positions, and it turns by more than a quarter from one reading to the '
        'next: correct one of the two; if the velocity is right, name it in wheels.names, not as a joint'
    )


Shows = Callable[[_View], Flags]
Words = Callable[[_View, int, int], str]  # of a view, the place of a reading and a joint
# By symptom. Readings that contradict each other make any estimate inconsistent.
CHECKS: Mapping[str, tuple[Severity, float, Shows, Words]] = {
    'two sources': (
        'conflict',
        _SOURCES,
        lambda view: view.spikes[0],
        lambda *at: (
            f'joint states come from two sources that contradict each other, {{name}} by {_by(*at)} {{unit}}: stop one '
            'of the publishers, or give each a topic of its own'
        ),
    ),
    'wrong values': (
        'note',
        _SOURCES,
        lambda view: view.spikes[1],
        lambda *at: (
            f'joint states hold wrong values now and then, {{name}} by {_by(*at)} {{unit}}, which are left out: look '
            'at the driver'
        ),
    ),
    'held': (
        'note',
        _SOURCES,
        _held,
        lambda *_: '{name} repeats its readings while other joints have new ones: read it as often as the others',
    ),
    'ticks': (
        'conflict',
        1.0,
        lambda view: np.asarray(view.position == np.round(view.position)),
        lambda view, place, joint: (
            f'{{name}} reads whole numbers, from {view.lowest[place, joint]:.0f} to {view.highest[place, joint]:.0f}: '
            'encoder ticks or degrees, not {unit}; convert them in the driver'
        ),
    ),
    'too fast': (
        'conflict',
        _MOST_STEPS,
        _fast,
        _why_fast,
    ),
    'no velocity': (
        'note',
        _MOST_STEPS,
        _turning,
        lambda *_: (
            '{name} turns on and on without a velocity, and may turn faster than its positions show: publish its '
            'velocity'
        ),
    ),
    'limits': (
        'conflict',
        _MOST_STEPS,
        lambda view: (np.abs(view.position) > view.bounds) & (view.position != np.round(view.position)),
        lambda view, place, joint: (
            f'{{name}} reads {view.position[place, joint]:.3g}, far beyond its limits in the robot description: '
            'degrees, millimetres or encoder ticks, not {unit}? Convert them in the driver'
        ),
    ),
}


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
