"""Covariances as messages carry them: often not set, sometimes not usable."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array

_SMALLEST, _LARGEST = 1e-24, 1e12


def usable_covariance(given: Array, default: Array) -> tuple[Array, tuple[bool, bool]]:
    """Return a (6, 6) covariance that can weight data, from one that may be unset, and which blocks are as given.

    A block (linear or angular) that is not finite, symmetric, of a real size and positive definite is replaced by the
    default's, and the correlation between the two is then left out.
    """
    if _is_covariance(given):
        return given, (True, True)
    used = default.copy()
    blocks = slice(0, 3), slice(3, 6)
    linear, angular = (_is_covariance(given[block, block]) for block in blocks)
    for block, good in zip(blocks, (linear, angular), strict=True):
        if good:
            used[block, block] = given[block, block]
    return used, (linear, angular)


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
