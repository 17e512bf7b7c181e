"""How well everything will be known after a motion to come: the trajectory filter's own, over windows not yet measured.

The information of a window depends on the motion alone, not on the numbers that will be read: rows, noise and the way
to the next window are those that the filter makes of a motion as it is predicted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dtrtrs

from mbaid_ros.core.contracts import in_stacks
from mbaid_ros.core.filter.gaussian import SquareRootInformation, update
from mbaid_ros.core.filter.linearise import TOGETHER, LinearisationCache, WhitenedWindow
from mbaid_ros.core.filter.posterior import FIRST, MeanAndCovariance, Posterior
from mbaid_ros.core.filter.time_update import advance
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.verdict import Reporting, relative_std
from mbaid_ros.core.robot.body import physical, physical_jacobian
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS
from mbaid_ros.core.state import BODY, Point
from mbaid_ros.core.windows import AFTER, BEFORE, Knots, Window, WindowNoise
from mbaid_ros.planning.floating import BaseMotion

_NOTHING = 1e-6  # of its size, by which undetermined directions must not move a determined parameter


@dataclass(frozen=True)
class Grid:
    """Windows of knots over motions that begin at time 0; of knots before and after, when the joints rest."""

    windows: int  # number
    knots: int  # in each
    spacing: float  # s, between knots

    @staticmethod
    def over(duration: float, window: float, knots: int) -> Grid:
        """Return whole windows that cover a motion."""
        return Grid(max(int(np.ceil(duration / window - 1e-6)), 1), knots, window / knots)

    @cached_property
    def half_steps(self) -> Array:
        """Instants of all knots and midway between them, (2 K - 1,) s."""
        count = self.windows * self.knots + BEFORE + AFTER
        return (np.arange(2 * count - 1) / 2.0 - BEFORE) * self.spacing

    @property
    def ends(self) -> Array:
        """Of each window, (W,) s."""
        return np.arange(1, self.windows + 1) * self.knots * self.spacing


class Information:
    """The information that future motions will add.

    Parameters
    ----------
    posterior : of the run
    reporting : has the sizes that standard deviations are relative to
    point : of the robot as it may be; as it is known best where not given
    """

    def __init__(self, posterior: Posterior, reporting: Reporting, point: Point | None = None) -> None:
        self._known, self._reporting = posterior, reporting
        self._point = point or posterior.point
        body = self._point.body
        self.parameters = physical(body)
        self._jacobian = physical_jacobian(body)
        self._scale = reporting.scale
        self._sizes = reporting.sizes(self.parameters)
        self._start = self._prior()

    def at_point(self, point: Point) -> Information:
        """Return the information of motions for one of the possible robots."""
        return Information(self._known, self._reporting, point)

    @cached_property
    def relative(self) -> Array:
        """Relative standard deviations of the ten parameters as they are known now, (10,)."""
        covariance = self._known.triangle[:, BODY.start - FIRST : BODY.stop - FIRST]
        return self._relative((covariance.T @ covariance)[None])[0]

    @cached_property
    def determinable(self) -> Flags:
        """The parameters that a motion can determine at all, (10,): four in a planar one."""
        variables = self._known.variables
        own = variables.basis[BODY, 2 * variables.pose_size : variables.first_unknown]
        left_out = self._jacobian @ (np.eye(10) - own @ own.T) * self._scale
        return np.asarray(np.linalg.norm(left_out, axis=1) < _NOTHING * self._sizes)

    def std_after(self, grid: Grid, joints: tuple[Array, Array], base: BaseMotion, every: int = 0) -> Array:
        """Return relative standard deviations of the parameters after B motions, (B, 10), or on the way (W, B, 10).

        Parameters
        ----------
        joints : (J, B, n) positions of all joints as read, and rates, at its knots
        base : of the same J knots
        every : how often on the way, in windows; 0 at the end alone
        """
        attitude_sensitivity = [
            self._relative(np.stack([self._covariance(gaussian) for gaussian in gaussians]))
            for number, gaussians in enumerate(self._posteriors(grid, joints, base), start=1)
            if number == grid.windows or (every and number % every == 0)
        ]
        return np.stack(attitude_sensitivity) if every else attitude_sensitivity[-1]

    def shares(self, grid: Grid, joints: tuple[Array, Array], base: BaseMotion) -> tuple[tuple[str, ...], Array]:
        """Return the causes of uncertainty beside the sensors, c names, and their shares after one motion.

        Parameters
        ----------
        grid, joints, base : as for `std_after`, of one motion

        Returns
        -------
        c names, (10, c) parts of the variances of the ten parameters
        """
        last = self._start
        for (gaussian,) in self._posteriors(grid, joints, base):
            last = gaussian
        distribution = MeanAndCovariance.from_gaussian(last, self._known.variables)
        own = distribution.factor_of(self._jacobian @ self._known.variables.to_state[BODY])
        layout = self._known.layout
        variances = distribution.contributions(own, layout).T ** 2 @ layout.belongs
        shares = variances / np.maximum(np.sum(own**2, axis=1, keepdims=True), np.finfo(float).tiny)
        return layout.causes, np.minimum(shares, 1.0)  # numbers further off than declared have more than their prior's

    def _posteriors(
        self, grid: Grid, joints: tuple[Array, Array], base: BaseMotion
    ) -> Iterator[list[SquareRootInformation]]:
        """Yield the posteriors of B motions after each window."""
        whitened = self._windows(grid, joints, base)
        batch = joints[0].shape[1]
        gaussians = [self._start] * batch
        for number in range(grid.windows):
            own = whitened[number * batch : (number + 1) * batch]
            gaussians = [update(gaussian, window) for gaussian, window in zip(gaussians, own, strict=True)]
            yield gaussians
            gaussians = [self._advanced(*pair) for pair in zip(gaussians, own, strict=True)]

    def _advanced(self, gaussian: SquareRootInformation, window: WhitenedWindow) -> SquareRootInformation:
        return advance(gaussian, window, self._known.variables, self._known.hypothesis)

    def _windows(self, grid: Grid, joints: tuple[Array, Array], base: BaseMotion) -> list[WhitenedWindow]:
        """Return the windows of B motions as the filter takes them: the first of each motion, then the second."""
        position, batch = joints[0], joints[0].shape[1]
        length = grid.knots * grid.spacing
        noise = self._noise(length)
        inside = slice(BEFORE, BEFORE + grid.knots)
        windows = [
            Window(self._knots(grid, position, base, number, each), inside, grid.spacing, noise, number * length, False)  # noqa: FBT003
            for number in range(grid.windows)
            for each in range(batch)
        ]
        # Passive joints swing on from window to window of a motion.
        apart = batch if self._known.layout.kernel.springs.count else 1
        made = [self._linearised(windows[place::apart]) for place in range(apart)]
        return [window for together in zip(*made, strict=True) for window in together]

    def _linearised(self, windows: Sequence[Window]) -> list[WhitenedWindow]:
        """Return windows as the filter takes them; those of passive joints in the order of one motion."""
        # Only encoders and poses are planned with: also those that named sensors make together.
        layout = replace(self._known.layout, sensors=(), odometry=True)
        variables = replace(self._known.variables, sensors=())
        linearised = LinearisationCache(layout, variables)
        parts = in_stacks(windows, TOGETHER)
        return [white for part in parts for _, white in linearised.all_whitened(part, self._point)]

    def _knots(self, grid: Grid, position: Array, base: BaseMotion, number: int, each: int) -> Knots:
        begin = number * grid.knots
        cut = slice(begin, begin + grid.knots + BEFORE + AFTER)
        count = cut.stop - cut.start
        stored = np.broadcast_to(self._known.end.stored, (count, len(self._known.end.stored)))
        frames = sum(len(getattr(unknown, 'frames', ())) for unknown in self._known.layout.unknowns)
        return Knots(
            joint_position=position[cut, each],
            base_rotation=base.rotation[cut, each],
            base_position=base.position[cut, each],
            base_twist=base.twist[cut, each] + (0.0 if self._known.end.measures_twist else np.nan),
            spread=np.zeros(count),
            offset=np.zeros(count),
            impulse=np.zeros((count, 6)),
            stored=stored,
            gravity_columns=np.zeros((count, 0)),
            thrust=np.zeros((count, 6 * THRUSTER_ERRORS * frames)),
            further=np.zeros((count, 0)),
            attitude_sensitivity=np.zeros((count, 0)),
        )

    def _noise(self, length: float) -> WindowNoise:
        end, noise = self._known.end, self._known.end.noise
        samples = max(round(end.rate * length), 1)
        twist = np.where(np.isfinite(noise.twist), noise.twist, np.eye(6))
        return WindowNoise(samples, noise.joint_position, noise.pose, twist)

    def _prior(self) -> SquareRootInformation:
        """Return the prior of the motion, without the pose error: the chain begins anew."""
        variables = self._known.variables
        poses, count = variables.pose_size, len(variables.scale)
        root = np.zeros((count, count))
        root[:poses, :poses] = variables.prior()[1][:poses, :poses]
        factor = variables.from_state[poses:, FIRST:] @ self._known.triangle.T
        triangle = np.linalg.qr(factor.T, mode='r')
        root[poses:, poses:] = np.linalg.qr(np.linalg.inv(triangle).T, mode='r')
        return SquareRootInformation.from_root(root, np.zeros(count), (self._known.hypothesis.force,), variables)[0]

    def _covariance(self, gaussian: SquareRootInformation) -> Array:
        """Return the (10, 10) covariance of the body's standard parameters."""
        variables = self._known.variables
        rows = np.zeros((gaussian.size, 10), order='F')
        rows[: len(variables.scale)] = variables.to_state[BODY].T
        own, _ = dtrtrs(gaussian.triangle, rows, trans=1)
        return np.asarray(own.T @ own + variables.covariance_outside[BODY, BODY])

    def _relative(self, covariance: Array) -> Array:
        """Return (N, 10) relative standard deviations of (N, 10, 10) covariances of standard parameters."""
        return relative_std(self._jacobian @ covariance @ self._jacobian.T, self._sizes)
