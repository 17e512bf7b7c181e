"""Sensor conventions and units that a driver or a URDF may have mistaken: readings transformed, and fitted again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, permutations, product

import numpy as np

from mbaid_ros.core.filter.knots import Knots
from mbaid_ros.core.filter.state import BODY, MOMENTUM, Layout, Point
from mbaid_ros.core.filter.window import Stack, Window, stacked, without_twist
from mbaid_ros.core.geometry import Array, exp, log, quaternion_from_rotation, rotation_from_quaternion, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum import inertia_matrix
from mbaid_ros.core.unknowns.base import marker_text
from mbaid_ros.core.unknowns.declaration import PlacedFrame

FITTED = 30  # work of fitting all windows, in steps of the filter

_MILLIMETRE = 1e-3  # m: a unit
_FAR_BASE = 20.0  # m, that a base seems to move at least where its positions may be in millimetres
_MOST_PAIRS = 12  # joints, up to which all pairs (66) are tried: of twenty they are nearly two hundred
_UNITS = (1e3, 1e-3)  # grams for kilograms, and the other way round
# s, late or early by 50 ms to half a second: less is within the prior of the time offset.
_DELAYS = 0.05 * np.concatenate((np.arange(-10, 0), np.arange(1, 11)))
_LIGHTEST = -0.05  # times the known mass, that a fitted one is at least: noise may make that of an empty hand negative
_TURN = 2.0 * np.pi  # rad, which the readings of an arm hardly reach: in degrees they go further
# Part of the misfit that a convention may leave to be tried, and that another target link or other axes may: a body
# that slips in the grasp resembles another link, but less well.
_LEFT, _RIGHT = 0.8, 0.2
_RIDGE = 1e-9  # relative, of the fit: unobservable numbers stay near zero


@dataclass(frozen=True, eq=False)
class Convention:
    """How the readings or the robot may be meant."""

    text: str  # the mistake and its remedy
    kernel: MomentumKernel  # of the robot under this hypothesis
    windows: Callable[[Sequence[Window]], Sequence[Window]] = list  # the windows under this hypothesis
    joint_range: float = 0.0  # rad, that joint readings exceed at least where it may be so
    base_range: float = 0.0  # m, that positions of the base do
    delay: float = 0.0  # s, of the joints' stamps
    misfit_left: float = _LEFT  # part of the misfit that it may leave to be tried

    def possible(self, windows: Sequence[Window]) -> bool:
        """Return whether windows may follow this convention: degrees make whole turns, millimetres are long."""
        if self.joint_range and _largest(each.knots.joint_position for each in windows) < self.joint_range:
            return False
        return not self.base_range or _largest(each.knots.base_position for each in windows) > self.base_range


# What may be mistaken on a robot.
ConventionFactory = Callable[[MomentumKernel], Iterable[Convention]]


def reversed_joints(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield each joint with the other sign."""
    order = np.arange(kernel.model.joints, dtype=np.int64)
    for joint, name in enumerate(kernel.model.joint_names):
        text = f'the sign of {name} is wrong: reverse it in the driver or the URDF'
        yield Convention(
            text, kernel, partial(_joints, change=partial(np.multiply, np.where(order == joint, -1.0, 1.0)))
        )


def swapped_joints(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield each pair of joints, the one in the place of the other."""
    names, count = kernel.model.joint_names, kernel.model.joints
    for one, other in combinations(range(count), 2) if count <= _MOST_PAIRS else ():
        swapped = np.arange(count, dtype=np.int64)
        swapped[[one, other]] = other, one
        text = f'{names[one]} and {names[other]} are swapped: check the names in the joint states'
        yield Convention(text, kernel, partial(_joints, change=partial(np.take, indices=swapped, axis=1)))


def joints_stamped_late(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield joints that are stamped too late or too early."""
    for delay in _DELAYS.tolist():
        more = ' or more' if abs(delay) == _DELAYS[-1] else ''
        how = f'{1e3 * abs(delay):.0f} ms{more} {"late" if delay > 0.0 else "early"}'
        text = (
            f'the joints are stamped some {how} against the poses: correct the stamps, or raise time_offset.prior_std'
        )
        yield Convention(text, kernel, partial(_stamped, delay=delay), delay=delay)


def joints_in_degrees(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield joint positions in degrees; none for a robot that only slides, which reads the same in either unit."""
    degrees = np.where(kernel.model.prismatic, 1.0, np.deg2rad(1.0))
    if np.any(degrees != 1.0):
        text = 'the joint positions are in degrees: in ROS they are in radians'
        yield Convention(text, kernel, partial(_joints, change=partial(np.multiply, degrees)), joint_range=_TURN)


def mistaken_poses(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield inverse orientations, quaternions with w first, and positions in millimetres."""
    for text, pose, far in _POSES:
        yield _posed(text, kernel, pose, base_range=far)


def other_targets(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield another unknown link on each other body: the last one with an inertia."""
    last = {link.body: link.name for link in kernel.model.links if link.parameters[0] > 0.0}
    for body, name in last.items() if len(kernel.unknown) == 1 else ():
        if body != kernel.target.body:
            text = f'the unknown body seems to be held by {name}, not {kernel.target.name}: set target_link: {name}'
            yield Convention(text, kernel.with_unknown_link(name), misfit_left=_RIGHT)


def mistaken_masses(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield links in a wrong unit: each, and all that move."""
    links = [link for link in kernel.model.links if link.parameters[0] > 0.0]
    # Of links fixed to each other.
    heaviest = {link.body: link for link in sorted(links, key=lambda each: each.parameters[0])}
    for link in heaviest.values():
        if link.name not in {each.name for each in kernel.unknown}:
            # A base in tonnes is an arm in grams: momentum and all masses may grow together.
            for unit in _UNITS[: 1 if link.body == 0 else None]:
                change = np.zeros_like(kernel.known)
                change[link.body] = (1.0 / unit - 1.0) * kernel.known[link.body]
                text = f'link {link.name} is {unit:g} times as heavy as it is: a wrong unit or body in the URDF?'
                yield Convention(text, kernel.with_body_changes(change))
    moving = ', '.join(link.name for link in kernel.model.links if link.body and link.parameters[0] > 0.0)
    for unit in _UNITS:
        change = (1.0 / unit - 1.0) * kernel.known
        change[0] = 0.0
        yield Convention(
            f'the moving links ({moving}) are {unit:g} times as heavy as they are: a wrong unit?',
            kernel.with_body_changes(change),
        )


def _scalar_first(knots: Knots) -> Knots:
    """Return the knots of quaternions whose w stands where x should, and so on."""
    quaternion = quaternion_from_rotation(knots.base_rotation)
    return replace(knots, base_rotation=rotation_from_quaternion(np.roll(quaternion, -1, axis=-1)))


_POSES: tuple[tuple[str, Callable[[Knots], Knots], float], ...] = (
    (
        'the orientation of the odometry is the inverse: in ROS it rotates from the base to the odometry frame',
        lambda knots: replace(knots, base_rotation=np.swapaxes(knots.base_rotation, -1, -2)),
        0.0,
    ),
    ('the quaternion of the odometry has its w first: in ROS it is x, y, z, w', _scalar_first, 0.0),
    (
        'the position of the odometry is in millimetres: in ROS it is in metres',
        lambda knots: replace(knots, base_position=_MILLIMETRE * knots.base_position),
        _FAR_BASE,
    ),
)


def _posed(
    text: str, kernel: MomentumKernel, change: Callable[[Knots], Knots], base_range: float = 0.0, left: float = _LEFT
) -> Convention:
    """Return a convention of the poses; a twist is in the axes of poses as they were read, and left out."""

    def changed(windows: Sequence[Window]) -> list[Window]:
        return [replace(each, knots=change(each.knots)) for each in map(without_twist, windows)]

    return Convention(text, kernel, changed, base_range=base_range, misfit_left=left)


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
            vector = log(axes)
            angle = float(np.linalg.norm(vector))
            mount = np.concatenate((-vector, np.zeros(3)))
            about = ', '.join(f'{each:.2g}' for each in np.round(vector / angle, 2) + 0.0)
            text = (
                f'the frame of the odometry is turned by {np.degrees(angle):.0f} degrees about ({about}) relative to '
                f'the base link: turn it back, or set {marker_text(mount, marker)}'
            )
            yield _posed(text, kernel, partial(_mounted, mount=mount), left=_RIGHT)
        names = ', '.join('-' * int(row.sum() < 0.0) + 'xyz'[int(np.argmax(np.abs(row)))] for row in axes.T)
        text = f'the positions of the odometry are ({names}) in the axes of its orientations: publish both in one frame'
        yield _posed(text, kernel, partial(_exchanged, axes=axes), left=_RIGHT)


def _exchanged(knots: Knots, axes: Array) -> Knots:
    return replace(knots, base_position=np.einsum('ij,nj->ni', axes, knots.base_position))


def _mounted(knots: Knots, mount: Array) -> Knots:
    """Return the knots of a base that is mounted (6,), rad and m, off what the odometry locates."""
    rotation = knots.base_rotation
    return replace(
        knots, base_rotation=rotation @ exp(mount[:3]), base_position=knots.base_position + rotation @ mount[3:]
    )


def _joints(windows: Sequence[Window], change: Callable[[Array], Array]) -> list[Window]:
    """Return windows with other joint positions."""
    return [
        replace(each, knots=replace(each.knots, joint_position=change(each.knots.joint_position))) for each in windows
    ]


def _stamped(windows: Sequence[Window], delay: float) -> list[Window]:
    """Return windows as they are if their joints are stamped late by a delay, s; those that were read by then."""
    times = [each.start + each.spacing * (np.arange(len(each.knots)) - each.inside.start) for each in windows]
    # Windows share knots with their neighbours.
    every, place = np.unique(np.round(np.concatenate(times), 6), return_index=True)
    values = np.concatenate([each.knots.joint_position for each in windows])[place]
    known = np.isfinite(values).all(axis=1)
    every, values = every[known], values[known]
    moved = []
    for each, own in zip(windows, times, strict=True):
        read = np.isfinite(each.knots.joint_position).all(axis=1)
        then, position = np.round(own + delay, 6), np.full_like(each.knots.joint_position, np.nan)
        if np.all((then >= every[0]) & (then <= every[-1]) | ~read):
            position[read] = np.column_stack([np.interp(then[read], every, joint) for joint in values.T])
            moved.append(replace(each, knots=replace(each.knots, joint_position=position)))
    return moved


def _largest(values: Iterable[Array]) -> float:
    """Return the largest of all magnitudes; zero where nothing is known."""
    return max((float(np.max(np.abs(np.nan_to_num(each)), initial=0.0)) for each in values), default=0.0)


@dataclass(frozen=True)
class Fit:
    """The body and momentum that explain windows best under a convention, by linear least squares."""

    convention: Convention
    parameters: Array  # (16,) (P, L, phi), L about the run's origin
    misfit: float  # mean squared velocity of the base that is not explained, angular ones times the robot's size

    @property
    def exists(self) -> bool:
        """Whether a body may have the fitted mass."""
        return bool(self.parameters[6] > _LIGHTEST * np.sum(self.convention.kernel.known[:, 0]))

    def point(self, layout: Layout) -> Point:
        """Return where windows are linearised."""
        state = np.concatenate((np.zeros(BODY.stop), layout.known.mean))
        state[MOMENTUM.start : BODY.stop] = self.parameters
        return layout.point(state)


def fitted(windows: Sequence[Window], convention: Convention, every: int = 1) -> Fit:
    """Return the fit of one in so many windows under a convention."""
    parts = [_equations(convention.kernel, stack) for stack in stacked(convention.windows(windows)[::every])]
    matrix, right = (np.concatenate(each) for each in zip(*parts, strict=True))
    size = np.sqrt(np.sum(matrix**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = matrix / size
    normal = scaled.T @ scaled + _RIDGE * np.eye(len(size))
    parameters = np.linalg.solve(normal, scaled.T @ right) / size
    return Fit(convention, parameters, float(np.mean((matrix @ parameters - right) ** 2)))


def point_as_described(layout: Layout, windows: Sequence[Window]) -> Point:
    """Return where the fit of the robot as it is described would have windows linearised."""
    return fitted(windows, Convention('', layout.kernel)).point(layout)


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
