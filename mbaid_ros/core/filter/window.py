"""Windows of knots with the noise of their measurements, and stacks of windows of one shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from mbaid_ros.core.filter.knots import Knots, Midpoints, at_the_base, midpoints, with_joints_later
from mbaid_ros.core.filter.state import ANGULAR_FIRST
from mbaid_ros.core.geometry import Array, Flags, cross, crossed, exp, log, rotate_back
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.unknowns.declaration import NominalModel


def on_link(middle: Midpoints, kinematics: Kinematics, link: Link) -> Midpoints:
    """Return a motion with the axes of an IMU on a link, and its turn by each joint rate."""
    flat, shape = middle.flat, middle.turn.shape[:-1]
    placed = kinematics.configure(flat.base_rotation, flat.joint_position)
    gain = np.swapaxes(placed.joint_twist[..., 3:] * kinematics.ancestors[link.body][:, None], 1, 2)
    axes, _ = placed.link_pose(link)
    return replace(middle, gyro_axes=axes.reshape(*shape, 3, 3), gyro_gain=gain.reshape(*shape, *gain.shape[1:]))


@dataclass(frozen=True)
class WindowNoise:
    """Noise of the means of a window's measurements."""

    samples: int  # number in the window
    joint_position: float | Array  # standard deviation of one sample, rad or m; (n,) where joints differ
    pose: Array  # (6, 6) mean covariance of one sample, (orientation, position), odometry axes
    twist: Array  # (6, 6) of one sample, (angular, linear), base axes
    gyro: float = 0.0  # rad/s/sqrt(Hz), density of the gyro's noise; 0 where there is none
    correlation_time: float = 0.0  # s, of the errors of the poses; 0 for independent ones


def window_noises(windows: Sequence[Samples], noise: SensorNoise, gyro: float = 0.0) -> list[WindowNoise]:
    """Return the noise of windows' means."""
    poses, twists = (
        np.stack([np.add.reduce(each, axis=0) / len(each) for each in covariances])[
            :, ANGULAR_FIRST[:, None], ANGULAR_FIRST
        ]
        for covariances in ([each.pose_covariance for each in windows], [each.twist_covariance for each in windows])
    )
    return [
        WindowNoise(len(window), declared.joint_position, pose, twist, gyro, declared.base_correlation_time)
        for window, pose, twist in zip(windows, poses, twists, strict=True)
        for declared in [noise.for_window(window)]
    ]


# Of a fourth difference, what `midpoints` leaves out: of midway values, and at the ends of the knots.
_TRUNCATION, _AT_AN_END = 3.0 / 256.0, 1.0 / 8.0
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])


def with_truncation(noise: WindowNoise, knots: Knots, *, at_an_end: bool) -> WindowNoise:
    """Return the noise of a window with the truncation error of its knots' fourth-order formulas, from the data.

    A fourth difference over the whole window, scaled to neighbouring knots, has less noise than the formulas.
    """
    stride = (len(knots) - 1) // 4
    five = knots[: 4 * stride + 1 : stride]
    turned = log(five.base_rotation @ five.base_rotation[2].T)
    linear, angular = five.base_twist[:, :3], five.base_twist[:, 3:]
    values = np.concatenate((turned, five.base_position, angular, linear, five.joint_position), axis=1)
    size = (_AT_AN_END if at_an_end else _TRUNCATION) / stride**4
    variance = noise.samples * np.nan_to_num(size * (_FOURTH @ values)) ** 2
    return replace(
        noise,
        joint_position=np.sqrt(noise.joint_position**2 + variance[12:]),
        pose=noise.pose + np.diag(variance[:6]),
        twist=noise.twist + np.diag(variance[6:12]),
    )


STACK = 10  # windows linearised at a time: one piece of work, of some milliseconds


@dataclass(frozen=True, eq=False)
class Window:
    """A window's knots, with the neighbours that its formulas need."""

    knots: Knots  # Knots
    inside: slice  # the window's own intervals among theirs; each begins at a knot of the window
    spacing: float  # s, between knots
    noise: WindowNoise  # WindowNoise
    start: float  # s since the first sample of the run
    fresh: bool  # whether a gap (or the start) comes before it
    origin: Array = field(default_factory=lambda: np.zeros(3))  # (3,) m, of the run in the odometry frame
    gap: float = 0.0  # s from the end of the window before to its start

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of knots, and first and last own interval: the same in a stack."""
        return len(self.knots), self.inside.start, self.inside.stop

    @property
    def length(self) -> float:
        """Of its own intervals, s."""
        return (self.inside.stop - self.inside.start) * self.spacing


@lru_cache(maxsize=256)
def without_twist(window: Window) -> Window:
    """Return a window of poses alone; the same object whenever it is asked for."""
    nothing = np.full_like(window.knots.base_twist, np.nan)
    return replace(window, knots=replace(window.knots, base_twist=nothing))


@dataclass(frozen=True)
class Stack:
    """Windows of one shape, side by side."""

    windows: tuple[Window, ...]  # B of them
    places: tuple[int, ...]  # where they are in the list that was stacked

    @cached_property
    def knots(self) -> Knots:
        """All knots, (J, B, ...)."""
        return Knots.stack([window.knots for window in self.windows])

    @cached_property
    def middle(self) -> Midpoints:
        """The motion midway between all knots as measured, (J - 1, B, ...)."""
        return midpoints(self.knots, self.windows[0].spacing)

    def motion(self, side: NominalModel, imu: Link | None = None, beside: int = 1) -> tuple[Midpoints, slice]:
        """Return the motion as a nominal model corrects it, with intervals `beside` it, and the own part.

        An IMU may be on a link that joints move (`imu`).
        """
        if side.mount.any():
            middle = midpoints(at_the_base(self.knots, side.mount), self.windows[0].spacing)
        elif side.gyro.any() and self.knots.course.shape[-1]:
            middle = midpoints(_turned_back(self.knots, side.gyro), self.windows[0].spacing)
            read = rotate_back(middle.base_rotation, middle.turn / self.windows[0].spacing)
            bias, scale, turn, shared = side.gyro.reshape(4, 3)
            errors = bias + scale * read + cross(read, np.broadcast_to(turn, read.shape)) + crossed(read) @ shared
            middle = replace(middle, gyro=middle.gyro - errors)
        else:
            middle = self.middle
        if side.delay != 0.0:
            middle = with_joints_later(middle, side.delay, self.windows[0].spacing)
        if side.zeros.any():
            middle = replace(middle, joint_position=middle.joint_position + side.zeros)
        first, last, _ = self.windows[0].inside.indices(len(middle))
        begin = max(first - beside, 0)
        middle = middle[begin : last + beside]
        if imu is not None and middle.gyro.shape[-1]:
            middle = on_link(middle, side.kernel.kinematics, imu)
        return middle, slice(first - begin, last - begin)

    @cached_property
    def samples(self) -> Array:
        """Number of samples in each window, (B, 1, 1)."""
        return np.array([float(window.noise.samples) for window in self.windows])[:, None, None]

    @cached_property
    def middles(self) -> Array:
        """Time in the middle of each window, (B,) s."""
        return np.array([window.start + 0.5 * window.length for window in self.windows])

    @cached_property
    def whitening(self) -> Array:
        """Share of a pose's change over each window that whitens the errors of its mean when added, (B, 1).

        For an autoregression x' = c x + e from knot to knot, the mean of e over m knots, over 1 - c, is the mean of x
        and 1 / (m (1 - c)) of its change. 0 where the errors are independent.
        """
        times = np.array([window.noise.correlation_time for window in self.windows])
        step = -np.expm1(-self.windows[0].spacing / np.where(times > 0.0, times, np.inf))
        first, last, _ = self.windows[0].inside.indices(len(self.knots))
        return np.where(times > 0.0, 1.0 / ((last - first) * np.where(times > 0.0, step, 1.0)), 0.0)[:, None]

    @cached_property
    def integrates_twist(self) -> Flags:
        """Which windows' twist counts by its integral (B,): where that is the better change of correlated poses.

        Its noise then adds to that of the mean pose. Not with a gyro beside.
        """
        inside = self.windows[0].inside
        twist = np.isfinite(self.knots.base_twist[inside.start : inside.stop + 1]).all(axis=(0, 2))
        if self.knots.gyro.shape[-1]:
            return np.zeros_like(twist)
        twist &= np.isfinite(self.pose_covariance).all(axis=(1, 2))
        pose, of_twist = (
            np.diagonal(each, axis1=1, axis2=2).reshape(-1, 2, 3).sum(axis=2)
            for each in (self.pose_covariance, self.twist_covariance)
        )
        added = (self.whitening * self.windows[0].length) ** 2 * of_twist
        return np.asarray((self.whitening[:, 0] > 0.0) & twist & np.all(added < pose, axis=1))

    @cached_property
    def joint_variance(self) -> Array:
        """Variance of the joint positions in one sample, (B, 1, 1) rad^2 or m^2; (B, 1, n) where joints differ."""
        return np.stack([np.atleast_1d(window.noise.joint_position**2) for window in self.windows])[:, None, :]

    @cached_property
    def pose_covariance(self) -> Array:
        """Covariances of one sample, (B, 6, 6)."""
        return np.stack([window.noise.pose for window in self.windows])

    @cached_property
    def twist_covariance(self) -> Array:
        """Covariances of one sample, (B, 6, 6)."""
        return np.stack([window.noise.twist for window in self.windows])

    @cached_property
    def gyro_variance(self) -> Array:
        """Power density of the gyro's noise, (B, 1, 1) rad^2/s."""
        return np.array([window.noise.gyro**2 for window in self.windows])[:, None, None]


def _turned_back(knots: Knots, errors: Array) -> Knots:
    """Return knots whose orientation and angular velocity are those of a gyro without (12,) errors."""
    away = knots.course.reshape(*knots.course.shape[:-1], 3, 12) @ errors
    return replace(knots, base_rotation=exp(-away) @ knots.base_rotation)


def stacked(windows: Sequence[Window]) -> list[Stack]:
    """Return windows in stacks of one shape each."""
    alike: dict[tuple[int, int, int], list[int]] = {}
    for place, window in enumerate(windows):
        alike.setdefault(window.shape, []).append(place)
    return [Stack(tuple(windows[place] for place in places), tuple(places)) for places in alike.values()]


def in_stacks(windows: Sequence[Window], size: int = STACK) -> list[list[Stack]]:
    """Return windows in order, `size` at a time, each part in stacks of one shape."""
    return [stacked(windows[first : first + size]) for first in range(0, len(windows), size)]
