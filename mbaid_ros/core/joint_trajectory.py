"""A motion of the joints as points in time, interpolated as ros2_control's controllers do."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.core.errors import DataError, listing
from mbaid_ros.core.geometry import Array

# Polynomials on [0, 1], in rising powers: factors of y1 - y0, y0', y1' of a cubic, and of y1 - y0, y0', y0'', y1', y1''
# of a quintic.
_CUBIC = np.array([[0.0, 0.0, 3.0, -2.0], [0.0, 1.0, -2.0, 1.0], [0.0, 0.0, -1.0, 1.0]])
_QUINTIC = np.array(
    [
        [0.0, 0.0, 0.0, 10.0, -15.0, 6.0],
        [0.0, 1.0, 0.0, -6.0, 8.0, -3.0],
        [0.0, 0.0, 0.5, -1.5, 1.5, -0.5],
        [0.0, 0.0, 0.0, -4.0, 7.0, -3.0],
        [0.0, 0.0, 0.0, 0.5, -1.0, 0.5],
    ]
)


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """Points that some joints pass.

    Between two points a joint follows the quintic by position, velocity and acceleration at both, the cubic without
    accelerations, and a straight line without velocities. Before the first point and after the last one it rests there.

    Raises DataError: The points do not make a motion.
    """

    joints: tuple[str, ...]  # names of the k joints
    time: Array  # (K,) s since its begin, increasing
    position: Array  # (K, k) rad or m
    velocity: Array  # (K, k); or (0, 0) where not given
    acceleration: Array  # (K, k); or (0, 0) where not given

    def __post_init__(self) -> None:
        """Refuse arrays that are not a motion."""
        count, names = len(self.time), len(self.joints)
        if not count or not names:
            raise DataError(f'a joint trajectory has {count} points of {names} joints; accepted: at least one of both')
        if len(set(self.joints)) < names:
            raise DataError(f'a joint trajectory names a joint twice: {listing(self.joints)}')
        for name in ('position', 'velocity', 'acceleration'):
            shape = getattr(self, name).shape
            if shape != (count, names) and (name == 'position' or shape != (0, 0)):
                raise DataError(
                    f'a joint trajectory has {name} of shape {shape}; accepted: {count} points of {names} joints'
                )
            if not np.all(np.isfinite(getattr(self, name))):
                raise DataError(f'a joint trajectory has a {name} that is not finite')
        if not np.all(np.isfinite(self.time)) or self.time[0] < 0.0 or np.any(np.diff(self.time) <= 0.0):
            raise DataError('the points of a joint trajectory are not in order; accepted: times >= 0 that increase')

    @property
    def duration(self) -> float:
        """Until the last point, s."""
        return float(self.time[-1])

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, (..., k) each, at (...) s since the begin."""
        if len(self.time) == 1:
            position = np.broadcast_to(self.position[0], (*np.shape(times), len(self.joints))).copy()
            return position, np.zeros_like(position), np.zeros_like(position)
        inside = np.clip(times, self.time[0], self.time[-1])
        place = np.clip(np.searchsorted(self.time, inside, side='right') - 1, 0, len(self.time) - 2)
        since = (inside - self.time[place])[..., None]
        own = self._polynomials[:, place]
        moving = (inside == times)[..., None]
        position = _horner(own, since)
        return position, moving * _horner(_derived(own), since), moving * _horner(_derived(_derived(own)), since)

    @cached_property
    def _polynomials(self) -> Array:
        """Of each segment, by rising powers of the time since its begin, (6, K - 1, k)."""
        length = np.diff(self.time)[:, None]
        parts = [self.position[1:] - self.position[:-1]]
        basis = np.array([[0.0, 1.0]])
        if self.velocity.size:
            parts += [length * self.velocity[:-1], length * self.velocity[1:]]
            basis = _CUBIC
        if self.velocity.size and self.acceleration.size:
            parts = [*parts[:2], length**2 * self.acceleration[:-1], parts[2], length**2 * self.acceleration[1:]]
            basis = _QUINTIC
        polynomials = np.zeros((6, *parts[0].shape))
        for power, coefficients in enumerate(basis.T):
            polynomials[power] = np.tensordot(coefficients, parts, axes=1) / length**power
        polynomials[0] = self.position[:-1]
        return polynomials


def _derived(polynomials: Array) -> Array:
    """Return the derivatives of polynomials, rising powers first."""
    powers = np.arange(1.0, len(polynomials)).reshape(-1, *(1,) * (polynomials.ndim - 1))
    return polynomials[1:] * powers


def _horner(polynomials: Array, argument: Array) -> Array:
    """Return the values of polynomials, rising powers first."""
    total = np.zeros_like(polynomials[0])
    for coefficient in polynomials[::-1]:
        total = total * argument + coefficient
    return total
