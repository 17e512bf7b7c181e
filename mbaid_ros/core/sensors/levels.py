"""How noisy the sensors have turned out to be, beside what was declared of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array, Flags

CHANNELS = (
    'joint_position',
    'joint_velocity',
    'base_position',
    'base_orientation',
    'base_linear_velocity',
    'base_angular_velocity',
)
UNITS = ('rad', 'rad/s', 'm', 'rad', 'm/s', 'rad/s')  # m and m/s of a prismatic joint
TYPICAL = np.array([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4])  # what sensors of a servicer have
# Times as noisy as found that joints are declared, from which what is taken off the equations for it pulls them
# aside.
_FAR_TOO_LARGE = 10.0
_WRONG = 1.3  # times too small or too large, from which a declared value is told to be: nobody declares it better


@dataclass(frozen=True)
class SensorLevels:
    """Standard deviations of single readings.

    Attributes
    ----------
    declared, found : (6,) of CHANNELS, SI; NaN where nobody has declared anything, where it is not found
    assumed : (6,) what is taken for it where it is neither, and there are readings
    correlation_time : s, over which the errors of the base's poses are taken to be correlated; 0 for independent ones
    used : (6,) whether what was found is used, and not what was declared
    """

    declared: Array
    found: Array
    assumed: Array
    correlation_time: float
    used: Flags

    @property
    def warning(self) -> str:
        """What leads to wrong numbers, whatever the innovations say: joints that are far better than declared.

        Their noise is in the coefficients of the equations. What it adds there on average is taken off.
        """
        declared, found = float(self.declared[0]), max(float(self.found[0]), float(TYPICAL[0]))
        if self.used[0] or not declared > _FAR_TOO_LARGE * found:
            return ''
        return (
            f'noise.joint_position is {declared:.2g} rad, the readings scatter by {self.found[0]:.2g}: estimates may '
            'be pulled aside by more than their intervals say; set what the joints have, or noise.estimate'
        )

    def shown(self) -> list[tuple[str, str, str]]:
        """Return name and unit of each sensor, and what is declared and found of it, that first which counts."""
        each = zip(CHANNELS, UNITS, self.declared, self.found, self.assumed, self.used, strict=True)
        rows = []
        for name, unit, declared, found, assumed, used in each:
            both = [(declared, 'declared'), (found, 'found')]
            every = [*(both[::-1] if used else both), (assumed, 'assumed')]
            known = [f'{value:.2g} {how}' for value, how in every if np.isfinite(value)]
            rows.append((name.replace('_', ' '), unit, ', '.join(known)))
        return rows

    def told(self) -> list[str]:
        """Return in words what a user should know: of each sensor that is not as declared, a line."""
        lines = []
        each = zip(CHANNELS, UNITS, self.declared, self.found, self.used, strict=True)
        for name, unit, declared, found, used in each:
            ratio = found / declared
            if np.isnan(ratio) or 1.0 / _WRONG < ratio < _WRONG:
                continue
            wrong = f'{ratio:.2g} times too small' if ratio > 1.0 else f'{1.0 / ratio:.2g} times too large'
            use = '; what was found is used' if used else ''
            value = f'your noise value, {declared:.2g} {unit}, is {wrong}'
            lines.append(f'{name.replace("_", " ")}: {value}: {found:.2g} {unit} in the data{use}')
        if found_alone := self._undeclared(self.found):
            lines.append(f'nobody has declared that of {listing(found_alone)}; what was found is used')
        if assumed := self._undeclared(self.assumed):
            lines.append(f'nobody has declared that of {listing(assumed)}, nor do readings tell it; so much is assumed')
        if self.correlation_time > 0.0:
            lines.append(f'the errors of the base pose are taken to be correlated over {self.correlation_time:.2g} s')
        return lines

    def _undeclared(self, known: Array) -> list[str]:
        """Return what is known (6,) of sensors of which nobody has declared anything."""
        return [
            f'{name.replace("_", " ")} ({value:.2g} {unit})'
            for name, unit, declared, value in zip(CHANNELS, UNITS, self.declared, known, strict=True)
            if np.isnan(declared) and not np.isnan(value)
        ]
