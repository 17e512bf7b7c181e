"""Faults of the odometry: a twist that is no rate of the poses, wrong axes and units, a base that is held."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import permutations, product

import numpy as np

from mbaid_ros.core.contracts import LEFT, RIGHT, Convention, PlacedFrame, converted
from mbaid_ros.core.geometry import (
    Array,
    Flags,
    exp,
    log,
    mirror,
    quaternion_from_rotation,
    rotate,
    rotate_back,
    rotation_from_quaternion,
)
from mbaid_ros.core.noise import LeastSteps
from mbaid_ros.core.odometry.model import marker_text
from mbaid_ros.core.repair import Conversion, Repair
from mbaid_ros.core.results.verdict import Reason, Severity
from mbaid_ros.core.robot.model import Kinematics, RobotModel
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import ArrayRecord, BaseStream, Samples, Stamps
from mbaid_ros.core.windows import Knots, Window, without_twist
from mbaid_ros.errors import listing

_FEWEST_SAMPLES = 5  # samples of a window
# m and rad, that a base out of the plane moves and tilts by at least (filters that hold it leave 1e-9); m and rad, by
# which base and joint have moved before that counts; cosine of an upright axis.
_FLAT, _MOVES_BY, _TURNS_BY, _UPRIGHT = 1e-6, 0.01, 0.2, 0.98
_TILT = 'roll and pitch'
_COORDINATES = ('x', 'y', 'z', _TILT, 'yaw', 'orientation')
# m, a step of positions that is no noise; share of the poses that change by it at most: of more it may be a velocity.
_COARSE, _PART = 4e-3, 0.5
_BINARY = 0.01  # difference of a step's logarithm to base 2 from a whole one, below which it is that of a float
_AS_FLOATS = 'as in float32 far from the origin: publish doubles, or positions about a nearer origin'
_AS_ROUNDED = 'as if rounded: publish all digits of the measurement'
_STILL = 10 * 10**9  # ns, that a coordinate stays the same after all else has moved: coarse ones change later
_FEWEST_RATES, _KEPT_RATES = (
    8,
    80,
)  # windows, of at least three numbers each: a wrong reading is no accident; and the latest ones
# Mean normalised square of the poses' steps less the rates', from which a rate is not that of the poses.
CONTRADICTS = 4.0
_LEFT = 0.25  # of the contradiction, and of the motion: most that another convention may leave to be accepted
FITTED = 2.0  # times as well as any other, that a convention with numbers of its own has to explain the data
_MILLIMETRE = 1e-3  # m: a unit
Meanings = Iterator[tuple[float, str, Array]]  # times as well that it has to explain the data, in words, (W, k) steps
_CLEARLY = 30.0  # standard deviations, that an axis moves by at least for its scale to be found
_LARGEST_AXIS_SCALE = 5.0  # of one axis: a larger one, or its inverse, is a misfit of the axes
_OTHER_SCALE = 0.1  # relative, of one axis: a smaller one is a scale error, and an unknown
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # cyclic neighbours of the three axes
# Windows before a first comparison, and part of those compared before that come before the next: fewer add little; the
# latest ones, whose motion is compared.
_FEWEST_STILL, _MORE, _KEPT = 10, 0.5, 120
_READ = 5  # samples of a window, of which the mean centre of mass is taken
_MOVED = 1e-3  # m, root mean square, that the centre of mass has to move by at least
_REACTION = 0.15  # times the motion of the centre of mass: the base's, from which it may be free
_CORRELATION = 0.5  # between the two, from which the base reacts, if by less than by the robot description
_WHITE = 3.0  # squared second difference over variance, 6 of white noise: of a motion, which is smooth, it is far less
_ROUNDING = 1e-12  # squared, of the motion of the centre of mass
_CERTAIN = 1e6  # log-likelihood that it counts as: more than a filter finds for any other cause
HELD = (
    'the base does not move while the arm does: it is held or bolted to the ground, or the odometry is that of another '
    'body; the method needs a base that floats'
)
_IS_HELD = Reason(HELD, 'conflict', _CERTAIN)
TURNED, AWAY = np.radians(1.0), 0.02  # rad and m, that a frame is turned and away by at least to be mentioned
_FAR_BASE = 20.0  # m, that a base seems to move at least where its positions may be in millimetres
_FEWEST_WINDOWS = 12  # windows: fewer hold a few swings and a trend of five numbers, and nothing beside
_FINER = 4  # frequencies tried for each that the length of the series resolves
_SWINGS = 2.5  # in the series at least: fewer are a drift
# Robust standard deviations (by the median) at which the series is clipped: a single large one is a jump, no swing.
_LARGEST = 4.0
_TREND = 5  # numbers of a polynomial that is no swing
_PEAKS = 2  # frequencies that are tried: each takes passes of its own
# Times the median of the spectrum: of noise, one frequency in 4000 (2^-12) is as high in one of the six numbers.
_CLEAR = 12.0


@dataclass(frozen=True)
class RateMotion(ArrayRecord):
    """How the base turned (rad) and moved (m) over W windows, the k angular numbers first."""

    step: Array  # (W, k) by the poses
    read: Array  # (W, k) by the rates, as they are read
    noise: Array  # (W, k) standard deviation of the difference between the two
    # arm, middle: (W, 3, 3) share of a point away from the base's in the linear step, m, per metre in base axes; and
    # the rotation of the base in the middle of each window
    arm: Array
    middle: Array

    def misfit(self, meant: Array) -> float:
        """Return the mean normalised square of the steps less (W, k)."""
        return float((((self.step - meant) / self.noise) ** 2).sum()) / meant.size

    def turned(self, turn: Callable[[Array, Array], Array]) -> Array:
        """Return (W, 6) of the twist with both parts turned, by a function of rotations and (W, 3) of it."""
        return np.concatenate([turn(self.middle, each) for each in np.split(self.read, 2, axis=1)], axis=1)


class RateCheck:
    """Follows windows, and finds the convention that a rate follows instead of that of the poses.

    Parameters
    ----------
    motion : that a window shows; None where it has no such rate
    error : the wrong convention that motions of a misfit show, in words, and its gain in log-likelihood; empty if none
    left_out : the repair without the rate, but for its cause
    severity : of the reason
    """

    def __init__(
        self,
        motion: Callable[[Samples], RateMotion | None],
        error: Callable[[RateMotion, float], tuple[str, float]],
        left_out: Repair,
        severity: Severity = 'note',
    ) -> None:
        self._motion, self._error, self._left_out, self._severity = motion, error, left_out, severity
        self._seen: deque[RateMotion] = deque(maxlen=_KEPT_RATES)
        self._misfits: deque[float] = deque(maxlen=_KEPT_RATES)  # of each as it is read

    def add(self, window: Samples) -> None:
        """Add a window."""
        motion = self._motion(window) if len(window) >= _FEWEST_SAMPLES else None
        if motion is not None and np.isfinite(misfit := motion.misfit(motion.read)):
            self._seen.append(motion)
            self._misfits.append(misfit)

    def reason(self) -> Reason | None:
        """Return the contradiction that the latest windows show."""
        contradiction = sum(self._misfits) / max(len(self._seen), 1)
        if len(self._seen) < _FEWEST_RATES or contradiction < CONTRADICTS:
            return None
        text, gain = self._error(RateMotion.concatenate(self._seen), contradiction)
        repair = replace(self._left_out, cause=text.partition(':')[0])
        return Reason(text, self._severity, gain, repair) if text else None

    def update(self, window: Samples) -> Reason | None:
        """Add a window, and return the contradiction that the latest ones show."""
        self.add(window)
        return self.reason()


class SensorChecks:
    """Follows windows with the checks of sensors against the base's poses: most contradict poses that are wrong.

    Parameters
    ----------
    checks : one of each sensor
    """

    def __init__(self, checks: Sequence[RateCheck]) -> None:
        self._checks = checks

    def update(self, window: Samples) -> Reason | None:
        """Add a window, and return the clearest contradiction that the latest ones show; no cause where most do."""
        found = [reason for each in self._checks if (reason := each.update(window)) is not None]
        if len(found) > 1 and 2 * len(found) > len(self._checks):
            text = f'{len(found)} of {len(self._checks)} sensors contradict the poses of the base in axes or units'
            return Reason(f'{text}: look at the frame of these first', 'conflict')
        return max(found, key=lambda each: each.gain or 0.0, default=None)


def twist_check() -> RateCheck:
    """Return the check whether the base's twist is the rate of its poses."""
    without = Repair('', conversion=Conversion(with_twist=False))
    return RateCheck(_twist_motion, lambda motion, misfit: likeliest(motion, misfit, _twist_meanings(motion)), without)


def likeliest(motion: RateMotion, contradiction: float, meanings: Meanings) -> tuple[str, float]:
    """Return the convention that explains motions of a misfit, and its gain; empty if none does."""
    _, left, text = min((factor * motion.misfit(meant), motion.misfit(meant), text) for factor, text, meant in meanings)
    if left > _LEFT * min(contradiction, motion.misfit(np.zeros(motion.step.shape))):
        return '', 0.0
    return text, 0.5 * (contradiction - left) * motion.step.size


def ends(values: Array) -> Array:
    """Return the first and the last third of (N, ...) values, joined: noise hardly averages out better than so."""
    third = max(len(values) // 3, 1)
    return np.concatenate((values[:third], values[-third:]))


def slope_over_window(ends: Array) -> Array:
    """Return the mean of the second half of (2 k, ...) values less that of the first."""
    first, last = ends.reshape(2, len(ends) // 2, -1).sum(axis=1)
    return np.asarray((last - first) / (len(ends) // 2))


def _weights(time: Array) -> Array:
    """Return the weights (N,), s, with which a rate makes the step of its integral (trapezoid) between the ends."""
    half = 0.5 * np.diff(time) * _shares(len(time))
    return np.append(half, 0.0) + np.append(0.0, half)


@cache
def _shares(count: int) -> Array:
    """Return the part of the steps of N values (N - 1,) that each step between two of them is in."""
    place = np.arange(1, count)
    return np.asarray(np.minimum(np.minimum(place, place[::-1]) / max(count // 3, 1), 1.0))


def spread(covariance: Array) -> Array:
    """Return the (6,) variances, angular ones first, in any axes: the largest mean one of each three."""
    variance = np.einsum('nii->i', covariance).reshape(2, 3) / len(covariance)
    return np.repeat(variance.max(axis=1)[::-1], 3)


def _twist_motion(window: Samples) -> RateMotion | None:
    """Return the motion of the base, odometry axes, by poses and twists; None without a twist."""
    if window.missing_rates[1]:
        return None
    time, rotation, count = window.time, window.base_rotation, len(window)
    turned = log(ends(rotation) @ rotation[0].T)
    step = slope_over_window(np.concatenate((turned, ends(window.base_position)), axis=1))
    weights, length = _weights(time), float(time[-1] - time[0])
    angular = weights[:, None] * window.base_angular_velocity
    read = np.concatenate((angular.sum(axis=0), weights @ window.base_linear_velocity))
    products = (angular.T @ rotation.reshape(count, 9)).reshape(3, 3, 3)
    arm = products[_NEXT, _LAST] - products[_LAST, _NEXT]  # the integral of [w]x R
    # Of means over thirds; the twist's noise is that of a mean, too, by trapezoids of weights.
    variance = 6.0 / count * spread(window.pose_covariance)
    variance += 5.0 / 9.0 * length**2 / count * spread(window.twist_covariance)
    rows = step, read, np.sqrt(variance), arm, rotation[count // 2]
    return RateMotion(*(row[None] for row in rows))


def _twist_meanings(motion: RateMotion) -> Meanings:
    """Yield the conventions of the twist, and the steps (W, 6) that each implies."""
    what = 'the twist of the odometry'
    angular, linear = motion.read[:, :3], motion.read[:, 3:]
    if not np.any(motion.read):
        yield 0.0, f'{what} is zero while its poses move: publish NaN where it is not measured', motion.step
        return
    yield (
        1.0,
        'the angular velocity of the odometry is in degrees a second: in ROS it is in rad/s',
        np.concatenate((np.deg2rad(angular), linear), axis=1),
    )
    yield (
        1.0,
        'the linear velocity of the odometry is in millimetres a second: in ROS it is in m/s',
        np.concatenate((angular, _MILLIMETRE * linear), axis=1),
    )
    still = np.zeros_like(angular)
    for moves in ((angular, still), (still, linear)):  # poses that do not move show no unit
        yield 0.5, '', np.concatenate(moves, axis=1)
    yield 1.0, f'{what} has the wrong sign', -motion.read
    yield 1.0, f'{what} is in the axes of its header.frame_id: set twist_frame: inertial', motion.turned(rotate_back)
    yield 1.0, f'{what} is in the axes of its child_frame_id: set twist_frame: child', motion.turned(rotate)
    point = _point(motion)
    place = ', '.join(f'{-1e3 * each:.0f}' for each in point)
    yield (
        FITTED,
        f'{what} is that of a point ({place}) mm away from that of its poses, in base axes',
        np.concatenate((angular, linear + motion.arm @ point), axis=1),
    )
    step, read, noise = (np.concatenate(np.split(each, 2, axis=1)) for each in (motion.step, motion.read, motion.noise))
    middle = np.concatenate((motion.middle, motion.middle))
    yield from _in_other_axes(motion)
    turn, about = turn_between(rotate_back(middle, step), rotate_back(middle, read), noise)
    yield (
        FITTED,
        f'the axes of the twist are turned by {about} against those of the poses',
        motion.turned(lambda rotation, part: rotate(rotation, rotate_back(rotation, part) @ turn.T)),
    )


def _in_other_axes(motion: RateMotion) -> Meanings:
    """Yield the angular or the linear velocity in axes of its own."""
    halves = np.split(motion.read, 2, axis=1)
    for index, part in enumerate(('angular', 'linear')):
        own = slice(3 * index, 3 * index + 3)
        step, read = (rotate_back(motion.middle, each[:, own]) for each in (motion.step, motion.read))
        meant, words = axes_between(step, read, motion.noise[:, own])
        if words:
            meant_halves = [*halves[:index], rotate(motion.middle, meant), *halves[index + 1 :]]
            text = f'the {part} velocity of the odometry has {words}: correct the driver'
            yield FITTED, text, np.concatenate(meant_halves, axis=1)


def _point(motion: RateMotion) -> Array:
    """Return the point, (3,) m in base axes, that the poses are of as the twist's point sees it: v + w x R r."""
    weight = 1.0 / motion.noise[:, 3:, None]
    rows = (weight * motion.arm).reshape(-1, 3)
    values = (weight[..., 0] * (motion.step - motion.read)[:, 3:]).ravel()
    return np.asarray(np.linalg.lstsq(rows, values, rcond=1e-6)[0])


def turn_between(step: Array, read: Array, noise: Array) -> tuple[Array, str]:
    """Return the rotation, (3, 3), that takes vectors (N, 3) read to the steps (Wahba's problem), and that in words."""
    left, _, right = np.linalg.svd((step / noise).T @ (read / noise))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    about = log(turn)
    angle = float(np.linalg.norm(about))
    axis = ', '.join(f'{each:.2f}' for each in np.round(about / max(angle, 1e-12), 2) + 0.0)
    return turn, f'{np.degrees(angle):.0f} degrees about ({axis})'


def axes_between(step: Array, read: Array, noise: Array) -> tuple[Array, str]:
    """Return vectors (N, 3) read in other axes as they best fit the steps, and that in words.

    The axes may be reversed, exchanged, or scaled one by one; without words where a rotation does it, or nothing, or
    where one of them hardly moves. The noise (N, 3) is that of the difference.
    """
    products, squares = step.T @ read, np.sum(read**2, axis=0)
    moved = np.minimum(squares, np.sum(step**2, axis=0))
    if np.any(moved < _CLEARLY**2 * np.mean(noise**2, axis=0)):
        return read, ''
    best, found = np.inf, (read, '')
    for order in permutations(range(3)):
        own = products[range(3), order], squares[list(order)]
        scale = own[0] / np.maximum(own[1], 1e-300)
        if np.any(np.abs(np.log(np.abs(scale) + 1e-300)) > np.log(_LARGEST_AXIS_SCALE)):
            continue
        meant = read[:, order] * scale
        left = float(np.sum((step - meant) ** 2))
        if left < best:
            best, found = left, (meant, _axes_text(order, scale))
    return found


def _axes_text(order: tuple[int, ...], scale: Array) -> str:
    """Return axes that are read for others, with the scale (3,) from a reading to its meaning."""
    turned = np.sign(scale)[:, None] * np.eye(3)[list(order)]
    off = [place for place in range(3) if abs(np.log(abs(scale[place]) + 1e-300)) > _OTHER_SCALE]
    if not off and np.linalg.det(turned) > 0.0:
        return ''
    texts = []
    if not np.array_equal(turned, np.eye(3)):
        names = ', '.join('-' * int(scale[place] < 0.0) + 'xyz'[order[place]] for place in range(3))
        hand = 'left-handed axes' if np.linalg.det(turned) < 0.0 else 'other axes'
        texts.append(f'{hand}: its x, y, z are ({names}) as read')
    texts += [f'{"xyz"[place]} reads {1.0 / abs(scale[place]):.3g} times its motion' for place in off]
    return ', '.join(texts) if len(texts) > 1 or not off else f'axes of other scales: {texts[0]}'


class HeldBase:
    """Follows windows, and finds whether the base is held.

    Parameters
    ----------
    kernel : the known links of the robot
    """

    def __init__(self, kernel: MomentumKernel) -> None:
        self._kernel = kernel
        self._pushed: Array = np.zeros(6)  # by thrust, at the end of the latest window
        # Of each window since the latest comparison: means of time and p; R and joints of a few samples.
        self._new: list[tuple[Array, Array, Array]] = []
        self._seen: deque[Array] = deque(maxlen=_KEPT)  # (7,) of each window before, means of time, p and c
        self._held = False
        # Of an unknown base, or a robot without moving parts, the known links determine no reaction.
        self._possible = kernel.target.body > 0

    def update(self, window: Samples) -> Reason | None:
        """Add a window; return a reason from the one on that shows that the base is held."""
        if self._held:
            return _IS_HELD
        self._possible &= bool(np.isfinite(window.pose_covariance[0, 0, 0]))  # else nothing locates it
        if not self._possible:
            return None
        pushed, self._pushed = (window.impulse != self._pushed).any(), window.impulse[-1]
        if pushed:  # thrust moves the base
            self._seen.clear()
            self._new.clear()
            return None
        some = np.arange(_READ) * (len(window) - 1) // (_READ - 1)
        middle = np.concatenate(([window.time.mean()], window.base_position.mean(axis=0)))
        self._new.append((middle, window.base_rotation[some], window.joint_position[some]))
        if len(self._new) < max(_FEWEST_STILL, _MORE * len(self._seen)):
            return None
        middles, rotations, joints = map(np.array, zip(*self._new, strict=True))
        self._new.clear()
        self._seen.extend(np.concatenate((middles, self._centres(rotations, joints)), axis=1))
        self._held = _is_held(np.array(self._seen))
        return _IS_HELD if self._held else None

    def _centres(self, rotation: Array, joints: Array) -> Array:
        """Return the mean offsets (W, 3) of the known links' centre of mass from the base, of (W, k) samples."""
        placed = self._kernel.kinematics.configure(rotation.reshape(-1, 3, 3), joints.reshape(-1, joints.shape[2]))
        known = self._kernel.known
        moments = np.sum(rotate(placed.rotation, known[:, 1:4]) + known[:, :1] * placed.position, axis=1)
        return np.asarray(np.mean(moments.reshape(*rotation.shape[:2], 3), axis=1) / np.sum(known[:, 0]))


def _is_held(seen: Array) -> bool:
    """Return whether a base stays where it is, apart from noise, beside the centre of mass: rows (W, 7) t, p, c."""
    time = seen[:, 0] - np.mean(seen[:, 0])
    trend = np.vander(time / np.max(np.abs(time)), 3)
    left = seen[:, 1:] - trend @ np.linalg.lstsq(trend, seen[:, 1:], rcond=None)[0]
    base, centre = np.split(left, 2, axis=1)
    bends = np.sum(np.diff(left, 2, axis=0) ** 2, axis=0).reshape(2, 3).sum(axis=1)
    base_square, square = float(np.sum(base**2)), float(np.sum(centre**2))
    if square < len(seen) * _MOVED**2 or base_square > _REACTION**2 * square or bends[1] > square:
        return False  # nothing moves, the base reacts, or the arm seems to leap, as in degrees
    if base_square < _ROUNDING * square:
        return True
    together = abs(float(np.sum(base * centre)))
    return bool(together < _CORRELATION * np.sqrt(base_square * square) and bends[0] > _WHITE * base_square)


class PlanarPoses:
    """Follows raw poses and joints, and finds coordinates of the base that never change, as in two dimensions.

    Parameters
    ----------
    model : RobotModel
    """

    def __init__(self, model: RobotModel) -> None:
        placed = Kinematics(model).configure(np.eye(3)[None], np.zeros((1, model.joints)))
        twist = placed.joint_twist[0]
        flat = np.where(model.prismatic, np.hypot(twist[:, 0], twist[:, 1]), np.abs(twist[:, 5]))
        # A joint that turns about another axis than the base's z, or slides along it, takes the base out of the plane.
        self._tilting = {name for name, along in zip(model.joint_names, flat, strict=True) if along < _UPRIGHT}
        self._first: dict[str, Array] = {}  # positions of base and joints at the begin
        self._rotation: Array | None = None  # of the base at the begin
        # ns, when the base moved, when it left the plane, when each coordinate changed, and when a joint moved
        self._since: dict[str, int] = {}
        self._joint = ''
        self._latest = 0  # ns, stamp of a pose

    def add_poses(self, base: BaseStream) -> None:
        """Take poses in the order of arrival."""
        first = self._first.setdefault('base', base.position[0])
        self._rotation = base.rotation[0] if self._rotation is None else self._rotation
        away, turned = np.abs(base.position - first), np.abs(base.rotation - self._rotation).max(axis=(1, 2))
        self._note('moved', np.any(away[:, :2] > _MOVES_BY, axis=1), base.stamp)
        self._note('changed', np.maximum(away.max(axis=1), turned) > _MOVES_BY, base.stamp)
        tilt = np.abs(base.rotation[:, 2, :2])
        self._note('left', (away[:, 2] > _FLAT) | np.any(tilt > _FLAT, axis=1), base.stamp)
        tilted = np.abs(base.rotation[:, 2, :2] - self._rotation[2, :2]).max(axis=1)
        (x, y), (x0, y0) = base.rotation[:, :2, 0].T, self._rotation[:2, 0]
        for name, change in zip(_COORDINATES, (*away.T, tilted, np.abs(x * y0 - y * x0), turned), strict=True):
            self._note(name, change > _FLAT, base.stamp)
        self._latest = max(self._latest, int(base.stamp[-1]))

    def add_joints(self, names: Sequence[str], stamp: Stamps, position: Array) -> None:
        """Take readings (N, k) of some joints in the order of arrival."""
        for name, values in zip(names, position.T, strict=True):
            if name in self._tilting and 'turned' not in self._since:
                turned = np.abs(values - self._first.setdefault(f'joint {name}', values[:1])) > _TURNS_BY
                self._note('turned', turned, stamp)
                self._joint = name

    def _note(self, what: str, flags: Flags, stamp: Stamps) -> None:
        if what not in self._since and flags.any():
            self._since[what] = int(stamp[np.argmax(flags)])

    def found(self) -> Iterator[tuple[str, int, str]]:
        """Yield the fault, from which stamp on (ns), and in words."""
        if {'moved', 'turned'} <= self._since.keys():
            since = max(self._since['moved'], self._since['turned'])
            if self._since.get('left', since + 1) > since:
                text = (
                    'the odometry is in two dimensions: z, roll and pitch of the base never change, though '
                    f'{self._joint} moves out of the plane; publish all three (dimensions: 3, no two_d_mode)'
                )
                yield 'planar', since, text
                return
        if {'changed', 'turned'} <= self._since.keys():
            since = max(self._since['changed'], self._since['turned']) + _STILL
            same = [name for name in _COORDINATES if self._since.get(name, since + 1) > since]
            if same and self._latest >= since:
                names = [name for name in same if name not in {_TILT, 'yaw'} or _COORDINATES[-1] not in same]
                text = (
                    f'coordinates of the base never change, though {self._joint} moves: {listing(names)}; publish all '
                    'six as they are measured'
                )
                yield 'same', since, text


class CoarsePositions:
    """Follows raw positions, and finds axes that change by steps: rounded, or in float32 far from the origin."""

    def __init__(self) -> None:
        self._steps = LeastSteps(3)
        self._last: BaseStream | None = None
        self._new = 0  # poses that differ from the one before
        self._changed = np.zeros(3)  # of these, those that differ along each axis

    def add_poses(self, base: BaseStream) -> Iterator[tuple[str, int, str]]:
        """Take poses in the order of arrival; yield the fault, from which stamp on (ns), and in words."""
        joined = base if self._last is None else BaseStream.concatenate((self._last, base))
        self._last = base[-1:]
        step = self._steps.add(joined.position, len(base.stamp))
        changed = np.diff(joined.position, axis=0) != 0.0
        new = changed.any(axis=1) | (np.diff(joined.rotation, axis=0) != 0.0).any(axis=(1, 2))
        number, changes = self._new + np.cumsum(new), self._changed + np.cumsum(changed, axis=0)
        coarse = (step > _COARSE) & (changes < _PART * number[:, None])
        if coarse.any():
            row = int(np.argmax(coarse.any(axis=1)))
            axes = listing(name for name, one in zip('xyz', coarse[row], strict=True) if one)
            largest = float(np.max(step[row, coarse[row]]))
            power = np.log2(largest)
            how = _AS_FLOATS if abs(power - round(power)) < _BINARY else _AS_ROUNDED
            text = f'the position of the odometry changes in steps of {1e3 * largest:.2g} mm along {axes}, {how}'
            yield 'coarse', int(joined.stamp[row + 1]), text
        if len(number):
            self._new, self._changed = int(number[-1]), changes[-1]


def mistaken_poses(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield inverse orientations, inverse poses, quaternions with w first, and positions in a smaller unit."""
    for text, pose, meaning in _POSES:
        yield replace(_posed(text, kernel, pose), repair=converted(text, meaning))
    # Few windows do not show a scale, and one of these explains positions in another of them nearly as well.
    for scale, unit in SMALLER_UNITS.items():
        text, far = IN_UNIT.format(unit), _FAR_BASE * _MILLIMETRE / scale
        repair = converted(text, Conversion(scale=scale))
        yield Convention(text, kernel, partial(rescaled, scale=scale), base_range=far, repair=repair)
    repair = converted(_TURNED_ROUND, Conversion(pose='turned round'))
    yield Convention(_TURNED_ROUND, kernel, turned_round, repair=repair)
    for axis, meaning in enumerate(_MIRRORS):
        text = _MIRRORED.format('xyz'[axis])
        yield Convention(text, kernel, partial(mirrored, axis=axis), repair=converted(text, meaning))


def turned_round(windows: Sequence[Window]) -> list[Window]:
    """Return windows with the inverse poses, whose twist is left out."""
    found, first = [], None
    for window in map(without_twist, windows):
        back = np.swapaxes(window.knots.base_rotation, -1, -2)
        position = -rotate(back, window.knots.base_position + window.origin)
        first = position[0] if first is None else first
        knots = replace(window.knots, base_rotation=back, base_position=position - first)
        found.append(replace(window, knots=knots))
    return found


def rescaled(windows: Sequence[Window], scale: float) -> list[Window]:
    """Return windows whose positions are in a unit of so many metres, without their twist."""
    return [
        replace(each, knots=replace(each.knots, base_position=scale * each.knots.base_position))
        for each in map(without_twist, windows)
    ]


def mirrored(windows: Sequence[Window], axis: int = 1) -> list[Window]:
    """Return windows whose poses are in axes of the other hand, without their twist."""
    return [
        replace(
            window,
            knots=replace(
                window.knots,
                base_rotation=mirror(window.knots.base_rotation, axis),
                base_position=np.where(np.arange(3) == axis, -1.0, 1.0) * window.knots.base_position,
            ),
        )
        for window in map(without_twist, windows)
    ]


_MIRRORS = (Conversion(pose='mirrored x'), Conversion(pose='mirrored y'), Conversion(pose='mirrored z'))
_MIRRORED = (
    'the pose of the odometry is in left-handed axes, {0} mirrored: in ROS they are right-handed; reverse the {0} of '
    'the position and the two other numbers of the vector part of the quaternion'
)
_TURNED_ROUND = (
    'the pose of the odometry is turned round, that of the odometry frame in the base: in ROS it is that of the base '
    'in the odometry frame; exchange parent and child, or publish the inverse'
)


def _scalar_first(knots: Knots) -> Knots:
    """Return the knots of quaternions whose w stands where x should, and so on."""
    quaternion = quaternion_from_rotation(knots.base_rotation)
    return replace(knots, base_rotation=rotation_from_quaternion(np.roll(quaternion, -1, axis=-1)))


SMALLER_UNITS = {_MILLIMETRE: 'millimetres', 0.01: 'centimetres', 0.0254: 'inches'}  # by their length, m
IN_UNIT = 'the position of the odometry is in {}: in ROS it is in metres'
MILLIMETRES = IN_UNIT.format('millimetres')
_POSES: tuple[tuple[str, Callable[[Knots], Knots], Conversion], ...] = (
    (
        'the orientation of the odometry is the inverse: in ROS it rotates from the base to the odometry frame',
        lambda knots: replace(knots, base_rotation=np.swapaxes(knots.base_rotation, -1, -2)),
        Conversion(pose='inverse'),
    ),
    (
        'the quaternion of the odometry has its w first: in ROS it is x, y, z, w',
        _scalar_first,
        Conversion(pose='w first'),
    ),
)


def _posed(text: str, kernel: MomentumKernel, change: Callable[[Knots], Knots], left: float = LEFT) -> Convention:
    """Return a convention of the poses; a twist is in the axes of poses as they were read, and left out."""

    def changed(windows: Sequence[Window]) -> list[Window]:
        return [replace(each, knots=change(each.knots)) for each in map(without_twist, windows)]

    return Convention(text, kernel, changed, misfit_left=left)


def inverted_marker(kernel: MomentumKernel, marker: PlacedFrame | None) -> Iterator[Convention]:
    """Yield the declared marker as the pose of the base link in the marker's frame."""
    if marker is not None:
        mount = np.concatenate(
            (log(marker.rotation @ marker.rotation), marker.position + marker.rotation @ marker.position)
        )
        text = (
            f'marker.position and marker.orientation look inverted: they must locate the marker in the base '
            f"link's frame; set {marker_text(mount, marker)}"
        )
        yield _posed(text, kernel, partial(_mounted, mount=mount))


def axis_conventions(kernel: MomentumKernel, marker: PlacedFrame | None = None) -> Iterator[Convention]:
    """Yield the base's frame in the 23 other right-handed axes, and its positions in the 47 others."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        axes = np.array(signs)[:, None] * np.eye(3)[list(order)]  # from the readings to the true ones
        if np.array_equal(axes, np.eye(3)):
            continue
        if np.linalg.det(axes) > 0.0:
            mount = np.concatenate((-log(axes), np.zeros(3)))
            text = other_frame_text(mount, marker)
            yield _posed(text, kernel, partial(_mounted, mount=mount), left=RIGHT)
        names = ', '.join('-' * int(row.sum() < 0.0) + 'xyz'[int(np.argmax(np.abs(row)))] for row in axes.T)
        text = f'the positions of the odometry are ({names}) in the axes of its orientations: publish both in one frame'
        yield _posed(text, kernel, partial(_exchanged, axes=axes), left=RIGHT)


def other_frame_text(mount: Array, marker: PlacedFrame | None) -> str:
    """Return that the poses are those of another frame on the base, at a mount (6,)."""
    angle = float(np.linalg.norm(mount[:3]))
    about = ', '.join(f'{each:.2g}' for each in np.round(-mount[:3] / max(angle, 1e-12), 2) + 0.0)
    parts = [f'turned by {np.degrees(angle):.0f} degrees about ({about})'] if angle > TURNED else []
    if np.linalg.norm(mount[3:]) > AWAY:
        place = ', '.join(f'{each:.0f}' for each in np.round(-1e3 * (exp(mount[:3]).T @ mount[3:])) + 0.0)
        parts.append(f'({place}) mm away')
    how = 'turn it back' if np.linalg.norm(mount[3:]) <= AWAY else 'correct it'
    where = f'{" and ".join(parts)} relative to the base link'
    return f'the frame of the odometry is {where}: {how}, or set {marker_text(mount, marker)}'


def mounted_windows(windows: Sequence[Window], mount: Array) -> list[Window]:
    """Return the windows of a base at a mount (6,) in what the odometry locates, without its twist."""
    return [replace(each, knots=_mounted(each.knots, mount)) for each in map(without_twist, windows)]


def _exchanged(knots: Knots, axes: Array) -> Knots:
    return replace(knots, base_position=np.einsum('ij,nj->ni', axes, knots.base_position))


def _mounted(knots: Knots, mount: Array) -> Knots:
    """Return the knots of a base that is mounted (6,), rad and m, off what the odometry locates."""
    rotation = knots.base_rotation
    return replace(
        knots, base_rotation=rotation @ exp(mount[:3]), base_position=knots.base_position + rotation @ mount[3:]
    )


def vibration_frequencies(values: Array, spacing: float) -> list[float]:
    """Return the frequencies (Hz) of the highest peaks in the spectrum of (W, k) values of windows, s apart."""
    count = len(values)
    if count < _FEWEST_WINDOWS:
        return []
    trend = np.vander(np.linspace(-1.0, 1.0, count), _TREND)
    left = values - trend @ np.linalg.lstsq(trend, values, rcond=None)[0]
    size = np.median(np.abs(left), axis=0) / 0.67
    clipped = np.clip(left, -_LARGEST * size, _LARGEST * size)
    power = np.abs(np.fft.rfft(clipped * np.hanning(count)[:, None], _FINER * count, axis=0)) ** 2
    power = np.max(power / np.maximum(np.median(power, axis=0), 1e-300), axis=1)
    frequency = np.fft.rfftfreq(_FINER * count, spacing)
    inner = power[1:-1]
    peak = np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > _CLEAR)) + 1
    peak = peak[frequency[peak] * count * spacing > _SWINGS]
    return [float(frequency[index]) for index in peak[np.argsort(-power[peak])][:_PEAKS]]
