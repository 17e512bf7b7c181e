"""The weighted difference form: standard parameters and the unknown total momentum together, at the statistical limit.

Differencing removes an unknown constant; the best reference to difference against is the noise-weighted mean, which is
the same as estimating the constant with the parameters. Every window adds six equations (window_rows), weighted with
their noise and corrected for the noise in their coefficients (errors_in_variables), to one likelihood whose maximum is
followed at bounded cost (sliding_window). The momentum is assumed constant, and tested (conservation).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.difference.conservation import Conservation, noise_covariance
from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.sliding_window import SlidingWindow
from mbaid_ros.core.difference.window_rows import BODY, LINEAR, ConsiderParameters, Subspace, subspace, window_rows
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.linear_algebra import inverse
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.reporting import Reporting, Solution
from mbaid_ros.core.results.status import Reason
from mbaid_ros.core.robot.kernel import MomentumKernel, unknown_scale
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import momentum_change
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.tasks import Method
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


class DifferenceRun:
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

    def add(self, block: Blocks, columns: Array, start: float) -> Solution:
        """Add a window that starts at a time (s): equations and columns (1, r, e) in the unknowns of the subspace."""
        window = self._window
        linear = window.add(block, columns)
        covariance = noise_covariance(window.linear.information)
        surplus = window.cross_information.surplus(covariance) if self._considered.count else 0.0
        self._conservation.update(window, start, covariance, surplus)
        redundancy = linear.equations - len(window.x)
        information, cross_information = linear.information, window.cross_information.cross
        covariances, share = [], 0.0
        for margin in (1.0, _NOISE_MARGIN):
            plain = inverse(information, information - margin * window.noise_information)
            by_considered = (plain @ cross_information) @ (plain @ cross_information).T
            total = plain + by_considered  # method.md, eq. 8
            if margin == 1.0:
                body = slice(0, self._momentum.start)
                share = float(np.mean(np.diag(by_considered)[body] / np.diag(total)[body]))
            covariances.append(self.space.lift(total, self._open_variance))
        return Solution(
            x=self.space.basis @ window.x,
            covariance=covariances[0],
            cautious_covariance=covariances[1],
            # Uncertain parameters leave residuals that the noise does not explain.
            cost=linear.cost * max(redundancy, 1) / (max(redundancy, 1) + surplus),
            redundancy=redundancy,
            origin=self.origin,
            plane=self.space.plane,
            reasons=tuple(self._reasons(share)),
        )

    @property
    def events(self) -> tuple[Event, ...]:
        """The first jump of the momentum, about the odometry's origin; none where there was none."""
        jump = self._conservation.jump
        if jump is None:
            return ()
        change = self.space.rows.T @ jump.value
        return (Event(jump.time, 'step', change[:3], change[3:] + cross(self.origin, change[:3]), _CAUSE),)

    def _reasons(self, share: float) -> Iterator[Reason]:
        """Yield the reasons to distrust the run: a jump of the momentum, excess innovations, a dominant model error.

        `share` is that of the consider parameters in the variance of the body.
        """
        if self._restarted:
            yield Reason('the motion is not planar: the planar solution was dropped')
        test = self._conservation
        for event in self.events:
            yield Reason(f'the momentum is not constant: {event}', 'contradiction')
        if test.excessive:
            yield Reason(
                f'windows are {test.mean:.1f} times as far from their predictions as the noise parameters explain '
                '(mean normalised innovation squared)',
                'contradiction',
            )
        if share > _WORTH_TELLING:
            yield Reason(f'{100.0 * share:.0f} % of the variance is due to the uncertainty of the robot model')


class DifferenceEstimator(Method):
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
        self._nominal = NominalModel.nominal(kernel) if prior is None else prior.nominal_model(kernel, unknowns)
        self._kernel = self._nominal.kernel
        self._settings = settings
        self._reporting = reporting
        self._considered = ConsiderParameters(self._kernel, unknowns, prior)
        self._plane = PlaneDetector(kernel.model)
        self._run: DifferenceRun | None = None
        self._samples = 0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Add closed windows and return one estimate a window; `origin` is the stamp at time 0, ns."""
        windows = [self._nominal.corrected(window) for window in windows]
        start = windows[0].base_position[0].copy() if self._run is None else self._run.origin
        rows = window_rows(self._kernel, windows, self._settings.noise, start)
        estimates = []
        for k, window in enumerate(windows):
            self._plane.update(window)
            run = self._run = self._current_run(start)
            columns = self._considered.columns([window], run.body)
            block = run.space.restricted(rows[k : k + 1])
            solution = run.add(block, run.space.rows @ columns, float(window.time[0]))
            self._samples += len(window)
            time = float(window.time[-1])
            stamp = origin + round(time * 1e9)
            now = Estimate(self.method, 'waiting', time, stamp, samples=self._samples, events=run.events)
            impulse = momentum_change(window, self._kernel.body_parameters(solution.x[BODY]))
            estimates.append(self._reporting.estimate(solution, now).after_thrust(impulse))
        return estimates

    def _current_run(self, start: Array) -> DifferenceRun:
        """Return the run; a new one where the motion has turned out spatial: its past had half the equations."""
        if self._run is not None and self._run.space.planar == self._plane.planar:
            return self._run
        space, scale = subspace(self._plane, self._kernel), unknown_scale(self._kernel)
        restarted = self._run is not None
        return DifferenceRun(space, start, scale, self._settings, self._considered, restarted=restarted)
