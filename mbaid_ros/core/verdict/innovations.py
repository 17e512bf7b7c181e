"""Are the innovations those of the declared noise? In size, sensor by sensor, and white from window to window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.geometry import Array

Integers = npt.NDArray[np.int64]

SENSORS = ('base_orientation', 'base_position', 'base_angular_velocity', 'base_linear_velocity', 'imu')


@dataclass(frozen=True, eq=False)
class Innovations:
    """Sums over the windows of a run, of each of the m numbers that may be measured.

    These are k of the pose, angular ones first, k of the twist, and those that a gyro measures.

    Attributes
    ----------
    angular : how many of the k are angular: three, or one in a plane
    squares, count : (m,) of the normalised innovations
    products, pairs : (m,) of those of neighbouring windows
    previous : (m,) those of the last window; NaN of what was not measured
    """

    angular: int
    squares: Array
    count: Array
    products: Array
    pairs: Array
    previous: Array

    @staticmethod
    def none(poses: int) -> Innovations:
        """Return the sums before the first window, of k = 6 pose measurements, or 3 in a plane."""
        angular = 3 if poses > 3 else 1
        nothing = np.zeros(2 * poses + angular)
        return Innovations(angular, nothing, nothing, nothing, nothing, np.full(len(nothing), np.nan))

    def after(self, normalised: Array, places: Integers) -> Innovations:
        """Return the sums with a window's normalised innovations (w,), which are of the numbers at some places."""
        latest = np.full(len(self.squares), np.nan)
        latest[places] = normalised
        product = latest * self.previous
        both = np.isfinite(product)
        squares, count = self.squares.copy(), self.count.copy()
        squares[places] += normalised**2
        count[places] += 1.0
        return replace(
            self,
            squares=squares,
            count=count,
            products=self.products + np.where(both, product, 0.0),
            pairs=self.pairs + both,
            previous=latest,
        )

    def by_sensor(self, sums: Array) -> Array:
        """Return the (5,) totals of sums, in the order of SENSORS."""
        poses = (len(sums) - self.angular) // 2
        ends = (0, self.angular, poses, poses + self.angular, 2 * poses)
        return np.add.reduceat(sums, ends)

    @property
    def ratio(self) -> Array:
        """Mean normalised innovation squared of each sensor, (5,): 1 for noise as declared; NaN without any."""
        count = self.by_sensor(self.count)
        return np.where(count > 0.0, self.by_sensor(self.squares) / np.maximum(count, 1.0), np.nan)

    @property
    def ratio_significance(self) -> Array:
        """By how many of its standard deviations, sqrt(2 / n), each ratio exceeds 1, (5,)."""
        return (self.ratio - 1.0) * np.sqrt(0.5 * self.by_sensor(self.count))

    @property
    def correlation(self) -> Array:
        """Covariance of neighbouring windows' innovations in units of the declared noise, (5,); NaN without any.

        0 where the noise is white. What is far below the declared noise is no matter, however correlated.
        """
        pairs = self.by_sensor(self.pairs)
        return np.where(pairs > 0.0, self.by_sensor(self.products) / np.maximum(pairs, 1.0), np.nan)

    @property
    def correlation_significance(self) -> Array:
        """How many of its standard deviations, the ratio over sqrt(n), each of these is, (5,)."""
        return self.correlation / np.maximum(self.ratio, 1.0) * np.sqrt(self.by_sensor(self.pairs))
