"""The weighted difference form: standard parameters and the unknown total momentum together, at the statistical limit.

Differencing removes an unknown constant; the best reference to difference against is the noise-weighted mean, which is
the same as estimating the constant with the parameters. Every window adds six equations (window_rows), weighted with
the noise they carry and corrected for the noise in their coefficients (errors_in_variables), to one likelihood whose
maximum is followed at bounded cost (sliding_window). The momentum is taken for constant, and tested (conservation).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.difference.conservation import TurningFrame, turning_frame
from mbaid_ros.core.difference.consider_parameters import ConsiderParameters
from mbaid_ros.core.difference.run import Run
from mbaid_ros.core.difference.solutions import WindowSolution, solutions
from mbaid_ros.core.difference.window_rows import BODY, subspace, window_rows
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.reporting import Instant, Reporting, Solution
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.orbit import brought
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.robot.scale import unknown_scale
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.unknowns.declaration import NominalModel, Unknown
from mbaid_ros.core.unknowns.priors import UnknownsPrior

# Windows of a run that is contradicted, from one look at what may be wrong to the next: it costs as much as they do.
_NOW_AND_THEN = 8
# Share of the variance due to consider parameters: from here on the model decides, not the sensors.
_WORTH_TELLING = 0.5


@dataclass(frozen=True)
class DifferenceSettings:
    """Settings of the weighted difference form.

    Attributes
    ----------
    noise : of the joint sensors (the base's stands in the samples)
    kept_windows : length of the sliding window; older windows are marginalised
    linear_momentum_std : N s, of the total linear momentum about zero; 0 is no prior
    """

    noise: SensorNoise
    kept_windows: int
    linear_momentum_std: float


class DifferenceEstimator:
    """Identifies one link and the total momentum, whatever the momentum is, as long as it is constant.

    Parameters
    ----------
    kernel : MomentumKernel
    settings : DifferenceSettings
    reporting : Reporting
    unknowns : what else is uncertain; it widens the covariance by what it does to them
    known : what is known of the unknowns together, whose mean the robot is taken at; None for their own variances about
        zero
    """

    method = 'difference'
    needs_rates = True

    def __init__(
        self,
        kernel: MomentumKernel,
        settings: DifferenceSettings,
        reporting: Reporting,
        unknowns: Sequence[Unknown],
        known: UnknownsPrior | None,
    ) -> None:
        self._side = NominalModel.nominal(kernel) if known is None else known.expected(kernel, unknowns)
        self._kernel = self._side.kernel
        self._settings = settings
        self._reporting = reporting
        self._considered = ConsiderParameters(self._kernel, unknowns, known)
        self._plane = PlaneDetector(kernel.model)
        self._run: Run | None = None
        self._samples = 0
        self._latest: deque[Samples] = deque(maxlen=settings.kept_windows)
        self._suspected: TurningFrame | None = None
        self._contradicted = 0  # windows

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows and return one estimate a window.

        Parameters
        ----------
        windows : list of Samples
        origin : ns, stamp at time 0
        """
        windows = [self._side.corrected(window) for window in windows]
        start = windows[0].base_position[0].copy() if self._run is None else self._run.origin
        rows = window_rows(self._kernel, windows, self._settings.noise, start)
        posteriors, instants, verdicts = [], [], []
        for k, window in enumerate(windows):
            self._plane.update(window)
            run = self._run = self._running(start)
            space = run.space
            columns = self._considered.columns([window], self._body(run))
            linear = run.add(space.of(rows[k : k + 1]), space.rows @ columns, float(window.time[0]))
            self._samples += len(window)
            time = float(window.time[-1])
            posteriors.append(WindowSolution.of(run, linear))
            instants.append(Instant(time, origin + round(time * 1e9), self._samples))
            self._latest.append(window)
            verdicts.append((run.event, run.contradictions, self._suspicion(run)))
        solved, shares = solutions(posteriors)
        estimates = self._reporting.estimates(self.method, solved, instants)
        return [
            _judged(estimate.after_thrust(self._brought(window, solution)), *verdict, self._told(share))
            for window, solution, estimate, verdict, share in zip(
                windows, solved, estimates, verdicts, shares, strict=True
            )
        ]

    def _suspicion(self, run: Run) -> tuple[tuple[str, float], ...]:
        """Return what may be wrong with a run that is contradicted: looked into now and then."""
        if not run.contradictions or run.window.marginalised + len(run.window.windows) < len(self._latest):
            return ()
        if self._latest[-1].tide.shape[1]:
            return ()  # the orbit is known
        if self._contradicted % _NOW_AND_THEN == 0:
            windows, space = run.window.windows, run.space
            at = space, run.origin, run.window.x
            latest = list(self._latest)[-len(windows) :]
            jump = np.inf if run.event is None else run.event.time
            found = turning_frame(windows.equations, latest, self._kernel, at, jump)
            # The longer such a run, the further off is its solution: what it was clearest by counts.
            if found is not None and (self._suspected is None or found.clarity > self._suspected.clarity):
                self._suspected = found
        self._contradicted += 1
        return () if self._suspected is None else ((self._suspected.cause, self._suspected.gain),)

    def _brought(self, window: Samples, solution: Solution) -> Array:
        """Return what thrust and orbit have changed the momentum by until the end of a window, (6,)."""
        return brought(window, self._kernel.with_target(solution.x[BODY]))

    def _running(self, start: Array) -> Run:
        """Return the run; a new one where the motion has turned out spatial: its past had half the equations."""
        if self._run is not None and self._run.space.planar == self._plane.planar:
            return self._run
        settings = self._settings
        return Run(
            subspace(self._plane, self._kernel),
            start,
            unknown_scale(self._kernel),
            settings.linear_momentum_std,
            self._considered,
            length=settings.kept_windows,
            restarted=self._run is not None,
        )

    @staticmethod
    def _body(run: Run) -> Array:
        """Return the target body (10,) that the effect of consider parameters is worked out with."""
        body = (run.space.basis @ run.window.x)[:10]
        return body if body[0] > 0.0 and run.window.certain else np.zeros(10)

    def _told(self, shares: Array) -> tuple[str, ...]:
        """Return the warning that the (1 + p,) shares of the unknowns in the variance are worth."""
        if shares[0] <= _WORTH_TELLING:
            return ()
        worst = int(np.argmax(shares[1:]))
        share, own, label = 100.0 * shares[0], 100.0 * shares[1 + worst], self._considered.labels[worst]
        return (
            f"{share:.0f} % of the variance is due to the robot's model being uncertain, {own:.0f} % to {label} alone",
        )


def _judged(
    estimate: Estimate,
    event: Event | None,
    contradictions: tuple[str, ...],
    causes: tuple[tuple[str, float], ...],
    warnings: tuple[str, ...],
) -> Estimate:
    """Return the estimate with what contradicts a constant momentum, and further warnings."""
    told = estimate.contradicted_by(contradictions)
    return replace(told, causes=causes, events=() if event is None else (event,), warnings=(*told.warnings, *warnings))
