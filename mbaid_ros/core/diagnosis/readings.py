"""Readings that are meant otherwise in several ways at once: a search over columns, signs, gears, zeros, mounts, units.

A run that is wrong in several numbers resembles none that is wrong in one of them, so they are found together. Some
hundred or thousand discrete meanings are compared by how well they conserve momentum, and the best are refined over the
continuous numbers by Gauss-Newton.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, islice, permutations, product
from typing import NamedTuple

import numpy as np

from mbaid_ros.core.clocks import restamped
from mbaid_ros.core.contracts import RIGHT, Convention, PlacedFrame, converted, stacked
from mbaid_ros.core.geometry import Array, Flags, Integers, exp, log, skew
from mbaid_ros.core.joints.model import joint_placements
from mbaid_ros.core.odometry.faults import (
    AWAY,
    IN_UNIT,
    SMALLER_UNITS,
    TURNED,
    mirrored,
    mounted_windows,
    other_frame_text,
    rescaled,
    turned_round,
)
from mbaid_ros.core.odometry.model import odometry_mount, odometry_scale
from mbaid_ros.core.repair import Conversion, PoseMeaning, Repair, Setting
from mbaid_ros.core.robot.momentum import MomentumKernel, inertia_matrix
from mbaid_ros.core.windows import Window, without_twist
from mbaid_ros.errors import listing
from mbaid_ros.tasks import Work

_WINDOWS = 16  # windows that meanings are compared over: six numbers each, body and momentum are sixteen
_BATCH, _BATCH_WORK = 50, 30  # meanings compared at a time, and the work of that in steps of the filter
_RIDGE = 1e-9  # relative, of the fit: unobservable numbers stay near zero
_MOST_JOINTS = 7  # up to which all orders (5,040) and signs (128) are tried: a second of work
_ZEROS = np.deg2rad(np.arange(30.0, 360.0, 30.0))  # rad, from the nearest of which the search converges
_GEARS = (0.5, 2.0 / 3.0, 1.5, 2.0, 3.0, 1.0 / 3.0)  # that are tried
_MOST_GEARS = 3  # that are found: more of them explain anything
_MOST_ZEROS = 3  # that are found without a look at all columns and signs, for the same reason
_MOST_GEAR = 4.0  # times, that joints are read too large or too small by at most: further ones explain by not moving
_REFINED, _WITH_GEARS = 64, 6  # meanings that are refined: their zeros, and their gears as well
_FEWEST = 12  # windows: fewer have hardly more numbers than the search has unknowns
# Times the noise, and part of the base's motion, that a meaning leaves if nothing is wrong beside it: less than a false
# one, and more than the declared errors of a robot.
_NOISE, _LEFT = 3.0, 1e-3
# Part of the base's motion that the joints leave unexplained, from which columns or signs may be wrong.
_DISCRETE = 0.03
_STEP, _LONGEST = 1e-4, 0.5  # rad, or relative: of numerical derivatives, and of an iteration at most
_ITERATIONS = 12  # of Gauss-Newton: from the nearest of the meanings above it converges in half of them
_DAMPING = (1e-3, 0.1, 10.0)  # relative to the curvature, that are tried in each
_CONVERGED = 0.99  # part of the squared residual that an iteration leaves at most if it goes on
_FLAT = 1e-6  # of the largest curvature: an unobservable number stays where it is
_AS_GOOD = 1.3  # times the least misfit, that a meaning of fewer numbers may leave
_SMALL_ZERO, _SMALL_GEAR = np.deg2rad(1.0), 0.02  # rad, and relative: smaller ones may be those of other errors
_ZERO_LEFT = 0.01  # rad, standard deviation of the rest of a zero that is found
# m and rad, standard deviations of the rest of a mount that is found; relative, of a scale
_MOUNT_LEFT, _SCALE_LEFT = (0.05, 0.01), 0.1
# m in a unit of the positions: from the nearest the search for a scale converges
_SCALES = (1e-3, 2e-3, 5e-3, 0.01, 0.0254, 0.05, 0.1, 0.2, 0.3048, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 10.0, 100.0, 1e3)
_UNITS = SMALLER_UNITS | {0.3048: 'feet', 1.0: 'metres', 1e3: 'kilometres'}
_FEWEST_FOR_SCALE = 40  # windows: a scale by fewer may be off by half
# Relative, of a scale by many windows and by few: inches are 2.5 centimetres; and of a unit that few windows show.
_SAME_UNIT, _ROUGHLY, _FAR = 0.15, 0.46, 3.0
# s, steps of the offset at the end of a run, among which the rate of the joints' clock is looked for: less than a
# quarter period of a motion; relative, furthest rate; steps at most; and how often the step is halved from there.
_APART, _FASTEST, _MOST_STEPS, _HALVED = 0.5, 0.25, 30, 8
# The right-handed axes of a cube, as rotation vectors: from the nearest the search for a mount converges.
_TURNS = tuple(
    log(np.array(signs)[:, None] * np.eye(3)[list(order)])
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3))
    if np.linalg.det(np.array(signs)[:, None] * np.eye(3)[list(order)]) > 0.0
)
_NICE = (1 / 3, 0.5, 2 / 3, 1.5, 2.0, 3.0, 10.0, 0.1, 100.0, 0.01, 60.0, float(np.rad2deg(1.0)), float(np.deg2rad(1.0)))


class Meaning(NamedTuple):
    """How readings are meant: joint i of n is gain_i times the reading of column_i, plus zero_i; and the base."""

    columns: Integers  # (n,)
    gains: Array  # (n,)
    zeros: Array  # (n,) rad or m
    # Of the base in what the odometry locates: rotation vector (3,) rad and position (3,) m.
    turn: Array
    lever: Array
    scale: float  # metres in one unit of the positions

    @property
    def numbers(self) -> int:
        """How many continuous ones there are: zeros, gains, turn, lever, scale."""
        return 2 * len(self.zeros) + 7

    def changed(self, step: Array) -> Meaning:
        """Return it with a change of its numbers, relative ones of gains and scale."""
        zeros, gains, turn, lever, scale = np.split(step, np.cumsum((len(self.zeros), len(self.zeros), 3, 3)))
        return self._replace(
            zeros=self.zeros + zeros,
            gains=self.gains * np.exp(gains),
            turn=log(exp(self.turn) @ exp(turn)),
            lever=self.lever + lever,
            scale=self.scale * float(np.exp(scale[0])),
        )


def as_read(joints: int) -> Meaning:
    """Return the readings of a robot with so many joints as they are."""
    return Meaning(np.arange(joints, dtype=np.int64), np.ones(joints), np.zeros(joints), np.zeros(3), np.zeros(3), 1.0)


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of W windows as it is read: the mean configuration and rates of each."""

    kernel: MomentumKernel
    joints: Array  # (W, n)
    rates: Array  # (W, n)
    rotation: Array  # (W, 3, 3)
    position: Array  # (W, 3)
    twist: Array  # (W, 6) linear, angular
    impulse: Array  # (W, 6)
    stored: Array  # (W, c)
    noise: Array  # (6,) variance of the twist by the poses, linear, angular

    def residuals(self, meanings: Sequence[Meaning], unit: float | None = None) -> Array:
        """Return the velocities (B, 6 W) of the base that body and momentum do not explain under B meanings.

        Angular ones are times the robot's size; linear ones in metres, or as they are read, where `unit` is one of the
        readings: a shorter unit does not make their noise less.
        """
        columns, gains, zeros, turn, lever, scale = (np.array(each) for each in zip(*meanings, strict=True))
        count, (windows, joints) = len(columns), self.joints.shape
        taken = np.broadcast_to(columns[:, None, :], (count, windows, joints))
        position = np.take_along_axis(self.joints[None], taken, axis=2) * gains[:, None, :] + zeros[:, None, :]
        rate = np.take_along_axis(self.rates[None], taken, axis=2) * gains[:, None, :]

        def tiled(values: Array) -> Array:
            return np.broadcast_to(values, (count, *values.shape)).reshape(count * windows, *values.shape[1:])

        away = np.einsum('wij,bj->bwi', self.rotation, lever)
        linear, angular = np.split(np.broadcast_to(self.twist, (count, windows, 6)), 2, axis=2)
        twist = np.concatenate((scale[:, None, None] * linear + np.cross(angular, away), angular), axis=2)
        place = (scale[:, None, None] * self.position + away).reshape(-1, 3)
        turned = (self.rotation @ exp(turn)[:, None]).reshape(-1, 3, 3)
        read = turned, position.reshape(-1, joints), rate.reshape(-1, joints), twist.reshape(-1, 6)
        states = self.kernel.states_of(*read, tiled(self.stored))
        total = np.zeros((count * windows, 6, 17))
        total[:, :, :6] = np.eye(6)
        total[:, 3:, :3] = -skew(place)
        total[:, :, 6:16] = -states.regressor
        total[:, :, 16] = states.known_momentum - (total[:, :, :6] @ tiled(self.impulse)[..., None])[..., 0]
        known = states.known.reshape(count, windows, *states.known.shape[1:])
        back = np.linalg.inv(inertia_matrix(np.mean(np.sum(known, axis=2), axis=1)))
        linear_weight = np.ones(count) if unit is None else unit / scale
        weights = np.repeat(np.stack((linear_weight, _lengths(back)), axis=1), 3, axis=1)
        weigh = back * weights[:, :, None]
        rows = weigh[:, None] @ total.reshape(count, windows, 6, 17)
        return _unexplained(rows.reshape(count, 6 * windows, 17))

    @cached_property
    def goal(self) -> float:
        """Mean squared residual of readings as they are meant: noise, and the declared errors of the robot."""
        noise, moved = self._sizes
        return _NOISE * noise + _LEFT * moved

    @property
    def moved(self) -> float:
        """The mean square of the base's velocities about their mean, as `residuals`."""
        return self._sizes[1]

    @cached_property
    def _sizes(self) -> tuple[float, float]:
        """The mean squares of noise and motion of the base, as `residuals`."""
        states = self.kernel.states_of(self.rotation, self.joints, self.rates, self.twist, self.stored)
        back = np.linalg.inv(inertia_matrix(np.mean(np.sum(states.known, axis=1), axis=0)))
        size = np.where(np.arange(6) < 3, 1.0, _lengths(back[None])[0])
        motion = (self.twist - np.mean(self.twist, axis=0)) * size
        return float(np.mean(self.noise * size**2)), float(np.mean(motion**2))

    def misfits(self, meanings: Iterable[Meaning]) -> Work[list[tuple[float, Meaning]]]:
        """Return the mean squared residual of each meaning."""
        found: list[tuple[float, Meaning]] = []
        remaining = iter(meanings)
        while batch := list(islice(remaining, _BATCH)):
            misfit = np.mean(self.residuals(batch) ** 2, axis=1)
            found += zip(misfit.tolist(), batch, strict=True)
            yield _BATCH_WORK
        return found


def motion_of(kernel: MomentumKernel, windows: Sequence[Window], most: int) -> Motion:
    """Return the motion of so many of the windows, evenly taken among those of one shape."""
    alike = max(stacked(windows), key=lambda each: len(each.windows)).windows
    chosen = np.unique(np.linspace(0, len(alike) - 1, min(most, len(alike))).round().astype(int))
    (stack,) = stacked([alike[place] for place in chosen])
    middle, spacing = stack.middle[stack.windows[0].inside], stack.windows[0].spacing
    # A mean rate is the difference of two knots, of some samples each.
    pose = np.mean([np.diag(each.noise.pose) / each.noise.samples for each in stack.windows], axis=0)
    noise = 2.0 * len(middle) * np.roll(pose, 3) / (len(middle) * spacing) ** 2
    return Motion(
        kernel,
        np.mean(middle.joint_position, axis=0),
        np.mean(middle.joint_velocity, axis=0),
        middle.base_rotation[len(middle) // 2],
        np.mean(middle.base_position, axis=0),
        np.mean(np.concatenate((middle.step, middle.turn), axis=-1), axis=0) / spacing,
        np.mean(middle.impulse, axis=0),
        np.mean(middle.stored, axis=0),
        noise,
    )


def _lengths(back: Array) -> Array:
    """Return the sizes (B,), m, of robots with inverse inertia matrices (B, 6, 6): turns as displacements."""
    return np.asarray(np.sqrt(back[:, 0, 0] / np.maximum(back[:, 3, 3], 1e-30)))


def _unexplained(rows: Array) -> Array:
    """Return the last of 17 columns (B, N, 17) less their fit by the others."""
    normal = np.swapaxes(rows, 1, 2) @ rows
    size = np.sqrt(np.einsum('bii->bi', normal))
    size[size == 0.0] = 1.0
    normal /= size[:, :, None] * size[:, None, :]
    solved = np.linalg.solve(normal[:, :16, :16] + _RIDGE * np.eye(16), normal[:, :16, 16:])[..., 0]
    parameters = solved * size[:, 16:] / size[:, :16]
    return np.asarray(rows[:, :, 16] - np.einsum('bij,bj->bi', rows[:, :, :16], parameters))


def singles(joints: int) -> Iterator[Meaning]:
    """Yield what may be wrong with one joint, or exchanged between two: columns, signs, zeros, gears."""
    own = as_read(joints)
    for one, other in combinations(range(joints), 2):
        columns = own.columns.copy()
        columns[[one, other]] = other, one
        yield own._replace(columns=columns)
    for joint in np.eye(joints):
        yield own._replace(gains=1.0 - 2.0 * joint)
        for zero in _ZEROS:
            yield own._replace(zeros=zero * joint)
        for gear in _GEARS:
            yield own._replace(gains=1.0 + (gear - 1.0) * joint)


def together(first: Meaning, second: Meaning) -> Meaning:
    """Return the meaning of readings that have both: the first of the readings, the second of its result."""
    columns, gains, zeros = second[:3]
    return first._replace(
        columns=first.columns[columns],
        gains=gains * first.gains[columns],
        zeros=gains * first.zeros[columns] + zeros,
    )


def combined(joints: int) -> Iterator[Meaning]:
    """Yield what may be wrong with several joints at once."""
    own, one, few = as_read(joints), list(singles(joints)), joints <= _MOST_JOINTS
    exchanged = [each for each in one if np.any(each.columns != own.columns)]
    turned = [own._replace(gains=1.0 - 2.0 * joint) for joint in np.eye(joints)]
    for first, second in combinations(one if few else [*exchanged, *turned], 2):
        yield together(first, second)
    in_a_row = [own._replace(columns=np.roll(own.columns[::way], by)) for way in (1, -1) for by in range(joints)]
    for row, single in product(in_a_row, one):
        yield together(row, single)
    if few:
        for order in permutations(range(joints)):
            yield own._replace(columns=np.array(order))
        for row, signs in product(in_a_row, product((1.0, -1.0), repeat=joints)):
            yield row._replace(gains=np.array(signs))
        for pairs, sign in product(combinations(exchanged, 2), turned):
            yield together(together(*pairs), sign)


def refined(motion: Motion, meaning: Meaning, free: Flags) -> Work[tuple[float, Meaning]]:
    """Return a meaning with its numbers that are free (k,) as they fit best, by damped Gauss-Newton."""
    places, unit = np.flatnonzero(free), meaning.scale
    value = motion.residuals([meaning], unit)[0]

    def changed(step: Array) -> Meaning:
        whole = np.zeros(meaning.numbers)
        whole[places] = np.clip(step, -_LONGEST, _LONGEST)
        return meaning.changed(whole)

    for _ in range(_ITERATIONS if len(places) else 0):
        ahead = motion.residuals([changed(_STEP * each) for each in np.eye(len(places))], unit)
        slope = (ahead - value).T / _STEP
        curvature, downhill = slope.T @ slope, -slope.T @ value
        size = np.diag(np.diag(curvature) + _FLAT * np.max(np.diag(curvature)) + 1e-300)
        tried = [changed(np.linalg.solve(curvature + damping * size, downhill)) for damping in _DAMPING]
        found = motion.residuals(tried, unit)
        best = int(np.argmin(np.sum(found**2, axis=1)))
        yield _BATCH_WORK
        improved = float(np.sum(found[best] ** 2) / max(np.sum(value**2), 1e-300))
        if improved >= 1.0:
            break
        meaning, value = tried[best], found[best]
        if improved > _CONVERGED:
            break
    return float(np.mean(value**2)), meaning


def _accepted(motion: Motion, every: Motion, found: Iterable[tuple[float, Meaning]], last: int) -> Work[Meaning | None]:
    """Return the first of some meanings, refined, that explains all of the motion with few numbers; None if none does.

    Parameters
    ----------
    motion, every : some of the motion, and all of it
    found : meanings with their misfits, the likeliest first
    last : number of the last of their numbers that are refined
    """
    for misfit, meaning in found:
        free = np.arange(meaning.numbers) < last
        result = misfit, meaning
        if misfit > motion.goal:
            result = yield from refined(motion, meaning, free)
        if result[0] < motion.goal:
            left, sparse = yield from _sparse(every, result[1])
            gears = np.abs(sparse.gains)
            few = np.sum(gears != 1.0) <= _MOST_GEARS and np.all((gears > 1.0 / _MOST_GEAR) & (gears < _MOST_GEAR))
            if left < every.goal and few:
                return _rounded(sparse)
    return None


def _sparse(motion: Motion, meaning: Meaning) -> Work[tuple[float, Meaning]]:
    """Return a meaning with as few zeros and gears as explain the motion about as well; the others are as read."""
    free = np.arange(meaning.numbers) < 2 * len(meaning.zeros)
    # Gears are free only where there are some: those of others are hardly observable beside all zeros.
    free[len(meaning.zeros) : 2 * len(meaning.zeros)] = np.abs(meaning.gains) != 1.0
    best = limit = yield from refined(motion, meaning, free)
    while np.any(free):
        places = np.flatnonzero(free)
        without = [_without(best[1], place) for place in places]
        misfits = np.mean(motion.residuals(without) ** 2, axis=1)
        least = int(np.argmin(misfits))
        fewer = free.copy()
        fewer[places[least]] = False
        result = yield from refined(motion, without[least], fewer)
        zeros, gears = _deviations(best[1])
        size = np.concatenate((zeros / _SMALL_ZERO, gears / _SMALL_GEAR))[places[least]]
        if result[0] > _AS_GOOD * limit[0] and size > 1.0:
            break
        best, free = result, fewer
    return best


def _without(meaning: Meaning, place: int) -> Meaning:
    """Return a meaning with one of its (2 n,) zeros and gains as read, but for the sign."""
    zeros, gains, joints = meaning.zeros.copy(), meaning.gains.copy(), len(meaning.zeros)
    if place < joints:
        zeros[place] = 0.0
    else:
        gains[place - joints] = np.sign(gains[place - joints])
    return meaning._replace(zeros=zeros, gains=gains)


def _deviations(meaning: Meaning) -> tuple[Array, Array]:
    """Return by how much zeros (n,), rad, and gears (n,), relative, differ from those as read."""
    return np.abs(meaning.zeros), np.abs(np.abs(meaning.gains) - 1.0)


def joint_meaning(kernel: MomentumKernel, windows: Sequence[Window]) -> Work[Meaning | None]:
    """Return how joint readings are meant where several numbers are wrong; None where nothing of that explains them."""
    joints, read_ones = kernel.model.joints, kernel.model.independent_joints
    if joints < 1 or len(read_ones) < joints or len(windows) < _FEWEST:
        return None
    motion, every = motion_of(kernel, windows, _WINDOWS), motion_of(kernel, windows, len(windows))
    one = sorted((yield from motion.misfits([as_read(joints), *singles(joints)])), key=_misfit)
    read = float(np.mean(motion.residuals([as_read(joints)]) ** 2))
    if read <= motion.goal:
        return None
    discrete = read > _DISCRETE * motion.moved
    found = yield from _accepted(motion, every, one[: _REFINED if discrete else _WITH_GEARS], joints)
    found = found or (yield from _accepted(motion, every, [(read, as_read(joints))], 2 * joints))
    if discrete and (found is None or np.count_nonzero(found.zeros) > _MOST_ZEROS):
        several = sorted((yield from motion.misfits(combined(joints))), key=_misfit)
        fewer = yield from _accepted(motion, every, several[:_REFINED], joints)
        found = found if fewer is None else fewer
        one = sorted([*one, *several[:_REFINED]], key=_misfit)
    return found or (yield from _accepted(motion, every, one[:_WITH_GEARS], 2 * joints))


def _misfit(each: tuple[float, Meaning]) -> float:
    return each[0]


def _rounded(meaning: Meaning) -> Meaning:
    """Return a meaning with gears that people build, and zeros within half a turn."""
    nice = np.array([1.0, *_NICE])
    gains = np.abs(meaning.gains)
    nearest = nice[np.argmin(np.abs(np.log(gains[:, None] / nice)), axis=1)]
    gains = np.sign(meaning.gains) * np.where(np.abs(gains / nearest - 1.0) < _SMALL_GEAR, nearest, gains)
    return meaning._replace(gains=gains, zeros=np.mod(meaning.zeros + np.pi, 2.0 * np.pi) - np.pi)


def mapped_joints(kernel: MomentumKernel, windows: Sequence[Window]) -> Work[list[Convention]]:
    """Return how joint readings are meant where several numbers are wrong at once; empty if nothing explains them."""
    meaning = yield from joint_meaning(kernel, windows)
    if meaning is None:
        return []
    names = kernel.model.joint_names
    text = mapping_text(names, meaning)
    columns, gains, zeros = meaning[:3]
    conversion = Conversion(
        factors={name: float(gain) for name, gain in zip(names, gains, strict=True) if gain != 1.0},
        columns={name: names[column] for name, column in zip(names, columns, strict=True) if names[column] != name},
        zeros={name: float(zero) for name, zero in zip(names, zeros, strict=True) if zero != 0.0},
    )
    parameters: dict[str, Setting] = {f'known_joints.{name}.zero_std': _ZERO_LEFT for name in conversion.zeros}
    repair = Repair(text.partition(':')[0], parameters or None, conversion)
    none = [0.0] * len(names)
    rest = joint_placements(kernel, [_ZERO_LEFT * (zero != 0.0) for zero in meaning.zeros], none, none)
    change = partial(_meant, meaning=meaning)
    return [Convention(text, kernel, change, misfit_left=RIGHT, repair=repair, rest=(rest,) if rest.count else ())]


def placed_bases(
    kernel: MomentumKernel, windows: Sequence[Window], marker: PlacedFrame | None
) -> Work[list[Convention]]:
    """Return the mount of a base whose poses, as read, turned round or mirrored, are those of another frame on it."""
    if kernel.model.joints < 1 or len(windows) < _FEWEST:
        return []
    own = as_read(kernel.model.joints)
    free = np.isin(np.arange(own.numbers), own.numbers - 7 + np.arange(6))
    starts = [own._replace(turn=turn) for turn in _TURNS]
    for kind, change in _POSES.items():
        read = change(windows)
        motion = motion_of(kernel, read, _WINDOWS)
        found = sorted((yield from motion.misfits(starts)), key=lambda each: each[0])
        for _, start in found:
            misfit, meaning = yield from refined(motion, start, free)
            if misfit < motion.goal:
                _, meaning = yield from refined(motion_of(kernel, read, len(read)), meaning, free)
                # Small ones are those that the filter estimates.
                far = np.linalg.norm(meaning.turn) > TURNED or np.linalg.norm(meaning.lever) > AWAY
                return [_mounted_base(kernel, meaning, marker, kind)] if far else []
    return []


def _mounted_base(
    kernel: MomentumKernel, meaning: Meaning, marker: PlacedFrame | None, kind: PoseMeaning
) -> Convention:
    """Return the convention of poses of a kind that are those of another frame on the base."""
    mount = np.concatenate((meaning.turn, meaning.lever))
    text = f'{_KINDS[kind]}{other_frame_text(mount, marker)}'
    position, orientation = _MOUNT_LEFT
    repair = Repair(
        text.partition(':')[0],
        {'odometry_mount.position_std': position, 'odometry_mount.orientation_std': orientation},
        Conversion(pose=kind, mount=tuple(map(float, mount))),
    )

    def placed(windows: Sequence[Window]) -> list[Window]:
        return mounted_windows(_POSES[kind](windows), mount)

    return Convention(text, kernel, placed, misfit_left=RIGHT, repair=repair, rest=(odometry_mount(*_MOUNT_LEFT),))


# How poses may be meant beside a mount, and that in words.
_POSES: Mapping[PoseMeaning, Callable[[Sequence[Window]], list[Window]]] = {
    'as read': lambda windows: list(map(without_twist, windows)),
    'turned round': turned_round,
    'mirrored y': mirrored,
}
_KINDS: Mapping[PoseMeaning, str] = {
    'as read': '',
    'turned round': 'the pose of the odometry is turned round (parent and child exchanged), and ',
    'mirrored y': 'the pose of the odometry is in left-handed axes (y mirrored), and ',
}


def scaled_positions(kernel: MomentumKernel, windows: Sequence[Window]) -> Work[list[Convention]]:
    """Return the likeliest length scale of the positions other than metres; empty where metres are."""
    if kernel.model.joints < 1 or len(windows) < _FEWEST:
        return []
    own, motion = as_read(kernel.model.joints), motion_of(kernel, list(map(without_twist, windows)), len(windows))
    found = yield from motion.misfits(own._replace(scale=scale) for scale in _SCALES)
    likely = min(found, key=lambda each: each[0])[1]
    _, meaning = yield from refined(motion, likely, np.arange(own.numbers) == own.numbers - 1)
    if np.mean(motion.residuals([meaning]) ** 2) > motion.goal * max(1.0, meaning.scale**2):
        return []
    # Noise makes the first estimates of a scale too small: they are good for a unit alone, and for no smaller one.
    long = len(windows) >= _FEWEST_FOR_SCALE
    units = [unit for unit in _UNITS if np.log(meaning.scale / unit) < _SAME_UNIT] or _UNITS
    nearest = min(units, key=lambda unit: abs(np.log(meaning.scale / unit)))
    named = abs(np.log(meaning.scale / nearest)) < (_SAME_UNIT if long else _ROUGHLY)
    scale = nearest if named else meaning.scale
    if scale == 1.0 or not (long or (named and abs(np.log(scale)) > _FAR)):
        return []
    if named:
        text = IN_UNIT.format(_UNITS[nearest])
    else:
        times = f'{1.0 / scale:.2g} times too large' if scale < 1.0 else f'{scale:.2g} times too small'
        text = (
            f'the scale of the odometry is wrong, its positions are about {times}: multiply them by {scale:.2g} (a '
            'monocular camera has no scale of its own)'
        )
    rest = {'odometry.scale_std': _SCALE_LEFT}
    repair = Repair(text.partition(':')[0], None if named else rest, Conversion(scale=scale))
    change = partial(rescaled, scale=scale)
    return [Convention(text, kernel, change, repair=repair, rest=() if named else (odometry_scale(_SCALE_LEFT),))]


def joints_by_another_clock(kernel: MomentumKernel, windows: Sequence[Window]) -> Work[list[Convention]]:
    """Return the rate of the joints' clock that fits best: simulated beside wall time; empty where theirs does."""
    if kernel.model.joints < 1 or len(windows) < _FEWEST:
        return []
    own, long = [as_read(kernel.model.joints)], max(windows[-1].start + windows[-1].length, 1.0)
    found: dict[float, float] = {}

    def tried(rate: float) -> Work[None]:
        left = restamped(windows, rate=rate)
        if len(left) >= _FEWEST:
            motion = motion_of(kernel, left, _WINDOWS)
            found[rate] = float(np.mean(motion.residuals(own) ** 2))
        yield 1

    step = _APART / long
    most = min(round(_FASTEST / step), _MOST_STEPS)
    for number in range(-most, most + 1):
        yield from tried(1.0 + number * step)
    for _ in range(_HALVED):
        step *= 0.5
        best = min(found, key=lambda each: found[each])
        yield from tried(best - step)
        yield from tried(best + step)
    best = min(found, key=lambda each: found[each])
    if abs(best - 1.0) * long < _APART:
        return []  # a drift that is an unknown
    text = (
        f'the stamps of the joint states run {best:.3g} times as fast as those of the poses: two clocks, as simulated '
        'and wall time; stamp both by one clock'
    )
    change = partial(restamped, rate=best)
    return [Convention(text, kernel, change, repair=converted(text, Conversion(clock=best)))]


def _meant(windows: Sequence[Window], meaning: Meaning) -> list[Window]:
    """Return windows with joint positions as they are meant."""
    columns, gains, zeros = meaning[:3]
    return [
        replace(each, knots=replace(each.knots, joint_position=each.knots.joint_position[:, columns] * gains + zeros))
        for each in windows
    ]


def mapping_text(names: Sequence[str], meaning: Meaning) -> str:
    """Return the errors of the joint readings, and the mapping to paste into the driver."""
    columns, gains, zeros = meaning[:3]
    moved = np.flatnonzero(columns != np.arange(len(columns)))
    parts = []
    if len(moved):
        shift = (columns - np.arange(len(columns))) % len(columns)
        pairs = [(one, int(columns[one])) for one in moved if columns[columns[one]] == one and columns[one] > one]
        if len(set(shift.tolist())) == 1 and len(columns) > 2:
            by = (int(shift[0]) + len(columns) // 2) % len(columns) - len(columns) // 2
            parts.append(f'the joint readings stand under the wrong names, moved by {abs(by)}')
        elif np.array_equal(columns, np.arange(len(columns))[::-1]):
            parts.append('the joint readings stand under the wrong names, in reversed order')
        elif 2 * len(pairs) == len(moved):
            parts.append(' and '.join(f'{names[one]} and {names[other]}' for one, other in pairs) + ' are swapped')
        else:
            parts.append(f'the readings of {listing(names[place] for place in moved)} stand under the wrong names')
    turned = [names[place] for place in np.flatnonzero(gains < 0.0)]
    if turned:
        parts.append(f'the signs of {listing(turned)} are wrong' if turned[1:] else f'the sign of {turned[0]} is wrong')
    geared = np.flatnonzero(np.abs(gains) != 1.0)
    parts += [f'{names[place]} reads {1.0 / abs(gains[place]):.3g} times its motion' for place in geared]
    shifted = [f'{names[place]} by {-np.degrees(zeros[place]):+.1f} degrees' for place in np.flatnonzero(zeros)]
    if shifted:
        zero = 'zeros are' if shifted[1:] else 'zero is'
        parts.append(f'the {zero} off, of {listing(shifted)}')
    mapping = [
        _assignment(names, place, meaning)
        for place in range(len(names))
        if columns[place] != place or gains[place] != 1.0 or zeros[place] != 0.0
    ]
    return f'{", ".join(parts)}: publish {"; ".join(mapping)}'


def _assignment(names: Sequence[str], place: int, meaning: Meaning) -> str:
    """Return one joint by the reading that it is."""
    gain, zero = meaning.gains[place], meaning.zeros[place]
    factor = '' if abs(gain) == 1.0 else f'{abs(gain):.5g} '
    added = '' if zero == 0.0 else f' {"-" if zero < 0.0 else "+"} {abs(zero):.4f}'
    return f'{names[place]} = {"-" if gain < 0.0 else ""}{factor}{names[meaning.columns[place]]}{added}'
