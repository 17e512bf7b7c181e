"""Passes of the filter over windows with more unknowns than the run has, one hypothesis at a time."""

from __future__ import annotations

from collections.abc import Collection, Generator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from mbaid_ros.core.diagnosis.changed_target import target_changed
from mbaid_ros.core.filter.bank import HypothesisFilter, update_bank
from mbaid_ros.core.filter.gaussian import MeanAndCovariance
from mbaid_ros.core.filter.square_root import SquareRootInformation
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.filter.variables import Variables, variables
from mbaid_ros.core.filter.whitened import LINEARISED, LinearisationCache, WhitenedWindow
from mbaid_ros.core.filter.window import STACK, Window, in_stacks
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.variance_components import PriorComparison
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.core.unknowns.hypotheses import Hypothesis
from mbaid_ros.core.unknowns.priors import UnknownsPrior

# Passes, ever nearer to what the windows say: what is left then is far below what decides between causes.
_REFINEMENTS = 3
_MOST = (30.0, 1000.0)  # times as uncertain as declared: what has been declared, and suspects
SLIPPING = 2  # windows that a slip may take

Passed = Generator[int, None, HypothesisFilter]
T = TypeVar('T')
Windows = list[tuple[Window, WhitenedWindow]]


@dataclass(frozen=True)
class WiderPriors:
    """Passes windows through the filter, with the unknowns of a layout."""

    layout: Layout
    plane: PlaneDetector
    uncertainty: Uncertainty

    @cached_property
    def variables(self) -> Variables:
        """Of the filter."""
        return variables(self.layout, self.plane, self.uncertainty)

    def fresh(self, hypothesis: Hypothesis) -> SquareRootInformation:
        """Return what is believed before the first window."""
        own = self.variables
        return SquareRootInformation.prior(own, own.force.shape[1] if hypothesis.force != 'none' else 0)

    def linearised(self, windows: Sequence[Window], point: Point) -> Generator[int, None, Windows]:
        """Return windows linearised at a point of this layout, or of the one that it extends."""
        own = self.layout
        lengths = own.parameters.stop - own.parameters.start, own.size - own.readings.start
        parameters, readings = (
            np.concatenate((values, np.zeros(length - len(values))))
            for values, length in zip((point.parameters, point.readings), lengths, strict=True)
        )
        at = replace(point, parameters=parameters, readings=readings)
        cache = LinearisationCache(self.layout, self.variables)
        passed: Windows = []
        for part in in_stacks(windows):
            passed += cache.all_whitened(part, at)
            yield LINEARISED * STACK
        return passed

    def passed(
        self,
        passed: Windows,
        hypothesis: Hypothesis,
        longest: int,
        begin: HypothesisFilter | None = None,
    ) -> Passed:
        """Return a hypothesis after windows; its jumps may take some of them."""
        track = begin or HypothesisFilter(hypothesis, self.fresh(hypothesis), longest=longest)
        own = self.variables
        for window, white in passed:
            (track,) = update_bank((track,), window, white, own)
            yield 1
        return track

    def changed(
        self,
        windows: Sequence[Window],
        place: int,
        points: tuple[Point, Point],
        hypothesis: Hypothesis,
        *,
        exchanged: bool,
    ) -> Passed:
        """Return a hypothesis after windows, from one of which on the target is another, or elsewhere: the best.

        Parameters
        ----------
        windows : in order
        place : of the first window in which the target changes
        points : at which windows before and after are linearised first
        hypothesis : that is followed
        exchanged : whether it is another target
        """
        end, (before, after) = place + SLIPPING, points
        best: HypothesisFilter | None = None
        for _ in range(_REFINEMENTS):
            passed = yield from self.linearised(windows[:end], before)
            track = yield from self.passed(passed[:place], hypothesis, 0)
            before = self._point(track.belief)
            during = [white for _, white in passed[place:]]
            track = target_changed(track, during, self.variables, exchanged=exchanged)
            passed = yield from self.linearised(windows[end:], after)
            track = yield from self.passed(passed, hypothesis, 0, begin=track)
            if best is None or track.belief.log_likelihood > best.belief.log_likelihood:
                best = track
            after = self._point(track.belief)
        assert best is not None, 'there is a first pass'
        return best

    def _point(self, belief: SquareRootInformation) -> Point:
        moments = MeanAndCovariance.of(belief, self.variables)
        return self.layout.point(moments.mean, moments.deviation)

    def repeated(self, windows: Sequence[Window], point: Point, hypothesis: Hypothesis) -> Passed:
        """Return a hypothesis linearised at points that are ever nearer to what it says: the best of these.

        Raises
        ------
        LinAlgError
            There is no robot at the first of them.
        """
        best: HypothesisFilter | None = None
        for _ in range(_REFINEMENTS):
            try:
                passed = yield from self.linearised(windows, point)
                track = yield from self.passed(passed, hypothesis, 0)
                point = self._point(track.belief)
            except np.linalg.LinAlgError:
                break  # it has led to a robot that cannot be
            if best is None or track.belief.log_likelihood > best.belief.log_likelihood:
                best = track
        if best is None:
            raise np.linalg.LinAlgError('the first point is of no robot that can be')
        return best

    def unpredicted(self, passed: Windows, belief: SquareRootInformation, hypothesis: Hypothesis) -> Array:
        """Return by how much each window's way is not as predicted, (W, p), in units of pose errors.

        Parameters
        ----------
        passed : the windows
        belief : after the last of them
        hypothesis : that they were passed under: a force that acts has changed the momentum until then
        """
        own = self.variables
        mean, force = np.split(belief.least_squares, [len(own.scale)])
        mean[: own.poses] = 0.0
        found = []
        for _, white in reversed(passed):
            if hypothesis.force != 'none':
                mean[own.poses : own.head] -= white.push(hypothesis.force) @ force
            mean[own.poses : own.head] -= white.brought @ mean
            found.append(white.drift + white.transition @ mean)
        return np.array(found[::-1])

    def gains(self, base: SquareRootInformation, declared: Collection[str]) -> dict[str, tuple[float, float]]:
        """Return what each cause would gain by less certainty, and by how much less; some have been declared."""
        values, covariance = MeanAndCovariance.of(base, self.variables).unknowns(self.layout)
        found = {}
        for place, cause in enumerate(self.layout.causes):
            own = np.flatnonzero(self.layout.belongs[:, place])
            numbers = PriorComparison.of(values[own], covariance[np.ix_(own, own)])
            gain, times = numbers.gain(_MOST[cause not in declared])
            found[cause] = float(gain), float(times)
        return found

    def widened(self, cause: str, factor: float) -> WiderPriors:
        """Return the same with one cause less certain."""
        known, place = self.layout.known, self.layout.causes.index(cause)
        wider = np.where(self.layout.belongs[:, place] > 0.0, factor, 1.0)
        return replace(
            self, layout=replace(self.layout, known=UnknownsPrior(known.mean, wider[:, None] * known.factor))
        )

    def value(self, track: HypothesisFilter, cause: str) -> Array:
        """Return the numbers (k,) of a cause as they are estimated, SI units."""
        mean = MeanAndCovariance.of(track.belief, self.variables).mean
        found: list[Array] = []
        for unknown, place in zip(self.layout.unknowns, self.layout.places, strict=True):
            numbers = unknown.factor @ mean[place]
            found += [numbers[row : row + 1] for row, label in enumerate(unknown.labels) if label == cause]
        return np.concatenate(found) if found else np.zeros(0)


def tried(passes: Generator[int, None, T]) -> Generator[int, None, T | None]:
    """Return what passes come to; None where they start at a robot that cannot be."""
    try:
        return (yield from passes)
    except np.linalg.LinAlgError:
        return None
