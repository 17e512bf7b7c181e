"""An identified body as files carry it: the JSON of `replay`, or a bag of estimates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros import limits
from mbaid_ros.bags import BagReader
from mbaid_ros.core.errors import DataError, ParameterError, listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import contradiction
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.files import parse_json, read_text

ESTIMATE_TYPE = 'mbaid_msgs/msg/InertiaEstimate'
_DEBRIS = '/debris'  # end of the name of the topic with the captured body alone
_TOLD = 'accepted: results of a run with debris.report: true that determined all ten parameters'
_ACCEPTED = 'accepted: what replay --json writes, or a bag that holds estimates'


@dataclass(frozen=True)
class Identified:
    """A body.

    Attributes
    ----------
    link : whose frame the parameters are in
    status : of the estimate
    parameters : (10,) in the order of PARAMETERS, NaN where not determined
    covariance : (10, 10) of them; NaN where not known
    warnings : of the estimate
    notes : what to know of the file, one line each
    """

    link: str
    status: str
    parameters: Array
    covariance: Array
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the model: the numbers must not be trusted, or have been withheld."""
        return contradiction(self.status, self.warnings)

    @property
    def missing(self) -> list[str]:
        """Names of the parameters that are not determined."""
        return [name for name, value in zip(PARAMETERS, self.parameters, strict=True) if math.isnan(value)]


def read_identified(path: str, result: int = 1, topic: str = '', *, alone: bool = False) -> Identified:
    """Return the body in a file.

    Parameters
    ----------
    path : JSON of `replay`, or a bag
    result : which one, counted from 1, of a file with several
    topic : of a bag with estimates on several
    alone : the captured body without the link that holds it

    Raises
    ------
    DataError
        The file cannot be read or holds no such body, or one of a size that none has.
    ParameterError
        A topic is given, and the file is no bag.
    """
    json = Path(path).suffix.lower() == '.json'
    if json and topic:
        raise ParameterError(f"--topic {topic} is for a bag, which '{path}' is not")
    body = _from_json_file(path, result, alone=alone) if json else _from_bag(path, topic, alone=alone)
    largest = np.max(np.abs(body.parameters), initial=0.0, where=~np.isnan(body.parameters))
    if largest > limits.QUANTITY:
        raise DataError(f"'{path}' holds a body with {largest:g}; at most {limits.QUANTITY:g} is accepted")
    return body


def _from_json_file(path: str, result: int, *, alone: bool) -> Identified:
    text = read_text(path, 'results', limits.JSON_CHARACTERS, _ACCEPTED, DataError)
    try:
        content = parse_json(text)
    except ValueError as error:
        raise DataError(f"'{path}' is not JSON: {error}; {_ACCEPTED}") from error
    if isinstance(content, dict) and 'odometry_mount' in content and 'estimate' not in content:
        raise DataError(f"'{path}' is a calibration, whose URDF calibrate --output writes; {_ACCEPTED}")
    results = content if isinstance(content, list) else [content]
    if not 1 <= result <= len(results):
        raise DataError(f"'{path}' holds {len(results)} results; result {result} is not among them")
    try:
        if alone:
            return _debris_from_json(results[result - 1], path)
        return _from_json(results[result - 1])
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise DataError(f"'{path}' cannot be used ({type(error).__name__}: {error}); {_ACCEPTED}") from error


def _debris_from_json(content: Any, path: str) -> Identified:
    found = content['debris']
    if found is None:
        raise DataError(f"'{path}' holds no captured body alone; {_TOLD}")
    covariance = _covariance(found.get('covariance'), found.get('std'))
    link, status = str(found['frame']['name']), str(content['status'])
    return Identified(link, status, _ten(found), covariance, _warnings(content))


def _from_json(content: Any) -> Identified:
    covariance = _covariance(content.get('covariance'), content.get('std'))
    link, status = str(content['target_link']), str(content['status'])
    return Identified(link, status, _ten(content['estimate']), covariance, _warnings(content))


def _warnings(content: Any) -> tuple[str, ...]:
    return tuple(map(str, content.get('warnings', ())))


def _covariance(covariance: Any, std: Any) -> Array:
    """Return the (10, 10) covariance, of standard deviations alone where there is no more."""
    if covariance is not None:
        matrix = np.array([[_number(value) for value in row] for row in covariance])
    elif std is not None:
        matrix = np.diag(_ten(std) ** 2)
    else:
        matrix = np.full((10, 10), np.nan)
    if matrix.shape != (10, 10):
        raise ValueError(f'covariance has the shape {matrix.shape}')
    return matrix


def _ten(shaped: Any) -> Array:
    """Return the ten numbers of mass, com and inertia."""
    com = list(shaped['com'])
    if len(com) != 3:
        raise ValueError(f'com has {len(com)} numbers')
    return np.array([_number(v) for v in (shaped['mass'], *com, *(shaped['inertia'][name] for name in PARAMETERS[4:]))])


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _from_bag(path: str, topic: str, *, alone: bool) -> Identified:
    with BagReader(path) as bag:
        estimates = [each.name for each in bag.topics.values() if each.type == ESTIMATE_TYPE]
        names = [name for name in estimates if name.endswith(_DEBRIS) == alone]
        if alone and estimates and not names:
            raise DataError(f"bag '{path}' holds no captured body alone; {_TOLD}")
        if not names:
            raise DataError(
                f"bag '{path}' holds no estimates ({ESTIMATE_TYPE}); topics: {listing(bag.topics)}; "
                'replay it with --json, and export that'
            )
        if topic and topic not in names:
            raise DataError(f"bag '{path}' holds no estimates on '{topic}'; accepted: {listing(sorted(names))}")
        if not topic and len(names) > 1:
            raise DataError(
                f"bag '{path}' holds estimates on several topics: {listing(sorted(names))}; choose one with --topic"
            )
        topic = topic or names[0]
        last = None
        for _, message, _ in bag.read([topic]):
            last = message
        notes = tuple(bag.warnings)
    if last is None:
        raise DataError('; '.join([f"bag '{path}' holds no estimate on {topic}", *notes]))
    inertia = last.inertia
    values = (inertia.m, inertia.com.x, inertia.com.y, inertia.com.z, *(getattr(inertia, n) for n in PARAMETERS[4:]))
    known = np.asarray(last.identifiable, dtype=bool)
    parameters = np.where(known, np.array(values, dtype=float), np.nan)
    covariance = np.array(last.covariance, dtype=float).reshape(10, 10)
    return Identified(last.header.frame_id, last.status, parameters, covariance, tuple(last.warnings), notes)
