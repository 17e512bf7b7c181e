"""Candidate causes for a run that contradicts its model: a table, scored by one loop.

The latest windows are passed through the filter once without any jump of the momentum, at the point that the run has
come to, with more unknowns than the run has. The likelihood gain of a wider prior of one
unknown follows from this one pass; the likeliest are passed once more. Further candidates are readings in other
conventions, readings that are left out, vibrations, disturbances, jumps of the momentum and a target that has changed.
All gains are log-likelihoods over the same pass, which makes them comparable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from mbaid_ros.core.diagnosis import readings
from mbaid_ros.core.diagnosis.conventions import (
    FITTED,
    Convention,
    ConventionFactory,
    Fit,
    fitted,
    point_as_described,
)
from mbaid_ros.core.diagnosis.filter_passes import SLIPPING, FilterPasses, attempted
from mbaid_ros.core.diagnosis.ranking import (
    WORTH,
    CandidateCause,
    Change,
    IsolationResult,
    candidate_cause,
    explains,
    likeliest_kinds,
)
from mbaid_ros.core.filter.bank import LONGEST, HypothesisFilter
from mbaid_ros.core.filter.batch import WhitenedWindows
from mbaid_ros.core.filter.square_root import SquareRootInformation
from mbaid_ros.core.filter.state import Declared, Layout, Point
from mbaid_ros.core.filter.time_update import Hypothesis
from mbaid_ros.core.filter.window import Window, without_twist
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PULSE
from mbaid_ros.core.results.status import LARGEST_NIS
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.tasks import Work
from mbaid_ros.core.unknowns.base import OF_TWIST, marker_text, vibration
from mbaid_ros.core.unknowns.catalogue import deviation_text, target_changed_text
from mbaid_ros.core.unknowns.declaration import Unknown

_EVERY = 2  # one window in so many shows which convention is likely: for half of the work
_TRIED = 4  # conventions
_SPOILT = 2  # joints with spoilt readings: two that fail at once are rare, and each takes passes
_MOST_PULSES = 2  # that can be the cause; more of them are the symptom of another one
_BEFORE = 10  # windows before a change of the target: the body before has to be known
_PARTS = 3  # of the first jumps, at which the target may have changed: later ones follow from the first
_LEFT = 0.1  # of the misfit, that the likeliest cause leaves, for more to be looked for: less may be linearisation
_LIGHTER = 1.5  # times its mass, that a link may look lighter by: noise may make it more than all
FEWEST = 4  # windows that have to be left: fewer have hardly more numbers (six each) than body and momentum, sixteen


@dataclass(frozen=True)
class Candidate:
    """Something that may be wrong, as the filter would pass the windows if it were."""

    # In words; or a function of the filter at the end, None of an impossible value.
    text: str | Callable[[HypothesisFilter], str | None]
    passes: FilterPasses  # with its unknowns
    windows: Sequence[Window]  # as they are then
    # Where windows are linearised first; None for the point of a fit, as data left out have misled the run.
    point: Point | None = None
    of_twist: bool = False  # whether it is something wrong with the base's twist
    part: float = 1.0  # of the windows, that it has readings of: the others count as if explained as well


@dataclass(frozen=True)
class CandidateCauses:
    """Scores the candidate causes of a run."""

    layout: Layout  # of the run's state
    plane: PlaneDetector  # whether the motion is planar
    declared: Declared  # as of the run
    hypotheses: tuple[Hypothesis, ...]  # that the run is followed under
    # Beside those of the run, each so nearly exact that the run stays as it was. The likelihood gain of a wider prior
    # follows from its estimate (`core/filter/prior_scale.py`).
    suspects: tuple[Unknown, ...] = ()
    conventions: tuple[ConventionFactory, ...] = ()  # that may be mistaken, in the order in which they are tried

    def isolate(
        self, windows: Sequence[Window], point: Point | None, jumps: Sequence[float] = (), wrong_twist: str = ''
    ) -> Work[IsolationResult]:
        """Return the candidates found.

        Parameters
        ----------
        windows : in order
        point : of the run's layout, at which they are linearised; None where it has come to none
        jumps : s, when the momentum seemed to jump in the run
        wrong_twist : how the twist contradicts the poses, in words; empty if it does not

        Raises
        ------
        LinAlgError
            There is no point of a robot that can be to pass the windows at, or none with other noise. It comes with the
            bit of work that shows it.
        """
        wide, quiet = self.extended(*self._suspects), self.hypotheses[0]
        fits = yield from self._fits(windows)
        points = [fits[0].point(self.layout)] if point is None else [point, fits[0].point(self.layout)]
        at, passed, base = yield from self._base(wide, windows, points)
        found: list[CandidateCause] = []
        candidates = chain(
            self._unknowns(windows, at, wide.gains(base, self.layout.causes)),
            self._conventions(windows, fits),
            self._left_out(windows, wrong_twist),
            self._vibrations(windows, at, wide.unpredicted(passed, base, quiet)),
        )
        for candidate in candidates:
            found += yield from self._scored(candidate, base)
        for hypothesis in self.hypotheses[1:]:
            filtered = yield from wide.filtered(passed, hypothesis)
            found.append(replace(candidate_cause(hypothesis.cause, filtered, base), physical=hypothesis.physical))
        filtered = yield from wide.filtered(passed, quiet, LONGEST)
        if explains(filtered) and 0 < len(filtered.jumps) <= _MOST_PULSES:
            when = ', '.join(f'{jump.time:.1f}' for jump in filtered.jumps)
            found.append(candidate_cause(f'{PULSE} at {when} s', filtered, base))
        times = [time for time in jumps if time >= windows[0].start] or [jump.time for jump in filtered.jumps]
        found += yield from self._target_changes(windows, point or at, times[:_PARTS], base)
        # A loose joint explains anything that its encoder may hide: it comes after all causes with a mechanism.
        left = base.misfit - max((each.gain for each in found if each.physical), default=0.0)
        if left > max(WORTH, _LEFT * base.misfit):
            found += yield from self._swinging(windows, at, base)
        found.sort(key=lambda each: -each.gain)
        return IsolationResult(tuple(each for each in found if each.gain > WORTH), base.innovations)

    def _unknowns(
        self, windows: Sequence[Window], at: Point, gains: Mapping[str, tuple[float, float]]
    ) -> Iterator[Candidate]:
        """Yield unknowns with a wider prior."""
        for cause in likeliest_kinds({cause: value for cause, (value, _) in gains.items() if value > WORTH}):
            suspected = (each.part(cause) for each in self._suspects if cause in each.causes)
            passes = self.extended(*suspected).with_inflated_prior(cause, gains[cause][1])
            yield Candidate(_text_of(passes, cause), passes, windows, at, of_twist=cause in OF_TWIST)

    def _conventions(self, windows: Sequence[Window], fits: Sequence[Fit]) -> Iterator[Candidate]:
        """Yield the conventions that fit best."""
        likely = [fit for fit in fits[1:] if fit.exists and fit.misfit < fit.convention.misfit_left * fits[0].misfit]
        likely.sort(key=lambda each: each.misfit)
        delays = [fit for fit in likely if fit.convention.delay]  # one of them will do
        for fit in [fit for fit in likely if fit not in delays[1:]][:_TRIED]:
            other = replace(self.layout, kernel=fit.convention.kernel)
            passes, read = replace(self, layout=other).extended(), fit.convention.windows(windows)
            yield Candidate(fit.convention.text, passes, read, fit.point(other), part=len(read) / len(windows))

    def _left_out(self, windows: Sequence[Window], wrong_twist: str) -> Iterator[Candidate]:
        """Yield windows without a wrong twist, or without those in which a joint stands still."""
        passes = self.extended()
        if wrong_twist and any(np.isfinite(window.knots.base_twist).any() for window in windows):
            yield Candidate(wrong_twist, passes, [without_twist(window) for window in windows], of_twist=True)
        for text, others in readings.stopped_readings(windows, self.layout.kernel.model.joint_names)[:_SPOILT]:
            yield Candidate(text, passes, others)

    def _vibrations(self, windows: Sequence[Window], at: Point, unpredicted: Array) -> Iterator[Candidate]:
        """Yield swings of the base, by how each window's way is not as predicted, (W, p)."""
        for frequency in readings.vibration_frequencies(unpredicted, windows[0].length):
            text = readings.swinging_text(frequency, windows, self.layout.kernel.model.joint_names)
            yield Candidate(text, self.extended(vibration(frequency)), windows, at)

    def _scored(self, candidate: Candidate, base: SquareRootInformation) -> Work[list[CandidateCause]]:
        """Return the gain of a candidate, or None if it has none."""
        left_out, point = candidate.point is None, candidate.point
        if len(candidate.windows) < FEWEST:
            return []
        if point is None:
            point = point_as_described(self.layout, candidate.windows)
            yield FITTED
        filtered = yield from attempted(candidate.passes.refined(candidate.windows, point, self.hypotheses[0]))
        if filtered is None:
            return []
        text = candidate.text if isinstance(candidate.text, str) else candidate.text(filtered)
        if text is None:
            return []
        # Data left out count as if they were explained.
        gain = (
            base.misfit - filtered.gaussian.misfit / candidate.part
            if left_out or candidate.part < 1.0
            else filtered.gaussian.log_likelihood - base.log_likelihood
        )
        return [CandidateCause(text, gain, of_twist=candidate.of_twist)]

    def _target_changes(
        self, windows: Sequence[Window], point: Point, times: Sequence[float], base: SquareRootInformation
    ) -> Work[list[CandidateCause]]:
        """Return the gain of a target that has moved in the grasp, or was exchanged, at some time."""
        found: list[CandidateCause] = []
        passes = self.extended()
        for time in times:
            place = next(index for index, window in enumerate(windows) if window.start >= time)
            later = windows[place + SLIPPING :]
            if place < _BEFORE:
                continue
            # A change that explains the data needs no later one.
            if len(later) < FEWEST or any(each.change for each in found):
                break
            # Another body may be far from the one before.
            points = point, point_as_described(self.layout, later)
            yield FITTED
            for exchanged in (False, True):
                filtered = yield from attempted(
                    passes.target_changes(windows, place, points, self.hypotheses[0], exchanged=exchanged)
                )
                if filtered is not None:
                    cause = candidate_cause(target_changed_text(time, exchanged=exchanged), filtered, base)
                    found.append(replace(cause, change=Change(time, exchanged) if explains(filtered) else None))
        return sorted(found, key=lambda each: -each.gain)[:1]

    def _fits(self, windows: Sequence[Window]) -> Work[list[Fit]]:
        """Return the fits of windows under the conventions that are possible, the declared ones first."""
        found, kernel = [], self.layout.kernel
        others = (convention for mistaken in self.conventions for convention in mistaken(kernel))
        for convention in (Convention('', kernel), *others):
            if convention.possible(windows):
                found.append(fitted(windows, convention, _EVERY))
                yield FITTED // _EVERY
        return found

    def _base(
        self, wide: FilterPasses, windows: Sequence[Window], points: Sequence[Point]
    ) -> Work[tuple[Point, WhitenedWindows, SquareRootInformation]]:
        """Return the point that explains windows best if nothing is wrong, and the pass there."""
        results: list[tuple[Point, WhitenedWindows, SquareRootInformation]] = []
        for point in points:
            # Where a robot is badly misdescribed, what fits best may be none that can be.
            passed = yield from attempted(wide.linearised(windows, point))
            if passed is not None:
                filtered = yield from wide.filtered(passed, self.hypotheses[0])
                results.append((point, passed, filtered.gaussian))
        if not results:
            raise np.linalg.LinAlgError('there is no point to pass the windows at')
        return max(results, key=lambda each: each[2].log_likelihood)

    def _swinging(
        self, windows: Sequence[Window], point: Point, base: SquareRootInformation
    ) -> Work[list[CandidateCause]]:
        """Return the gain of a joint whose far side swings against its encoder; of the likeliest one."""
        names = self.layout.kernel.model.joint_names
        first, *others = readings.LARGE_SWING if base.nis > LARGEST_NIS * base.measured else readings.SMALL_SWING
        filters: dict[tuple[int, float], HypothesisFilter] = {}

        def tried(joint: int, times: float) -> Work[None]:
            noisier = readings.swinging(windows, joint, times, len(names))
            filters[joint, times] = yield from self.extended().filtered_once(noisier, point, self.hypotheses[0])

        def best() -> tuple[int, float]:
            return max(filters, key=lambda each: filters[each].gaussian.log_likelihood)

        for joint in range(len(names)):
            yield from tried(joint, first)
        likeliest, _ = best()
        if filters[best()].gaussian.log_likelihood > base.log_likelihood:
            for times in others:
                yield from tried(likeliest, times)
        _, times = best()
        if not explains(filters[best()]):
            return []  # something else pushes the base, too; and what it explains it has no name for
        text = readings.loose_joint_text(names[likeliest], windows, times)
        return [replace(candidate_cause(text, filters[best()], base), physical=False)]

    @property
    def _suspects(self) -> tuple[Unknown, ...]:
        return tuple(each for each in self.suspects if not set(each.causes) & set(self.layout.causes))

    def extended(self, *more: Unknown) -> FilterPasses:
        """Return passes with more unknowns."""
        return FilterPasses(self.layout.extended(more), self.plane, self.declared)


def _text_of(passes: FilterPasses, cause: str) -> Callable[[HypothesisFilter], str | None]:
    """Return the value that an unknown would need; None for a link that would lose far more than its mass."""
    kind, _, name = cause.partition(':')

    def text(filtered: HypothesisFilter) -> str | None:
        value, kernel = passes.value(filtered, cause), passes.layout.kernel
        if kind == 'link' and value[0] <= -_LIGHTER * kernel.known[kernel.model.link(name).body, 0]:
            return None
        declared = f', or set {marker_text(value, passes.declared.marker)}' if kind == 'mount' else ''
        return deviation_text(cause, value) + declared

    return text
