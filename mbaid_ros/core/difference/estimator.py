"""The weighted difference form: standard parameters and the unknown total momentum together, at the statistical limit.

Differencing removes an unknown constant; the best reference to difference against is the noise-weighted mean, which is
the same as estimating the constant with the parameters. Every window adds six equations (window_rows), weighted with
the noise they carry and corrected for the noise in their coefficients (errors_in_variables), to one likelihood whose
maximum is followed at bounded cost (rolling).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.rolling import RollingLikelihood
from mbaid_ros.core.difference.subspace import Subspace, subspace
from mbaid_ros.core.difference.window_rows import LINEAR, window_rows
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.reporting import NOISE_MARGIN, Reporting, Solution, inverse
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.robot.scale import unknown_scale
from mbaid_ros.core.samples import Samples, SensorNoise

# Standard deviation of the start in typical sizes: far too much to be a prior, and enough to keep every step finite.
_NO_PRIOR = 100.0


@dataclass(frozen=True)
class DifferenceSettings:
    """Settings of the weighted difference form.

    Attributes
    ----------
    noise : of the joint sensors (the base's stands in the samples)
    linear_momentum_std : N s, of the total linear momentum about zero; 0 is no prior
    kept_windows : windows solved again at each update; older ones are folded
    forgetting_time : s, time constant of forgetting; 0 never forgets
    window : s
    """

    noise: SensorNoise
    linear_momentum_std: float
    kept_windows: int
    forgetting_time: float
    window: float


@dataclass
class _Run:
    """What a run has led to: where it started, what its motion can tell, and the likelihood of that."""

    origin: Array
    space: Subspace
    likelihood: RollingLikelihood
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
        self._prior = self._prior_information()
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

    def _window(self, window: Samples, block: Blocks, start: Array, origin: int) -> Estimate:
        self._plane.update(window)
        run = self._run = self._running(start)
        linear = run.likelihood.add(run.space.of(block))
        covariance, cautious = (
            run.space.lift(
                inverse(linear.information, linear.information - share * run.likelihood.noise_information),
                1.0 / self._prior,
            )
            for share in (1.0, NOISE_MARGIN)
        )
        self._samples += len(window)
        solution = Solution(
            x=run.space.basis @ run.likelihood.x,
            covariance=covariance,
            cautious_covariance=cautious,
            cost=linear.cost,
            redundancy=linear.equations - len(run.likelihood.x),
            origin=run.origin,
            plane=run.space.plane,
            restarted=run.restarted,
        )
        time = float(window.time[-1])
        stamp = origin + round(time * 1e9)
        return self._reporting.estimate(self.method, solution, time=time, stamp=stamp, samples=self._samples)

    def _running(self, start: Array) -> _Run:
        """Return the run; a new one where the motion has turned out spatial: its past had half the equations."""
        if self._run is not None and self._run.space.planar == self._plane.planar:
            return self._run
        space = subspace(self._plane, self._kernel)
        forgetting = 1.0
        if self._settings.forgetting_time > 0.0:
            forgetting = float(np.exp(-self._settings.window / self._settings.forgetting_time))
        prior = (space.basis.T * self._prior) @ space.basis
        typical = np.abs(space.basis.T) @ unknown_scale(self._kernel)
        likelihood = RollingLikelihood(prior, self._settings.kept_windows, forgetting, typical)
        return _Run(start, space, likelihood, restarted=self._run is not None)

    def _prior_information(self) -> Array:
        """Return the (16,) information of each unknown about zero."""
        information = 1.0 / (_NO_PRIOR * unknown_scale(self._kernel)) ** 2
        if self._settings.linear_momentum_std > 0.0:
            information[LINEAR] = 1.0 / self._settings.linear_momentum_std**2
        return np.asarray(information)
