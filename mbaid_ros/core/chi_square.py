"""The chi-square distribution, for sums of squared normalised residuals."""

from __future__ import annotations

from functools import lru_cache

from scipy.special import chdtri


@lru_cache(maxsize=1024)  # asked for many times a window, of few degrees
def limit(chance: float, degrees: int) -> float:
    """Return the value that a chi-square variable of some degrees of freedom exceeds with a given probability."""
    return float(chdtri(degrees, chance))
