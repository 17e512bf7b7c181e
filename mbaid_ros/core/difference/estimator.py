"""The weighted difference form: standard parameters and the unknown total momentum together, at the statistical limit.

Differencing removes an unknown constant; the best reference to difference against is the noise-weighted mean, which is
the same as estimating the constant with the parameters. Every window adds six equations (window_rows), weighted with
the noise they carry and corrected for the noise in their coefficients (errors_in_variables), to one likelihood whose
maximum is followed at bounded cost (rolling) and watched for disturbances (steps, monitor).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.difference.delay import delay_columns, with_joints_later
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation
from mbaid_ros.core.difference.problem import Beside, Problem, Surroundings, observed
from mbaid_ros.core.difference.rolling import RollingLikelihood
from mbaid_ros.core.difference.run import Disturbances, Run, delay, disturbances
from mbaid_ros.core.difference.steps import SteppedLikelihood
from mbaid_ros.core.difference.window_rows import Counts, joined, joined_rows
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.reporting import NOISE_MARGIN, Instant, Reporting, Solution, inverse
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.known_errors import KnownErrors
from mbaid_ros.core.robot.planar import PlaneDetector
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
            solution = self._solution(run, linear, around.gains[k - begun])
            instant = Instant(time, origin + round(time * 1e9), self._samples)
            found.append((solution, instant, disturbances(run, self._kernel)))
        solutions, instants, disturbed = zip(*found, strict=True)
        estimates = self._reporting.estimates(self.method, solutions, instants)
        return [
            _judged(estimate.after_thrust(window.impulse[-1]), by)
            for window, estimate, by in zip(windows, estimates, disturbed, strict=True)
        ]

    def _equations(self, samples: Samples, counts: Counts, start: Array) -> tuple[Blocks, Array]:
        """Return the equations of K windows, and (K, 6, 11) how they change with a delay of the joints' stamps."""
        rows = joined_rows(self._observed, samples, counts, self._settings.noise, start)
        if self._settings.beside.delay_std > 0.0:
            return rows, delay_columns(self._kernel, samples, counts)
        return rows, np.zeros((len(counts), 6, 11))

    def _equations_later(self, window: Samples, around: Surroundings, run: Run, late: float) -> tuple[Blocks, Array]:
        """Return a window's equations in the run's unknowns, and its effects, with joints that were stamped late, s."""
        samples, counts = joined([window])
        rows, delays = self._equations(with_joints_later(samples, counts, late), counts, run.origin)
        return run.problem.of(around, rows, delays)

    def _solution(self, run: Run, linear: Linearisation, gains: Array) -> Solution:
        """Return the solution after a window, at whose end forces have changed the momentum by (f, 6, 6) gains."""
        problem, likelihood = run.problem, run.likelihood.likelihood
        forces = [(found, found.kind) for found in run.likelihood.found if found.kind != 'delay']
        space, variance = problem.space, problem.open_variance
        own = np.concatenate((np.arange(space.basis.shape[1]), *(force.place for force, _ in forces)))  # without jumps
        if forces:
            space = replace(space, basis=np.asarray(block_diag(space.basis, *[space.rows.T] * len(forces))))
            more = np.full(6 * len(forces), 1.0 / np.min(problem.watched.prior['inertial']))
            variance = np.concatenate((variance, more))
        present = problem.present([axes for _, axes in forces], gains)
        information, noise = linear.information, likelihood.noise_information
        plain = [inverse(information, information - share * noise) for share in (1.0, NOISE_MARGIN)]
        spreads = [run.likelihood.spread(matrix) for matrix in plain]
        run.blame = _blame(plain[0], spreads[0], problem.momentum.start, self._kernel.errors)
        covariance, cautious = (
            present @ space.lift((matrix + spread @ spread.T)[own[:, None], own], variance) @ present.T
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


def _judged(estimate: Estimate, disturbed: Disturbances) -> Estimate:
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
