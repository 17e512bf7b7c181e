"""How passive joints swing along the windows, and how that depends on the parameters (appendages.md).

Their state x = (deflections, s) at the midpoints of intervals follows from the motion of joints and base, the momentum
and the parameters, step by step from the first instant on. Windows are linearised along it; its derivatives by the
parameters enter those of the predicted twist.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mbaid_ros.core.filter.exponential import transition_steps
from mbaid_ros.core.filter.knots import Midpoints
from mbaid_ros.core.filter.passive_prediction import starting_columns, starting_states
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.filter.twist_prediction import Bodies, Prediction, Swing
from mbaid_ros.core.filter.window import Stack, Window
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import composed
from mbaid_ros.core.unknowns.priors import UnknownsPrior

BESIDE = 2  # intervals on either side of a window that its steps are interpolated from
_SWEEPS = 8  # of Newton's iteration along the windows, at most: each squares the error
# rad or m, change of deflection, and of its rate over the natural one, by the last sweep: the prediction follows it to
# first order, and the rest is below 1e-7.
_CONVERGED = 1e-3
_LARGEST = 30.0  # rad or m, of such a change: no appendage swings as far
_POINTS, _WINDOWS = 8, 1_000  # linearisation points, and windows, that are remembered

Motions = Sequence[tuple[Midpoints, slice]]
Predict = Callable[[Layout, Midpoints, Point, Array], tuple[Prediction, Bodies]]


@dataclass(frozen=True)
class _Part:
    """A stack of B windows with m intervals each, among the instants of all stacks."""

    stack: Stack
    inside: slice  # the own intervals
    instants: slice
    intervals: int  # m
    ends: tuple[int, ...]  # of each window: the number of the interval after it

    @property
    def begin(self) -> int:
        """The interval before the own ones, or the first where there is none before."""
        return max(self.inside.start - 1, 0)

    def divided(self, flat: Array) -> Array:
        """Return the part (m, B, ...) of all instants."""
        own = flat[self.instants]
        return own.reshape(self.intervals, -1, *own.shape[1:])


class SwingCourse:
    """The swing of the passive joints along the windows of one run.

    Parameters
    ----------
    layout : of the state
    predict : predicts the twist of the base at midpoints, and the swing there, as `twist_prediction.predict`
    """

    def __init__(self, layout: Layout, predict: Predict) -> None:
        self._layout = layout
        self._predict = predict
        self._bare = replace(layout, unknowns=(), known=UnknownsPrior.standard_normal(0))
        # Time constants of the parameters that are Gauss-Markov processes, s; inf of x itself and of all others.
        times = np.concatenate([np.full(17, np.inf), *(each.time_constants for each in layout.predicted)])
        self._decay = 1.0 / times
        # By point, and the interval after a window: x and its derivative by the parameters, (2, 2 f, 1 + u), in the
        # last two intervals of the window.
        self._ends: OrderedDict[Point, OrderedDict[int, Array]] = OrderedDict()
        # By the interval after a window: these in all of it, (m, 2 f, 1 + u), where it was linearised last.
        self._guesses: OrderedDict[int, tuple[Array, Point]] = OrderedDict()
        # By the interval after a window: the least and the highest deflections, (2, f), and whether it was closed.
        self._deflections: OrderedDict[int, tuple[Array, bool]] = OrderedDict()
        self._largest: Array | None = None  # (f,) deflections in the closed ones of these; None where they have changed

    @np.errstate(over='ignore', invalid='ignore')  # a swing without bounds is noticed
    def predict(
        self, stacks: Sequence[Stack], motions: Motions, point: Point
    ) -> tuple[Motions, Prediction, Bodies, Array]:
        """Return motions, (m, B, ...) each, with the swing of the passive joints, and the twist predicted then.

        Last, the derivatives of the deflections at the ends of all windows, (B, f, u), stack by stack.
        """
        springs, parts = point.side.kernel.springs, _parts(stacks, motions)
        joints, size = list(springs.joints), springs.count
        flat = Midpoints.concatenate([motion.flat for motion, _ in motions])
        position, velocity = flat.joint_position.copy(), flat.joint_velocity.copy()
        zeros, velocity[:, joints] = position[:, joints], 0.0
        x = np.concatenate([self._guessed(part, point) for part in parts])
        new = not all(end in self._guesses for part in parts for end in part.ends)
        for sweep in range(_SWEEPS):
            # The first sweep of new windows never converges: it needs no derivatives by the unknowns.
            layout = self._bare if new and sweep == 0 else self._layout
            position[:, joints] = zeros + x[:, :size]
            placed = replace(flat, joint_position=position, joint_velocity=velocity)
            prediction, bodies = self._predict(layout, placed, point, x[:, size:])
            assert bodies.passive is not None, 'there are passive joints'
            passive: Swing = bodies.passive
            columns = self._followed(parts, passive, x, point)
            step, x = columns[..., 0] - x, columns[..., 0]
            faster = (passive.by_state @ step[..., None])[:, :size, 0]
            if _largest(step[:, :size], faster / springs.frequency) < _CONVERGED and layout is self._layout:
                break
        prediction.twist[...] += (passive.twist_by_state @ step[..., None])[..., 0]
        prediction.by_parameters[...] += passive.twist_by_state @ columns[..., 1:]
        position[:, joints], velocity[:, joints] = zeros + x[:, :size], passive.slope[:, :size] + faster
        moved: list[tuple[Midpoints, slice]] = []
        for part, (motion, inside) in zip(parts, motions, strict=True):
            self._remember(part, part.divided(columns), point)
            places, rates = part.divided(position), part.divided(velocity)
            moved.append((replace(motion, joint_position=places, joint_velocity=rates), inside))
        ends = [_at_the_end(part.divided(columns)[..., :size, 1:], part.inside) for part in parts]
        return moved, prediction, bodies, np.concatenate(ends)

    def deflections(self, window: Window) -> Array:
        """Return the largest deflections in all windows, and the least and the highest in one, (3, f) rad or m.

        A window that is still open is linearised once, maybe far from the solution: only its latest state counts.
        """
        own, _ = self._deflections[_end(window)]
        if self._largest is None:
            closed = [each for each, whole in self._deflections.values() if whole]
            self._largest = np.abs([np.zeros_like(own), *closed]).max(axis=(0, 1))
        return np.vstack((np.maximum(self._largest, np.abs(own).max(axis=0)), own))

    def _guessed(self, part: _Part, point: Point) -> Array:
        """Return the states (m B, 2 f) near those of the point before, or else zero."""
        states = np.zeros((part.intervals, len(part.ends), 2 * self._layout.kernel.springs.count))
        for window, end in enumerate(part.ends):
            columns, before = self._guesses.get(end, (states[:0], point))
            if len(columns) == part.intervals:
                states[:, window] = _columns_at(columns, before, point)[..., 0]
        return states.reshape(-1, states.shape[-1])

    def _followed(self, parts: Sequence[_Part], passive: Swing, x: Array, point: Point) -> Array:
        """Return x and its derivatives at all instants, (N, 2 f, 1 + u), along windows in order.

        `passive` are their rates, linear about x (N, 2 f) and in the first u parameters.
        """
        by_state = passive.by_state
        rest = passive.slope[..., None] - by_state @ x[..., None]
        driven = np.concatenate((rest, passive.by_parameters), axis=-1)
        mean, size, columns = np.mean(by_state, axis=0), by_state.shape[-1], driven.shape[-1]
        results, first = np.zeros_like(driven), starting_columns(self._layout, point)[..., :columns]
        steps = []  # by part, linear in x one interval before the own ones
        for part in parts:
            onward = transition_steps(mean, part.divided(by_state), part.divided(driven), part.stack.windows[0].spacing)
            steps.append(composed(*(step[part.begin :] for step in onward)))
        ends: dict[int, Array] = {}
        places = [
            (place, number, index) for number, part in enumerate(parts) for index, place in enumerate(part.stack.places)
        ]
        for _, number, index in sorted(places):
            part = parts[number]
            begin, stop = part.begin, part.inside.stop
            window, step, result = part.stack.windows[index], steps[number][:, index], part.divided(results)[:, index]
            before = None if window.fresh else self._before(window, ends, point)
            if before is None:
                instant = part.instants.start + begin * len(part.ends) + index
                start = result[:begin] = starting_states(first, by_state[instant], driven[instant])
            else:
                start, result[:begin] = before[1, :, :columns], before[:begin, :, :columns]
            result[begin:] = step[..., :size] @ start + step[..., size:]
            ends[part.ends[index]] = result[stop - 2 : stop]
        return results

    def _before(self, window: Window, ends: dict[int, Array], point: Point) -> Array | None:
        """Return x and its derivatives (2, 2 f, 1 + u) before a window, of these, of this point or another one near."""
        number = round(window.start / window.spacing)
        found = ends.get(number)
        if found is None:
            others = [other for other, each in self._ends.items() if number in each]
            if not others:
                return None
            near = point if point in others else min(others, key=lambda other: _distance(other, point))
            found = _columns_at(self._ends[near][number], near, point)
        # A window's amplitudes of decaying terms are those at its own begin.
        return np.asarray(found * np.exp(self._decay[: found.shape[-1]] * window.length))

    def _remember(self, part: _Part, columns: Array, point: Point) -> None:
        """Remember windows, (m, B, 2 f, 1 + u)."""
        ends = self._ends.setdefault(point, OrderedDict())
        self._ends.move_to_end(point)
        deflections = columns[part.inside, :, : self._layout.kernel.springs.count, 0]
        extremes = np.stack((deflections.min(axis=0), deflections.max(axis=0)), axis=1)
        closed, self._largest = part.inside.stop < part.intervals, None  # closed: there are knots after it
        self._deflections.update((end, (each, closed)) for end, each in zip(part.ends, extremes, strict=True))
        for window, end in enumerate(part.ends):
            own = columns[:, window].copy()
            ends[end], self._guesses[end] = own[part.inside.stop - 2 : part.inside.stop], (own, point)
        for kept, most in (
            (ends, _WINDOWS),
            (self._guesses, _WINDOWS),
            (self._deflections, 2 * _WINDOWS),  # open and closed
            (self._ends, _POINTS),
        ):
            while len(kept) > most:
                kept.popitem(last=False)


def _largest(step: Array, rates: Array) -> float:
    """Return the largest change of a deflection, or of a rate over the natural one, rad or m."""
    largest = float(np.max(np.abs((step, rates))))
    if not largest < _LARGEST:  # nor where it is NaN
        raise np.linalg.LinAlgError('the passive joints swing without bounds')
    return largest


def _parts(stacks: Sequence[Stack], motions: Motions) -> list[_Part]:
    """Return the stacks, (m, B, ...) each, among all instants."""
    shapes = [motion.turn.shape[:2] for motion, _ in motions]
    bounds = np.cumsum([0, *(rows * windows for rows, windows in shapes)]).tolist()
    return [
        _Part(
            *(stack, inside, slice(*own), shape[0]),
            tuple(map(_end, stack.windows)),
        )
        for stack, (_, inside), shape, own in zip(stacks, motions, shapes, pairwise(bounds), strict=True)
    ]


def _end(window: Window) -> int:
    """Return the number of the interval after a window."""
    return round((window.start + window.length) / window.spacing)


def _columns_at(columns: Array, before: Point, point: Point) -> Array:
    """Return x and its derivatives (..., 2 f, 1 + u) of one point at another."""
    moved = columns.copy()
    moved[..., 0] += columns[..., 1:] @ (point.parameters - before.parameters)
    return moved


def _distance(one: Point, other: Point) -> float:
    """Return how far two points are apart, squared, in units of their priors; the mass in units of itself."""
    step = one.parameters - other.parameters
    return float(np.sum(step[16:] ** 2) + (step[6] / (abs(one.parameters[6]) + 1e-9)) ** 2)


def _at_the_end(values: Array, inside: slice) -> Array:
    """Return (B, ...) at the end of the own part of (m, B, ...) midpoints."""
    last = values[inside.stop - 1]
    step = values[inside.stop] - last if inside.stop < len(values) else last - values[inside.stop - 2]
    return np.asarray(last + 0.5 * step)
