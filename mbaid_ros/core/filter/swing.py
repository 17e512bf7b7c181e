"""How passive joints swing along the windows, and how that depends on the parameters (appendages.md).

Their state x = (deflections, s) at the midpoints of intervals follows from the motion of joints and base, the momentum
and the parameters, step by step from the first instant on. Windows are linearised along it; its derivatives by the
parameters enter those of the predicted twist.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from mbaid_ros.core.filter.exponential import steps_of
from mbaid_ros.core.filter.knots import Midpoints
from mbaid_ros.core.filter.passive_prediction import passive_motion
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.filter.twist_prediction import Bodies, Prediction
from mbaid_ros.core.filter.window import Stack
from mbaid_ros.core.geometry import Array, Flags, Integers

BESIDE = 2  # intervals on either side of a window that its steps are interpolated from
_SWEEPS = 8  # of Newton's iteration along the windows, at most: each squares the error
# rad or m, change of deflection, and of its rate over the natural one, by a sweep: it squares the error.
_CONVERGED = 1e-4
_LARGEST = 30.0  # rad or m, of such a change: no appendage swings as far
_POINTS, _ENDS, _GUESSES = 8, 2_000, 20_000  # linearisation points, their intervals, and guesses that are remembered

Motions = Sequence[tuple[Midpoints, slice]]
Start = Callable[[int, int, int], Array]  # of a stack, a window and an interval: the columns (2 f, c) to begin with


@dataclass(frozen=True)
class _Run:
    """A stack of B windows of m intervals: their numbers (m, B), the own part, and which follow a gap."""

    numbers: Integers
    inside: slice
    fresh: Flags
    spacing: float

    @staticmethod
    def of(stack: Stack, inside: slice, intervals: int) -> _Run:
        spacing = stack.windows[0].spacing
        starts = np.array([round(window.start / spacing) for window in stack.windows])
        numbers = starts + np.arange(intervals)[:, None] - inside.start
        return _Run(numbers, inside, np.array([window.fresh for window in stack.windows]), spacing)


class SwingCourse:
    """The swing of the passive joints along the windows of one run.

    Parameters
    ----------
    layout : of the state
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        # Time constants of the parameters that are Gauss-Markov processes, s; inf of all others.
        times = np.concatenate([np.full(16, np.inf), *(each.times for each in layout.predicted)])
        self._decay = 1.0 / times
        # By linearisation point and number of an interval: x and its derivative by the parameters, (2 f, 1 + u).
        self._ends: OrderedDict[Point, OrderedDict[int, Array]] = OrderedDict()
        # By number of an interval: these, and the point of the latest linearisation.
        self._guesses: OrderedDict[int, tuple[Array, Point]] = OrderedDict()

    def applied(self, stacks: Sequence[Stack], motions: Motions, point: Point) -> Motions:
        """Return motions, (m, B, ...) each, with deflections and rates of the passive joints."""
        springs = point.side.kernel.springs
        joints, size = list(springs.joints), springs.count
        runs = _runs(stacks, motions)
        zeros = [motion.joint_position[..., joints] for motion, _ in motions]

        def placed(states: Sequence[Array], rates: Sequence[Array] | None = None) -> Motions:
            moved = []
            for place, (motion, inside) in enumerate(motions):
                position, velocity = motion.joint_position.copy(), motion.joint_velocity.copy()
                position[..., joints] = zeros[place] + states[place][..., :size]
                velocity[..., joints] = 0.0 if rates is None else rates[place]
                moved.append((replace(motion, joint_position=position, joint_velocity=velocity), inside))
            return moved

        @cache
        def start(stack: int, window: int, interval: int) -> Array:
            motion = motions[stack][0]
            first = motion.flat[np.array([interval * motion.turn.shape[1] + window])]
            first.joint_position[:, joints] += springs.start[0]
            found, _ = passive_motion(self._layout, first, point, rates=springs.start[1][None])
            return np.append(springs.start[0], found.along)[:, None]

        states = self._guessed(runs, point)
        for _ in range(_SWEEPS):
            flat = Midpoints.concatenate([motion.flat for motion, _ in placed(states)])
            along = np.concatenate([state[..., size:].reshape(-1, size) for state in states])
            found, rates = passive_motion(self._layout, flat, point, along)
            slope = np.concatenate((rates, found.forces), axis=-1)[..., None]
            slopes, by_state = _divided(slope, motions), _divided(found.by_state, motions)
            driven = [
                rate - jacobian @ x[..., None] for rate, jacobian, x in zip(slopes, by_state, states, strict=True)
            ]
            new = self._followed(runs, stacks, (by_state, driven), start, point, 1)
            # Rates to first order of the last step, which is small.
            rate_of = [rest + jacobian @ x for rest, jacobian, x in zip(driven, by_state, new, strict=True)]
            steps = [part[..., 0] - before for part, before in zip(new, states, strict=True)]
            faster = [(one - other)[..., :size, 0] / springs.rate for one, other in zip(rate_of, slopes, strict=True)]
            states = [part[..., 0] for part in new]
            change = max(float(np.max(np.abs(part))) for part in (*(step[..., :size] for step in steps), *faster))
            if not change < _LARGEST:  # nor where it is NaN
                raise np.linalg.LinAlgError('the passive joints swing without bounds')
            if change < _CONVERGED:
                break
        self._states = states
        return placed(states, [part[..., :size, 0] for part in rate_of])

    def add_to(
        self, stacks: Sequence[Stack], motions: Motions, point: Point, prediction: Prediction, bodies: Bodies
    ) -> Array:
        """Add the parameters' effect through the swing to the derivatives of the predicted twist, at all instants.

        Return the derivatives of the deflections at the ends of all windows, (B, f, u), stack by stack.
        """
        passive = bodies.passive
        assert passive is not None, 'there are passive joints'
        runs = _runs(stacks, motions)
        by_state, driven, first = (
            _divided(part, motions) for part in (passive.by_state, passive.by_parameters, passive.first)
        )

        def start(stack: int, window: int, interval: int) -> Array:
            return first[stack][interval, window]

        swing = self._followed(runs, stacks, (by_state, driven), start, point, None)
        for run, state, derivative in zip(runs, self._states, swing, strict=True):
            columns = np.concatenate((state[..., None], derivative), axis=-1)
            self._put(run, columns, point)
            found = columns.reshape(-1, *columns.shape[2:])
            self._guesses.update(
                {number: (each, point) for number, each in zip(run.numbers.ravel().tolist(), found, strict=True)}
            )
        while len(self._guesses) > _GUESSES:
            self._guesses.popitem(last=False)
        flat = np.concatenate([part.reshape(-1, *part.shape[2:]) for part in swing])
        prediction.by_parameters[...] += passive.twist_by_state @ flat
        size = self._layout.kernel.springs.count
        return np.concatenate(
            [_at_the_end(part[..., :size, :], run.inside) for run, part in zip(runs, swing, strict=True)]
        )

    @property
    def largest(self) -> Array:
        """The largest deflections (f,) in all windows, rad or m, where they were linearised last."""
        size = self._layout.kernel.springs.count
        found = np.array([state[:size, 0] for state, _ in self._guesses.values()]).reshape(-1, size)
        return np.max(np.abs(found), axis=0, initial=0.0)

    def _guessed(self, runs: Sequence[_Run], point: Point) -> list[Array]:
        """Return the states (m, B, 2 f) near those of the point before, or else zero."""
        size = 2 * self._layout.kernel.springs.count
        nothing = np.zeros((size, 1 + len(point.parameters))), point
        states = []
        for run in runs:
            found = [self._guesses.get(number, nothing) for number in run.numbers.ravel().tolist()]
            step = point.parameters - np.array([before.parameters for _, before in found])
            columns = np.concatenate((np.ones((len(step), 1)), step), axis=1)
            guessed = np.array([state for state, _ in found]) @ columns[..., None]
            states.append(guessed.reshape(*run.numbers.shape, size))
        return states

    @np.errstate(over='ignore', invalid='ignore')  # a swing without bounds is noticed
    def _followed(
        self,
        runs: Sequence[_Run],
        stacks: Sequence[Stack],
        slopes: tuple[Sequence[Array], Sequence[Array]],
        start: Start,
        point: Point,
        columns: int | None,
    ) -> list[Array]:
        """Return states, or their derivatives, (m, B, 2 f, c), along windows in order.

        Parameters
        ----------
        runs, stacks : of the windows
        slopes : (m, B, 2 f, 2 f) derivatives of the rates of x, and the rest (m, B, 2 f, c) of those
        start : where a window follows none
        point : of the linearisation
        columns : of the remembered state: the first, 1, or all others, None
        """
        mean = np.mean(np.concatenate([part.reshape(-1, *part.shape[2:]) for part in slopes[0]]), axis=0)
        steps = [steps_of(mean, one, other, run.spacing) for run, one, other in zip(runs, *slopes, strict=True)]
        results = [np.zeros_like(driven) for driven in slopes[1]]
        which = slice(0, 1) if columns else slice(1, None)
        ends: dict[int, Array] = {}
        order = sorted(
            (place, stack, window) for stack, each in enumerate(stacks) for window, place in enumerate(each.places)
        )
        for _, stack, window in order:
            run, (onward, gain), out = runs[stack], steps[stack], results[stack]
            numbers = run.numbers[:, window].tolist()
            # A window's amplitudes of decaying terms are those at its own begin.
            length = run.spacing * (run.inside.stop - run.inside.start)
            onwards = 1.0 if columns else np.exp(self._decay * length)
            begin = run.inside.start - (0 if run.fresh[window] or run.inside.start == 0 else 1)

            def earlier(place: int, numbers: Sequence[int] = numbers, onwards: float | Array = onwards) -> Array | None:
                if numbers[place] in ends:
                    return np.asarray(ends[numbers[place]] * onwards)
                found = self._end(numbers[place], point)
                return None if found is None else np.asarray(found[:, which] * onwards)

            before = None if run.fresh[window] else earlier(begin)
            out[begin, window] = start(stack, window, begin) if before is None else before
            for place in range(begin, len(out) - 1):
                out[place + 1, window] = onward[place, window] @ out[place, window] + gain[place, window]
            for place in range(begin - 1, -1, -1):
                before = earlier(place)
                out[place, window] = out[begin, window] if before is None else before
            for place in range(run.inside.stop - 2, run.inside.stop):
                ends[numbers[place]] = out[place, window]
        return results

    def _end(self, number: int, point: Point) -> Array | None:
        """Return x and its derivatives (2 f, 1 + u) at an interval, of this point, or from another one near."""
        if point in self._ends and number in self._ends[point]:
            return self._ends[point][number]
        others = [other for other in self._ends if number in self._ends[other]]
        if not others:
            return None
        near = min(others, key=lambda other: _apart(other, point))
        found = self._ends[near][number]
        moved = found.copy()
        moved[:, 0] += found[:, 1:] @ (point.parameters - near.parameters)
        return moved

    def _put(self, run: _Run, columns: Array, point: Point) -> None:
        """Remember the last two own intervals of windows, (m, B, 2 f, 1 + u)."""
        ends = self._ends.setdefault(point, OrderedDict())
        self._ends.move_to_end(point)
        for place in range(run.inside.stop - 2, run.inside.stop):
            ends.update(zip(run.numbers[place].tolist(), columns[place].copy(), strict=True))
        while len(ends) > _ENDS:
            ends.popitem(last=False)
        while len(self._ends) > _POINTS:
            self._ends.popitem(last=False)


def _apart(one: Point, other: Point) -> float:
    """Return how far two points are apart, squared, in units of their priors; the mass in units of itself."""
    step = one.parameters - other.parameters
    return float(np.sum(step[16:] ** 2) + (step[6] / (abs(one.parameters[6]) + 1e-9)) ** 2)


def _runs(stacks: Sequence[Stack], motions: Motions) -> list[_Run]:
    return [_Run.of(stack, inside, len(motion)) for stack, (motion, inside) in zip(stacks, motions, strict=True)]


def _at_the_end(values: Array, inside: slice) -> Array:
    """Return (B, ...) at the end of the own part of (m, B, ...) midpoints."""
    last = values[inside.stop - 1]
    step = values[inside.stop] - last if inside.stop < len(values) else last - values[inside.stop - 2]
    return np.asarray(last + 0.5 * step)


def _divided(flat: Array, motions: Motions) -> list[Array]:
    """Return parts (m, B, ...) of all instants, one after the other."""
    shapes = [motion.turn.shape[:2] for motion, _ in motions]
    ends = np.cumsum([0, *(rows * windows for rows, windows in shapes)])
    return [
        flat[begin:end].reshape(*shape, *flat.shape[1:])
        for (begin, end), shape in zip(pairwise(ends), shapes, strict=True)
    ]
