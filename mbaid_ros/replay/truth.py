"""The true parameters of a simulated run, as `simulate` writes them beside the bag."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PARAMETERS

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
    try:
        content = json.loads(Path(path).read_text(encoding='utf-8'))
    except OSError as error:
        raise DataError(f"cannot read truth '{path}': {error.strerror or error}") from error
    except ValueError as error:
        raise DataError(f"truth '{path}' is not JSON: {error}; {_ACCEPTED}") from error
    try:
        return _truth(str(path), content)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"truth '{path}' cannot be used ({type(error).__name__}: {error}); {_ACCEPTED}") from error


def _truth(path: str, content: Any) -> Truth:
    inertia = [float(content['inertia'][name]) for name in PARAMETERS[4:]]
    com = [float(value) for value in content['com']]
    if len(com) != 3:
        raise ValueError(f'com has {len(com)} numbers')
    momentum = content.get('momentum') or {}
    nothing = [np.nan] * 3
    total = [float(value) for name in ('linear', 'angular') for value in momentum.get(name, nothing)]
    if len(total) != 6:
        raise ValueError(f'momentum has {len(total)} numbers')
    parameters = np.array([float(content['mass']), *com, *inertia])
    if not np.all(np.isfinite(parameters)):
        raise ValueError('a parameter is not finite')
    return Truth(path, str(content['target_link']), parameters, np.array(total))
