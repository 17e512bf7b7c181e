"""Normalised innovations of a run, summed by sensor: their size, correlation and significance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.results.estimate import SensorFit

# In the order of a pose's and a twist's numbers.
BASE_SENSORS = ('base_orientation', 'base_position', 'base_angular_velocity', 'base_linear_velocity')
# Standard deviations from which a deviation of the innovations is no accident: one in a billion.
SIGNIFICANT = 6.0


@dataclass(frozen=True, eq=False)
class Innovations:
    """Sums over the windows of a run, of each of the m numbers that may be measured, those of a sensor in a row."""

    sources: tuple[str, ...]  # m, the sensor that each of the numbers is of
    # sums, counts: (2, m) of the normalised innovations squared, and of the products of those of neighbouring windows
    sums: Array
    counts: Array
    previous: Array  # (m,) those of the last window; NaN if not measured

    @staticmethod
    def none(sources: tuple[str, ...]) -> Innovations:
        """Return the sums before the first window."""
        nothing = np.zeros((2, len(sources)))
        return Innovations(sources, nothing, nothing, np.full(len(sources), np.nan))

    def with_window(self, normalised: Array, places: Integers) -> Innovations:
        """Return the sums with a window's normalised innovations (w,), which are of the numbers at some places."""
        latest = np.full(len(self.previous), np.nan)
        latest[places] = normalised
        products = np.array((latest, self.previous)) * latest
        known = np.isfinite(products)
        return Innovations(self.sources, self.sums + np.where(known, products, 0.0), self.counts + known, latest)

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors, in the order of their numbers."""
        return tuple(dict.fromkeys(self.sources))

    @property
    def fits(self) -> tuple[SensorFit, ...]:
        """How well each sensor agrees with the model: the odometry, and the further ones by name."""
        names = np.array(['odom' if sensor in BASE_SENSORS else sensor for sensor in self.sensors])
        squares, found = self._of_sensors[0][0], []
        for name in dict.fromkeys(names.tolist()):
            own = names == name
            count, part = int(np.sum(self.count[own])), float(np.sum(squares[own]))
            residual, share = (float(np.sqrt(part / count)), part / float(np.sum(squares))) if count else (np.nan,) * 2
            found.append(SensorFit(name, count, residual, share))
        return tuple(found)

    @cached_property
    def _of_sensors(self) -> tuple[Array, Array]:
        """Sums and counts, (2, s) each, of the s sensors."""
        begins = [self.sources.index(name) for name in self.sensors]
        sums, counts = np.add.reduceat(np.array((self.sums, self.counts)), begins, axis=2)
        return sums, counts

    @property
    def count(self) -> Array:
        """How many innovations of each sensor there were, (s,)."""
        return self._of_sensors[1][0]

    @property
    def pairs(self) -> Array:
        """How many pairs of neighbouring windows' innovations of each sensor there were, (s,)."""
        return self._of_sensors[1][1]

    @cached_property
    def ratio(self) -> Array:
        """Mean normalised innovation squared of each sensor, (s,): 1 for noise as declared; NaN without any."""
        return np.where(self.count > 0.0, self._of_sensors[0][0] / np.maximum(self.count, 1.0), np.nan)

    @cached_property
    def ratio_significance(self) -> Array:
        """By how many of its standard deviations, sqrt(2 / n), each ratio exceeds 1, (s,)."""
        return (self.ratio - 1.0) * np.sqrt(0.5 * self.count)

    @cached_property
    def correlation(self) -> Array:
        """Covariance of neighbouring windows' innovations in units of the declared noise, (s,); NaN without any.

        0 where the noise is white. Innovations far below the declared noise do not matter.
        """
        return np.where(self.pairs > 0.0, self._of_sensors[0][1] / np.maximum(self.pairs, 1.0), np.nan)

    @cached_property
    def correlation_significance(self) -> Array:
        """How many of its standard deviations, the ratio over sqrt(n), each of these is, (s,)."""
        return self.correlation / np.maximum(self.ratio, 1.0) * np.sqrt(self.pairs)


def widening(innovations: Innovations, nis: float) -> float:
    """Return by how much variances grow: innovations larger than declared, and correlated from window to window.

    The variance of a mean of correlated numbers is 1 + 2 (r_1 + r_2 + ...) times as large (Newey and West 1987); with
    r_k = r^k that is (1 + r) / (1 - r).
    """
    significant = innovations.correlation_significance > 0.5 * SIGNIFICANT
    correlation = float(np.max(np.where(significant, innovations.correlation, 0.0)))
    correlation = min(max(correlation, 0.0), 0.9)
    return max(1.0, nis) * (1.0 + correlation) / (1.0 - correlation)
