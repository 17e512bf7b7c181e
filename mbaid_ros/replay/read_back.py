"""Results read back from files: the JSON of `replay`, bags of estimates, and the truth of a simulated run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PARAMETERS, contradiction
from mbaid_ros.errors import DataError, ParameterError, listing
from mbaid_ros.estimate_messages import parameters_of
from mbaid_ros.files import read_json

if TYPE_CHECKING:
    from mbaid_ros.bags import BagReader

TRUTH_FILE = 'truth.json'
ESTIMATE_TYPE = 'mbaid_msgs/msg/InertiaEstimate'
_DEBRIS = '/debris'  # end of the name of the topic with the captured body alone
_DEBRIS_NEEDS = 'accepted: results of a run with debris.report: true that determined all ten parameters'
_ACCEPTED = 'accepted: a file of replay --json, or a bag with estimates'
_ACCEPTED_TRUTH = 'accepted: a JSON object with target_link, mass, com and inertia, as simulate writes it'


@contextmanager
def usable(path: str | Path, accepted: str) -> Iterator[None]:
    """Turn an error that a value of another shape leads to into a DataError that names the file."""
    try:
        yield
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise DataError(f"'{path}' cannot be used ({type(error).__name__}: {error}); {accepted}") from error


@dataclass(frozen=True)
class Truth:
    """The true parameters (10,) of a link and total momentum (6,) in the odometry frame, NaN where it is not known.

    `problem` is the reason why the file cannot be used, empty where it can.
    """

    path: str
    target_link: str
    parameters: Array
    momentum: Array
    problem: str = ''

    def why_not(self, target_link: str) -> str:
        """Return why an estimate of a link cannot be compared with it; empty if it can."""
        if self.problem or self.target_link == target_link:
            return self.problem
        return f"{self.path} is about link '{self.target_link}', not '{target_link}': not compared"


def truth_beside(bag: str) -> Truth | None:
    """Return the truth in a bag's folder, None if there is none; a file that cannot be used is no error, but named."""
    path = Path(bag)
    file = (path if path.is_dir() else path.parent) / TRUTH_FILE
    if not file.is_file():
        return None
    try:
        return read_truth(file)
    except DataError as error:
        return Truth(str(file), '', np.full(10, np.nan), np.full(6, np.nan), str(error))


def read_truth(path: str | Path) -> Truth:
    """Return the truth in a file.

    Raises DataError: It cannot be read or is no truth.
    """
    content = read_json(path, 'truth', limits.TRUTH_CHARACTERS, _ACCEPTED_TRUTH)
    with usable(path, _ACCEPTED_TRUTH):
        parameters = _ten(_object(content, 'it'))
        momentum = _object(content.get('momentum') or {}, 'momentum')
        parts = [_three(momentum.get(part, [math.nan] * 3), part) for part in ('linear', 'angular')]
        if not np.all(np.isfinite(parameters)):
            raise ValueError('a parameter is not finite')
        if not isinstance(content['target_link'], str):
            raise TypeError('target_link is no string')
        return Truth(str(path), content['target_link'], parameters, np.array(parts, dtype=float).ravel())


def _object(value: Any, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise TypeError(f'{name} is no object of JSON')
    return value


def _three(value: Any, name: str) -> list[Any]:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f'{name} is no list of 3 numbers')
    return value


def _ten(content: Any) -> Array:
    """Return the ten numbers of mass, com and inertia, NaN for None."""
    inertia = _object(content['inertia'], 'inertia')
    ten = (content['mass'], *_three(content['com'], 'com'), *(inertia[name] for name in PARAMETERS[4:]))
    return np.array(list(map(_number, ten)))


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


@dataclass(frozen=True)
class Identified:
    """An identified body: parameters (10,) in the link's frame and covariance (10, 10), NaN where not known.

    The warnings are the estimate's, the notes are about the file.
    """

    link: str
    status: str
    parameters: Array
    covariance: Array
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()
    # robot_sha256, base_link: of the robot description that it was made with; empty where not known, or the root
    robot_sha256: str = ''
    base_link: str = ''
    date: str = ''  # ISO 8601, of the last estimate in a bag or of a JSON file's making; empty where not known

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the model: the numbers must not be trusted, or have been withheld."""
        return contradiction(self.status, self.warnings)

    @property
    def missing(self) -> list[str]:
        """Names of the parameters that are not determined."""
        return [name for name, value in zip(PARAMETERS, self.parameters, strict=True) if math.isnan(value)]


def read_identified(path: str, result: int = 1, topic: str = '', *, alone: bool = False) -> Identified:
    """Return the body in JSON of `replay` (one of its results, counted from 1) or in a bag (on one of its topics).

    With `alone` it is the captured body without the link that holds it.

    Raises DataError: The file cannot be read or holds no such body, or one of a size that none has.
    Raises ParameterError: A topic is given, and the file is no bag.
    """
    json = Path(path).suffix.lower() == '.json'
    if json and topic:
        raise ParameterError(f"--topic {topic} is for a bag, which '{path}' is not")
    body = _from_json_file(path, result, alone=alone) if json else _from_bag(path, topic, alone=alone)
    largest = np.max(np.abs(body.parameters), initial=0.0, where=~np.isnan(body.parameters))
    if largest > limits.QUANTITY:
        raise DataError(f"'{path}' contains a body with {largest:g}; at most {limits.QUANTITY:g} is accepted")
    return body


def _from_json_file(path: str, result: int, *, alone: bool) -> Identified:
    content = read_json(path, 'results', limits.JSON_CHARACTERS, _ACCEPTED)
    if isinstance(content, dict) and 'odometry_mount' in content and 'estimate' not in content:
        raise DataError(f"'{path}' is a calibration, whose URDF calibrate --output writes; {_ACCEPTED}")
    results = content if isinstance(content, list) else [content]
    if not 1 <= result <= len(results):
        raise DataError(f"'{path}' contains {len(results)} results; result {result} is not among them")
    chosen = results[result - 1]
    with usable(path, _ACCEPTED):
        body = chosen['debris'] if alone else chosen
        if body is None:
            raise DataError(f"'{path}' contains no captured body alone; {_DEBRIS_NEEDS}")
        covariance = _covariance(body.get('covariance'), body.get('std'))
        link = str(chosen['target_link'])
        parameters = _ten(body if alone else body['estimate'])
        warnings = tuple(map(str, chosen.get('warnings', ())))
        made = chosen.get('made_by') or {'robot': {'sha256': ''}, 'parameters': {}}
        robot, base = str(made['robot']['sha256']), str(made['parameters'].get('base_link', ''))
        date = _date(str(made.get('date', '')))
        return Identified(link, str(chosen['status']), parameters, covariance, warnings, (), robot, base, date)


def _date(text: str) -> str:
    """Return a date if it is one; raise a ValueError otherwise."""
    return datetime.fromisoformat(text).isoformat() if text else ''


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


def _from_bag(path: str, topic: str, *, alone: bool) -> Identified:
    """Return the last estimate in a bag."""
    from mbaid_ros.bags import BagReader  # noqa: PLC0415 - results of `identify` need no library for bags

    with BagReader(path) as bag:
        topic = _chosen_topic(bag, path, topic, alone=alone)
        last = None
        for _, message, _ in bag.read([topic]):
            last = message
        notes = tuple(bag.warnings)
    if last is None:
        raise DataError('; '.join([f"bag '{path}' contains no estimate on {topic}", *notes]))
    covariance = np.array(last.covariance, dtype=float).reshape(10, 10)
    stamp = last.header.stamp.sec + 1e-9 * last.header.stamp.nanosec
    date = datetime.fromtimestamp(stamp, timezone.utc).isoformat()
    warnings = tuple(last.warnings)
    return Identified(last.header.frame_id, last.status, parameters_of(last), covariance, warnings, notes, date=date)


def _chosen_topic(bag: BagReader, path: str, topic: str, *, alone: bool) -> str:
    """Return the topic with estimates: the only one, or the one that is asked for."""
    estimates = [each.name for each in bag.topics.values() if each.type == ESTIMATE_TYPE]
    names = sorted(name for name in estimates if name.endswith(_DEBRIS) == alone)
    if alone and estimates and not names:
        raise DataError(f"bag '{path}' contains no captured body alone; {_DEBRIS_NEEDS}")
    if not names:
        raise DataError(
            f"bag '{path}' contains no estimates ({ESTIMATE_TYPE}); topics: {listing(bag.topics)}; "
            'replay it with --json, and export that'
        )
    if topic and topic not in names:
        raise DataError(f"bag '{path}' contains no estimates on '{topic}'; accepted: {listing(names)}")
    if not topic and len(names) > 1:
        raise DataError(f"bag '{path}' contains estimates on several topics: {listing(names)}; choose one with --topic")
    return topic or names[0]
