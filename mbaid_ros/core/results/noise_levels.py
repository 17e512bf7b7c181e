"""Noise levels of the sensors: declared against found."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.errors import listing

CHANNELS = (
    'joint_position',
    'joint_velocity',
    'base_position',
    'base_orientation',
    'base_linear_velocity',
    'base_angular_velocity',
)
UNITS = ('rad', 'rad/s', 'm', 'rad', 'm/s', 'rad/s')  # m and m/s of a prismatic joint
TYPICAL = np.array([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4])  # usual for the sensors of a servicer
# Declared joint noise over found noise, from which the bias correction of the equations biases them itself.
_FAR_TOO_LARGE = 10.0
_WRONG = 1.3  # times too small or too large, from which a declared value is reported as wrong: declarations are rough


@dataclass(frozen=True)
class NoiseLevels:
    """Standard deviations of single readings.

    Attributes
    ----------
    declared, estimated : (6,) of CHANNELS, SI; NaN if undeclared, if not estimated
    assumed : (6,) used for readings that have neither
    correlation_time, twist_correlation_time : s, of the errors of the base's poses and twists; 0 for independent ones
    used : (6,) whether the estimated level is used instead of the declared one
    contradicted : (6,) whether that is because the readings contradict the declared one
    clear : as of `FoundLevels`
    """

    declared: Array
    estimated: Array
    assumed: Array
    correlation_time: float
    used: Flags
    twist_correlation_time: float = 0.0
    contradicted: Flags = field(default_factory=lambda: np.zeros(len(CHANNELS), dtype=bool))
    clear: bool = True

    @property
    def as_declared(self) -> bool:
        """Whether the errors of the base are independent, and as large as declared."""
        return self.clear and not (self.correlation_time or self.twist_correlation_time or np.any(self.contradicted))

    @property
    def warnings(self) -> list[str]:
        """A sentence if a declared level is replaced, and one if joints are far better than declared.

        The filter subtracts the expected bias of their noise in the coefficients; too much of it biases estimates.
        """
        texts = []
        for what, own in (('joints', slice(0, 2)), ('odometry', slice(2, 6))):
            each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.contradicted, strict=True)
            replaced = [
                f'{name.replace("_", " ")} {_wrong(found / declared)}: {found:.2g} {unit} is used, not {declared:.2g}'
                for name, unit, declared, found, wrong in list(each)[own]
                if wrong
            ]
            texts += [f'the declared noise of the {what} is wrong: {"; ".join(replaced)}'] if replaced else []
        declared, found = float(self.declared[0]), max(float(self.estimated[0]), float(TYPICAL[0]))
        if self.used[0] or not declared > _FAR_TOO_LARGE * found:
            return texts
        texts.append(
            f'noise.joint_position is {declared:.2g} rad, the readings scatter by {self.estimated[0]:.2g}: estimates '
            'may be biased by more than their intervals; declare the noise of the joints, or set noise.estimate'
        )
        return texts

    def rows(self) -> list[tuple[str, str, str]]:
        """Return name and unit of each sensor, and its declared and found level, the one in use first."""
        each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.assumed, self.used, strict=True)
        rows = []
        for name, unit, declared, found, assumed, used in each:
            both = [(declared, 'declared'), (found, 'found')]
            every = [*(both[::-1] if used else both), (assumed, 'assumed')]
            known = [f'{value:.2g} {how}' for value, how in every if np.isfinite(value)]
            rows.append((name.replace('_', ' '), unit, ', '.join(known)))
        return rows

    def differences(self) -> list[str]:
        """Return a line for each sensor whose noise is not as declared."""
        lines = []
        each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.used, strict=True)
        for name, unit, declared, found, used in each:
            ratio = found / declared
            if np.isnan(ratio) or 1.0 / _WRONG < ratio < _WRONG:
                continue
            use = '; the data are used' if used else ''
            value = f'your noise value, {declared:.2g} {unit}, is {_wrong(ratio)}'
            lines.append(f'{name.replace("_", " ")}: {value}: {found:.2g} {unit} in the data{use}')
        if found_alone := self._undeclared(self.estimated):
            lines.append(f'no noise is declared for {listing(found_alone)}: estimated from the data')
        if assumed := self._undeclared(self.assumed):
            lines.append(f'no noise is declared for {listing(assumed)}, and the data do not determine it: assumed')
        for what, time in (('pose', self.correlation_time), ('twist', self.twist_correlation_time)):
            if time > 0.0:
                lines.append(f'the errors of the base {what} are taken to be correlated over {time:.2g} s')
        return lines

    def _undeclared(self, known: Array) -> list[str]:
        """Return known levels (6,) of undeclared sensors in words."""
        return [
            f'{name.replace("_", " ")} ({value:.2g} {unit})'
            for name, unit, declared, value in zip(CHANNELS, UNITS, self.declared, known, strict=True)
            if np.isnan(declared) and not np.isnan(value)
        ]


def _wrong(ratio: float) -> str:
    return f'{ratio:.2g} times too small' if ratio > 1.0 else f'{1.0 / ratio:.2g} times too large'
