"""Where a filter may begin that only a gyro tells the motion: with the angular momentum of a robot that turns so.

Without it the first pass takes the robot for one at rest, far from one that tumbles: what is linear there leads away.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.filter.bank import (
    LONGEST_AT_A_GUESS,
    Bank,
    best,
    clamped,
    far_better,
)
from mbaid_ros.core.filter.batch import (
    MASS,
    BatchIteration,
    BatchResult,
    Relinearised,
)
from mbaid_ros.core.filter.gaussian import MeanAndCovariance
from mbaid_ros.core.filter.state import (
    ANGULAR,
    BODY,
    BODY_PLACES,
    Point,
)
from mbaid_ros.core.filter.window import (
    STACK,
    Stack,
    Window,
    in_stacks,
    stacked,
)
from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.sensitivity import mobility_and_momentum
from mbaid_ros.core.unknowns.environment import Hypothesis

# First windows, whose mean angular momentum a start has: noise is far below the rate, disturbances have hardly acted.
_FIRST = 5


def angular_momentum(kernel: MomentumKernel, target: Array, windows: Sequence[Window]) -> Array:
    """Return the angular momentum about the centre of mass, odometry axes, (3,); zero where poses locate the base.

    Parameters
    ----------
    kernel : of the robot
    target : (10,) standard parameters of its target
    windows : of which the first ones count
    """
    known, found = kernel.with_target(target), []
    for window in windows[:_FIRST]:
        middle = Stack((window,), (0,)).middle[window.inside].flat
        if np.isfinite(window.noise.pose[-1, -1]) or not middle.gyro.shape[-1] or not np.all(np.isfinite(middle.gyro)):
            continue
        placed = kernel.kinematics.configure(middle.base_rotation, middle.joint_position)
        joints = kernel.kinematics.body_twists(placed, middle.joint_velocity, np.zeros((len(middle), 6)))
        mobility, moving = mobility_and_momentum(known, placed, joints)
        if kernel.storage.count:
            moving[:, 3:] += np.sum(kernel.storage.momenta(placed.rotation, middle.stored), axis=1)
        # With V = M^-1 (h - b) and no linear momentum: the angular part of M^-1 alone makes the rate of what is left.
        at_rest = (mobility @ moving[..., None])[..., 0]
        rate = rotate(middle.base_rotation, middle.gyro) + at_rest[:, 3:]
        found.append(np.linalg.solve(mobility[:, 3:, 3:], rate[..., None])[..., 0])
    return np.mean(np.concatenate(found), axis=0) if found else np.zeros(3)


# The guesses that the first passes are linearised at: balls of part of the known bodies' mass and size, at rest. The
# size is that of at most so many links: an unknown body is not the larger, the more joints lead to it.
_GUESSED_MASSES, _GUESSED_RADIUS, _LINKS = (0.1, 0.3, 1.0), 0.25, 7
# Standard deviations that the noise of the rows may move a result by: beyond, less misfit may come from it alone.
_PLAIN = 1.0


@dataclass(frozen=True)
class Start:
    """What a search has come to.

    Attributes
    ----------
    bank : of all hypotheses
    point : at which they are linearised
    settled : whether that is one that stays
    covariance : (10, 10) of the body, of the windows that were searched
    curvature : how near linear the windows are about it, to be found out bit by bit; None where it has not settled
    """

    bank: Bank
    point: Point
    settled: bool
    covariance: Array
    curvature: Iterator[int | Curvature] | None


# What is done bit by bit: it yields how much work each bit was, in steps of the filter, and at last what it has found.
Search = Iterator[int | Start]


@dataclass(frozen=True)
class MultiStart:
    """Searches the point that windows lead to.

    Attributes
    ----------
    passes : over the windows
    hypotheses : the first is the one to beat
    """

    passes: BatchIteration
    hypotheses: tuple[Hypothesis, ...]

    def search(self, windows: list[Window], points: Sequence[Callable[[], Point | None]]) -> Search:
        """Linearise windows ever nearer to what they say, from a point; from the guesses where that leads nowhere.

        Parameters
        ----------
        windows : in order; those that are added while the search goes on are only followed
        points : make what has been found earlier, or None; each is asked only where the one before leads nowhere

        Raises
        ------
        LinAlgError
            Neither points nor guesses lead to a robot that can be. It comes with the bit of work that shows it.
        """
        count = len(windows)
        stacks = in_stacks(windows)
        results: list[BatchResult] = []
        result: BatchResult | None = None
        sound = other_leads = False
        for begin in points:
            point = begin()
            if point is None or _massless(point.parameters):
                continue
            found = yield from self.passes.repeat(stacks, point, self.passes.fresh(self.hypotheses[0]))
            if found is not None:
                results, result, sound = [*results, found], found, found.sound
                passed, bank, other_leads = yield from self._hypotheses(stacks, found)
            if sound or other_leads:
                break
        if result is None or not (sound or other_leads):
            results += yield from self._from_guesses(stacks)
            if not results:
                raise np.linalg.LinAlgError('no start leads to a robot that can be')
            result = max(results, key=lambda each: each.merit)
            passed, bank, other_leads = yield from self._hypotheses(stacks, result)
        settled = other_leads or (result.certain and not any(result.rivals(other) for other in results))
        covariance = MeanAndCovariance.of(best(bank).belief, self.passes.variables).covariance(BODY_PLACES)
        curvature = self.passes.curvature(stacks, best(bank)) if settled else None
        while count < len(windows):
            more = windows[count : count + STACK]
            passed = yield from self.passes.over([stacked(more)], passed.point)
            count += len(more)
            bank = yield from self.passes.run(passed, bank)
        yield Start(bank, passed.point, settled, covariance, curvature)

    def _from_guesses(self, stacks: list[list[Stack]]) -> Generator[int, None, list[BatchResult]]:
        """Return what the windows lead to with the guessed masses, and from the best of these with any mass.

        Where noise is in the rows as much as motion is, one point may stay, with narrow intervals, although bodies of
        quite another mass explain the windows as well: those tell.
        """
        held: list[BatchResult] = []
        for guess in self._guesses([window for stack in stacks[0] for window in stack.windows]):
            fresh = self.passes.fresh(self.hypotheses[0], LONGEST_AT_A_GUESS, float(guess.parameters[MASS]))
            result = yield from self.passes.repeat(stacks, guess, fresh, held=True)
            held += [] if result is None else [result]
        free: list[BatchResult] = []
        for start in sorted(held, key=lambda each: each.merit, reverse=True):
            fresh = self.passes.fresh(self.hypotheses[0], LONGEST_AT_A_GUESS)
            result = yield from self.passes.repeat(stacks, start.point, fresh)
            free += [] if result is None else [result]
            if result is not None and result.certain:
                break
        return free + held

    def _hypotheses(
        self, stacks: list[list[Stack]], result: BatchResult
    ) -> Generator[int, None, tuple[Relinearised, Bank, bool]]:
        """Return the windows as linearised for the hypothesis to lead, all hypotheses, and whether it is not the first.

        At its own solution another hypothesis must explain the windows and still be the better one; else its lead was
        the linearisation's. And where the first explains the windows too, what the other gains must not come from noise
        in its rows.
        """
        first, *others = self.hypotheses
        passed, longest = result.passed, result.track.longest
        bank: Bank = (result.track,)
        if others:
            beside = yield from self.passes.run(passed, tuple(self.passes.fresh(each, longest) for each in others))
            bank = (result.track, *beside)
        leading = best(bank).hypothesis
        if leading is first:
            return passed, bank, False
        other = yield from self.passes.repeat(stacks, result.point, self.passes.fresh(leading, longest))
        if other is None:
            return passed, clamped(bank), False
        needed = not result.sound or self._plain(other)
        if not (needed and other.certain and other.sound and far_better(other.track, result.track)):
            return passed, clamped(bank), False
        bank = yield from self.passes.run(
            other.passed, tuple(self.passes.fresh(each, longest) for each in self.hypotheses)
        )
        return other.passed, bank, True

    def _plain(self, result: BatchResult) -> bool:
        """Tell whether the noise of the rows hardly matters; else, that less is left says little."""
        shift = np.abs(result.moments.shift[self.passes.layout.parameters])
        return bool(np.all(shift <= _PLAIN * result.deviation))

    def _guesses(self, windows: Sequence[Window]) -> list[Point]:
        """Return the parameters of balls: of the mass that is declared, or of parts of the known mass.

        At rest; where a gyro alone tells the motion in some windows, in a robot that turns as it says.
        """
        kernel = self.passes.layout.kernel
        declared = float(self.passes.variables.mean[BODY.start])
        parts = [part * float(np.sum(kernel.known[:, 0])) for part in _GUESSED_MASSES]
        lengths = np.linalg.norm(kernel.model.positions, axis=1)
        length = float(np.sum(lengths)) * min(1.0, _LINKS / max(len(lengths), 1))
        guesses: list[Point] = []
        for mass in [declared] if declared > 0.0 else parts:
            state = np.concatenate((np.zeros(BODY.stop), self.passes.layout.known.mean))
            state[BODY.start] = mass
            state[[BODY.start + 4, BODY.start + 7, BODY.start + 9]] = mass * (_GUESSED_RADIUS * max(length, 0.1)) ** 2
            state[ANGULAR] = angular_momentum(kernel, state[BODY], windows)
            guesses.append(self.passes.layout.point(state))
        return guesses


def _massless(parameters: Array) -> bool:
    return bool(parameters[MASS] <= 0.0)
