"""The ten published parameters, and a 95 % interval as it is printed."""

from __future__ import annotations

import math

# Mass, centre of mass (link frame), inertia about it (link axes).
PARAMETERS = ('mass', 'com_x', 'com_y', 'com_z', 'ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
UNITS = ('kg', 'm', 'm', 'm', *('kg m^2',) * 6)
BAND = 1.96  # standard deviations either side that hold 95 % of a Gaussian
_DIGITS = 2  # of a standard deviation: more would claim to know how well it is known
_MOST_DECIMALS = 7  # written out: more of them, or a number from 1e7 on whose ones are not known, are a power of ten


def rounded(value: float, std: float, unknown: str = '', digits: int = 6) -> tuple[str, str]:
    """Return a value and its 95 % band, both to the decimal of the second significant digit of the standard deviation.

    Parameters
    ----------
    value, std : number and one standard deviation of it; NaN where not known
    unknown : text for a number that is not known
    digits : significant ones of a value whose standard deviation is not known
    """
    if not math.isfinite(value):
        return unknown, unknown
    if not (math.isfinite(std) and std > 0.0):
        return f'{value:.{digits}g}', f'{0.0:g}' if std == 0.0 else unknown
    # As it is printed: 0.0996 has its second digit where 0.10 has it.
    decimals = _DIGITS - 1 - int(f'{std:.{_DIGITS - 1}e}'.partition('e')[2])
    return _with_decimals(value, decimals), _with_decimals(BAND * std, decimals)


def _with_decimals(value: float, decimals: int) -> str:
    kept = round(value, decimals) + 0.0  # no -0.0
    if 0 <= decimals <= _MOST_DECIMALS:
        return f'{kept:.{decimals}f}'
    if not kept or (decimals < 0 and abs(kept) < 1e7):
        return f'{kept:.0f}'
    exponent = math.floor(math.log10(abs(kept)))
    return f'{kept:.{max(exponent + decimals, 0)}e}'
