"""Windows in the filter's variables, measurements in units of their noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mbaid_ros.core.filter.chain import WindowModel, window_models
from mbaid_ros.core.filter.joint_noise import TwistLink, errors_in_variables_bias, integrated_twist_rows
from mbaid_ros.core.filter.measured_window import Measurement
from mbaid_ros.core.filter.state import BODY, MOMENTUM, POSE, Layout, Point
from mbaid_ros.core.filter.swing import SwingCourse
from mbaid_ros.core.filter.twist_prediction import predict
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.window import Stack, Window, stacked
from mbaid_ros.core.geometry import Array, Integers, skew

# Where a constant force and torque acts, and in which axes.
Axes = Literal['none', 'inertial', 'inertial on the base', 'body']
_ACTING: tuple[Axes, ...] = ('inertial', 'inertial on the base', 'body')


@dataclass(frozen=True)
class WhitenedWindow:
    """A window in the filter's variables, measurements in units of their noise."""

    # value, rows: (k,), (k, v): value = rows variables + white noise of variance 1
    value: Array
    rows: Array
    log_noise: float  # logarithm of the determinant of the noise's covariance
    # transition, drift, process: (p, v), (p,), (p, n): to the p pose errors, the first variables, at the next window's
    # first knot; the last is a factor of the joint noise that accumulates until then
    transition: Array
    drift: Array
    process: Array
    inverse_transition: Array  # (2 p, 2 p) inverse of the transition of pose error and momentum
    shared: Array  # (v,) mean score by noise that rows and value share
    bias_information: Array  # (b, b + 1) information M of the body by noise in the rows, and M times the body
    pose_error_by_momentum: Array  # (6, 6) derivative of the next pose error by the momentum, SI units
    momentum_change: Array  # (p, v) change of the momentum until the next window by the variables
    momentum_by_force: Array  # (3, p, f) change of the momentum by a constant force and torque, acting as in `_ACTING`
    by_process_steps: Array  # (p, f) as of `JointNoise`
    process_variance: Array  # (f,) the same
    length: float  # s
    places: Integers  # (k,) of the values among the numbers that a window may measure, as of `Innovations`
    twist_link: TwistLink | None = None  # for an integrated twist, the links to the windows before and after

    def with_known(self, values: Array) -> WhitenedWindow:
        """Return the window where some variables are known exactly: their values (v,), NaN for the others."""
        known = np.isfinite(values)
        at = np.where(known, values, 0.0)
        return replace(
            self,
            value=self.value - self.rows @ at,
            rows=self.rows * ~known,
            drift=self.drift + self.transition @ at,
            transition=self.transition * ~known,
        )

    def force_impulse(self, axes: Axes) -> Array:
        """Return the change of the momentum by a constant force and torque in these axes, (p, f)."""
        return self.momentum_by_force[_ACTING.index(axes)]


def whitened_windows(windows: WindowModel, variables: Variables) -> list[WhitenedWindow]:
    """Return B windows in the filter's variables."""
    known = np.isfinite(windows.pose.covariance)
    # In a run all windows measure the same parts: pose, orientation alone, or nothing.
    missing = ~np.diagonal(known, axis1=1, axis2=2).all(axis=0)
    select = variables.measured[~np.any(variables.measured[:, missing], axis=1)]
    measurement = replace(windows.pose, covariance=np.where(known, windows.pose.covariance, np.eye(6)))
    pose = _whitened(measurement, variables, select)
    precision = pose.precision
    weighed = pose.weighed(windows.noise.pose, windows.joints_of_gyro)
    places = np.arange(len(select))
    measured = [(*each, places) for each in zip(pose.value, pose.rows, pose.log_noise, strict=True)]
    links: list[TwistLink | None] = [None] * len(measured)
    integrated = windows.integrated.replaces_twist
    if integrated.any():
        chosen = windows[integrated]
        joined, precision[integrated] = integrated_twist_rows(chosen.integrated, chosen.pose, chosen.noise, variables)
        weighed[integrated] = precision[integrated] @ chosen.noise.pose
        for index, (value, rows, log_noise, link) in zip(np.flatnonzero(integrated).tolist(), joined, strict=True):
            measured[index], links[index] = (value, rows, log_noise, np.arange(len(value))), link
    alone = np.where(integrated[:, None], np.nan, windows.twist.value)
    for moving, select, of_rates in _rates(alone, variables):
        measurement = windows.twist[moving]
        measurement = replace(measurement, value=np.nan_to_num(measurement.value))  # of those outside this selection
        twist = _whitened(measurement, variables, select)
        times = windows.joints_in_twist[moving, None, None]
        precision[moving] += times * twist.precision
        weighed[moving] += times * twist.weighed(windows.noise.pose[moving], windows.joints_of_gyro[moving])
        values = np.concatenate((pose.value[moving], twist.value), axis=1)
        both = np.concatenate((pose.rows[moving], twist.rows), axis=1)
        log_noise = pose.log_noise[moving] + twist.log_noise
        all_places = np.concatenate((places, of_rates))
        for index, values_of_window in zip(moving.tolist(), zip(values, both, log_noise, strict=True), strict=True):
            measured[index] = (*values_of_window, all_places)
    turn = variables.from_state[: variables.poses, POSE]
    transition = turn @ variables.rows(windows.transition)
    head: Array = np.tile(np.eye(variables.head), (len(transition), 1, 1))
    head[:, : variables.poses] = transition[..., : variables.head]
    return [
        WhitenedWindow(value, rows, float(log_noise), *rest)
        for (value, rows, log_noise), *rest in zip(
            (each[:3] for each in measured),
            transition,
            (turn @ windows.drift[..., None])[..., 0],
            turn @ windows.noise.process,
            np.linalg.inv(head),
            _shared(weighed, windows.noise.by_unknowns, variables),
            errors_in_variables_bias(precision, windows.noise.by_unknowns, windows.body, variables),
            windows.transition[..., MOMENTUM],
            variables.from_state[variables.poses : variables.head, MOMENTUM] @ variables.rows(windows.momentum_change),
            _momentum_by_force(windows, variables),
            turn @ windows.noise.by_process_steps,
            windows.noise.process_variance,
            windows.length.tolist(),
            (each[3] for each in measured),
            links,
            strict=True,
        )
    ]


@dataclass(frozen=True)
class _White:
    """Measurements of B windows in units of their noise."""

    # value, rows, log_noise: (B, k), (B, k, v), (B,) as in `WhitenedWindow`
    value: Array
    rows: Array
    log_noise: Array
    whiten: Array  # (B, k, 6) the whitening matrix for the joints' noise in pose or twist
    whiten_gyro: Array  # (B, k, 3) and for the extra noise of a gyro on a link; (B, k, 0) without a gyro

    @property
    def precision(self) -> Array:
        """S^-1 of these measurements, for the joints' noise in them, (B, 6, 6)."""
        return np.asarray(np.swapaxes(self.whiten, -1, -2) @ self.whiten)

    def weighed(self, joints: Array, of_gyro: Array) -> Array:
        """Return S^-1 A of the joints' noise A (B, 6, n), beside which a gyro on a link has (B, 3, n)."""
        white = self.whiten @ joints
        if self.whiten_gyro.shape[-1] and of_gyro.any():
            white = white + self.whiten_gyro @ of_gyro
        return np.asarray(np.swapaxes(self.whiten, -1, -2) @ white)


def _rates(value: Array, variables: Variables) -> Iterator[tuple[Integers, Array, Integers]]:
    """Yield the windows with twist alone, gyro alone, or both, the combinations that hold, and their places.

    A value (B, 6), or with a gyro (B, 9), is NaN where it is not measured.
    """
    poses, known = variables.poses, np.isfinite(value)
    twist, gyro = known[:, :6].all(axis=-1), known[:, 6:].all(axis=-1) & (value.shape[1] > 6)
    turns = variables.measured[variables.measured[:, :3].any(axis=1)]
    select = np.zeros((poses + len(turns), value.shape[1]))
    select[:poses, :6] = variables.measured
    if value.shape[1] > 6:
        select[poses:, 6:] = turns[:, :3]
    places = poses + np.arange(len(select))
    for which, of_it in (
        (twist & ~gyro, slice(0, poses)),
        (gyro & ~twist, slice(poses, None)),
        (twist & gyro, slice(None)),
    ):
        windows = np.flatnonzero(which)
        if len(windows):
            yield windows, select[of_it], places[of_it]


def _whitened(measurement: Measurement, variables: Variables, select: Array) -> _White:
    """Return a measurement of B windows in white noise, of the combinations that hold."""
    factor = np.linalg.cholesky(select @ measurement.covariance @ select.T)
    whiten = np.linalg.inv(factor) @ select
    # The joints' noise is in the gyro's angular velocity as it is in that of the twist.
    folded = whiten[..., :6]
    if whiten.shape[-1] > 6:
        folded = np.concatenate((whiten[..., :3] + whiten[..., 6:], whiten[..., 3:6]), axis=-1)
    return _White(
        value=(whiten @ measurement.value[..., None])[..., 0],
        rows=whiten @ variables.rows(measurement.rows),
        # One after the other along the first axis, in the same order for one window as for many.
        log_noise=2.0 * np.add.reduce(np.log(np.diagonal(factor, axis1=1, axis2=2).T.copy()), axis=0),
        whiten=folded,
        whiten_gyro=whiten[..., 6:],
    )


def _shared(weighed: Array, slope: Array, variables: Variables) -> Array:
    """Return the (B, v) mean score by the joints' noise in values (B, 6, n) and in rows (B, 6, 10 + e, n)."""
    windows, _, numbers, _ = slope.shape
    by_number = slope.transpose(0, 2, 1, 3).reshape(windows, numbers, -1)
    score = np.zeros((windows, 1, len(variables.basis)))
    score[:, 0, BODY.start : BODY.start + numbers] = (by_number @ weighed.reshape(windows, -1, 1))[..., 0]
    return variables.rows(score)[:, 0]


def _momentum_by_force(windows: WindowModel, variables: Variables) -> Array:
    """Return the (B, 3, p, f) change of the momentum by a constant force and torque, as in `_ACTING`.

    A window's momentum is that of its middle. The force acts from there to the middle of the next window, on a robot
    that is between the two.
    """
    upright = np.broadcast_to(np.eye(3), windows.rotation.shape)
    rotation = np.stack((upright, upright, windows.rotation), axis=1)
    point = np.stack((windows.centre, windows.position, windows.position), axis=1)
    push = np.zeros((*point.shape[:2], 6, 6))
    push[..., :3, :3] = push[..., 3:, 3:] = rotation
    push[..., 3:, :3] = skew(point) @ rotation
    force = windows.length[:, None, None, None] * variables.force
    return np.asarray(variables.from_state[variables.poses : variables.head, MOMENTUM] @ (push @ force))


LINEARISED = 5  # work of linearising a window, in steps of the filter
TOGETHER = 8  # windows linearised at once: singly a replay takes a sixth longer, by 32 no less


class LinearisationCache:
    """Linearises windows, and the next ones with them: one numpy call costs much the same for ten as for one."""

    def __init__(self, layout: Layout, variables: Variables) -> None:
        self._layout = layout
        self._variables = variables
        self._course = SwingCourse(layout, predict) if layout.kernel.springs.count else None
        self._coming: Sequence[Window] = ()
        self._turn: dict[Window, int] = {}
        self._made: dict[Window, WhitenedWindow] = {}
        self._point: Point | None = None  # at which these are linearised

    def expect(self, windows: Sequence[Window]) -> None:
        """Set the coming windows, in order."""
        self._coming = windows
        self._turn = {window: turn for turn, window in enumerate(windows)}
        self._made.clear()

    def deflections(self, window: Window) -> Array:
        """Return the largest deflections of passive joints so far, least and highest in a window, (3, f) rad or m."""
        return np.zeros((3, 0)) if self._course is None else self._course.deflections(window)

    def whitened(self, window: Window, point: Point) -> WhitenedWindow:
        """Return a window, linearised at a point."""
        if point is not self._point:
            self._point = point
            self._made.clear()
        if window not in self._made:
            turn = self._turn.get(window)
            together = [window] if turn is None else self._coming[turn : turn + TOGETHER]
            self._made.update(self.all_whitened(stacked(together), point))
        return self._made.pop(window)

    def all_whitened(self, stacks: Sequence[Stack], point: Point) -> list[tuple[Window, WhitenedWindow]]:
        """Return stacked windows in their order before they were stacked, as they are and linearised."""
        models = window_models(self._layout, stacks, point, self._course)
        placed = dict(pair for stack in stacks for pair in zip(stack.places, stack.windows, strict=True))
        windows = [placed[place] for place in sorted(placed)]
        return list(zip(windows, whitened_windows(models, self._variables), strict=True))
