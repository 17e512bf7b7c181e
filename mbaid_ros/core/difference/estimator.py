"""The weighted difference form: standard parameters and the unknown total momentum together, at the statistical limit.

Differencing removes an unknown constant; the best reference to difference against is the noise-weighted mean, which is
the same as estimating the constant with the parameters. Every window adds six equations (window_rows), weighted with
the noise they carry and corrected for the noise in their coefficients (errors_in_variables), to one likelihood whose
maximum is followed at bounded cost (rolling) and watched for disturbances (steps, monitor).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.difference.delay import Moved, with_joints_later
from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.problem import Beside, Problem, Surroundings, observed
from mbaid_ros.core.difference.rolling import RollingLikelihood
from mbaid_ros.core.difference.run import Disturbances, Run, blamed, delay, disturbances
from mbaid_ros.core.difference.solutions import Knowledge, solutions
from mbaid_ros.core.difference.steps import SteppedLikelihood
from mbaid_ros.core.difference.window_rows import Counts, joined, joined_rows
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.reporting import Instant, Reporting
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.robot.rows import momentum_rows
from mbaid_ros.core.samples import Samples, SensorNoise

_LATER = 3  # times as many windows are kept before they are folded


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
        self._run: Run | None = None
        self._samples = 0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows and return one estimate a window.

        Parameters
        ----------
        windows : list of Samples
        origin : ns, stamp at time 0
        """
        start = windows[0].base_position[0].copy() if self._run is None else self._run.origin
        samples, counts = joined(windows)
        rows, delays = self._equations(samples, counts, start)
        # What may act is added up from window to window, for all at once: anew where a run has begun anew.
        run, begun, found = None, 0, []
        for k, window in enumerate(windows):
            self._plane.update(window)
            self._run = self._running(start, float(window.time[0]))
            if self._run is not run:
                run, begun = self._run, k
                around = run.problem.surroundings(*(joined(windows[k:]) if k else (samples, counts)))
                equations = run.problem.of(around, rows[k:], delays[k:])
            place = slice(k - begun, k - begun + 1)
            late = delay(run)[0]
            if np.isnan(late):
                late, own = 0.0, (equations[0][place], equations[1][place])
            else:
                own = self._equations_later(window, around[place], run, late)
            time = float(window.time[-1])
            linear = run.likelihood.add(*own, (float(window.time[0]), time), late)
            self._samples += len(window)
            instant = Instant(time, origin + round(time * 1e9), self._samples)
            found.append((Knowledge.of(run, linear, around.gains[k - begun]), instant, disturbances(run)))
        known, instants, disturbed = zip(*found, strict=True)
        solved, blames = solutions(known, self._kernel.errors)
        estimates = self._reporting.estimates(self.method, solved, instants)
        return [
            _judged(estimate.after_thrust(window.impulse[-1]), by, blamed(blame, self._kernel))
            for window, estimate, by, blame in zip(windows, estimates, disturbed, blames, strict=True)
        ]

    def _equations(self, samples: Samples, counts: Counts, start: Array) -> tuple[Blocks, Array]:
        """Return the equations of K windows, and (K, 6, 11) how they change with a delay of the joints' stamps."""
        kernel, count, noise = self._observed, len(samples), self._settings.noise
        if self._settings.beside.delay_std == 0.0:
            rows = momentum_rows(kernel, samples)
            return joined_rows(kernel, samples, counts, rows, noise, start), np.zeros((len(counts), 6, 11))
        moved = Moved.of(samples, counts)
        rows = momentum_rows(kernel, Samples.concatenate([samples, moved.later]))
        equations = joined_rows(kernel, samples, counts, rows.first(count), noise, start)
        return equations, moved.columns(rows)

    def _equations_later(self, window: Samples, around: Surroundings, run: Run, late: float) -> tuple[Blocks, Array]:
        """Return a window's equations in the run's unknowns, and its effects, with joints that were stamped late, s."""
        samples, counts = joined([window])
        rows, delays = self._equations(with_joints_later(samples, counts, late), counts, run.origin)
        return run.problem.of(around, rows, delays)

    def _running(self, start: Array, time: float) -> Run:
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
        return Run(start, problem, likelihood, time, restarted=self._run is not None)


def _judged(estimate: Estimate, disturbed: Disturbances, warnings: tuple[str, ...]) -> Estimate:
    """Return the estimate with what has disturbed its run, and further warnings."""
    return replace(
        estimate,
        status='inconsistent' if disturbed.too_many and estimate.status != 'not_identifiable' else estimate.status,
        events=disturbed.events,
        warnings=(*estimate.warnings, *disturbed.warnings, *warnings),
        time_offset=disturbed.delay[0],
        time_offset_std=disturbed.delay[1],
    )
