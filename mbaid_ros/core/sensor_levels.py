"""How noisy the sensors have turned out to be, beside what was declared of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array

CHANNELS = (
    'joint_position',
    'joint_velocity',
    'base_position',
    'base_orientation',
    'base_linear_velocity',
    'base_angular_velocity',
)
UNITS = ('rad', 'rad/s', 'm', 'rad', 'm/s', 'rad/s')  # m and m/s of a prismatic joint
_WRONG = 1.3  # times too small or too large, from which a declared value is told to be


@dataclass(frozen=True)
class SensorLevels:
    """Standard deviations of single readings.

    Attributes
    ----------
    declared, found : (6,) of CHANNELS, SI; NaN where not found
    correlation_time : s, over which the errors of the base's poses are taken to be correlated; 0 for independent ones
    used : whether what was found is used, and not what was declared
    """

    declared: Array
    found: Array
    correlation_time: float
    used: bool

    def told(self) -> list[str]:
        """Return in words what a user should know: of each sensor that is not as declared, a line."""
        lines = []
        for name, unit, declared, found in zip(CHANNELS, UNITS, self.declared, self.found, strict=True):
            ratio = found / declared
            if np.isnan(ratio) or 1.0 / _WRONG < ratio < _WRONG:
                continue
            wrong = f'{ratio:.2g} times too small' if ratio > 1.0 else f'{1.0 / ratio:.2g} times too large'
            use = '; what was found is used' if self.used else ''
            value = f'your noise value, {declared:.2g} {unit}, is {wrong}'
            lines.append(f'{name.replace("_", " ")}: {value}: {found:.2g} {unit} in the data{use}')
        if self.correlation_time > 0.0:
            lines.append(f'the errors of the base pose are taken to be correlated over {self.correlation_time:.2g} s')
        return lines
