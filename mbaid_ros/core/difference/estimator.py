"""The weighted difference form: standard parameters and the unknown total momentum together, at the statistical limit.

Differencing removes an unknown constant; the best reference to difference against is the noise-weighted mean, which is
the same as estimating the constant with the parameters. Every window adds six equations (window_rows), weighted with
their noise and corrected for the noise in their coefficients (errors_in_variables), to one likelihood whose maximum is
followed at bounded cost (sliding_window). The momentum is assumed constant, and tested (conservation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from mbaid_ros.core.difference.conservation import Conservation, noise_covariance
from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.sliding_window import SlidingWindow
from mbaid_ros.core.difference.window_rows import BODY, LINEAR, ConsiderParameters, Subspace, subspace, window_rows
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.linear_algebra import inverses
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.reporting import Reporting, Solution
from mbaid_ros.core.results.status import contradictions, notes, with_reasons
from mbaid_ros.core.robot.kernel import MomentumKernel, unknown_scale
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.orbit import brought
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.unknowns.declaration import NominalModel, Unknown
from mbaid_ros.core.unknowns.priors import UnknownsPrior

# Standard deviation of the start in typical sizes: far too much to be a prior, and enough to keep every step finite.
NO_PRIOR = 100.0
# Share of the variance due to consider parameters: from here on the model decides, not the sensors.
_WORTH_TELLING = 0.5
_CAUSE = 'thrust, contact, a slip of the grasp, or a force that lasts'


# The noise's own information fluctuates: anything below twice it is not signal.
_NOISE_MARGIN = 2.0


@dataclass(frozen=True)
class DifferenceSettings:
    """Settings of the weighted difference form."""

    noise: SensorNoise  # of the joint sensors (the samples hold that of the base)
    kept_windows: int  # length of the sliding window; older windows are marginalised
    linear_momentum_std: float  # N s, of the total linear momentum about zero; 0 is no prior


@dataclass(frozen=True)
class _Posterior:
    """The state of a run after a window."""

    run: Run  # Run
    x: Array  # (u,) the solution
    # information, noise: (u, u) of the unknowns, and the part of it by noise alone
    information: Array
    noise: Array
    cross: Array  # (u, e) cross-information with the consider parameters
    # cost, surplus: sum of the squared normalised residuals, and the expected part of the consider parameters
    cost: float
    surplus: float
    redundancy: int  # number of equations less that of unknowns
    event: Event | None  # of the run
    contradictions: tuple[str, ...]  # of the run


class Run:
    """The likelihood of the unknowns x = (m, h, I_o, P_0, L_0), as far as the motion excites them, and its tests.

    Parameters
    ----------
    space : which equations hold, in which unknowns
    origin : (3,) m, about which L_0 is taken
    scale : (16,) typical sizes of x
    considered : the consider parameters
    restarted : whether earlier windows had to be given up
    """

    def __init__(
        self,
        space: Subspace,
        origin: Array,
        scale: Array,
        settings: DifferenceSettings,
        considered: ConsiderParameters,
        *,
        restarted: bool,
    ) -> None:
        self.space = space
        self.origin = origin
        self._considered = considered
        self._restarted = restarted
        deviation = NO_PRIOR * scale
        self._open_variance = deviation**2  # (16,) of x without information
        if settings.linear_momentum_std > 0.0:
            deviation[LINEAR] = settings.linear_momentum_std
        basis = space.basis
        prior = np.asarray((basis.T * (1.0 / deviation**2)) @ basis)
        self._momentum = slice(len(prior) - len(space.rows), len(prior))
        self._window = SlidingWindow(prior, settings.kept_windows, np.abs(basis.T) @ scale, considered.count)
        self._conservation = Conservation(self._momentum)

    @property
    def body(self) -> Array:
        """The target body (10,) at which consider parameters are linearised: zeros while it is uncertain."""
        body = (self.space.basis @ self._window.x)[:10]
        return body if body[0] > 0.0 and self._window.certain else np.zeros(10)

    def add(self, block: Blocks, columns: Array, start: float) -> _Posterior:
        """Add a window that starts at a time (s): equations and columns (1, r, e) in the unknowns of the subspace."""
        window = self._window
        linear = window.add(block, columns)
        covariance = noise_covariance(window.linear.information)
        surplus = window.cross_information.surplus(covariance) if self._considered.count else 0.0
        self._conservation.update(window, start, covariance, surplus)
        return _Posterior(
            run=self,
            x=window.x,
            information=linear.information,
            noise=window.noise_information,
            cross=window.cross_information.cross,
            cost=linear.cost,
            surplus=surplus,
            redundancy=linear.equations - len(window.x),
            event=self._event(),
            contradictions=self._contradictions(),
        )

    def _event(self) -> Event | None:
        """Return the first jump of the momentum, about the odometry's origin; None where there was none."""
        jump = self._conservation.jump
        if jump is None:
            return None
        change = self.space.rows.T @ jump.value
        return Event(jump.time, 'step', change[:3], change[3:] + cross(self.origin, change[:3]), _CAUSE)

    def _contradictions(self) -> tuple[str, ...]:
        """Return why the momentum of this run is not constant, or its noise not as declared."""
        event, test = self._event(), self._conservation
        found = [f'the momentum is not constant: {event}'] if event else []
        if test.excessive:
            found.append(
                f'windows are {test.mean:.1f} times as far from their predictions as the noise parameters explain '
                '(mean normalised innovation squared)'
            )
        return tuple(found)

    def solutions(self, posteriors: Sequence[_Posterior]) -> list[tuple[Solution, Array]]:
        """Return the solution after each window, and the shares (1 + p,) of the consider parameters in its variance.

        All windows together take few array operations instead of many each.
        """
        information, noise, cross_information = (
            np.array([getattr(one, name) for one in posteriors]) for name in ('information', 'noise', 'cross')
        )
        covariances = []
        shares: list[Array] = [np.zeros(1)] * len(posteriors)
        for margin in (1.0, _NOISE_MARGIN):
            plain = inverses(information, information - margin * noise)
            spread = plain @ cross_information
            if margin == 1.0 and cross_information.shape[2]:
                shares = [self._shares(*pair) for pair in zip(plain, spread, strict=True)]
            total = plain + spread @ np.swapaxes(spread, 1, 2)  # method.md, eq. 8
            covariances.append(self.space.lift(total, self._open_variance))
        return [
            (
                Solution(
                    x=self.space.basis @ one.x,
                    covariance=covariances[0][k],
                    cautious_covariance=covariances[1][k],
                    # Uncertain parameters leave residuals that the noise does not explain.
                    cost=one.cost * max(one.redundancy, 1) / (max(one.redundancy, 1) + one.surplus),
                    redundancy=one.redundancy,
                    origin=self.origin,
                    plane=self.space.plane,
                    restarted=self._restarted,
                ),
                shares[k],
            )
            for k, one in enumerate(posteriors)
        ]

    def _shares(self, covariance: Array, spread: Array) -> Array:
        """Return the consider parameters' share in the variance of the body, (1 + p,): of all, and of each part.

        `covariance` (u, u) is that without them, `spread` (u, e) the effect of each of them.
        """
        body = self._momentum.start
        parts = np.column_stack((np.sum(spread[:body] ** 2, axis=1), self._considered.shares(spread[:body])))
        return np.asarray(np.mean(parts / (np.diag(covariance)[:body] + parts[:, 0])[:, None], axis=0))


class DifferenceEstimator:
    """Identifies one link and the total momentum, which may have any constant value.

    Parameters
    ----------
    unknowns : consider parameters, which widen the covariance
    prior : joint prior of the unknowns, whose mean the robot is taken at; None for independent ones about zero
    """

    method = 'difference'
    needs_rates = True

    def __init__(
        self,
        kernel: MomentumKernel,
        settings: DifferenceSettings,
        reporting: Reporting,
        unknowns: Sequence[Unknown],
        prior: UnknownsPrior | None,
    ) -> None:
        self._nominal = NominalModel.nominal(kernel) if prior is None else prior.expected(kernel, unknowns)
        self._kernel = self._nominal.kernel
        self._settings = settings
        self._reporting = reporting
        self._considered = ConsiderParameters(self._kernel, unknowns, prior)
        self._plane = PlaneDetector(kernel.model)
        self._run: Run | None = None
        self._samples = 0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Add closed windows and return one estimate a window; `origin` is the stamp at time 0, ns."""
        windows = [self._nominal.corrected(window) for window in windows]
        start = windows[0].base_position[0].copy() if self._run is None else self._run.origin
        rows = window_rows(self._kernel, windows, self._settings.noise, start)
        posteriors, began = [], []
        for k, window in enumerate(windows):
            self._plane.update(window)
            run = self._run = self._current_run(start)
            columns = self._considered.columns([window], run.body)
            block = run.space.of(rows[k : k + 1])
            posteriors.append(run.add(block, run.space.rows @ columns, float(window.time[0])))
            self._samples += len(window)
            time = float(window.time[-1])
            stamp = origin + round(time * 1e9)
            began.append(Estimate(self.method, 'waiting', time, stamp, samples=self._samples))
        solved = [
            pair for run, group in groupby(posteriors, lambda one: one.run) for pair in run.solutions(list(group))
        ]
        estimates = self._reporting.estimates([solution for solution, _ in solved], began)
        return [
            self._with_run(estimate, posterior, shares).after_thrust(
                brought(window, self._kernel.with_target(solution.x[BODY]))
            )
            for window, (solution, shares), estimate, posterior in zip(
                windows, solved, estimates, posteriors, strict=True
            )
        ]

    def _current_run(self, start: Array) -> Run:
        """Return the run; a new one where the motion has turned out spatial: its past had half the equations."""
        if self._run is not None and self._run.space.planar == self._plane.planar:
            return self._run
        space, scale = subspace(self._plane, self._kernel), unknown_scale(self._kernel)
        restarted = self._run is not None
        return Run(space, start, scale, self._settings, self._considered, restarted=restarted)

    def _with_run(self, estimate: Estimate, posterior: _Posterior, shares: Array) -> Estimate:
        """Return the estimate with the contradictions and the event of its run, and a warning about the shares."""
        estimate = with_reasons(estimate, contradictions(posterior.contradictions))
        events = () if posterior.event is None else (posterior.event,)
        if shares[0] <= _WORTH_TELLING:
            return replace(estimate, events=events)
        worst = int(np.argmax(shares[1:]))
        warning = (
            f'{100.0 * shares[0]:.0f} % of the variance is due to the uncertainty of the robot model, '
            f'{100.0 * shares[1 + worst]:.0f} % to {self._considered.labels[worst]} alone'
        )
        return replace(with_reasons(estimate, notes([warning])), events=events)
