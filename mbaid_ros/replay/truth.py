"""The true parameters of a simulated run, as `simulate` writes them beside the bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.files import parse_json, read_text

TRUTH_FILE = 'truth.json'
_ACCEPTED = 'accepted: a JSON object with target_link, mass, com and inertia, as simulate writes it'


@dataclass(frozen=True)
class Truth:
    """What is to be found.

    Attributes
    ----------
    path : the file
    target_link : link the parameters belong to
    parameters : (10,) in the order of PARAMETERS
    momentum : (6,) total momentum in the odometry frame; NaN where not told
    problem : why the file says nothing, empty where it does
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
    """Return the truth that lies in a bag's folder, None if there is none.

    Files of that name may be anything: one that cannot be used is no error here, and says so.
    """
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

    Raises
    ------
    DataError
        It cannot be read or is no truth.
    """
    text = read_text(path, 'truth', limits.TRUTH_CHARACTERS, _ACCEPTED, DataError)
    try:
        content = parse_json(text)
    except ValueError as error:
        raise DataError(f"truth '{path}' is not JSON: {error}; {_ACCEPTED}") from error
    try:
        return _truth(str(path), content)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise DataError(f"truth '{path}' cannot be used ({type(error).__name__}: {error}); {_ACCEPTED}") from error


def _truth(path: str, content: Any) -> Truth:
    if not isinstance(content, dict):
        raise TypeError('it is no object of JSON')
    inertia = [float(_object(content['inertia'], 'inertia')[name]) for name in PARAMETERS[4:]]
    momentum = _object(content.get('momentum') or {}, 'momentum')
    nothing = [np.nan] * 3
    total = [*_three(momentum.get('linear', nothing), 'linear'), *_three(momentum.get('angular', nothing), 'angular')]
    parameters = np.array([float(content['mass']), *_three(content['com'], 'com'), *inertia])
    if not np.all(np.isfinite(parameters)):
        raise ValueError('a parameter is not finite')
    link = content['target_link']
    if not isinstance(link, str):
        raise TypeError('target_link is no string')
    return Truth(path, link, parameters, np.array(total))


def _object(value: Any, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise TypeError(f'{name} is no object of JSON')
    return value


def _three(value: Any, name: str) -> list[float]:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f'{name} is no list of 3 numbers')
    return [float(number) for number in value]
