"""Faults of joint readings: ticks, degrees, swapped, reversed, stuck and loose joints, jumps, wrong velocities."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from mbaid_ros.core.contracts import Convention, converted
from mbaid_ros.core.geometry import Array, Flags, Integers
from mbaid_ros.core.joints.stream import position_steps
from mbaid_ros.core.noise import LeastSteps, white_noise
from mbaid_ros.core.repair import Conversion, Repair, Setting, widened
from mbaid_ros.core.results.verdict import Reason, Severity
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import JointStream, Samples, Stamps
from mbaid_ros.core.windows import Window
from mbaid_ros.errors import listing

_FEWEST_READINGS = 6  # samples of a window, for their noise
_PART = 0.5  # of the motion, by positions or velocities, from which a difference is no filter's or stamp's
_MOVES = 5e-4  # rad or m, from which the motion in a window counts: less are steps of an encoder, or a filter's tail
_FAR_FROM_RATE = 7.0  # standard deviations of the difference, from which it is no noise
_SURE_OF_JOINTS = 3  # windows, from which the velocities are wrong all along
_MOST = 0.25  # share of the windows with motion, that contradict at least then
_MOST_PAIRS = 12  # joints, up to which all pairs (66) are tried: of twenty they are nearly two hundred
_TURN = 2.0 * np.pi  # rad, which the readings of an arm hardly reach: in degrees they go further
_SAME = 1e-12  # rad or m, by which means of equal numbers differ: rounding
_LISTED = 3  # times that are listed: a line holds no more
Stretches = tuple[tuple[float, float], ...]  # s, begin and end of each
# The declared noise, so many times: all joints are tried with the first, the likeliest with the others. Where little is
# unexplained, a swing that has died down, fewer.
LARGE_SWING, SMALL_SWING = (30.0, 10.0, 100.0), (3.0, 2.0, 10.0)
_FEWEST_SAMPLES = 12  # samples of a window: fewer have too few differences of fourth order for a median
_FEWEST = 10  # readings with a symptom, from which it is no accident
_SOURCES = 0.02  # share of readings from another source: single outliers, which are dropped, are fewer
_SPIKE = 50.0  # standard deviations, and times the motion over two readings, of a step to another source and back
_BETWEEN = 1.5  # times the interval before, that readings around one of another source are apart: else one is missing
_LATEST = 3  # readings that are kept: a spike shows with those around it, and their intervals with the one before
_STEP = 20.0  # standard deviations of a jump, or of a step after repeats: those of a coarse encoder are smaller
_QUARTER = 0.5 * np.pi  # rad between two readings: of a half turn the direction is not known
_AGREE = 1.0  # rad, that a wheel's step may differ from its velocity times the interval
_ROUND, _TURNING = 6.2, 0.05  # rad, a turn but for a reading's step, and the least step of a wheel that turns on and on
_WRAPPED = 2.1 * np.pi  # rad, range of wrapped angles at most
_FAR = 1000.0  # rad, that no arm turns by, in degrees neither
_MOST_STEPS = 0.5  # share of steps of a quarter turn: outliers and turns of wrapped angles are fewer
_COARSE = 10.0  # rad or m, range of whole numbers from which they are no positions
_MILLIMETRE = 1e-3  # m: a unit
_BEYOND, _LONG = 2.0, 1.0  # times its limits that no joint reaches; m, that a prismatic one reads in millimetres


class JointRates:
    """Leaves out joint velocities that contradict the positions.

    Parameters
    ----------
    names : of the joints
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._wrong = np.zeros(len(self._names), dtype=np.int64)  # windows that contradict, by joint
        self._moved = np.zeros(len(self._names), dtype=np.int64)  # windows in which a joint moves
        self._left_out: Flags = np.zeros(len(self._names), dtype=bool)
        self._zero: Flags = np.ones(len(self._names), dtype=bool)  # whether the velocity was zero all along

    def with_valid_rates(self, window: Samples) -> Samples:
        """Return the next window, without velocities that are no rates."""
        position, velocity, time = window.joint_position, window.joint_velocity, window.time
        if len(window) < _FEWEST_READINGS or not velocity.shape[1] or window.missing_rates[0]:
            return window
        turned = _path(time, velocity)
        paths = np.concatenate((position, turned, position - turned), axis=1)
        moved, turned, apart = np.std(paths, axis=0).reshape(3, -1)
        size = np.maximum(moved, turned)
        read, of_rates = white_noise(np.concatenate((position, velocity), axis=1), 2).reshape(2, -1)
        noise = np.hypot(read, (time[-1] - time[0]) / (len(time) - 1) * np.sqrt(len(window)) * of_rates)
        moves = size > np.maximum(_FAR_FROM_RATE * noise, _MOVES)
        wrong = moves & (apart > np.maximum(_FAR_FROM_RATE * noise, _PART * size))
        self._wrong += wrong
        self._moved += moves
        self._zero &= turned == 0.0
        if wrong.any():
            self._left_out |= (self._wrong >= _SURE_OF_JOINTS) & (self._wrong > _MOST * self._moved)
        if wrong.any() or self._left_out.any():
            return replace(window, joint_velocity=np.full_like(velocity, np.nan))
        return window

    def reason(self) -> Reason | None:
        """Return which velocities contradict the positions; None where none do."""
        wrong = self._left_out
        if not wrong.any():
            return None
        names = listing(name for name, each in zip(self._names, wrong, strict=True) if each)
        how = 'zero while the positions change' if np.all(self._zero[wrong]) else 'no rates of the positions'
        return Reason(
            f'the velocities of {names} are {how}: velocities are taken from the positions; correct the driver'
        )


def _path(time: Array, rate: Array) -> Array:
    """Return the integral of a rate (N, k) since the first of N times (trapezoid)."""
    steps = 0.5 * np.diff(time)[:, None] * (rate[1:] + rate[:-1])
    return np.concatenate((np.zeros((1, rate.shape[1])), np.cumsum(steps, axis=0)))


def reversed_joints(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield each joint with the other sign."""
    names, read = kernel.model.joint_names, kernel.model.independent_joints
    for name in names:
        text, repair = f'the sign of {name} is wrong: reverse it in the driver or the URDF', None
        change: Callable[[Array], Array] = partial(np.multiply, [-1.0 if each == name else 1.0 for each in names])
        if name in read:
            change = _of_readings(kernel, partial(np.multiply, [-1.0 if each == name else 1.0 for each in read]))
            repair = converted(text, Conversion(factors={name: -1.0}))
        yield Convention(text, kernel, partial(_joints, change=change), repair=repair)


def swapped_joints(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield each pair of joints, the one in the place of the other."""
    names, count = kernel.model.independent_joints, len(kernel.model.independent_joints)
    for one, other in combinations(range(count), 2) if count <= _MOST_PAIRS else ():
        swapped = np.arange(count, dtype=np.int64)
        swapped[[one, other]] = other, one
        text = f'{names[one]} and {names[other]} are swapped: check the names in the joint states'
        repair = converted(text, Conversion(columns={names[one]: names[other], names[other]: names[one]}))
        change = _of_readings(kernel, partial(np.take, indices=swapped, axis=1))
        yield Convention(text, kernel, partial(_joints, change=change), repair=repair)


def _of_readings(kernel: MomentumKernel, change: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Return a change of the joints that are read as one of all joints: others may mimic them."""
    moved = kernel.model.transmission
    return change if moved.direct else lambda position: moved.positions(change(position[:, moved.independent]))


def joints_in_degrees(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield joint positions in degrees; none for a robot that only slides, which reads the same in either unit."""
    independent = kernel.model.transmission.independent
    degrees = np.where(np.array(kernel.model.prismatic, dtype=bool)[independent], 1.0, np.deg2rad(1.0))
    if np.any(degrees != 1.0):
        text = 'the joint positions are in degrees: in ROS they are in radians'
        names = kernel.model.independent_joints
        turning = {name: float(factor) for name, factor in zip(names, degrees, strict=True) if factor != 1.0}
        repair = converted(text, Conversion(factors=turning))
        change = partial(_joints, change=_of_readings(kernel, partial(np.multiply, degrees)))
        yield Convention(text, kernel, change, joint_range=_TURN, repair=repair)


def _joints(windows: Sequence[Window], change: Callable[[Array], Array]) -> list[Window]:
    """Return windows with other joint positions."""
    return [
        replace(each, knots=replace(each.knots, joint_position=change(each.knots.joint_position))) for each in windows
    ]


def without(windows: Sequence[Window], spoilt: Flags) -> list[Window]:
    """Return windows without spoilt ones (W,) and their neighbours; nothing links the next one to those before."""
    left = ~(spoilt | np.append(spoilt[1:], False) | np.append(False, spoilt[:-1]))
    return [
        replace(window, after_gap=window.after_gap or (place > 0 and not left[place - 1]))
        for place, window in enumerate(windows)
        if left[place]
    ]


def stopped_readings(
    windows: Sequence[Window], joints: Sequence[str], read: Sequence[int] | None = None
) -> list[tuple[str, list[Window], Stretches]]:
    """Return which joint stands still to the bit in some windows while others move, the other windows, and when.

    The joint that stands still longest comes first. `read` are the indices of those with readings of their own, None
    of all; `joints` their names.
    """
    own = slice(None) if read is None else list(read)
    moved = [np.ptp(window.knots.joint_position[:, own], axis=0) for window in windows]
    still = np.array([each <= _SAME for each in moved])  # False of NaN
    rest = still.all(axis=1)  # the robot may be at rest
    still[rest] = False
    still &= ~still[~rest].all(axis=0)  # passive, locked or parked
    found = [place for place in np.argsort(-still.sum(axis=0), kind='stable') if still[:, place].any()]
    return [_stopped(windows, still[:, place], joints[place]) for place in found]


def _stopped(windows: Sequence[Window], still: Flags, joint: str) -> tuple[str, list[Window], Stretches]:
    groups = groupby(enumerate(still.tolist()), key=itemgetter(1))
    places = [[place for place, _ in group] for stands, group in groups if stands]
    length = windows[0].length
    # The windows beside them may have a part of it.
    stretches = tuple((windows[each[0]].start - length, windows[each[-1]].start + 2.0 * length) for each in places)
    times = [f'{begin + length:.1f} to {end - length:.1f}' for begin, end in stretches]
    listed = ', '.join(times[:_LISTED]) + (' and more' if len(times) > _LISTED else '')
    text = f'the reading of {joint} repeats from {listed} s: check its encoder or driver'
    return text, without(windows, still), stretches


def swinging(windows: Sequence[Window], joint: int, times: float, joints: int) -> list[Window]:
    """Return windows in which one of so many joints' readings is so many times as noisy."""
    larger = np.where(np.arange(joints) == joint, times, 1.0)
    return [
        replace(window, noise=replace(window.noise, joint_position=larger * window.noise.joint_position))
        for window in windows
    ]


def loose_joint_text(joint: str, windows: Sequence[Window], times: float) -> str:
    """Return the cause that a joint's load swings against its encoder, with that many times the declared noise."""
    return (
        f'{joint} is flexible or has play: its load swings by about {1e3 * swing_size(windows, times):.1g} mrad (mm) '
        'relative to its encoder; check both'
    )


def swing_size(windows: Sequence[Window], times: float) -> float:
    """Return by how much a window's mean is off, one standard deviation, with that many times the declared noise."""
    noise = [window.noise for window in windows]
    return times * float(np.mean([np.max(each.joint_position) / np.sqrt(each.samples) for each in noise]))


def joint_noise_factor(windows: Sequence[Samples], declared: float, joints: Sequence[int]) -> float:
    """Return how many times as noisy as specified, rad, the joints are by their samples; NaN where not known.

    `joints` are the indices of those that are read.
    """
    read = list(joints)
    found = [white_noise(window.joint_position[:, read], 4) for window in windows if len(window) >= _FEWEST_SAMPLES]
    return float(np.median(found)) / declared if np.size(found) else np.nan


class JointFaults:
    """The joints of one kind of message: what they are like, the latest readings, and what earlier ones have shown."""

    def __init__(self, model: RobotModel, joints: Sequence[int], noise: float) -> None:
        own = model.transmission.independent[joints]
        self.noise = noise
        self.slides, self.wheels = (np.array(each, dtype=bool)[own] for each in (model.prismatic, model.continuous))
        limits = np.array([max(-each.lower, each.upper) for each in model.limits])[own]
        self.bounds = np.maximum(_BEYOND * limits, np.where(self.slides, _LONG, _WRAPPED))  # far beyond the limits
        self.names = tuple(model.independent_joints[joint] for joint in joints)
        self._last: JointStream | None = None
        self._count, self.first = 0, 0  # readings so far, and ns, stamp of the first
        self._shown: dict[str, Integers] = {}  # by symptom, how many of each joint's readings show it
        self._range: tuple[Array, Array] | None = None
        self.rows, self.jumped = 0, np.zeros(len(joints))  # number and sum of `_View.jump` until now
        self._steps = LeastSteps(len(joints))

    def add(self, stream: JointStream) -> Iterator[tuple[str, int, str, Repair | None]]:
        """Add readings; yield the symptoms that are frequent enough, each from the reading on that makes it so.

        As of `Found`, with how a run takes each into account, where it can.
        """
        joined = stream if self._last is None else stream.concatenate((self._last, stream))
        self.first = self.first if self._count else int(stream.stamp[0])
        low, high = self._range or (joined.position[0], joined.position[0])
        lowest = np.minimum(np.minimum.accumulate(joined.position), low)
        highest = np.maximum(np.maximum.accumulate(joined.position), high)
        quantum, new = self._steps.add(joined.position, len(stream.stamp)), len(stream.stamp)
        view = _View(self, joined.stamp, joined.position, joined.velocity, lowest, highest, quantum)
        for symptom, check in CHECKS.items():
            flags = check.shows(view)[-new:]
            if not flags.any():  # what is not frequent enough without them is not with them
                continue
            seen = self._shown.get(symptom, 0) + np.cumsum(flags, axis=0)
            number = self._count + new - len(flags) + 1 + np.arange(len(flags))[:, None]
            certain = (seen >= check.fewest) & (seen >= check.share * number)
            certain &= (highest - lowest)[-len(flags) :] >= check.extent
            self._shown[symptom] = seen[-1]
            if np.any(certain):
                row = int(np.argmax(np.any(certain, axis=1)))
                place, joint = len(joined.stamp) - len(flags) + row, int(np.argmax(certain[row]))
                text = check.text.format(
                    name=self.names[joint],
                    unit='m' if self.slides[joint] else 'rad',
                    by=np.max(np.abs(view.step[max(place - _LATEST, 0) : place, joint]), initial=0.0),
                    value=joined.position[place, joint],
                    lowest=lowest[place, joint],
                    highest=highest[place, joint],
                    time=1e-9 * (int(joined.stamp[place]) - self.first),
                    quantum=view.quantum[place - len(joined.stamp), joint],
                )
                repair = None if check.repair is None else check.repair(view, place, joint)
                yield symptom, int(joined.stamp[place]), text, repair
        self._count += new
        self.rows, self.jumped = self.rows + len(view.jump), self.jumped + np.sum(view.jump, axis=0)
        self._range, self._last = (lowest[-1], highest[-1]), joined[-_LATEST:]


@dataclass(frozen=True)
class _View:
    """The latest readings of k joints, with those before them: N in all."""

    joints: JointFaults
    stamp: Stamps
    position: Array  # (N, k)
    velocity: Array  # (N, k) NaN where none is given
    lowest: Array  # (N, k) of all readings until each
    highest: Array
    quantum: Array  # (N - 1, k) at most, step of a coarse encoder until each of the latest; 0: none

    @cached_property
    def whole(self) -> Flags:
        """Which readings are whole numbers, (N, k)."""
        return np.asarray(self.position == np.round(self.position))

    @cached_property
    def extent(self) -> Array:
        """The range of all readings until each but the first, (N - 1, k)."""
        return (self.highest - self.lowest)[1:]

    @cached_property
    def steps(self) -> tuple[Array, Array, Array]:
        """As of `position_steps`, (N - 1, k)."""
        return position_steps(JointStream(self.stamp, self.position, self.velocity))

    @cached_property
    def step(self) -> Array:
        """From each reading to the next, (N - 1, k); of wrapped angles the shorter way, of wheels off the velocity."""
        step, expected, _ = self.steps
        goes_on = self.joints.slides | (self.extent > _WRAPPED)
        wheel = self.joints.wheels & (np.abs(expected) > _QUARTER)
        return np.where(wheel, _shorter(step - expected), np.where(goes_on, step, _shorter(step)))

    @cached_property
    def jump(self) -> Array:
        """By how much a step differs from those before and after it, size, (N - 3, k)."""
        return np.asarray(np.abs(self.step[1:-1] - 0.5 * (self.step[:-2] + self.step[2:])))

    @cached_property
    def spikes(self) -> tuple[Flags, Flags]:
        """Readings far from both neighbours, which agree with each other: of another source, and wrong ones.

        Those of another publisher come between the readings, wrong ones in place of one. They are known with the
        reading after them; the rows (N - 3, k) are of these.
        """
        if len(self.stamp) <= _LATEST:
            return self.whole[:0], self.whole[:0]
        there, back, counts = self.step[:-1], self.step[1:], self.whole
        spike = np.minimum(np.abs(there), np.abs(back)) > _SPIKE * (self.joints.noise + np.abs(there + back))
        spike &= ~(counts[:-2] & counts[1:-1] & counts[2:])  # those of an encoder flip by one
        spike &= ~(self.joints.wheels & np.isnan(self.velocity[1:-1]))  # how far they turn is not known
        around, before = self.stamp[3:] - self.stamp[1:-2], self.stamp[1:-2] - self.stamp[:-3]
        # Where two sources send by turns, the reading before is a spike, too.
        between = ((around < _BETWEEN * before) | np.any(spike[:-1], axis=1))[:, None]
        return spike[1:] & between, spike[1:] & ~between


def _held(view: _View) -> Flags:
    """Return readings that are new after repeats while other joints were new; coarse encoders have small steps."""
    new = np.diff(view.position, axis=0) != 0.0
    far = (np.abs(view.step[2:]) > _STEP * view.joints.noise) & ~view.whole[3:]
    held = far & new[2:] & ~new[1:-1] & ~new[:-2] & np.any(new[1:-1], axis=1, keepdims=True)
    return np.asarray(held & (view.quantum[len(view.quantum) - len(far) :] == 0.0))


def _stepped(view: _View) -> Flags:
    """Return the changes of coarse encoders with steps far larger than the noise."""
    changes = (view.step[2:] != 0.0) & ~view.whole[3:] & ~view.joints.wheels
    return np.asarray(changes & (view.quantum[len(view.quantum) - len(changes) :] > _STEP * view.joints.noise))


def _jumps(view: _View) -> Flags:
    """Return readings after a step between two that go on as before: known with the next, rows (N - 3, k)."""
    before, after, jump = view.step[:-2], view.step[2:], view.jump
    # The noise may be larger than declared. Jumps of a coarse encoder are less than two and a half of its steps, and it
    # stands still before and after many.
    number = view.joints.rows + 1 + np.arange(len(jump))[:, None]
    usual = np.maximum(view.joints.noise, (view.joints.jumped + np.cumsum(jump, axis=0)) / number)
    far = (jump > _STEP * usual) & (jump > 2.5 * np.maximum(np.abs(before), np.abs(after)))
    interval = np.diff(view.stamp)
    even = (interval[1:-1] < _BETWEEN * interval[:-2]) & (interval[1:-1] < _BETWEEN * interval[2:])
    return np.asarray(far & (before != 0.0) & (after != 0.0) & even[:, None] & ~view.joints.wheels)


def _fast(view: _View) -> Flags:
    """Return steps of more than a quarter turn, of joints without a velocity."""
    step, expected, _ = view.steps
    # Wrapped readings stay within a turn, those of wheels go on and on.
    turns = (np.abs(_shorter(step)) > _QUARTER) & (view.extent < _WRAPPED)
    turns |= (np.abs(step) > np.pi) & (view.extent > _FAR)
    return np.asarray(turns & np.isnan(expected) & ~view.joints.slides)


def _contradicted(view: _View) -> Flags:
    """Return steps of wheels that their velocity contradicts."""
    step, expected, change = view.steps
    differs = (np.abs(expected) > _QUARTER) & (np.abs(_shorter(step - expected)) + change > _AGREE)
    return np.asarray(view.joints.wheels & differs)


def _turning(view: _View) -> Flags:
    """Return steps of wheels without a velocity: by whole turns more or less they would look the same."""
    unknown = view.joints.wheels & np.isnan(view.velocity[1:]) & (view.extent > _ROUND)
    return np.asarray(unknown & (np.abs(view.step) > _TURNING))


def _shorter(angle: Array) -> Array:
    """Return angles without whole turns."""
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def _jumped(view: _View, place: int, joint: int) -> Repair:
    """Return the readings after a jump as if it were none, up to the noise; it is known with the reading at a place."""
    step = view.step[:, joint]
    size = float(step[place - 2] - 0.5 * (step[place - 3] + step[place - 1]))
    name, unit = view.joints.names[joint], 'm' if view.joints.slides[joint] else 'rad'
    since = int(view.stamp[place - 1])
    noise = float(np.sqrt(5.0)) * view.joints.noise  # of the size: four readings, by .5, 1.5, 1.5 and .5
    return Repair(
        f'the reading of {name} jumps by {1e3 * size:+.3g} m{unit}',
        {f'known_joints.{name}.tracking_std': widened(noise)},
        Conversion(steps=((name, since, size),)),
        value=size,
        std=noise,
        unit=unit,
        since=1e-9 * (since - view.joints.first),
    )


def _encoder(view: _View, place: int, _joint: int) -> Repair:
    """Return joints with coarse encoders, as they show until a reading, as far from theirs as steps make them."""
    names, step = view.joints.names, view.quantum[place - len(view.stamp)]
    far = np.flatnonzero(step > _STEP * view.joints.noise)
    size = float(np.max(step[far], initial=0.0))
    wider: dict[str, Setting] = {
        f'known_joints.{names[each]}.tracking_std': widened(float(step[each]) / np.sqrt(12.0)) for each in far
    }
    return Repair(f'joints are read in steps of up to {1e3 * size:.2g} mrad (mm)', wider, value=size)


def _other_unit(view: _View, _place: int, joint: int) -> Repair:
    """Return turning joints as in degrees, or a sliding one as in millimetres."""
    names, slides = view.joints.names, view.joints.slides
    if slides[joint]:
        conversion = Conversion(factors={names[joint]: _MILLIMETRE})
        return Repair(f'{names[joint]} is in millimetres', conversion=conversion)
    turning = {name: float(np.deg2rad(1.0)) for name, slide in zip(names, slides.tolist(), strict=True) if not slide}
    return Repair('the joint positions are in degrees', conversion=Conversion(factors=turning))


class Check(NamedTuple):
    """A symptom of joint readings. Those that contradict each other make any estimate inconsistent."""

    severity: Severity
    share: float  # of a joint's readings, that show it at least
    shows: Callable[[_View], Flags]  # which readings, or steps, the latest last
    text: str  # in words
    extent: float = 0.0  # least range of the joint's readings, rad or m
    fewest: int = _FEWEST  # readings that show it
    # How a run takes it into account, by the readings, the one that makes it certain, and the joint.
    repair: Callable[[_View, int, int], Repair] | None = None


CHECKS: Mapping[str, Check] = {
    'two sources': Check(
        'conflict',
        _SOURCES,
        lambda view: view.spikes[0],
        'joint states come from two sources that contradict each other, {name} by {by:.2g} {unit}: stop one of the '
        'publishers, or give each a topic of its own',
    ),
    'wrong values': Check(
        'note',
        _SOURCES,
        lambda view: view.spikes[1],
        'joint states contain wrong values now and then, {name} by {by:.2g} {unit}, which are left out: look at the '
        'driver',
    ),
    'held': Check(
        'note',
        _SOURCES,
        _held,
        '{name} repeats its readings while other joints have new ones: read it as often as the others',
    ),
    'steps': Check(
        'note',
        _SOURCES,
        _stepped,
        '{name} is read in steps of {quantum:.2g} {unit}, as by a coarse encoder, and off by up to half a step: '
        'publish finer readings, or raise known_joints.tracking_std',
        repair=_encoder,
    ),
    'jump': Check(
        'note',
        0.0,
        _jumps,
        'the reading of {name} jumps by {by:.2g} {unit} at {time:.1f} s: look at its encoder',
        fewest=1,
        repair=_jumped,
    ),
    'ticks': Check(
        'conflict',
        1.0,
        lambda view: view.whole,
        '{name} reads whole numbers, from {lowest:.0f} to {highest:.0f}: encoder ticks or degrees, not {unit}; convert '
        'them in the driver',
        _COARSE,
    ),
    'too fast': Check(
        'conflict',
        _MOST_STEPS,
        _fast,
        '{name} turns by more than a quarter from one reading to the next: how far is not known without its velocity; '
        'publish velocities, or read it more often',
    ),
    'velocity': Check(
        'conflict',
        _MOST_STEPS,
        _contradicted,
        'the velocity of {name} contradicts its positions, and it turns by more than a quarter from one reading to the '
        'next: correct one of the two; if the velocity is right, name it in wheels.names, not as a joint',
    ),
    'no velocity': Check(
        'note',
        _MOST_STEPS,
        _turning,
        '{name} turns on and on without a velocity, and may turn faster than its positions show: publish its velocity',
    ),
    'limits': Check(
        'conflict',
        _MOST_STEPS,
        lambda view: (np.abs(view.position) > view.joints.bounds) & ~view.whole,
        '{name} reads {value:.3g}, far beyond its limits in the robot description: degrees, millimetres or encoder '
        'ticks, not {unit}? Convert them in the driver',
        repair=_other_unit,
    ),
}
