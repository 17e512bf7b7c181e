"""What may be wrong where a run contradicts its model: what the latest windows would gain by one thing at a time.

The windows are passed through the filter once without any jump of the momentum, at the point that the run has come to,
with more unknowns than the run has (`unknowns/suspects.py`). What is known of the robot is then made less certain, one
thing at a time: what the data would gain by that follows from this one pass. The likeliest are passed once more, ever
nearer to what they say. What acts from outside, jumps of the momentum and a target that has changed are passes of their
own. All gains are log-likelihoods over the same pass: they tell the causes apart.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.diagnosis.conventions import (
    FITTED,
    Fit,
    as_described,
    convention_errors,
    fitted,
)
from mbaid_ros.core.diagnosis.encoders import size, swinging, times_of
from mbaid_ros.core.diagnosis.left_out import FEWEST, LeftOut, noisier_poses
from mbaid_ros.core.diagnosis.ranking import (
    WORTH,
    CandidateCause,
    Change,
    IsolationResult,
    lines,
)
from mbaid_ros.core.diagnosis.wider_priors import (
    SLIPPING,
    WiderPriors,
    Windows,
    tried,
)
from mbaid_ros.core.filter.bank import LONGEST, HypothesisFilter
from mbaid_ros.core.filter.square_root import SquareRootInformation
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PULSE
from mbaid_ros.core.results.verdict import LARGEST_NIS
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.hypotheses import Hypothesis
from mbaid_ros.core.unknowns.suspects import OF_TWIST, line, suspects
from mbaid_ros.core.unknowns.words import of_change, of_line, of_suspect, of_swinging

_EVERY = 2  # one window in so many tells which other robot is likely: for half of the work
# Part of the misfit that another robot may leave to be tried, and how many are.
_LIKELY, _TRIED = 0.8, 2
# Of how many the gain is found by passes of their own, and of how many of one kind: three links or joints will do.
_REFINED, _ALIKE = 5, 3
_MOST_PULSES = 2  # that can be what is wrong; more of them are what something else looks like
_BEFORE = 10  # windows before a change of the target that tell of it: the body before has to be known
_PARTS = 3  # of the first jumps, at which the target may have changed: later ones are what the first leads to
_LEFT = 0.1  # of the misfit, that the likeliest cause leaves, for more to be looked for: less may be linearisation
_LIGHTER = 1.5  # times its mass, that a link may look lighter by: noise may make it more than all


Inquiry = Iterator['int | IsolationResult']


@dataclass(frozen=True)
class CandidateCauses:
    """Asks what may be wrong with a run.

    Attributes
    ----------
    layout : of the run's state
    plane : whether the motion is planar
    uncertainty : of the known side
    hypotheses : that the run is followed under
    """

    layout: Layout
    plane: PlaneDetector
    uncertainty: Uncertainty
    hypotheses: tuple[Hypothesis, ...]

    def inquire(self, windows: Sequence[Window], point: Point | None, jumps: Sequence[float] = ()) -> Inquiry:
        """Yield how much work each bit was, in steps of the filter, and at last what has been found.

        Parameters
        ----------
        windows : in order
        point : of the run's layout, at which they are linearised; None where it has come to none
        jumps : s, when the momentum seemed to jump in the run

        Raises
        ------
        LinAlgError
            There is no point to pass the windows at that is of a robot that can be, or none with other noise. It comes
            with the bit of work that shows it.
        """
        wide, quiet = self.extended(*self._suspects()), self.hypotheses[0]
        fits = yield from self._fits(windows)
        points = [fits[0].point(self.layout)] if point is None else [point, fits[0].point(self.layout)]
        at, passed, base = yield from self._base(wide, windows, points)
        found = yield from self._widened(wide.gains(base, self.layout.causes), windows, at, base)
        found += yield from self._misread(windows, fits, base)
        left_out = LeftOut(self.extended(), quiet, base)
        for part in (left_out.twist, left_out.stopped, left_out.slipped):
            found += yield from part(windows)
        for frequency in lines(wide.unpredicted(passed, base, quiet), windows[0].length):
            track = yield from tried(self.extended(line(frequency)).repeated(windows, at, quiet))
            found += _gained(of_line(frequency), track, base)
        found += yield from self._from_outside(wide, passed, base)
        track = yield from wide.passed(passed, quiet, LONGEST)
        found += _pulses(track, base)
        times = [time for time in jumps if time >= windows[0].start] or [jump.time for jump in track.jumps]
        found += yield from self._changed(windows, point or at, times[:_PARTS], base)
        misfit = base.misfit
        if misfit > WORTH:
            found += yield from self._noisier(windows, at, base)
        # What has no name but its place is looked for where nothing that has one explains the data.
        left = misfit - max((each.gain for each in found if each.physical), default=0.0)
        if left > max(WORTH, _LEFT * misfit):
            found += yield from self._swinging(windows, at, base)
        found.sort(key=lambda each: -each.gain)
        worth = tuple(each for each in found if each.gain > WORTH)
        yield IsolationResult(worth, base.innovations, misfit)

    def _from_outside(
        self, wide: WiderPriors, passed: Windows, base: SquareRootInformation
    ) -> Generator[int, None, list[CandidateCause]]:
        """Return what would be gained by what acts or drifts."""
        found: list[CandidateCause] = []
        for hypothesis in self.hypotheses[1:]:
            track = yield from wide.passed(passed, hypothesis, 0)
            gained = track.belief.log_likelihood - base.log_likelihood
            found.append(CandidateCause(hypothesis.cause, gained, hypothesis.physical))
        return found

    def _changed(
        self, windows: Sequence[Window], point: Point, times: Sequence[float], base: SquareRootInformation
    ) -> Generator[int, None, list[CandidateCause]]:
        """Return what would be gained by a target that has moved in the grasp, or was exchanged, at some time."""
        changes: list[CandidateCause] = []
        plain, quiet = self.extended(), self.hypotheses[0]
        for time in times:
            place = next(index for index, window in enumerate(windows) if window.start >= time)
            later = windows[place + SLIPPING :]
            if place < _BEFORE:
                continue
            # What has been explained needs no later change.
            if len(later) < FEWEST or any(each.change for each in changes):
                break
            # Another body may be far from the one before: where it is to be looked for, a fit tells.
            points = point, as_described(self.layout, later)
            yield FITTED
            for change in (Change(time, exchanged=False), Change(time, exchanged=True)):
                track = yield from tried(plain.changed(windows, place, points, quiet, exchanged=change.exchanged))
                explains = track is not None and _explains(track)
                text = of_change(time, exchanged=change.exchanged)
                changes += _gained(text, track, base, change if explains else None)
        return sorted(changes, key=lambda each: -each.gain)[:1]

    def _fits(self, windows: Sequence[Window]) -> Generator[int, None, list[Fit]]:
        """Return what windows say of the robot as it is described, and of those that it may be taken for."""
        found = []
        for misreading in convention_errors(self.layout.kernel):
            if not misreading.possible(windows):
                continue
            found.append(fitted(self.layout.kernel, windows, misreading, _EVERY))
            yield FITTED // _EVERY
        return found

    def _base(
        self, wide: WiderPriors, windows: Sequence[Window], points: Sequence[Point]
    ) -> Generator[int, None, tuple[Point, Windows, SquareRootInformation]]:
        """Return the point that explains windows best if nothing is wrong, and the pass there.

        Raises
        ------
        LinAlgError
            None of the points is of a robot that can be.
        """
        results: list[tuple[Point, Windows, SquareRootInformation]] = []
        for point in points:
            # Where a robot is badly misdescribed, what fits best may be none that can be.
            passed = yield from tried(wide.linearised(windows, point))
            if passed is not None:
                track = yield from wide.passed(passed, self.hypotheses[0], 0)
                results.append((point, passed, track.belief))
        if not results:
            raise np.linalg.LinAlgError('there is no point to pass the windows at')
        return max(results, key=lambda each: each[2].log_likelihood)

    def _misread(
        self, windows: Sequence[Window], fits: Sequence[Fit], base: SquareRootInformation
    ) -> Generator[int, None, list[CandidateCause]]:
        """Return what would be gained by another robot; of those that the fits make likely."""
        likely = [fit for fit in fits[1:] if fit.misfit < _LIKELY * fits[0].misfit]
        found: list[CandidateCause] = []
        for fit in sorted(likely, key=lambda each: each.misfit)[:_TRIED]:
            other = replace(self.layout, kernel=self.layout.kernel.corrected(fit.misreading.change))
            trial = replace(self, layout=other).extended()
            read_so = fit.misreading.windows(windows)
            track = yield from tried(trial.repeated(read_so, fit.point(other), self.hypotheses[0]))
            found += _gained(fit.misreading.text, track, base)
        return found

    def _swinging(
        self, windows: Sequence[Window], point: Point, base: SquareRootInformation
    ) -> Generator[int, None, list[CandidateCause]]:
        """Return what would be gained by a joint whose far side swings against its encoder; of the likeliest one."""
        names = self.layout.kernel.model.joint_names
        first, *others = times_of(base.nis / base.measured)
        tracks: dict[tuple[int, float], HypothesisFilter] = {}

        def tried(joint: int, times: float) -> Generator[int, None, None]:
            tracks[joint, times] = yield from self._once(swinging(windows, joint, times, len(names)), point)

        def best() -> tuple[int, float]:
            return max(tracks, key=lambda each: tracks[each].belief.log_likelihood)

        for joint in range(len(names)):
            yield from tried(joint, first)
        likeliest, _ = best()
        if tracks[best()].belief.log_likelihood > base.log_likelihood:
            for times in others:
                yield from tried(likeliest, times)
        _, times = best()
        if not _explains(tracks[best()]):
            return []  # something else pushes the base, too; and what it explains it has no name for
        text = of_swinging(names[likeliest], size(windows, times))
        return [replace(each, physical=False) for each in _gained(text, tracks[best()], base)]

    def _noisier(
        self, windows: Sequence[Window], point: Point, base: SquareRootInformation
    ) -> Generator[int, None, list[CandidateCause]]:
        """Return what would be gained by a base that is read with a little more noise."""
        text, noisier = noisier_poses(windows, base.innovations)
        track = (yield from self._once(noisier, point)) if noisier else None
        return _gained(text, track, base) if track is not None and _explains(track) else []

    def _once(self, windows: Sequence[Window], point: Point) -> Generator[int, None, HypothesisFilter]:
        passed = yield from self.extended().linearised(windows, point)
        return (yield from self.extended().passed(passed, self.hypotheses[0], 0))

    def _suspects(self) -> tuple[Unknown, ...]:
        return suspects(self.layout.causes, self.layout.kernel.model.joint_names)

    def extended(self, *more: Unknown) -> WiderPriors:
        """Return what passes windows, with more unknowns."""
        return WiderPriors(self.layout.extended(more), self.plane, self.uncertainty)

    def _widened(
        self,
        gains: Mapping[str, tuple[float, float]],
        windows: Sequence[Window],
        point: Point,
        base: SquareRootInformation,
    ) -> Generator[int, None, list[CandidateCause]]:
        """Return what would be gained by less certainty of each thing; of the likeliest by passes of their own."""
        found: list[CandidateCause] = []
        for cause in _likeliest({cause: value for cause, (value, _) in gains.items() if value > WORTH}):
            factor = gains[cause][1]
            suspected = (each.part(cause) for each in self._suspects() if cause in each.causes)
            using = self.extended(*suspected).widened(cause, factor)
            track = yield from tried(using.repeated(windows, point, self.hypotheses[0]))
            if track is not None and self._possible(cause, value := using.value(track, cause)):
                text = of_suspect(cause, value)
                found += [replace(each, of_twist=cause in OF_TWIST) for each in _gained(text, track, base)]
        return found

    def _possible(self, cause: str, value: Array) -> bool:
        """Tell whether a link could be so: one that is lighter by far more than it weighs explains nothing."""
        kind, _, name = cause.partition(':')
        if kind != 'link':
            return True
        body = self.layout.kernel.model.link(name).body
        return bool(value[0] > -_LIGHTER * self.layout.kernel.known[body, 0])


def _explains(track: HypothesisFilter) -> bool:
    """Tell whether a pass leaves innovations as large as they should be."""
    return track.belief.nis < LARGEST_NIS * track.belief.measured


def _gained(
    text: str, track: HypothesisFilter | None, base: SquareRootInformation, change: Change | None = None
) -> list[CandidateCause]:
    """Return what a cause gains over a pass without it, if it has led to anything."""
    if track is None:
        return []
    return [CandidateCause(text, track.belief.log_likelihood - base.log_likelihood, change=change)]


def _likeliest(gains: Mapping[str, float]) -> list[str]:
    """Return the causes that are worth a pass of their own, the likeliest first."""
    found: list[str] = []
    kinds: Counter[str] = Counter()
    for cause in sorted(gains, key=lambda each: -gains[each]):
        kind = cause.partition(':')[0]
        kinds[kind] += 1
        if kinds[kind] <= _ALIKE:
            found.append(cause)
    return found[:_REFINED]


def _pulses(track: HypothesisFilter, base: SquareRootInformation) -> list[CandidateCause]:
    """Return what would be gained by jumps of the momentum, where a few leave nothing unexplained."""
    if not _explains(track) or not 0 < len(track.jumps) <= _MOST_PULSES:
        return []
    times = ', '.join(f'{jump.time:.1f}' for jump in track.jumps)
    return [CandidateCause(f'{PULSE} at {times} s', track.belief.log_likelihood - base.log_likelihood)]
