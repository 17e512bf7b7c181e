"""Are the innovations those of the declared noise? In size, sensor by sensor, and white from window to window."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mbaid_ros.core.geometry import Array

SENSORS = ('base_orientation', 'base_position', 'base_angular_velocity', 'base_linear_velocity')


def _zeros() -> Array:
    return np.zeros(len(SENSORS))


@dataclass(frozen=True, eq=False)
class Innovations:
    """Sums over the windows of a run, sensor by sensor in the order of SENSORS.

    Attributes
    ----------
    squares, count : (4,) of the normalised innovations
    products, pairs : (4,) of those of neighbouring windows
    previous : (4, d) of the last window; NaN where a sensor was silent
    """

    squares: Array = field(default_factory=_zeros)
    count: Array = field(default_factory=_zeros)
    products: Array = field(default_factory=_zeros)
    pairs: Array = field(default_factory=_zeros)
    previous: Array = field(default_factory=lambda: np.full((len(SENSORS), 0), np.nan))

    def after(self, normalised: Array, angular: int) -> Innovations:
        """Return the sums with a window's normalised innovations.

        Parameters
        ----------
        normalised : (k,) or (2 k,) of unit variance: of the pose, then of the twist where there is one; angular first
        angular : how many of the k are angular
        """
        whole = len(SENSORS) // 2
        latest = np.full((len(SENSORS), 3), np.nan)
        pose = angular + (3 if angular == 3 else 2)  # in a plane: one angle, two coordinates
        for place in range(min(len(normalised) // pose, whole)):
            part = normalised[place * pose : (place + 1) * pose]
            latest[2 * place, :angular], latest[2 * place + 1, : pose - angular] = part[:angular], part[angular:]
        before = self.previous if self.previous.shape[1] else np.full_like(latest, np.nan)
        product = latest * before
        return Innovations(
            self.squares + np.nansum(latest**2, axis=1),
            self.count + np.sum(np.isfinite(latest), axis=1),
            self.products + np.nansum(product, axis=1),
            self.pairs + np.sum(np.isfinite(product), axis=1),
            latest,
        )

    @property
    def ratio(self) -> Array:
        """Mean normalised innovation squared of each sensor, (4,): 1 for noise as declared; NaN without any."""
        return np.where(self.count > 0.0, self.squares / np.maximum(self.count, 1.0), np.nan)

    @property
    def ratio_significance(self) -> Array:
        """By how many of its standard deviations, sqrt(2 / n), each ratio exceeds 1, (4,)."""
        return (self.ratio - 1.0) * np.sqrt(0.5 * self.count)

    @property
    def correlation(self) -> Array:
        """Correlation of neighbouring windows' innovations, (4,): 0 where the noise is white; NaN without any."""
        size = self.squares / np.maximum(self.count, 1.0)
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.where(self.pairs > 0.0, self.products / np.maximum(self.pairs, 1.0) / size, np.nan)

    @property
    def correlation_significance(self) -> Array:
        """How many of its standard deviations, 1 / sqrt(n), each of these is, (4,)."""
        return self.correlation * np.sqrt(self.pairs)
