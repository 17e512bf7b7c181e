"""The start of the filter: batch iterations from earlier solutions, or from guessed bodies where these lead nowhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.filter.bank import LONGEST_AT_A_GUESS, NO_JUMPS, Bank, cap_likelihood, far_likelier, joined, leader
from mbaid_ros.core.filter.batch import MASS, BatchIteration, BatchResult
from mbaid_ros.core.filter.square_root import MeanAndCovariance
from mbaid_ros.core.filter.state import BODY, BODY_PLACES, Layout, Point, mobility_and_joint_momentum
from mbaid_ros.core.filter.time_update import Hypothesis
from mbaid_ros.core.filter.whitened import LinearisationCache
from mbaid_ros.core.filter.window import STACK, Stack, Window, in_stacks, stacked
from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.tasks import Work

_FIRST = 5  # windows of a mean angular momentum: noise is far below the rate, disturbances have hardly acted


def angular_momentum(kernel: MomentumKernel, target: Array, windows: Sequence[Window]) -> Array:
    """Return the angular momentum about the centre of mass, odometry axes, (3,); zero where poses locate the base.

    A gyro alone measures the motion then. A start at rest would be too far from a robot that tumbles.

    Parameters
    ----------
    kernel : of the robot
    target : (10,) standard parameters of its target
    windows : of which the first ones count
    """
    known, momenta = kernel.body_parameters(target), []
    for window in windows[:_FIRST]:
        middle = Stack((window,), (0,)).middle[window.inside].flat
        if np.isfinite(window.noise.pose[-1, -1]) or not middle.gyro.shape[-1] or not np.all(np.isfinite(middle.gyro)):
            continue
        placed = kernel.kinematics.configure(middle.base_rotation, middle.joint_position)
        joints = kernel.kinematics.body_twists(placed, middle.joint_velocity, np.zeros((len(middle), 6)))
        bodies = express(known, placed.rotation, placed.position)
        mobility, moving = mobility_and_joint_momentum(kernel, middle.stored, bodies, placed, joints)
        # V = M^-1 (h - b), no linear momentum: solve with the angular part of M^-1 alone.
        at_rest = (mobility @ moving[..., None])[..., 0]
        rate = rotate(middle.base_rotation, middle.gyro) + at_rest[:, 3:]
        momenta.append(np.linalg.solve(mobility[:, 3:, 3:], rate[..., None])[..., 0])
    return np.mean(np.concatenate(momenta), axis=0) if momenta else np.zeros(3)


# Guessed bodies: balls of part of the known bodies' mass and size, at rest. The size is that of at most so many links:
# an unknown body is not the larger, the more joints lead to it.
_GUESSED_MASSES, _GUESSED_RADIUS, _LINKS = (0.3, 0.1, 1.0), 0.25, 7
_LARGEST_SHIFT = 1.0  # standard deviations that noise in the rows may move a result by: above, it may explain the gain


@dataclass(frozen=True)
class Start:
    """The outcome of a search."""

    bank: Bank  # of all hypotheses
    point: Point  # at which they are linearised
    accepted: bool  # whether the search has converged to one acceptable point
    covariance: Array  # (10, 10) of the body, of the windows that were searched
    # computes how near linear the windows are about the point; None where it is not accepted
    nonlinearity: Work[Curvature] | None


@dataclass(frozen=True)
class MultiStart:
    """Searches the point that windows lead to."""

    batch: BatchIteration  # iterates over the windows
    hypotheses: tuple[Hypothesis, ...]  # the first is the one to beat

    def search(self, windows: list[Window], points: Sequence[Callable[[], Point | None]]) -> Work[Start]:
        """Return the start that batch iterations lead to, from earlier points or else from guesses.

        Raises LinAlgError: Neither points nor guesses lead to a robot that can exist.

        Parameters
        ----------
        windows : in order; those that are added during the search are only filtered
        points : make earlier solutions, or None; each is tried only where the one before leads nowhere
        """
        count, stacks = len(windows), in_stacks(windows)
        results: list[BatchResult] = []
        for make in points:
            point = make()
            if point is None or point.parameters[MASS] <= 0.0:
                continue
            result = yield from self.batch.converge(stacks, point, self.batch.prior(self.hypotheses[0]))
            if result is None:
                continue
            results.append(result)
            chosen, bank, other_leads = yield from self._choose_hypothesis(stacks, result)
            if result.consistent or other_leads:
                break
        else:
            results += yield from self._from_guesses(stacks)
            if not results:
                raise np.linalg.LinAlgError('no start leads to a robot that can be')
            result = max(results, key=lambda each: each.merit)
            chosen, bank, other_leads = yield from self._choose_hypothesis(stacks, result)
        accepted = other_leads or (result.acceptable and not any(result.is_rivalled_by(other) for other in results))
        distribution = MeanAndCovariance.from_gaussian(leader(bank).gaussian, self.batch.variables)
        covariance = distribution.covariance(BODY_PLACES)
        nonlinearity = self.batch.nonlinearity(stacks, leader(bank)) if accepted else None
        while count < len(windows):
            more = windows[count : count + STACK]
            linearised = yield from self.batch.relinearise([stacked(more)], chosen.linearised_at)
            count += len(more)
            bank = yield from self.batch.filter(linearised, bank)
        return Start(bank, chosen.linearised_at, accepted, covariance, nonlinearity)

    def _from_guesses(self, stacks: list[list[Stack]]) -> Work[list[BatchResult]]:
        """Return the solutions with each guessed mass held, and from the best of these with any mass.

        Where the rows are as noisy as the motion is large, an iteration may converge with narrow intervals although
        bodies of quite another mass explain the windows as well: the results with the mass held show those.
        """
        if self.batch.variables.has_body_prior:
            guess = self.batch.layout.point(self._beginning(self.batch.variables.mean[BODY], stacks[0][0].windows))
            result = yield from self.batch.converge(stacks, guess, self.batch.prior(self.hypotheses[0]))
            return [] if result is None else [result]
        batch, *stages = from_loose_swing(self.batch)
        results = yield from self._from_masses(stacks, batch)
        for stage in stages if results else []:
            point = max(results, key=lambda each: each.merit).point
            result = yield from stage.converge(stacks, point, self.batch.prior(self.hypotheses[0], NO_JUMPS))
            if result is None:
                return []
            results = [result]
        return results

    def _from_masses(self, stacks: list[list[Stack]], batch: BatchIteration) -> Work[list[BatchResult]]:
        """Return these, by an iteration; with passive joints one guess is enough where its solution is sure."""
        held: list[BatchResult] = []
        free: list[BatchResult] = []
        of_any_mass = self.batch.prior(self.hypotheses[0], LONGEST_AT_A_GUESS)
        for guess in self._guesses([window for stack in stacks[0] for window in stack.windows], batch.layout):
            prior = self.batch.prior(self.hypotheses[0], LONGEST_AT_A_GUESS, float(guess.parameters[MASS]))
            result = yield from batch.converge(stacks, guess, prior, mass_held=True)
            held += [] if result is None else [result]
            if result is None or not (batch.layout.kernel.springs.count and result.consistent):
                continue
            result = yield from batch.converge(stacks, result.point, of_any_mass)
            if result is not None and result.acceptable and result.consistent and self._is_hardly_shifted(result):
                return [result, *held]
        for start in sorted(held, key=lambda each: each.merit, reverse=True):
            result = yield from batch.converge(stacks, start.point, of_any_mass)
            free += [] if result is None else [result]
            if result is not None and result.acceptable:
                break
        return free + held

    def _choose_hypothesis(
        self, stacks: list[list[Stack]], result: BatchResult
    ) -> Work[tuple[BatchResult, Bank, bool]]:
        """Return the result of the best hypothesis, all hypotheses there, and whether another one leads.

        Another hypothesis leads only if it explains the windows, and better, at its own solution: its gain is else the
        linearisation's. Where the first explains them too, the gain must not come from noise in the rows.
        """
        first, *others = self.hypotheses
        longest = result.filtered.longest_jump
        bank: Bank = (result.filtered,)
        if others:
            followed = yield from self.batch.filter(result.windows, self.batch.priors(others, longest))
            bank = (result.filtered, *followed)
            bank = bank if result.mass_held else joined(bank)
        leading = leader(bank).hypothesis
        if leading is first:
            return result, bank, False
        other = yield from self.batch.converge(stacks, result.point, self.batch.prior(leading, longest))
        if other is None:
            return result, cap_likelihood(bank), False
        needed = not result.consistent or self._is_hardly_shifted(other)
        if not (needed and other.acceptable and other.consistent and far_likelier(other.filtered, result.filtered)):
            return result, cap_likelihood(bank), False
        bank = yield from self.batch.filter(other.windows, self.batch.priors(self.hypotheses, longest))
        return other, bank, True

    def _is_hardly_shifted(self, result: BatchResult) -> bool:
        """Return whether the correction for noise in the rows is small."""
        shift = np.abs(result.distribution.shift[self.batch.layout.parameters])
        return bool(np.all(shift <= _LARGEST_SHIFT * result.deviation))

    def _guesses(self, windows: Sequence[Window], layout: Layout) -> list[Point]:
        """Return points with balls as target: of the declared mass, or of parts of the known mass.

        The robot is at rest, or turns as the gyro measures where no pose locates the base.
        """
        kernel = self.batch.layout.kernel
        declared = float(self.batch.variables.mean[BODY.start])
        parts = [part * float(np.sum(kernel.known[:, 0])) for part in _GUESSED_MASSES]
        lengths = np.linalg.norm(kernel.model.positions, axis=1)
        length = float(np.sum(lengths)) * min(1.0, _LINKS / max(len(lengths), 1))
        guesses: list[Point] = []
        for mass in [declared] if declared > 0.0 else parts:
            ball = np.zeros(10)
            ball[0], ball[[4, 7, 9]] = mass, mass * (_GUESSED_RADIUS * max(length, 0.1)) ** 2
            guesses.append(layout.point(self._beginning(ball, windows)))
        return guesses

    def _beginning(self, body: Array, windows: Sequence[Window]) -> Array:
        """Return the state with a body (10,), as the windows begin."""
        angular = angular_momentum(self.batch.layout.kernel, body, windows)
        return self.batch.layout.state(body, np.concatenate((np.zeros(3), angular)))


# Natural frequency (Hz) from which it is loose first: an iteration follows the three periods of the first 5 s only.
_FAST = 0.6
_LOOSE = (1.0, 0.1, 0.01)  # unmodelled excitation, in deviations of the swing at the start


def from_loose_swing(batch: BatchIteration) -> list[BatchIteration]:
    """Return iterations to run one after the other, the last as it is; alone where no passive joint is fast.

    A wrong body, or a frequency off by a few percent, puts the predicted swing out of phase in the first windows, and
    no iteration leads back. So the swing may first change from window to window as much as it may be at the start,
    then ever less.
    """
    layout = batch.layout
    if layout.kernel.springs.highest_frequency < _FAST:
        return [batch]
    stages: list[BatchIteration] = []
    for part in _LOOSE:
        eased = tuple(each.eased(part, layout.unknowns) for each in layout.unknowns)
        if all(each is own for each, own in zip(eased, layout.unknowns, strict=True)):
            return [batch]
        looser = replace(layout, unknowns=eased)
        stages.append(replace(batch, layout=looser, linearised=LinearisationCache(looser, batch.variables)))
    return [*stages, batch]
