"""The weighted difference form: standard parameters and the unknown total momentum together, at the statistical limit.

Differencing removes an unknown constant; the best reference to difference against is the noise-weighted mean, which is
the same as estimating the constant with the parameters. Every window adds six equations (window_rows), weighted with
the noise they carry and corrected for the noise in their coefficients (errors_in_variables), to one likelihood whose
maximum is followed at bounded cost (rolling) and watched for disturbances (steps, monitor).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation
from mbaid_ros.core.difference.problem import Beside, Problem
from mbaid_ros.core.difference.rolling import RollingLikelihood
from mbaid_ros.core.difference.steps import Jump, SteppedLikelihood
from mbaid_ros.core.difference.window_rows import window_rows
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.reporting import NOISE_MARGIN, Reporting, Solution, inverse
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.samples import Samples, SensorNoise

_MOST_TOLD = 5  # jumps in the warnings


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
    restarted: bool = False


class DifferenceEstimator:
    """Identifies one link and the total momentum, whatever the momentum is."""

    method = 'difference'
    needs_rates = True

    def __init__(self, kernel: MomentumKernel, settings: DifferenceSettings, reporting: Reporting) -> None:
        self._kernel = kernel
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
        rows = window_rows(self._kernel, windows, self._settings.noise, start)
        return [self._window(window, rows[k : k + 1], start, origin) for k, window in enumerate(windows)]

    def _window(self, window: Samples, rows: Blocks, start: Array, origin: int) -> Estimate:
        self._plane.update(window)
        run = self._run = self._running(start)
        time = float(window.time[-1])
        block, columns = run.problem.of(window, rows)
        linear = run.likelihood.add(block, columns, (float(window.time[0]), time))
        self._samples += len(window)
        solution = self._solution(run, linear)
        stamp = origin + round(time * 1e9)
        estimate = self._reporting.estimate(self.method, solution, time=time, stamp=stamp, samples=self._samples)
        return self._judged(estimate, run)

    def _judged(self, estimate: Estimate, run: _Run) -> Estimate:
        """Return the estimate with what has disturbed its run."""
        events = tuple(_event(jump, run) for jump in run.likelihood.jumps)
        warnings = [*estimate.warnings, *map(str, events[-_MOST_TOLD:])]
        if run.likelihood.too_many:
            warnings.append('the momentum keeps changing: something acts all the time, or the model is wrong')
        return replace(estimate, events=events, warnings=tuple(warnings))

    def _solution(self, run: _Run, linear: Linearisation) -> Solution:
        space, likelihood = run.problem.space, run.likelihood.likelihood
        own = slice(0, space.basis.shape[1])  # without jumps
        covariance, cautious = (
            space.lift(
                inverse(linear.information, linear.information - share * likelihood.noise_information)[own, own],
                run.problem.open_variance,
            )
            for share in (1.0, NOISE_MARGIN)
        )
        x = space.basis @ likelihood.x[own]
        if len(x) > 16:
            now = np.zeros((16, len(x)))
            now[:10, :10], now[10:, 10:] = np.eye(10), run.problem.gain()
            x, covariance, cautious = now @ x, now @ covariance @ now.T, now @ cautious @ now.T
        return Solution(
            x=x,
            covariance=covariance,
            cautious_covariance=cautious,
            cost=linear.cost,
            redundancy=linear.equations - len(likelihood.x),
            origin=run.origin,
            plane=space.plane,
            restarted=run.restarted,
        )

    def _running(self, start: Array) -> _Run:
        """Return the run; a new one where the motion has turned out spatial: its past had half the equations."""
        if self._run is not None and self._run.problem.space.planar == self._plane.planar:
            return self._run
        settings = self._settings
        problem = Problem(self._kernel, settings.beside, self._plane, start)
        forgetting = 1.0
        if settings.forgetting_time > 0.0:
            forgetting = float(np.exp(-settings.window / settings.forgetting_time))
        rolling = RollingLikelihood(
            problem.prior, settings.kept_windows, forgetting, problem.typical, effects=problem.effects
        )
        likelihood = SteppedLikelihood(rolling, problem.momentum, problem.open_prior, problem.uncertain)
        return _Run(start, problem, likelihood, restarted=self._run is not None)


def _event(jump: Jump, run: _Run) -> Event:
    """Return a jump of the momentum as it is reported, about the odometry's origin."""
    change = run.problem.space.rows.T @ jump.value
    linear = change[:3]
    return Event(jump.start, 'step', linear, change[3:] + cross(run.origin, linear), 'thrust pulse or contact')
