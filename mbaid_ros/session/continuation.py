"""The run that another one continues, in the JSON of `replay`."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros import limits
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.filter.posterior import Continuation
from mbaid_ros.errors import ParameterError
from mbaid_ros.files import parse_json, read_text
from mbaid_ros.parameters import shown, values_of

_ACCEPTED = 'accepted: the JSON of one run of replay that reached an estimate with method trajectory'
# Parameters that give the unknowns' numbers their meaning: both runs need the same.
_SHARED = (
    *('base_link', 'target_', 'known_', 'odometry', 'marker.', 'flexible.', 'wheels.', 'thrust.', 'orbit.'),
    *('imu.', 'gyros.', 'poses.', 'disturbance.', 'time_offset.', 'momentum.'),
)
_CALIBRATION = 'known_links.calibration'  # a path, of a file that may have changed


def continuation_as_json(left: Continuation, urdf: str, calibration: str = '') -> dict[str, Any]:
    """Return the posterior of a run as JSON for the next one; of that run the robot, and its path of a calibration."""
    return {
        'robot': _digest(urdf.encode()),
        **({'calibration': _content(calibration)} if calibration else {}),
        'planar': left.planar,
        'root': [row[place:] for place, row in enumerate(left.root.tolist())],  # the rest of a triangle is zero
        'bias': left.bias.tolist(),
    }


def read_continuation(config: EstimatorConfig, urdf: str) -> Continuation | None:
    """Return the run that the parameters name; None where they name none.

    Raises ParameterError: The file cannot be read, holds no such run, or one of another robot or other parameters.
    """
    path = config.continue_from
    if not path:
        return None
    try:
        content = parse_json(read_text(path, 'result', limits.JSON_CHARACTERS, _ACCEPTED))
        state, given = content['continuation'], content['made_by']['parameters']
        if state['robot'] != _digest(urdf.encode()):
            raise ParameterError(f"'{path}' is of another robot description; accepted: a result with the same")
        own = {name: _plain(value) for name, value in values_of(config).items()}
        for name in [each for each in dict.fromkeys((*own, *given)) if each.startswith(_SHARED)]:
            # Those of a joint, link or sensor stand there only where they are given.
            known = name in own and name in given
            if known and name == _CALIBRATION and own[name] and given[name]:
                continue  # by its contents
            if own[name] != given[name] if known else name.count('.') > 1:
                before, now = (shown(each[name]) if name in each else 'not set' for each in (given, own))
                raise ParameterError(f"'{path}' was made with {name} {before}, this run has {now}; accepted: the same")
        if config.known_links.calibration and state.get('calibration') != _content(config.known_links.calibration):
            raise ParameterError(
                f"'{path}' was made with a {_CALIBRATION} of other contents than "
                f"'{config.known_links.calibration}'; accepted: the same file"
            )
        count = len(state['root'])
        root = np.array([[0.0] * place + list(row) for place, row in enumerate(state['root'])], dtype=float)
        bias = np.array(state['bias'], dtype=float)
        if root.shape != (count, count + 1) or not np.all(np.diag(root)) or not np.all(np.abs(root) < limits.QUANTITY):
            raise ValueError('its root is no triangle')
        if bias.shape != (len(bias), len(bias) + 1) or not np.all(np.abs(bias) < limits.QUANTITY):
            raise ValueError('its bias is none')
        return Continuation(bool(state['planar']), root, bias)
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        reason = f'it lacks {error}' if isinstance(error, KeyError) else ' '.join(str(error).split())
        raise ParameterError(f"'{path}' cannot be continued: {reason}; {_ACCEPTED}") from error


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def _content(calibration: str) -> str:
    """Return what identifies the contents of a file; none if they cannot be read, or there is no path."""
    try:
        return _digest(Path(calibration).read_bytes()) if calibration else ''
    except OSError:
        return ''


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
