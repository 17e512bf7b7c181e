"""The chi-square distribution: what a sum of squared normalised residuals is compared with."""

from __future__ import annotations

from functools import lru_cache

from scipy.special import chdtri


@lru_cache(maxsize=1024)  # asked for many times a window, of few degrees
def limit(chance: float, degrees: int) -> float:
    """Return what a chi-square variable of some degrees of freedom exceeds by a given chance."""
    return float(chdtri(degrees, chance))
