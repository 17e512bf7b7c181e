"""The file in which `calibrate` says what it has found: read back for what comes after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.geometry import Array
from mbaid_ros.files import parse_json, read_text

_ACCEPTED = 'accepted: what calibrate --json writes'
# Parts of the largest variance (all parameters in units of their own deviation) that rounding may make negative.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class CalibratedLinks:
    """What a calibration found of k links.

    Attributes
    ----------
    path : of the file
    names : of the links
    values, covariance : (10 k,), (10 k, 10 k) standard parameters (m, h, I_o), each link's in its own frame
    """

    path: str
    names: tuple[str, ...]
    values: Array
    covariance: Array


def read_calibration(path: str) -> CalibratedLinks:
    """Return the calibration in a file.

    Raises
    ------
    ParameterError
        The file cannot be read, or is none that `calibrate` writes.
    """
    text = read_text(path, 'calibration', limits.JSON_CHARACTERS, _ACCEPTED)
    try:
        return _read(path, text)
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        reason = f'it lacks {error}' if isinstance(error, KeyError) else ' '.join(str(error).split())
        raise ParameterError(f"'{path}' is no calibration: {reason}; {_ACCEPTED}") from error


def _read(path: str, text: str) -> CalibratedLinks:
    content = parse_json(text)
    if not isinstance(content, dict):
        raise TypeError('it is no object of JSON')
    if content.get('status') == 'inconsistent':
        raise ParameterError(
            f"calibration '{path}' must not be trusted, for its data contradict the model; "
            "accepted: one with the status 'calibrated'"
        )
    names = tuple(content['links'])
    if not all(isinstance(name, str) for name in names):
        raise TypeError('the names of its links are no strings')
    values, covariance = (np.array(content['covariance'][key], dtype=float) for key in ('values', 'matrix'))
    size = 10 * len(names)
    if values.shape != (size,) or covariance.shape != (size, size):
        raise ValueError(
            f'values and covariance of {len(names)} links have the shapes {values.shape}, {covariance.shape}'
        )
    if not np.all(np.isfinite(values)) or not _is_covariance(covariance):
        raise ValueError('its matrix is no covariance')
    return CalibratedLinks(path, names, values, covariance)


def _is_covariance(matrix: Array) -> bool:
    if not np.all(np.isfinite(matrix)) or np.any(np.diag(matrix) < 0.0):
        return False
    size = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    scaled = matrix / size / size[:, None]
    symmetric = np.allclose(scaled, scaled.T, rtol=0.0, atol=_ROUNDING)
    return bool(symmetric and np.linalg.eigvalsh(scaled)[0] > -_ROUNDING * len(scaled))
