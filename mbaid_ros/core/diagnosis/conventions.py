"""Poses in other conventions than those of ROS: what a driver may have mistaken."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from mbaid_ros.core.filter.knots import Knots
from mbaid_ros.core.filter.state import (
    BODY,
    MOMENTUM,
    Layout,
    Point,
)
from mbaid_ros.core.filter.window import (
    Stack,
    Window,
    stacked,
    without_twist,
)
from mbaid_ros.core.geometry import Array, Integers, quaternion_from_rotation, rotation_from_quaternion, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum import inertia_matrix

PoseReading = Callable[[Knots], Knots]

_MILLIMETRE = 1e-3  # m: a unit


def as_read(knots: Knots) -> Knots:
    """Return knots as they are."""
    return knots


def _inverse(knots: Knots) -> Knots:
    return replace(knots, base_rotation=np.swapaxes(knots.base_rotation, -1, -2))


def _scalar_first(knots: Knots) -> Knots:
    """Return the knots of quaternions whose w stands where x should, and so on."""
    quaternion = quaternion_from_rotation(knots.base_rotation)
    return replace(knots, base_rotation=rotation_from_quaternion(np.roll(quaternion, -1, axis=-1)))


def _in_millimetres(knots: Knots) -> Knots:
    return replace(knots, base_position=_MILLIMETRE * knots.base_position)


# In words, what knots are if it is so, and how far (m) the base would seem to go at least: less of it is explained by
# anything that makes it less.
MISREAD_POSES: tuple[tuple[str, PoseReading, float], ...] = (
    (
        'the orientation of the odometry is the inverse: in ROS it turns from the base to the odometry frame',
        _inverse,
        0.0,
    ),
    ('the quaternion of the odometry has its w first: in ROS it is x, y, z, w', _scalar_first, 0.0),
    ('the position of the odometry is in millimetres: in ROS it is in metres', _in_millimetres, 20.0),
)


FITTED = 30  # work of fitting all windows, in steps of the filter

_MOST_PAIRS = 12  # joints, up to which all pairs (66) are tried: of twenty they are nearly two hundred
_UNITS = (1e3, 1e-3)  # grams for kilograms, and the other way round
# s, late or early by 50 ms to half a second: less is within the prior of the time offset.
_DELAYS = 0.05 * np.concatenate((np.arange(-10, 0), np.arange(1, 11)))
_TURN = 2.0 * np.pi  # rad or m, which the readings of an arm hardly reach: in degrees or millimetres they go further
_RIDGE = 1e-9  # relative, of the fit: what the motion does not show stays near zero


@dataclass(frozen=True, eq=False)
class ConventionError:
    """Another robot.

    Attributes
    ----------
    text : in words
    order, scale : (n,) the joints' positions are scale times those of the joints in this order
    change : (n + 1, 10) that is added to the known bodies
    delay : s, by which the joints are stamped late
    pose : what knots are, of poses that are meant otherwise
    way : m, that the base goes at least, where it may be so
    """

    text: str
    order: Integers
    scale: Array
    change: Array
    delay: float = 0.0
    pose: PoseReading = as_read
    way: float = 0.0

    def possible(self, windows: Sequence[Window]) -> bool:
        """Tell whether windows may be of it: joints in degrees make whole turns, lengths in millimetres are long."""
        if np.any(np.abs(self.scale) != 1.0) and _largest(each.knots.joint_position for each in windows) < _TURN:
            return False
        return self.way == 0.0 or _largest(each.knots.base_position for each in windows) > self.way

    def windows(self, windows: Sequence[Window]) -> list[Window]:
        """Return windows as that robot has them; a twist is in the axes of poses as they were read."""
        if self.pose is not as_read:
            return [replace(each, knots=self.pose(each.knots)) for each in map(without_twist, windows)]
        return [
            replace(each, knots=replace(each.knots, joint_position=self.scale * positions[:, self.order]))
            for each, positions in zip(windows, _stamped(windows, self.delay), strict=True)
        ]


def convention_errors(kernel: MomentumKernel) -> Iterator[ConventionError]:
    """Yield the robot as it is described, and those that are tried beside it."""
    names, count = kernel.model.joint_names, kernel.model.joints
    order, sign, same = np.arange(count, dtype=np.int64), np.ones(count), np.zeros_like(kernel.known)
    yield ConventionError('', order, sign, same)
    for joint, name in enumerate(names):
        flipped = np.where(order == joint, -1.0, 1.0)
        yield ConventionError(
            f'the sign of {name} is wrong: turn it round in the driver or the URDF', order, flipped, same
        )
    for one, other in combinations(range(count), 2) if count <= _MOST_PAIRS else ():
        swapped = order.copy()
        swapped[[one, other]] = other, one
        text = f'{names[one]} and {names[other]} are swapped: check the names in the joint states'
        yield ConventionError(text, swapped, sign, same)
    for delay in _DELAYS.tolist():
        more = ' or more' if abs(delay) == _DELAYS[-1] else ''
        how = f'{1e3 * abs(delay):.0f} ms{more} {"late" if delay > 0.0 else "early"}'
        text = f'the joints are stamped some {how} against the poses: mend the stamps, or raise time_offset.prior_std'
        yield ConventionError(text, order, sign, same, delay)
    degrees = np.where(kernel.model.prismatic, 1.0, np.deg2rad(1.0))
    yield ConventionError('the joint positions are in degrees: in ROS they are in radians', order, degrees, same)
    if any(kernel.model.prismatic):
        millimetres = np.where(kernel.model.prismatic, 1e-3, 1.0)
        yield ConventionError(
            'the positions of prismatic joints are in millimetres: in ROS they are in metres', order, millimetres, same
        )
    for text, pose, way in MISREAD_POSES:
        yield ConventionError(text, order, sign, same, pose=pose, way=way)
    links = [link for link in kernel.model.links if link.parameters[0] > 0.0]
    heaviest = {link.body: link for link in sorted(links, key=lambda each: each.parameters[0])}  # of what is fixed
    for link in heaviest.values():
        if link.name not in {each.name for each in kernel.unknown}:
            # A base in tonnes is an arm in grams: momentum and all masses may grow together.
            for unit in _UNITS[: 1 if link.body == 0 else None]:
                change = same.copy()
                change[link.body] = (1.0 / unit - 1.0) * kernel.known[link.body]
                text = f'link {link.name} is {unit:g} times as heavy as it is: a wrong unit or body in the URDF?'
                yield ConventionError(text, order, sign, change)
    for unit in _UNITS:
        change = (1.0 / unit - 1.0) * kernel.known
        change[0] = 0.0
        moving = ', '.join(link.name for link in kernel.model.links if link.body and link.parameters[0] > 0.0)
        yield ConventionError(
            f'the moving links ({moving}) are {unit:g} times as heavy as they are: a wrong unit?', order, sign, change
        )


def _largest(values: Iterable[Array]) -> float:
    """Return the largest of all magnitudes; zero where nothing is known."""
    return max((float(np.max(np.abs(np.nan_to_num(each)), initial=0.0)) for each in values), default=0.0)


def _stamped(windows: Sequence[Window], delay: float) -> list[Array]:
    """Return the joint positions (J, n) at the knots of windows if they are stamped late by a delay, s."""
    positions = [each.knots.joint_position for each in windows]
    if delay == 0.0:
        return positions
    times = [each.start + each.spacing * (np.arange(len(each.knots)) - each.inside.start) for each in windows]
    # Windows share knots with their neighbours.
    every, place = np.unique(np.round(np.concatenate(times), 6), return_index=True)
    values = np.concatenate(positions)[place]
    known = np.isfinite(values).all(axis=1)
    every, values = every[known], values[known]
    # Before the first and after the last of them the joints go on as they went.
    ends = np.array([[0, 1], [-1, -2]])
    rates = np.diff(values[ends], axis=1)[:, 0] / np.diff(every[ends], axis=1)
    beyond = np.array([every[0] - abs(delay), every[-1] + abs(delay)])
    further = values[[0, -1]] + rates * (beyond - every[[0, -1]])[:, None]
    every = np.concatenate((beyond[:1], every, beyond[1:]))
    values = np.concatenate((further[:1], values, further[1:]))
    return [np.column_stack([np.interp(own + delay, every, joint) for joint in values.T]) for own in times]


@dataclass(frozen=True)
class Fit:
    """What windows say under a misreading.

    Attributes
    ----------
    misreading : Misreading
    parameters : (16,) (P, L, phi), L about the run's origin
    misfit : mean squared velocity of the base that is not explained, angular ones times the robot's size
    """

    misreading: ConventionError
    parameters: Array
    misfit: float

    def point(self, layout: Layout) -> Point:
        """Return where windows are linearised."""
        state = np.concatenate((np.zeros(BODY.stop), layout.known.mean))
        state[MOMENTUM.start : BODY.stop] = self.parameters
        return layout.point(state)


def fitted(kernel: MomentumKernel, windows: Sequence[Window], misreading: ConventionError, every: int = 1) -> Fit:
    """Return the body and momentum that explain windows, or one in so many of them, best under a misreading."""
    rows, values = [], []
    robot = kernel.corrected(misreading.change)
    for stack in stacked(misreading.windows(windows)[::every]):
        own, value = _equations(robot, stack)
        rows.append(own)
        values.append(value)
    matrix, right = np.concatenate(rows), np.concatenate(values)
    size = np.sqrt(np.sum(matrix**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = matrix / size
    normal = scaled.T @ scaled + _RIDGE * np.eye(len(size))
    parameters = np.linalg.solve(normal, scaled.T @ right) / size
    return Fit(misreading, parameters, float(np.mean((matrix @ parameters - right) ** 2)))


def as_described(layout: Layout, windows: Sequence[Window]) -> Point:
    """Return where a fit of the robot as it is described would have windows linearised."""
    return fitted(layout.kernel, windows, next(convention_errors(layout.kernel))).point(layout)


def _equations(kernel: MomentumKernel, stack: Stack) -> tuple[Array, Array]:
    """Return T h - Y phi = momentum of the known bodies, means over each window, in velocities of the base."""
    middle, inside = stack.middle, stack.windows[0].inside
    motion, spacing = middle[inside], stack.windows[0].spacing
    shape, flat = motion.turn.shape[:2], motion.flat
    twist = np.concatenate((flat.step, flat.turn), axis=1) / spacing
    states = kernel.states_of(flat.base_rotation, flat.joint_position, flat.joint_velocity, twist)
    total = np.zeros((len(twist), 6, 16))
    total[:, :, :6] = np.eye(6)
    total[:, 3:, :3] = -skew(flat.base_position)
    total[:, :, 6:] = -states.regressor
    value = states.known_momentum - (total[:, :, :6] @ flat.impulse[..., None])[..., 0]
    back = np.linalg.inv(np.mean(np.sum(inertia_matrix(states.known), axis=1), axis=0))
    size = np.sqrt(back[0, 0] / max(back[3, 3], 1e-30))  # m: turns as displacements
    weigh = back * np.repeat((1.0, size), 3)[:, None]
    rows = np.mean((weigh @ total).reshape(*shape, 6, 16), axis=0)
    return rows.reshape(-1, 16), np.mean((value @ weigh.T).reshape(*shape, 6), axis=0).ravel()
