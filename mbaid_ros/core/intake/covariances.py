"""Covariances as messages carry them: often not set, sometimes not usable."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mbaid_ros.core.geometry import Array

# Variances that a sensor may declare, SI units: none is as small or large, and products keep their digits.
_SMALLEST, _LARGEST = 1e-24, 1e12


class Usable(NamedTuple):
    """A covariance that can weight data.

    Attributes
    ----------
    matrix : (6, 6)
    own : whether its linear and its angular block are as given
    wrong : whether something is given that is not used: zeros are what is not set
    """

    matrix: Array
    own: tuple[bool, bool]
    wrong: bool


def usable_covariance(given: Array, default: Array) -> Usable:
    """Return a covariance that can weight data from one (6, 6) that may be unset.

    A block (linear or angular) that is not finite, symmetric, of a real size and positive definite is replaced by the
    default's, and the correlation between the two is then left out.
    """
    if _is_covariance(given):
        return Usable(given, (True, True), wrong=False)
    used, kept = default.copy(), np.zeros((6, 6))
    blocks = slice(0, 3), slice(3, 6)
    linear, angular = (_is_covariance(given[block, block]) for block in blocks)
    for block, good in zip(blocks, (linear, angular), strict=True):
        if good:
            used[block, block] = kept[block, block] = given[block, block]
    return Usable(used, (linear, angular), wrong=not np.array_equal(kept, given))


def _is_covariance(matrix: Array) -> bool:
    if not np.all(np.isfinite(matrix)) or np.max(np.abs(matrix)) > _LARGEST:
        return False
    scale = np.sqrt(np.abs(np.diag(matrix)))
    if np.any(np.diag(matrix) < _SMALLEST):
        return False
    correlation = matrix / scale / scale[:, None]
    if np.max(np.abs(correlation - correlation.T)) > 1e-6:
        return False
    return bool(np.linalg.eigvalsh(correlation)[0] > 1e-9)
