"""Samples averaged to nodes, and the motion midway between nodes, to fourth order.

A node is the mean of the raw samples of a few hundredths of a second. A mean is not the value at the centre, and the
mean of two nodes is not the value midway: both corrections below come from the neighbours' differences. So does that
for samples that come unevenly, or are lost, whose mean time is not the node's centre. Joint rates are
differences of the same nodes as the joint angles, so that joint noise telescopes when rates are integrated.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.geometry import Array, Flags, cross, exp, log
from mbaid_ros.core.samples import Samples

Integers = npt.NDArray[np.int64]

# Nodes that a window needs of its neighbours, before and after, for its fourth-order formulas.
BEFORE, AFTER = 3, 4
# What a node is of the two or four around it.
_LINEAR, _CUBIC = np.array([1.0, 1.0]) / 2.0, np.array([-1.0, 4.0, 4.0, -1.0]) / 6.0


@dataclass(frozen=True)
class Nodes:
    """J consecutive nodes, equally spaced; all NaN where one has no sample.

    Attributes
    ----------
    joint_position : (J, n)
    base_rotation : (J, 3, 3)
    base_position : (J, 3) m, relative to the run's origin
    base_twist : (J, 6) (v, w) in odometry axes; NaN where not measured
    spread : (J,) variance of the sample times in the node over the square of the nodes' spacing
    offset : (J,) mean of the sample times less the node's centre, over the nodes' spacing
    impulse : (J, 6) what known thrust has changed (P, L) by, L about the run's origin
    """

    joint_position: Array
    base_rotation: Array
    base_position: Array
    base_twist: Array
    spread: Array
    offset: Array
    impulse: Array

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.spread)

    @property
    def empty(self) -> Flags:
        """Which nodes have no sample, (J,)."""
        return np.isnan(self.spread)

    def __getitem__(self, index: slice) -> Nodes:
        """Return a slice of the nodes."""
        return Nodes(*(getattr(self, field.name)[index] for field in fields(self)))

    @staticmethod
    def concatenate(parts: list[Nodes]) -> Nodes:
        """Return the parts' nodes, joined in order."""
        return Nodes(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Nodes)))


@dataclass(frozen=True)
class Midpoints:
    """The motion midway between J nodes (J - 1 intervals), and what was measured from one node to the next.

    Attributes
    ----------
    joint_position, joint_velocity : (J - 1, n)
    base_rotation, base_position, base_twist : (J - 1, 3, 3), (J - 1, 3), (J - 1, 6)
    turn : (J - 1, 3) rad, rotation vector from each node to the next, odometry axes
    step : (J - 1, 3) m, displacement from each node to the next
    impulse : (J - 1, 6) as of the nodes, the mean of both
    """

    joint_position: Array
    joint_velocity: Array
    base_rotation: Array
    base_position: Array
    base_twist: Array
    turn: Array
    step: Array
    impulse: Array

    def __len__(self) -> int:
        """Return the number of intervals."""
        return len(self.turn)

    def __getitem__(self, index: slice | Integers) -> Midpoints:
        """Return some of the intervals."""
        return Midpoints(*(getattr(self, field.name)[index] for field in fields(self)))

    @staticmethod
    def concatenate(parts: list[Midpoints]) -> Midpoints:
        """Return the parts' intervals, joined in order."""
        return Midpoints(
            *(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Midpoints))
        )


@dataclass(frozen=True)
class WindowNoise:
    """Noise of the means of a window's measurements.

    Attributes
    ----------
    samples : number in the window
    joint_position : one standard deviation of one sample, rad or m
    pose : (6, 6) mean covariance of one sample, (orientation, position), odometry axes
    twist : (6, 6) of one sample, (angular, linear), base axes
    """

    samples: int
    joint_position: float
    pose: Array
    twist: Array


@dataclass(frozen=True)
class Window:
    """A window's nodes, with the neighbours that its formulas need.

    Attributes
    ----------
    nodes : Nodes
    inside : the window's own intervals among theirs; each begins at a node of the window
    spacing : s, between nodes
    noise : WindowNoise
    start : s since the first sample of the run
    fresh : whether a gap (or the start) comes before it
    """

    nodes: Nodes
    inside: slice
    spacing: float
    noise: WindowNoise
    start: float
    fresh: bool

    @cached_property
    def middle(self) -> Midpoints:
        """The motion midway between all nodes: it does not depend on where the window is linearised."""
        return midpoints(self.nodes, self.spacing)

    def motion(self, late: float) -> Midpoints:
        """Return the same with joints that were measured `late` s before their stamps."""
        return self.middle if late == 0.0 else _with_joints_later(self.middle, late, self.spacing)

    @property
    def places(self) -> Integers:
        """Its own first, middle and last interval, (3,) indices."""
        first, _, _ = self.inside.indices(len(self.middle))
        count = len(range(*self.inside.indices(len(self.middle))))
        return first + np.array([0, count // 2, count - 1])


def average(window: Samples, start: float, spacing: float, count: int, origin: Array) -> Nodes | None:
    """Return the nodes of one window, None where two in a row have no sample.

    Parameters
    ----------
    window : Samples
    start : s, time at which the window begins
    spacing : s, between nodes
    count : number of nodes
    origin : (3,) m, subtracted from the positions
    """
    number = np.clip(np.floor((window.time - start + 1e-9) / spacing).astype(int), 0, count - 1)
    starts = np.searchsorted(number, np.arange(count))
    sizes = np.diff(np.append(starts, len(window)))
    empty = sizes == 0
    if np.any(empty[1:] & empty[:-1]):
        return None
    share = sizes[~empty].astype(float)

    def mean(values: Array) -> Array:
        result = np.full((count, *values.shape[1:]), np.nan)
        total = np.add.reduceat(values, starts[~empty], axis=0)
        result[~empty] = total / share.reshape(-1, *(1,) * (values.ndim - 1))
        return result

    time = mean(window.time)
    middle = window.base_rotation[np.minimum(starts + sizes // 2, len(window) - 1)]
    turns = log(window.base_rotation @ np.swapaxes(middle[number], 1, 2))
    return Nodes(
        joint_position=mean(window.joint_position),
        base_rotation=exp(mean(turns)) @ middle,
        base_position=mean(window.base_position - origin),
        base_twist=mean(np.concatenate((window.base_linear_velocity, window.base_angular_velocity), axis=1)),
        spread=mean((window.time - time[number]) ** 2) / spacing**2,
        offset=(time - start) / spacing - np.arange(count) - 0.5,
        impulse=mean(_about(window.impulse, origin)),
    )


def bridged(nodes: Nodes) -> Nodes:
    """Return nodes with the empty ones, each between two others, filled in from the two or four around it."""
    values = {field.name: getattr(nodes, field.name).copy() for field in fields(Nodes)}
    for index in np.flatnonzero(nodes.empty):
        far = 2 <= index < len(nodes) - 2 and not np.any(nodes.empty[[index - 2, index + 2]])
        around = index + (np.array([-2, -1, 1, 2]) if far else np.array([-1, 1]))
        weights = _CUBIC if far else _LINEAR
        for name, value in values.items():
            if name == 'base_rotation':
                back = value[index - 1].T
                value[index] = exp(weights @ log(value[around] @ back)) @ value[index - 1]
            else:
                value[index] = np.tensordot(weights, value[around], axes=1)
    return Nodes(**values)


def midpoints(nodes: Nodes, spacing: float) -> Midpoints:
    """Return the motion midway between nodes.

    Values at the node centres are the means less the offset times the slope and half the spread times the second
    difference; midway values take a sixteenth, rates a twenty-fourth of the neighbours' differences off. At the ends
    the neighbour's correction serves.
    """
    joints = _centre(nodes.joint_position, nodes)
    position = _centre(nodes.base_position, nodes)
    twist = _centre(nodes.base_twist, nodes)
    rotation = _centre_rotation(nodes)
    turn = _turns(rotation)
    bend = _padded(turn[2:] - turn[:-2])
    # With the angular velocity w: half the turn has an eighth of its commutator D^3 / 12 w' x w, not a half.
    half = 0.5 * turn - bend / 16.0 - cross(bend, turn) / 64.0
    difference = np.diff(joints, axis=0)
    return Midpoints(
        joint_position=_midway(joints),
        joint_velocity=(difference - _second_difference(difference) / 24.0) / spacing,
        base_rotation=exp(half) @ rotation[:-1],
        base_position=_midway(position),
        base_twist=_midway(twist),
        turn=turn,
        step=np.diff(position, axis=0),
        # It may jump, which the corrections are not for.
        impulse=0.5 * (nodes.impulse[1:] + nodes.impulse[:-1]),
    )


def _with_joints_later(middle: Midpoints, late: float, spacing: float) -> Midpoints:
    """Return the joints' motion `late` s after the midpoints, to third order, with the base's at the midpoints."""
    rate = middle.joint_velocity
    second = np.gradient(rate, spacing, axis=0)
    third = np.gradient(second, spacing, axis=0)
    return replace(
        middle,
        joint_position=middle.joint_position + late * (rate + late / 2.0 * (second + late / 3.0 * third)),
        joint_velocity=rate + late * (second + late / 2.0 * third),
    )


def _about(impulse: Array, origin: Array) -> Array:
    """Return (N, 6) impulses with L about a point."""
    moved = impulse.copy()
    moved[:, 3:] -= cross(np.broadcast_to(origin, (len(impulse), 3)), impulse[:, :3])
    return moved


def _turns(rotation: Array) -> Array:
    return log(rotation[1:] @ np.swapaxes(rotation[:-1], 1, 2))


def _centre(values: Array, nodes: Nodes) -> Array:
    """Return the values at the nodes' centres. Twice: the first slopes are of means that are off themselves."""
    offset, square = nodes.offset[:, None], (nodes.spread + nodes.offset**2)[:, None]
    centred = values - offset * np.gradient(values, axis=0)
    return values - offset * np.gradient(centred, axis=0) - 0.5 * square * _second_difference(centred)


def _centre_rotation(nodes: Nodes) -> Array:
    """Return the orientations at the nodes' centres, in the same way."""
    offset, square = nodes.offset[:, None], (nodes.spread + nodes.offset**2)[:, None]
    turn = _turns(nodes.base_rotation)
    turn = _turns(exp(-offset * _slope(turn)) @ nodes.base_rotation)
    return exp(-offset * _slope(turn) - 0.5 * square * _padded(np.diff(turn, axis=0))) @ nodes.base_rotation


def _slope(turn: Array) -> Array:
    """Return the turn a node's spacing at each node, from those between nodes."""
    return np.concatenate((turn[:1], 0.5 * (turn[1:] + turn[:-1]), turn[-1:]))


def _midway(values: Array) -> Array:
    step = np.diff(values, axis=0)
    return 0.5 * (values[1:] + values[:-1]) - _padded(step[2:] - step[:-2]) / 16.0


def _second_difference(values: Array) -> Array:
    return _padded(np.diff(values, n=2, axis=0))


def _padded(inner: Array) -> Array:
    return np.concatenate((inner[:1], inner, inner[-1:]))
