"""Fault isolation: which cause explains the contradiction best, by likelihood."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from mbaid_ros.core.contracts import Convention, ConventionFactory, Hypothesis, Unknown, belongs, deviation_text
from mbaid_ros.core.diagnosis.passes import FITTED, SLIPPING, FilterPasses, Fit, attempted, fitted, point_as_described
from mbaid_ros.core.diagnosis.readings import (
    joints_by_another_clock,
    mapped_joints,
    placed_bases,
    scaled_positions,
)
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.hypotheses import LONGEST, HypothesisFilter, WhitenedWindows
from mbaid_ros.core.filter.run import Run
from mbaid_ros.core.forces import DisturbanceModel, disturbance_repair, disturbances
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.faults import (
    LARGE_SWING,
    SMALL_SWING,
    joint_noise_factor,
    loose_joint_text,
    stopped_readings,
    swing_size,
    swinging,
)
from mbaid_ros.core.joints.model import tracking_repair
from mbaid_ros.core.odometry.faults import twist_check, vibration_frequencies
from mbaid_ros.core.odometry.model import OF_TWIST, marker_text, vibration
from mbaid_ros.core.passive import swinging_text
from mbaid_ros.core.repair import Conversion, Repair, as_likely, widened
from mbaid_ros.core.results.estimate import PULSE
from mbaid_ros.core.results.innovations import BASE_SENSORS, Innovations
from mbaid_ros.core.results.verdict import FOUND_NOISE, LARGEST_NIS, Cause, too_small
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.state import Declared, Layout, Point
from mbaid_ros.core.target import target_changed_text
from mbaid_ros.core.windows import Window, without_twist
from mbaid_ros.tasks import AT_ONCE, Kind, Tasks, Work, outcome_or_none

# Log-likelihood, the odds of hypotheses.MARGIN: a smaller gain is not reported, and a smaller lead is no lead.
WORTH = 10.0
_TOO_SMALL = 1.3  # times the declared noise, from which the declared one is wrong: declarations are no better
# Share that counts of the gain of a cause without a mechanism: where both explain all, one with a mechanism leads.
CATCH_ALL = 0.95
# Of how many the gain is found by passes of their own, and of how many of one kind: three links or joints will do.
_REFINED, _ALIKE = 5, 3
# Standard deviations of the misfit that n right numbers have by chance, sqrt(n / 2): leaving them out gains that.
_CHANCE = 2.0
_EVERY = 2  # one window in so many shows which convention is likely: for half of the work
_TRIED = 4  # conventions
_AGREES = 0.01  # part of the misfit, from which one that an earlier search has found needs no other search
_SEVERAL = 0.05  # part of the misfit that a convention of one number leaves at least, for several to be looked for
_SPOILT = 2  # joints with spoilt readings: two that fail at once are rare, and each takes passes
_MOST_PULSES = 2  # that can be the cause; more of them are the symptom of another one
_BEFORE = 10  # windows before a change of the target: the body before has to be known
_PARTS = 3  # of the first jumps, at which the target may have changed: later ones follow from the first
# Levels, N/kg of the known bodies (N m at a metre), and times, s, of a force that varies.
_PROCESS_LEVELS, _PROCESS_TIMES = (1e-5, 1e-4, 1e-3), (1.0, 10.0, 100.0)
# Of the gain by the likeliest, that a force of shorter time may lack: real ones begin and end at once, and a smooth
# process makes too little of that.
_ROUGHER = 0.1
_LEFT = 0.1  # of the misfit, that the likeliest cause leaves, for more to be looked for: less may be linearisation
_LIGHTER = 1.5  # times its mass, that a link may look lighter by: noise may make it more than all
_LINK_KINDS = {'link', 'density'}  # labels of any error of a link, and of one that is heavier throughout
FEWEST = 4  # windows that have to be left: fewer have hardly more numbers (six each) than body and momentum, sixteen
_FIRST = 24  # windows before the first search: fewer do not discriminate causes
_AFTER_A_JUMP = 1 + SLIPPING + FEWEST  # windows since a jump that may be a change of the target: enough to see it
# Windows, at most, that a jump is left open while a search is under way: by then its result is there.
_OPEN = 16
_APART = 16  # minimum windows from one search to the next: fewer new ones add less than the noise
# Windows of one search: a fault has seldom begun earlier, and work and memory stay bounded.
_KEPT = 80
_LATEST = 8  # windows whose samples show how noisy the sensors are: as noisy as they are now
# A search over so many windows is due one window later: its work, up to some seconds, fits between their messages.
_PACE = 5
# Correlation of a sensor's innovations from window to window, over their size, below which they are noise.
_WHITE = 0.3


@dataclass(frozen=True)
class Change:
    """A target that has moved in the grasp, or was exchanged for another."""

    time: float  # s since the first sample, start of the window in which it was noticed
    exchanged: bool  # whether mass and momentum have changed as well


@dataclass(frozen=True)
class CandidateCause:
    """One candidate cause."""

    text: str  # in words
    gain: float  # how much likelier that makes the data (log-likelihood)
    physical: bool = True  # whether it has a mechanism; a random walk follows anything
    change: Change | None = None  # what has become of the target, where that leaves nothing unexplained
    of_twist: bool = False  # whether it is something wrong with the base's twist, which poses can do without
    vibrates: bool = False  # whether something swings at one frequency
    repair: Repair | None = None  # how a run takes it into account; None where it cannot
    link: str = ''  # name of a link that is not as described


@dataclass(frozen=True)
class IsolationResult:
    """The result of a search."""

    causes: tuple[CandidateCause, ...]  # the likeliest first
    innovations: Innovations  # of the pass without jumps
    repairs: Mapping[str, Repair] = field(default_factory=dict)  # of forces and drifts, by the text of the cause
    contradicting: float = 0.0  # gain of unknowns that contradict the model by themselves

    @property
    def leading(self) -> CandidateCause | None:
        """The cause with a mechanism, if nothing of another kind explains the data nearly as well."""
        first = next((each for each in self.causes if each.physical), None)
        if first is None:
            return None
        others = (each for each in self.causes if each is not first and not (each.of_twist and first.of_twist))
        rivals = (each.gain + WORTH if each.physical else CATCH_ALL * each.gain for each in others)
        return first if first.gain > max(rivals, default=0.0) else None


def ranked(
    gains: Mapping[str, tuple[float, bool]],
    innovations: Innovations,
    joint_noise: float,
    repairs: Mapping[str, Repair | None] | None = None,
) -> tuple[Cause, ...]:
    """Return the candidate causes, the likeliest first.

    Parameters
    ----------
    gains : by text the gain of each, and whether it has a mechanism
    innovations : of a pass in which nothing explains anything
    joint_noise : how many times as noisy as specified the joints are by their samples
    repairs : by text, how a run takes each into account
    """
    how = repairs or {}
    causes = [
        Cause(text, gain if physical else CATCH_ALL * gain, how.get(text)) for text, (gain, physical) in gains.items()
    ]
    if joint_noise > _TOO_SMALL:
        # The joints' noise is in every sensor's innovations. That of the base is estimated.
        ratio = np.maximum(np.nan_to_num(innovations.ratio, nan=1.0), 1.0)
        text = (
            f'the noise values are too small: noise.joint_position {joint_noise:.1f} times; correct it, or set '
            'noise.estimate'
        )
        repair = Repair(f'the joints are {joint_noise:.1f} times as noisy as specified', FOUND_NOISE, value=joint_noise)
        causes.append(Cause(text, 0.5 * float(innovations.count @ (ratio - 1.0 - np.log(ratio))), repair))
    causes.sort(key=lambda cause: -cause.gain)
    leading = causes[0].repair if causes else None
    return tuple(each for each in causes if not (leading and each.repair and leading.corrects_twist(each.repair)))


def candidate_cause(
    text: str, filtered: HypothesisFilter, base: SquareRootInformation, repair: Repair | None = None
) -> CandidateCause:
    """Return the gain of a cause over a pass without it."""
    return CandidateCause(text, filtered.gaussian.log_likelihood - base.log_likelihood, repair=repair)


def with_links_as_likely(found: Sequence[CandidateCause]) -> list[CandidateCause]:
    """Return causes; the likeliest of links that are not as described names those that explain the data as well."""
    links = sorted((each for each in found if each.link and each.gain > WORTH), key=lambda each: -each.gain)
    others = ', '.join(each.link for each in links[1:] if each.gain >= as_likely(links[0].gain))
    if not others:
        return list(found)
    text = f'{links[0].text}; as likely: {others}'
    return [replace(each, text=text) if each is links[0] else each for each in found]


def likeliest_kinds(gains: Mapping[str, float]) -> list[str]:
    """Return the causes that are worth a pass of their own, the likeliest first."""
    found: list[str] = []
    kinds: Counter[str] = Counter()
    links: set[str] = set()
    for cause in sorted(gains, key=lambda each: -gains[each]):
        kind, _, name = cause.partition(':')
        if kind in _LINK_KINDS:  # the likelier of a link that is heavier throughout, and one with any error
            kind = 'link'
            if name in links:
                continue
            links.add(name)
        kinds[kind] += 1
        if kinds[kind] <= _ALIKE:
            found.append(cause)
    return found[:_REFINED]


def explains(filtered: HypothesisFilter) -> bool:
    """Return whether a pass leaves innovations of the size that the noise explains."""
    return filtered.gaussian.nis < LARGEST_NIS * filtered.gaussian.measured


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
    vibrates: bool = False  # whether something swings at one frequency
    # Weight of its gain, and the part taken off it: a fault of a sensor explains nearly all that leaving it out does.
    weight: float = 1.0
    less: float = 0.0
    whole: bool = False  # whether it is none where it leaves anything unexplained: its gain may be that of iterating
    # How a run takes it into account; or the label of the unknown that knows.
    repair: Repair | str | None = None

    @property
    def link(self) -> str:
        """Name of the link that is not as described; empty where it is something else."""
        kind, _, name = self.repair.partition(':') if isinstance(self.repair, str) else ('', '', '')
        return name if kind in _LINK_KINDS else ''

    def repair_of(self, filtered: HypothesisFilter) -> Repair | None:
        """Return how a run takes it into account, given the filter at the end; None where it cannot."""
        return self.passes.repair(filtered, self.repair) if isinstance(self.repair, str) else self.repair


@dataclass(frozen=True)
class CandidateCauses:
    """Scores the candidate causes of a run."""

    layout: Layout  # of the run's state
    plane: PlaneDetector  # whether the motion is planar
    declared: Declared  # as of the run
    hypotheses: tuple[Hypothesis, ...]  # that the run is followed under
    # Beside those of the run, each so nearly exact that the run stays as it was. The likelihood gain of a wider prior
    # follows from its estimate (`core/filter/posterior.py`).
    suspects: tuple[Unknown, ...] = ()
    conventions: tuple[ConventionFactory, ...] = ()  # that may be mistaken, in the order in which they are tried
    several: list[Convention] = field(default_factory=list)  # with several numbers, that earlier searches have found

    def isolate(
        self,
        windows: Sequence[Window],
        point: Point | None,
        jumps: Sequence[float] = (),
        wrong_twist: str = '',
        leading: str = '',
    ) -> Work[IsolationResult]:
        """Return the candidates found.

        Parameters
        ----------
        windows : in order
        point : of the run's layout, at which they are linearised; None where it has come to none
        jumps : s, when the momentum seemed to jump in the run
        wrong_twist : how the twist contradicts the poses, in words; empty if it does not
        leading : cause of the hypothesis that the run reports; empty if undisturbed

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
        contradicting = wide.contradicting(base)
        candidates = chain(
            self._unknowns(windows, at, wide.gains(base, self.layout.causes)),
            self._conventions(windows, fits),
            self._left_out(windows, wrong_twist),
            self._without_sensors(windows, base.innovations),
            self._vibrations(windows, at, wide.unpredicted(passed, base, quiet)),
        )
        for candidate in candidates:
            found += yield from self._scored(candidate, base, contradicting)
        found = with_links_as_likely(found)
        for hypothesis in self.hypotheses[1:]:
            filtered = yield from wide.filtered(passed, hypothesis)
            cause = candidate_cause(hypothesis.cause, filtered, base, hypothesis.repair)
            found.append(replace(cause, physical=hypothesis.physical))
        filtered = yield from wide.filtered(passed, quiet, LONGEST)
        if explains(filtered) and 0 < len(filtered.jumps) <= _MOST_PULSES:
            when = ', '.join(f'{jump.time:.1f}' for jump in filtered.jumps)
            found.append(candidate_cause(f'{PULSE} at {when} s', filtered, base))
        times = [time for time in jumps if time >= windows[0].start] or [jump.time for jump in filtered.jumps]
        found += yield from self._target_changes(windows, point or at, times[:_PARTS], base)
        # A loose joint explains anything that its encoder may hide: it comes after all causes with a mechanism.
        best = max((each.gain for each in found if each.physical), default=0.0)
        left = base.misfit - best
        repairs = yield from self._processes(found, windows, at, best, leading, base)
        found = [replace(each, repair=repairs.get(each.text, each.repair)) for each in found]
        if left > max(WORTH, _LEFT * base.misfit):
            found += yield from self._swinging(windows, at, base)
        found.sort(key=lambda each: -each.gain)
        return IsolationResult(
            tuple(each for each in found if each.gain > WORTH), base.innovations, repairs, contradicting
        )

    def _unknowns(
        self, windows: Sequence[Window], at: Point, gains: Mapping[str, tuple[float, float]]
    ) -> Iterator[Candidate]:
        """Yield unknowns with a wider prior."""
        for cause in likeliest_kinds({cause: value for cause, (value, _) in gains.items() if value > WORTH}):
            suspected = (each.part(cause) for each in self._suspects if any(belongs(own, cause) for own in each.causes))
            passes = self.extended(*suspected).with_inflated_prior(cause, gains[cause][1])
            yield Candidate(_text_of(passes, cause), passes, windows, at, of_twist=cause in OF_TWIST, repair=cause)

    def _conventions(self, windows: Sequence[Window], fits: Sequence[Fit]) -> Iterator[Candidate]:
        """Yield the conventions that fit best."""
        likely = [fit for fit in fits[1:] if fit.exists and fit.misfit < fit.convention.misfit_left * fits[0].misfit]
        likely.sort(key=lambda each: each.misfit)
        delays = [fit for fit in likely if fit.convention.delay]  # one of them will do
        # A small change of the momentum, which the misfit of noisy windows does not show: the likelihood does.
        small = [fit for fit in likely if fit.convention.misfit_left == np.inf]
        others = [fit for fit in likely if fit not in (*delays[1:], *small)]
        for fit in (*others[:_TRIED], *small):
            other = replace(self.layout, kernel=fit.convention.kernel)
            passes, read = replace(self, layout=other).extended(*fit.convention.rest), fit.convention.windows(windows)
            part, repair = len(read) / len(windows), fit.convention.repair
            whole, text = fit in small, fit.convention.text
            yield Candidate(text, passes, read, fit.point(other), part=part, whole=whole, repair=repair)

    def _left_out(self, windows: Sequence[Window], wrong_twist: str) -> Iterator[Candidate]:
        """Yield windows without a wrong twist, or without those in which a joint stands still."""
        passes = self.extended()
        if wrong_twist and any(np.isfinite(window.knots.base_twist).any() for window in windows):
            repair = Repair(wrong_twist.partition(':')[0], conversion=Conversion(with_twist=False))
            left = [without_twist(window) for window in windows]
            yield Candidate(wrong_twist, passes, left, of_twist=True, repair=repair)
        for text, others, stretches in stopped_readings(windows, *self._encoders)[:_SPOILT]:
            since, conversion = stretches[0][0], Conversion(left_out=stretches)
            repair = Repair(text.partition(':')[0], conversion=conversion, since=since)
            yield Candidate(text, passes, others, repair=repair)

    def _without_sensors(self, windows: Sequence[Window], innovations: Innovations) -> Iterator[Candidate]:
        """Yield windows without one named sensor each, and without the odometry where others measure the pose.

        Innovations that are white show noise that is larger than declared; others, an error.
        """
        passes, ratios = self.extended(), dict(zip(innovations.sensors, innovations.ratio.tolist(), strict=True))
        correlations = dict(zip(innovations.sensors, innovations.correlation.tolist(), strict=True))
        counts = dict(zip(innovations.sensors, innovations.count.tolist(), strict=True))
        for sensor in self.layout.sensors:
            ratio = ratios.get(sensor.name, np.nan)
            if not ratio > 1.0:
                continue
            times = float(np.sqrt(ratio))
            text = f'{sensor.name} contradicts the other sensors, with {times:.2g} times its noise'
            repair = Repair(text, sensor.leave_out)
            text = f'{text}: check its clock, axes, units and mount, or leave it out'
            if correlations[sensor.name] < _WHITE * ratio:
                text = too_small(sensor.noise, times)
                declared = {name: times * value for name, value in sensor.noise.items() if value > 0.0}
                repair = Repair(text, declared or sensor.leave_out, value=times)
            without = [sensor.without(window) for window in windows]
            chance = _CHANCE * float(np.sqrt(0.5 * counts[sensor.name]))
            yield Candidate(text, passes, without, weight=CATCH_ALL, less=chance, repair=repair)
        if self.layout.odometry and any(sensor.of_pose for sensor in self.layout.sensors):
            text = 'the odometry contradicts the other sensors: check it, or leave it out (poses.alone)'
            other = replace(self, layout=replace(self.layout, odometry=False))
            chance = _CHANCE * float(np.sqrt(0.5 * sum(counts.get(name, 0.0) for name in BASE_SENSORS)))
            without = [without_twist(window) for window in windows]
            yield Candidate(text, other.extended(), without, weight=CATCH_ALL, less=chance)

    def _vibrations(self, windows: Sequence[Window], at: Point, unpredicted: Array) -> Iterator[Candidate]:
        """Yield swings of the base, by how each window's way is not as predicted, (W, p)."""
        for frequency in vibration_frequencies(unpredicted, windows[0].length):
            text = swinging_text(frequency, windows, self.layout.kernel.model.joint_names)
            yield Candidate(text, self.extended(vibration(frequency)), windows, at, vibrates=True)

    def _scored(
        self, candidate: Candidate, base: SquareRootInformation, contradicting: float
    ) -> Work[list[CandidateCause]]:
        """Return the gain of a candidate, or None if it has none.

        Parameters
        ----------
        base : after a pass without it
        contradicting : gain of the unknowns that contradict the model there, which the candidate may explain as well
        """
        left_out, point = candidate.point is None, candidate.point
        if len(candidate.windows) < FEWEST:
            return []
        if point is None:
            point = point_as_described(self.layout, candidate.windows)
            yield FITTED
        filtered = yield from attempted(candidate.passes.refined(candidate.windows, point, self.hypotheses[0]))
        if filtered is None:
            return []
        left = candidate.passes.contradicting(filtered.gaussian)
        if candidate.whole and (left or not explains(filtered)):
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
        gain = candidate.weight * (gain + contradicting - left)
        gain -= candidate.less
        repair = candidate.repair_of(filtered) if gain > WORTH else None
        return [
            CandidateCause(
                text,
                gain,
                of_twist=candidate.of_twist,
                vibrates=candidate.vibrates,
                repair=repair,
                link=candidate.link,
            )
        ]

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

    def _processes(
        self,
        found: Sequence[CandidateCause],
        windows: Sequence[Window],
        point: Point,
        best: float,
        leading: str,
        base: SquareRootInformation,
    ) -> Work[dict[str, Repair]]:
        """Return the force and torque that explain a likely force, drift or vibration best, by the text of the cause.

        A run tries constant forces by itself: where it is contradicted all the same, they vary.
        """
        names = {each.cause: each.name for each in self.hypotheses if each.disturbed and each.repair is None}
        names |= {each.text: each.text.partition(':')[0] for each in found if each.vibrates}
        likely = {each.text for each in found if each.gain > max(WORTH, 0.5 * best)} | {leading}
        if best <= WORTH:  # what drifts may lead before the next search
            likely |= {each.cause for each in self.hypotheses if each.momentum > 0.0}
        likely &= names.keys()
        process = (yield from self._process(windows, point, base.log_likelihood)) if likely else None
        return {} if process is None else {text: disturbance_repair(names[text], *process) for text in sorted(likely)}

    def _process(
        self, windows: Sequence[Window], point: Point, base: float
    ) -> Work[tuple[DisturbanceModel, DisturbanceModel] | None]:
        """Return a stationary torque and force that explain windows, the least smooth of likely ones.

        `base` is the log-likelihood without any.
        """
        mass = float(np.sum(self.layout.kernel.known[:, 0]))
        likelihoods: dict[tuple[float, float, float], float] = {}

        def tried(torque: float, force: float, time: float) -> Work[None]:
            models = (DisturbanceModel(each, time) for each in (torque, force))
            passes = self.extended(*(each for each in disturbances(*models) if each.count))
            filtered = yield from attempted(passes.filtered_once(windows, point, self.hypotheses[0]))
            if filtered is not None:
                likelihoods[torque, force, time] = filtered.gaussian.log_likelihood

        def best() -> tuple[float, float, float]:
            most = max(likelihoods.values())
            least = most - max(WORTH, _ROUGHER * (most - base))
            time = min(each[2] for each, value in likelihoods.items() if value >= least)
            least = max(value for each, value in likelihoods.items() if each[2] == time) - WORTH
            likely = [each for each, value in likelihoods.items() if each[2] == time and value >= least]
            return max(likely, key=lambda each: each[0] + each[1])

        for time in _PROCESS_TIMES:
            for level in _PROCESS_LEVELS:
                yield from tried(level * mass, level * mass, time)
        if not likelihoods:
            return None
        size, _, time = best()
        for one in ((size / 3.0,) * 2, (3.0 * size,) * 2, (size, 0.0), (0.0, size)):
            yield from tried(*one, time)
        torque, force, time = best()
        return DisturbanceModel(widened(torque), time), DisturbanceModel(widened(force), time)

    def _fits(self, windows: Sequence[Window]) -> Work[list[Fit]]:
        """Return the fits of windows under the conventions that are possible, the declared ones first."""
        found, kernel = [], self.layout.kernel
        others = (convention for mistaken in self.conventions for convention in mistaken(kernel))
        for convention in (Convention('', kernel), *others):
            if convention.possible(windows):
                found.append(fitted(windows, convention, _EVERY))
                yield FITTED // _EVERY
        # What an earlier search has found, if more windows agree; then what is wrong in one number alone is found.
        found += [fit for fit in (fitted(windows, each, _EVERY) for each in self.several) if _agrees(fit, found[0])]
        of_poses = placed_bases(kernel, windows, self.declared.marker), scaled_positions(kernel, windows)
        for search in (joints_by_another_clock(kernel, windows), *of_poses, mapped_joints(kernel, windows)):
            if min(each.misfit for each in found if each.exists or each is found[0]) > _SEVERAL * found[0].misfit:
                conventions = yield from search
                self.several.extend(conventions)
                found += [fitted(windows, convention, _EVERY) for convention in conventions]
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
        first, *others = LARGE_SWING if base.nis > LARGEST_NIS * base.measured else SMALL_SWING
        filters: dict[tuple[int, float], HypothesisFilter] = {}

        def tried(joint: int, times: float) -> Work[None]:
            noisier = swinging(windows, joint, times, len(names))
            filters[joint, times] = yield from self.extended().filtered_once(noisier, point, self.hypotheses[0])

        def best() -> tuple[int, float]:
            return max(filters, key=lambda each: filters[each].gaussian.log_likelihood)

        for joint in self.layout.kernel.model.transmission.independent.tolist():
            yield from tried(joint, first)
        likeliest, _ = best()
        if filters[best()].gaussian.log_likelihood > base.log_likelihood:
            for times in others:
                yield from tried(likeliest, times)
        _, times = best()
        if not explains(filters[best()]):
            return []  # something else pushes the base, too; and what it explains it has no name for
        text = loose_joint_text(names[likeliest], windows, times)
        repair = tracking_repair(names[likeliest], swing_size(windows, times), self.layout.kernel)
        return [replace(candidate_cause(text, filters[best()], base, repair), physical=False)]

    @property
    def read_joints(self) -> tuple[int, ...]:
        """Indices of the joints with readings: neither followers of others nor passive ones."""
        kernel = self.layout.kernel
        independent = kernel.model.transmission.independent.tolist()
        return tuple(joint for joint in independent if joint not in kernel.springs.joints)

    @property
    def _encoders(self) -> tuple[tuple[str, ...], tuple[int, ...]]:
        """Names and indices of the joints that follow no other."""
        model = self.layout.kernel.model
        return model.independent_joints, tuple(model.transmission.independent.tolist())

    @property
    def _suspects(self) -> tuple[Unknown, ...]:
        left = [each for each in (own.without(self.layout.causes) for own in self.suspects) if each.count]
        return tuple(left if self.layout.plane is None else (each.in_plane(self.plane) for each in left))

    def extended(self, *more: Unknown) -> FilterPasses:
        """Return passes with more unknowns."""
        return FilterPasses(self.layout.extended(more), self.plane, self.declared)


def _agrees(fit: Fit, read: Fit) -> bool:
    """Return whether a convention explains nearly all that the readings as they are do not."""
    return fit.misfit < _AGREES * read.misfit


def _text_of(passes: FilterPasses, cause: str) -> Callable[[HypothesisFilter], str | None]:
    """Return the value that an unknown would need; None for a link that would lose far more than its mass."""
    kind, _, name = cause.partition(':')

    def text(filtered: HypothesisFilter) -> str | None:
        value, kernel = passes.value(filtered, cause), passes.layout.kernel
        if kind in {'link', 'density'} and value[0] <= -_LIGHTER * kernel.known[kernel.model.link(name).body, 0]:
            return None
        declared = f', or set {marker_text(value, passes.declared.marker)}' if kind == 'mount' else ''
        return deviation_text(cause, value, () if name else kernel.model.joint_names) + declared

    return text


class FaultIsolation:
    """Searches repeatedly for the causes of a contradiction, over the latest windows of a run.

    Attributes
    ----------
    suspicious : whether the run was, when it was last followed

    Parameters
    ----------
    candidates : the candidate causes
    noise : as declared
    tasks : run its searches; that of a run before it is given up
    """

    def __init__(self, candidates: CandidateCauses, noise: SensorNoise, tasks: Tasks) -> None:
        self._candidates = candidates
        self._noise = noise
        self._samples: deque[Samples] = deque(maxlen=_LATEST)
        self._twist = twist_check()
        self._windows: deque[Window] = deque(maxlen=_KEPT)
        self._seen = 0
        self._onset, self._next = 0, _FIRST  # windows until the run was suspicious, and until the next search
        self.suspicious = False
        self._tasks = tasks
        tasks.cancel(Kind.CAUSES)
        self._due: int | None = None  # number of windows at which the result of a search is
        self._found: IsolationResult | None = None
        self._over = False  # whether the contradiction has ended since
        self._about: tuple[float, ...] = ()  # s, of the jumps that the latest search was begun for

    def add_window(self, window: Window | None, samples: Samples) -> None:
        """Add the next window for the following searches, and the samples of the one after it."""
        self._samples.append(samples)
        if self.suspicious or self._seen < _FIRST:  # only a search needs it
            self._twist.add(samples)
        if window is not None:
            self._windows.append(window)
            self._seen += 1
            if self._seen == self._due:
                self._tasks.require(Kind.CAUSES)

    def begin_if_due(self, run: Run, *, suspicious: bool) -> None:
        """Begin a search for the causes in a suspicious run, if one is due."""
        self.suspicious = suspicious
        if not suspicious:
            self._over = True
            self._onset, self._next = self._seen, max(_FIRST, self._seen)
        early = run.has_state and bool(run.unconfirmed_jumps) and self._seen < self._onset + _AFTER_A_JUMP
        # A walk that leads has taken the jump up: it is there all the same.
        walks = run.has_state and not run.best.hypothesis.physical
        early = early or (walks and self._since_a_jump(run) < _AFTER_A_JUMP)
        if self._due is None and suspicious and self._seen >= self._next and not early:
            self._next = self._seen + max(_APART, self._seen - self._onset)  # when twice as much contradicts it
            point = run.point if run.has_state else None
            since = self._windows[max(self._onset - self._seen, -len(self._windows))].start
            self._about = tuple(time for time in run.jump_times if time >= since)
            wrong_twist = self._twist.reason()
            text = wrong_twist.text if wrong_twist else ''
            leading = run.best.hypothesis.cause if run.has_state else ''
            isolated = self._candidates.isolate(list(self._windows), point, run.jump_times, text, leading)
            # The point may be of no robot that can be: a later one may be.
            work, size = outcome_or_none(isolated, np.linalg.LinAlgError), self._candidates.layout.size
            self._tasks.begin(Kind.CAUSES, work, self._accept, size=size, steps=AT_ONCE, due=False)
            self._due = self._seen + -(-len(self._windows) // _PACE)

    def _accept(self, found: IsolationResult | None) -> None:
        """Accept the result of a search."""
        self._due = None
        # The cause of a contradiction may have died down: it is not in the latest windows any more.
        if found is not None and (found.causes or self._over or self._found is None):
            self._found, self._over = found, False

    def open_jumps(self, run: Run) -> tuple[float, ...]:
        """Return when the momentum of a run seems to have jumped, s, where a search for the cause is under way.

        A leading constant force explains changes that are jumps without it.
        """
        if self._due is None:
            return ()
        latest = self._windows[-1]
        since = latest.start - _OPEN * latest.length
        left = {jump.time for jump in run.best.jumps} if run.best.hypothesis.physical else set(run.jump_times)
        return tuple(time for time in run.jump_times if time in self._about and time > since and time in left)

    def _since_a_jump(self, run: Run) -> float:
        """Return how many windows there have been since the first jump, if nothing drifts; infinitely many without."""
        if not run.jump_times or not self._windows:
            return np.inf
        return (self._windows[-1].start - run.jump_times[0]) / self._windows[-1].length

    @property
    def searched(self) -> bool:
        """Whether there is the result of a search."""
        return self._found is not None

    @property
    def contradicting(self) -> float:
        """Gain of unknowns that contradict the model by themselves, in the latest search; infinite before one."""
        return np.inf if self._found is None else self._found.contradicting

    @property
    def _leading(self) -> CandidateCause | None:
        return None if self._found is None else self._found.leading

    @property
    def change(self) -> Change | None:
        """The change of the target, if the latest search found it as the cause."""
        return self._leading.change if self._leading else None

    @property
    def wrong_twist(self) -> str:
        """The error of the base's twist, if the latest search found it as the cause; else empty."""
        return self._leading.text if self._leading and self._leading.of_twist else ''

    def windows_since(self, time: float) -> list[Window]:
        """Return the windows that begin at a time, s, or later."""
        return [window for window in self._windows if window.start >= time]

    def causes(self, run: Run) -> tuple[Cause, ...]:
        """Return the causes found by the latest search, the likeliest first; none before one."""
        found = self._found
        if found is None:
            return ()
        gains = {cause.text: (cause.gain, cause.physical) for cause in found.causes}
        repairs = {cause.text: cause.repair for cause in found.causes}
        leading = run.best.hypothesis if run.has_state else None
        if leading is not None and leading.disturbed:  # the run may have more windows by now
            # Over all of the run, not its latest windows alone: a hypothesis that fits anything gains nothing then.
            least = min((cause.gain for cause in found.causes), default=run.log_likelihood_ratio)
            lead = run.log_likelihood_ratio if leading.physical else min(run.log_likelihood_ratio, least)
            gains.setdefault(leading.cause, (lead, leading.physical))
            repairs.setdefault(leading.cause, leading.repair or found.repairs.get(leading.cause))
        latest = self._noise.for_window(self._samples[-1])
        noise = joint_noise_factor(self._samples, latest.joint_position, self._candidates.read_joints)
        return ranked(gains, found.innovations, noise, repairs)
