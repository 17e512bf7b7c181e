"""The weighted difference form: standard parameters and the unknown total momentum together, at the statistical limit.

Differencing removes an unknown constant; the best reference to difference against is the noise-weighted mean, which is
the same as estimating the constant with the parameters. Every window adds six equations (window_rows), weighted with
the noise they carry and corrected for the noise in their coefficients (errors_in_variables), to one likelihood whose
maximum is followed at bounded cost (rolling) and watched for disturbances (steps, monitor).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core import chi_square
from mbaid_ros.core.difference.disturbances import Jump
from mbaid_ros.core.difference.effects import Axes, delay_columns, with_joints_later
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation
from mbaid_ros.core.difference.problem import Beside, Problem, Surroundings, observed
from mbaid_ros.core.difference.rolling import RollingLikelihood
from mbaid_ros.core.difference.steps import SteppedLikelihood
from mbaid_ros.core.difference.window_rows import joined, window_rows
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.causes import PULSE, constant_force
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.reporting import NOISE_MARGIN, Instant, Reporting, Solution, inverse
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.known_errors import KnownErrors
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.samples import Samples, SensorNoise

_LATER = 3  # times as many windows are kept before they are folded
_MOST_TOLD = 5  # events in the warnings
_LONG = 1.5  # s, from which a jump of the momentum is no pulse
# Chance of an estimate to be as large if there was nothing, from which on a jump is none, and a force is one.
_NOTHING, _CERTAIN = 1e-3, 1e-9
_ANYTHING = (
    'wrong known bodies (known_links.relative_std), order or sign of joints or twist frame, or a force that changes'
)


@dataclass(frozen=True)
class DifferenceSettings:
    """Settings of the weighted difference form.

    Attributes
    ----------
    noise : of the joint sensors (the base's stands in the samples)
    kept_windows : windows solved again at each update; older ones are folded
    forgetting_time : s, time constant of forgetting; 0 never forgets
    window : s
    beside : what is there beside the body and the momentum
    """

    noise: SensorNoise
    kept_windows: int
    forgetting_time: float
    window: float
    beside: Beside


@dataclass
class _Run:
    """What a run has led to: where it started, what its motion can tell, and the likelihood of that."""

    origin: Array
    problem: Problem
    likelihood: SteppedLikelihood
    started: float  # s since the first sample
    restarted: bool = False
    blame: Array = field(default_factory=lambda: np.zeros(1))  # share of all known bodies in the variance, and of each


@dataclass(frozen=True)
class _Disturbances:
    """What has disturbed a run by an instant: events, warnings, (value, standard deviation) of a delay of the joints.

    `too_many` tells whether there are more than the model can be right with.
    """

    events: tuple[Event, ...]
    warnings: tuple[str, ...]
    delay: tuple[float, float]
    too_many: bool


class DifferenceEstimator:
    """Identifies one link and the total momentum, whatever the momentum is."""

    method = 'difference'
    needs_rates = True

    def __init__(self, kernel: MomentumKernel, settings: DifferenceSettings, reporting: Reporting) -> None:
        self._kernel = kernel
        self._observed = observed(kernel, settings.beside)
        self._settings = settings
        self._reporting = reporting
        self._plane = PlaneDetector(kernel.model)
        self._run: _Run | None = None
        self._samples = 0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows and return one estimate a window.

        Parameters
        ----------
        windows : list of Samples
        origin : ns, stamp at time 0
        """
        start = windows[0].base_position[0].copy() if self._run is None else self._run.origin
        rows, delays = self._equations(windows, start)
        # What may act is added up from window to window, for all at once: anew where a run has begun anew.
        run, found = None, []
        around: Iterator[Surroundings] = iter(())
        for k, (window, row, delay) in enumerate(zip(windows, rows.each(), delays[:, None], strict=True)):
            self._plane.update(window)
            self._run = self._running(start, float(window.time[0]))
            if self._run is not run:
                run = self._run
                around = run.problem.surroundings(*joined(windows[k:])).each()
            found.append(self._window(window, (row, delay, next(around)), run, origin))
        solutions, instants, disturbances = zip(*found, strict=True)
        estimates = self._reporting.estimates(self.method, solutions, instants)
        return [
            _judged(estimate.after_thrust(window.impulse[-1]), disturbed)
            for window, estimate, disturbed in zip(windows, estimates, disturbances, strict=True)
        ]

    def _equations(self, windows: list[Samples], start: Array) -> tuple[Blocks, Array]:
        """Return the equations of K windows, and (K, 6, 11) how they change with a delay of the joints' stamps."""
        rows = window_rows(self._observed, windows, self._settings.noise, start)
        if self._settings.beside.delay_std > 0.0:
            return rows, delay_columns(self._kernel, *joined(windows), rows)
        return rows, np.zeros((len(windows), 6, 11))

    def _window(
        self, window: Samples, equations: tuple[Blocks, Array, Surroundings], run: _Run, origin: int
    ) -> tuple[Solution, Instant, _Disturbances]:
        rows, delays, around = equations
        time = float(window.time[-1])
        late = float(np.nan_to_num(_delay(run)[0]))
        if late != 0.0:
            window = with_joints_later(*joined([window]), late)
            rows, delays = self._equations([window], run.origin)
        block, columns = run.problem.of(around, rows, delays)
        linear = run.likelihood.add(block, columns, (float(window.time[0]), time), late)
        self._samples += len(window)
        solution = self._solution(run, linear)
        instant = Instant(time, origin + round(time * 1e9), self._samples)
        return solution, instant, self._disturbances(run)

    def _disturbances(self, run: _Run) -> _Disturbances:
        """Return what has disturbed a run by now."""
        events = (*_forces(run), *(_step(jump, run) for jump in run.likelihood.jumps))
        warnings = [str(event) for event in events[-_MOST_TOLD:]]
        too_many = run.likelihood.too_many
        if too_many:
            events = tuple(replace(event, cause=_ANYTHING) for event in events)
            warnings.append(f'the momentum seems to change all the time: {_ANYTHING}')
        delay = _delay(run)
        if delay[1] > 0.0:
            warnings.append(f'JointState is stamped {1e3 * delay[0]:.1f} ms late relative to Odometry; estimated along')
        if run.blame[0] > 0.5:
            worst = int(np.argmax(run.blame[1:]))
            link = next(x.name for x in self._kernel.model.links if x.body == self._kernel.errors.bodies[worst])
            warnings.append(
                f'{100.0 * run.blame[0]:.0f} % of the variance is due to the known bodies being uncertain, '
                f'{100.0 * run.blame[1 + worst]:.0f} % to {link} alone'
            )
        return _Disturbances(events, tuple(warnings), delay, too_many=too_many)

    def _solution(self, run: _Run, linear: Linearisation) -> Solution:
        problem, likelihood = run.problem, run.likelihood.likelihood
        forces = [(found, found.kind) for found in run.likelihood.found if found.kind != 'delay']
        space, variance = problem.space, problem.open_variance
        own = np.concatenate((np.arange(space.basis.shape[1]), *(force.place for force, _ in forces)))  # without jumps
        if forces:
            space = replace(space, basis=np.asarray(block_diag(space.basis, *[space.rows.T] * len(forces))))
            more = np.full(6 * len(forces), 1.0 / np.min(problem.watched.prior['inertial']))
            variance = np.concatenate((variance, more))
        present = problem.present([axes for _, axes in forces])
        information, noise = linear.information, likelihood.noise_information
        plain = [inverse(information, information - share * noise) for share in (1.0, NOISE_MARGIN)]
        spreads = [run.likelihood.spread(matrix) for matrix in plain]
        run.blame = _blame(plain[0], spreads[0], problem.momentum.start, self._kernel.errors)
        covariance, cautious = (
            present @ space.lift((matrix + spread @ spread.T)[np.ix_(own, own)], variance) @ present.T
            for matrix, spread in zip(plain, spreads, strict=True)
        )
        redundancy = linear.equations - len(likelihood.x)
        return Solution(
            x=present @ (space.basis @ likelihood.x[own]),
            covariance=covariance,
            cautious_covariance=cautious,
            # The uncertain bodies leave residuals that the noise does not explain.
            cost=linear.cost * max(redundancy, 1) / (max(redundancy, 1) + run.likelihood.surplus),
            redundancy=redundancy,
            origin=run.origin,
            plane=space.plane,
            restarted=run.restarted,
        )

    def _running(self, start: Array, time: float) -> _Run:
        """Return the run; a new one where the motion has turned out spatial: its past had half the equations."""
        if self._run is not None and self._run.problem.space.planar == self._plane.planar:
            return self._run
        settings = self._settings
        problem = Problem(self._kernel, settings.beside, self._plane, start)
        forgetting = 1.0
        if settings.forgetting_time > 0.0:
            forgetting = float(np.exp(-settings.window / settings.forgetting_time))
        # Errors of known bodies settle slowly, and windows are folded at the solution of their time.
        kept = settings.kept_windows * (_LATER if problem.estimated else 1)
        rolling = RollingLikelihood(problem.prior, kept, forgetting, problem.typical, problem.effects)
        likelihood = SteppedLikelihood(
            rolling, problem.momentum, problem.open_prior, problem.uncertain, problem.watched
        )
        return _Run(start, problem, likelihood, time, restarted=self._run is not None)


def _judged(estimate: Estimate, disturbed: _Disturbances) -> Estimate:
    """Return the estimate with what has disturbed its run."""
    return replace(
        estimate,
        status='inconsistent' if disturbed.too_many and estimate.status != 'not_identifiable' else estimate.status,
        events=disturbed.events,
        warnings=(*estimate.warnings, *disturbed.warnings),
        time_offset=disturbed.delay[0],
        time_offset_std=disturbed.delay[1],
    )


def _blame(covariance: Array, spread: Array, body: int, errors: KnownErrors) -> Array:
    """Return the share of the known bodies in the variance of the identified one, (1 + b,): of all, and of each.

    A mean over its parameters.

    Parameters
    ----------
    covariance : (u, u) without them
    spread : (u, e) standard deviations due to each of the independent errors
    body : number of the identified one's parameters, which come first
    errors : of the known bodies
    """
    if not spread.shape[1]:
        return np.zeros(1)
    parts = np.column_stack((np.sum(spread[:body] ** 2, axis=1), errors.shares(spread[:body])))
    return np.asarray(np.mean(parts / (np.diag(covariance)[:body] + parts[:, 0])[:, None], axis=0))


def _step(jump: Jump, run: _Run) -> Event:
    """Return a jump of the momentum as it is reported, about the odometry's origin."""
    change = run.problem.space.rows.T @ jump.value
    linear = change[:3]
    return Event(jump.start, 'step', linear, change[3:] + cross(run.origin, linear), _cause(jump))


def _cause(jump: Jump) -> str:
    """Return what may have made a jump of the momentum."""
    if not _tells(jump.value, jump.covariance, _NOTHING):
        return 'the momentum came back: a fault of the sensors, or two pulses that cancel'
    if jump.end - jump.start > _LONG:
        return f'a force or torque for {jump.end - jump.start:.1f} s: thrust or contact'
    return PULSE


def _forces(run: _Run) -> tuple[Event, ...]:
    """Return the constant forces that act on the origin of the base link, if there are any."""
    found = [(item.place, item.kind) for item in run.likelihood.found if item.kind != 'delay']
    acting = found if run.problem.acting is None else [run.problem.acting]
    if not run.likelihood.ready:
        return ()
    return tuple(
        _force(axes, value, run)
        for value, covariance, axes in ((*run.likelihood.part(place), axes) for place, axes in acting)
        if len(found) == 1 or _tells(value, covariance, _CERTAIN)
    )


def _force(axes: Axes, value: Array, run: _Run) -> Event:
    """Return a constant force and torque as it is reported."""
    wrench = run.problem.space.rows.T @ value
    cause = f'{constant_force(axes)}; estimated along, which widens the intervals'
    return Event(run.started, 'ramp', wrench[:3], wrench[3:], cause)


def _delay(run: _Run) -> tuple[float, float]:
    """Return how late the joints are stamped and its standard deviation, s; NaN where that was not found."""
    for found in run.likelihood.found:
        if found.kind == 'delay':
            value, covariance = run.likelihood.part(found.place)
            return float(value[0]), float(np.sqrt(covariance[0, 0]))
    return np.nan, np.nan


def _tells(value: Array, covariance: Array, chance: float) -> bool:
    """Return whether an estimate would be so far from zero by chance less often than that."""
    return bool(float(value @ np.linalg.solve(covariance, value)) > chi_square.limit(chance, len(value)))
