"""The file of results that `calibrate` writes and later runs read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros import limits
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.capture import CaptureConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.target import TargetPriorConfig
from mbaid_ros.errors import ParameterError
from mbaid_ros.files import parse_json, read_text
from mbaid_ros.parameters import build, parameter

_ACCEPTED = 'accepted: a file of calibrate --json'
# Parts of the largest variance (all parameters in units of their own deviation) that rounding may make negative.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class CalibrationFile:
    """A calibration of k links, n joints and the odometry's mount."""

    path: str  # of the file
    links: tuple[str, ...]  # names
    joints: tuple[str, ...]  # names
    # values, covariance: (10 k + 6 n + 6,) and squared: standard parameters (m, h, I_o) of the links, each in its own
    # frame; of each joint zero, displacement of its frame (3) and tilts of its axis (2); mount
    values: Array
    covariance: Array
    # positions, rotations: (n, 3), (n, 3, 3) frame of each joint in that of the moving body that carries it
    positions: Array
    rotations: Array


def read_calibration(path: str) -> CalibrationFile:
    """Return the calibration in a file.

    Raises ParameterError: The file cannot be read, or is none that `calibrate` writes.
    """
    text = read_text(path, 'calibration', limits.JSON_CHARACTERS, _ACCEPTED)
    try:
        return _read(path, text)
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        reason = f'it lacks {error}' if isinstance(error, KeyError) else ' '.join(str(error).split())
        raise ParameterError(f"'{path}' is no calibration: {reason}; {_ACCEPTED}") from error


def _read(path: str, text: str) -> CalibrationFile:
    content = parse_json(text)
    if not isinstance(content, dict):
        raise TypeError('it is no object of JSON')
    if content.get('status') == 'inconsistent':
        raise ParameterError(
            f"calibration '{path}' must not be trusted, for its data contradict the model; "
            "accepted: one with the status 'calibrated'"
        )
    links, joints = tuple(content['links']), tuple(content['joints'])
    if not all(isinstance(name, str) for name in (*links, *joints)):
        raise TypeError('the names of its links and joints are no strings')
    values, covariance = (np.array(content['covariance'][key], dtype=float) for key in ('values', 'matrix'))
    size = 10 * len(links) + 6 * len(joints) + 6
    if values.shape != (size,) or covariance.shape != (size, size):
        raise ValueError(
            f'values and covariance of {len(links)} links and {len(joints)} joints have the shapes {values.shape}, '
            f'{covariance.shape}'
        )
    frames = [
        np.array([content['joints'][name][key] for name in joints], dtype=float).reshape(-1, *shape)
        for key, shape in (('position', (3,)), ('rotation', (3, 3)))
    ]
    if not all(len(each) == len(joints) and np.all(np.abs(each) <= limits.LENGTH) for each in frames):
        raise ValueError('position or rotation of a joint is none')
    if not np.all(np.abs(values) <= limits.QUANTITY) or not _is_covariance(covariance):
        raise ValueError('its matrix is no covariance')
    return CalibrationFile(path, links, joints, values, covariance, *frames)


def _is_covariance(matrix: Array) -> bool:
    if not np.all(np.abs(matrix) <= limits.QUANTITY**2) or np.any(np.diag(matrix) < 0.0):
        return False
    size = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    with np.errstate(over='ignore'):  # a covariance with a number without variance
        scaled = matrix / size / size[:, None]
    if not np.all(np.isfinite(scaled)):
        return False
    symmetric = np.allclose(scaled, scaled.T, rtol=0.0, atol=_ROUNDING)
    return bool(symmetric and np.linalg.eigvalsh(scaled)[0] > -_ROUNDING * len(scaled))


NODE = 'calibrate'
_OWN = 'unknown_links'


@dataclass(frozen=True)
class CalibrationConfig:
    """The unknowns to calibrate."""

    unknown_links: tuple[str, ...] = parameter(())
    """Links to calibrate; the others count as known. Empty means every link that has an <inertial>."""


def calibration_parameters(values: Mapping[str, object]) -> tuple[EstimatorConfig, tuple[str, ...]]:
    """Return the parameters of dotted names: the estimator's, and the names of `CalibrationConfig.unknown_links`.

    Those of a run that follows the calibration do not count: target, capture and the calibration itself.

    Raises ParameterError: An unknown name, or a value that is not accepted.
    """
    own = {name: value for name, value in values.items() if name == _OWN}
    estimator = build(EstimatorConfig, {name: value for name, value in values.items() if name not in own})
    estimator = replace(
        estimator,
        known_links=replace(estimator.known_links, calibration=''),
        target_prior=TargetPriorConfig(),
        capture=CaptureConfig(),
    )
    return estimator, build(CalibrationConfig, own).unknown_links
