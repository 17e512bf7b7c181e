"""Are the innovations those of the declared noise? In size, sensor by sensor, and white from window to window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array

SENSORS = ('base_orientation', 'base_position', 'base_angular_velocity', 'base_linear_velocity')


@dataclass(frozen=True, eq=False)
class Innovations:
    """Sums over the windows of a run, of each of the 2 k numbers that pose and twist measure, angular ones first.

    Attributes
    ----------
    angular : how many of the k are angular: three, or one in a plane
    squares, count : (2 k,) of the normalised innovations
    products, pairs : (2 k,) of those of neighbouring windows
    previous : those of the last window
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
        nothing = np.zeros(2 * poses)
        return Innovations(3 if poses > 3 else 1, nothing, nothing, nothing, nothing, nothing[:0])

    def after(self, normalised: Array) -> Innovations:
        """Return the sums with a window's normalised innovations: (k,) of the pose, (2 k,) with the twist."""
        measured, both = len(normalised), min(len(normalised), len(self.previous))
        squares, count = self.squares.copy(), self.count.copy()
        products, pairs = self.products.copy(), self.pairs.copy()
        squares[:measured] += normalised**2
        count[:measured] += 1.0
        products[:both] += normalised[:both] * self.previous[:both]
        pairs[:both] += 1.0
        return replace(self, squares=squares, count=count, products=products, pairs=pairs, previous=normalised)

    def by_sensor(self, sums: Array) -> Array:
        """Return the (4,) totals of sums, in the order of SENSORS."""
        poses = len(sums) // 2
        ends = (0, self.angular, poses, poses + self.angular)
        return np.add.reduceat(sums, ends)

    @property
    def ratio(self) -> Array:
        """Mean normalised innovation squared of each sensor, (4,): 1 for noise as declared; NaN without any."""
        count = self.by_sensor(self.count)
        return np.where(count > 0.0, self.by_sensor(self.squares) / np.maximum(count, 1.0), np.nan)

    @property
    def ratio_significance(self) -> Array:
        """By how many of its standard deviations, sqrt(2 / n), each ratio exceeds 1, (4,)."""
        return (self.ratio - 1.0) * np.sqrt(0.5 * self.by_sensor(self.count))

    @property
    def correlation(self) -> Array:
        """Covariance of neighbouring windows' innovations in units of the declared noise, (4,); NaN without any.

        0 where the noise is white. What is far below the declared noise is no matter, however correlated.
        """
        pairs = self.by_sensor(self.pairs)
        return np.where(pairs > 0.0, self.by_sensor(self.products) / np.maximum(pairs, 1.0), np.nan)

    @property
    def correlation_significance(self) -> Array:
        """How many of its standard deviations, the ratio over sqrt(n), each of these is, (4,)."""
        return self.correlation / np.maximum(self.ratio, 1.0) * np.sqrt(self.by_sensor(self.pairs))
