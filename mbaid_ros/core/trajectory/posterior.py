"""The posterior at the end of a run: the start of the next one, and of plans for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.square_root import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import LINEAR, Layout, Point
from mbaid_ros.core.filter.time_update import Hypothesis, new_motion
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.window import WindowNoise, window_noises
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.sensors.rates import FEWEST, with_rates

FIRST = LINEAR.start  # after the pose error, which each motion draws anew


@dataclass(frozen=True, eq=False)
class End:
    """The last sample of a run, and the rate and noise of its sensors by then."""

    rate: float  # samples a second
    noise: WindowNoise  # of one sample; NaN twist where it is not measured
    time: float  # s since the run's first sample
    joint_position: Array  # (n,) as read
    joint_velocity: Array  # (n,) as read
    stored: Array  # (c,) readings of stored momentum
    # base_rotation, base_position: (3, 3), (3,) m, of the base, from the run's origin
    base_rotation: Array
    base_position: Array
    origin: Array  # (3,) m, the run's, in the odometry frame
    momentum_change: Array  # (6,) change of the momentum by thrust and orbit since the run began, L about its origin

    @property
    def measures_twist(self) -> bool:
        """Whether the base's twist is measured, beside its pose."""
        return bool(np.all(np.isfinite(self.noise.twist)))

    @staticmethod
    def from_window(window: Samples, noise: SensorNoise, length: float, origin: Array, momentum_change: Array) -> End:
        """Return it from the last window of a run, of a length in s, that began at an origin (3,) m.

        `momentum_change` (6,) is the change of the momentum since then, L about the odometry's origin.
        """
        last = window_noises([window[-1:]], noise)[0]
        if window.missing_rates[1]:
            last = replace(last, twist=np.full((6, 6), np.nan))
        rate = len(window) / length
        if window.missing_rates[0] and len(window) >= FEWEST:
            window = with_rates(window)
        return End(
            rate,
            last,
            float(window.time[-1]),
            window.joint_position[-1],
            np.nan_to_num(window.joint_velocity[-1]),
            window.stored[-1],
            window.base_rotation[-1],
            window.base_position[-1] - origin,
            origin,
            np.concatenate((momentum_change[:3], momentum_change[3:] - cross(origin, momentum_change[:3]))),
        )


@dataclass(frozen=True, eq=False)
class Continuation:
    """The information that a run leaves to the next one of the same robot and target, without widening."""

    planar: bool  # whether the run was, and has the numbers of a planar motion
    # root, bias: as of `Variables.for_continued_run`
    root: Array
    bias: Array

    @staticmethod
    def from_gaussian(gaussian: SquareRootInformation, variables: Variables) -> Continuation:
        """Return that of the Gaussian at the end of a run."""
        root = variables.without_force(new_motion(gaussian, variables).root)
        rest = slice(variables.head, None)
        return Continuation(variables.poses < 6, root[rest, rest], gaussian.bias_information)


@dataclass(frozen=True, eq=False)
class Posterior:
    """The trajectory filter's state at the end of a run."""

    layout: Layout  # of the state
    variables: Variables  # of the state
    hypothesis: Hypothesis  # the best one
    mean: Array  # (s,) of the state
    triangle: Array  # (s - 6, s - 6) upper T, T^T T the covariance of the state without the pose error
    end: End
    continuation: Continuation  # as the filter has it

    @property
    def deviation(self) -> Array:
        """Standard deviations of the state, (s,); zero for the pose error."""
        return np.concatenate((np.zeros(FIRST), np.sqrt(np.add.reduce(self.triangle**2, axis=0))))

    @property
    def state(self) -> Array:
        """The mean with the present momentum, (s,)."""
        state = self.mean.copy()
        state[LINEAR.start : LINEAR.start + 6] += self.end.momentum_change
        return state

    @property
    def point(self) -> Point:
        """The linearisation point of the next motion."""
        return self.layout.point(self.state, self.deviation)

    def drawn(self, count: int, seed: int) -> list[Point]:
        """Return `count` points drawn from the posterior, each with its mirror image, of at least half the mass."""
        generator = np.random.default_rng(seed)
        half = generator.standard_normal((-(-count // 2), len(self.triangle)))
        away = np.concatenate((half, -half))[:count] @ self.triangle
        mean, points = self.state, []
        mass = LINEAR.start + 6
        for each in away:
            state = mean.copy()
            least = 0.5 * abs(mean[mass])
            part = min(1.0, least / max(least, -each[mass - FIRST])) if mean[mass] > 0.0 else 0.0
            state[FIRST:] += part * each
            points.append(self.layout.point(state, self.deviation))
        return points


def posterior(
    layout: Layout, hypothesis: Hypothesis, distribution: MeanAndCovariance, prior_scales: PriorScaleFactors, end: End
) -> Posterior:
    """Return the posterior of a run, as published, from the mean and covariance of its state."""
    variables, rows, mean = distribution.variables, np.arange(FIRST, layout.size), distribution.mean.copy()
    outside = variables.factor - variables.basis @ (variables.basis.T @ variables.factor)
    mean[rows], factor = distribution.published(prior_scales, layout, rows)
    triangle = np.asarray(np.linalg.qr(np.concatenate((factor, outside[rows]), axis=1).T, mode='r'))
    continuation = Continuation.from_gaussian(distribution.gaussian, variables)
    return Posterior(layout, variables, hypothesis, mean, triangle, end, continuation)
