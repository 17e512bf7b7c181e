"""Where a plan begins: the end of a run, as a result or its bag has it."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbaid_ros import limits
from mbaid_ros.cli import warn
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file, parse_assignment
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import DataError, ParameterError
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.files import parse_json, read_text
from mbaid_ros.replay.feed import progress_bar
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.provenance import sha256
from mbaid_ros.replay.run import replay_bag
from mbaid_ros.session import from_numbers
from mbaid_ros.session.robot import Robot

_ACCEPTED = 'accepted: what replay --json writes, or a bag'
_OF_THE_FILES = ('robot_description_file',)


@dataclass(frozen=True)
class Begin:
    """The end of a run.

    Attributes
    ----------
    config : parameters, with those of the plan
    urdf : of its robot
    status : of the run
    knowledge : what it came to know
    """

    config: EstimatorConfig
    urdf: str
    status: str
    knowledge: Posterior


def read_begin(arguments: argparse.Namespace, urdf: str) -> Begin:
    """Return where a plan begins; what is to know of a bag is told on stderr.

    Raises
    ------
    DataError, ModelError, ParameterError
        The run, the robot or a parameter cannot be used.
    """
    path = arguments.start
    if Path(path).suffix.lower() != '.json':
        config = build(EstimatorConfig, _given(arguments))
        with progress_bar(path) as progress:
            run = replay_bag(path, config, urdf, Inputs.of(arguments, config), progress=progress)
        warn('plan', run.warnings)
        return _begin(path, config, urdf, run.final.status, run.state)
    content = _content(path)
    made = content.get('made_by') or {}
    _require_the_robot(path, made, arguments.model)
    values = _given(arguments)
    if not arguments.params:
        values = {**{k: v for k, v in made.get('parameters', {}).items() if k not in _OF_THE_FILES}, **values}
    target = values.get('target_link')
    if target and target != content.get('target_link'):
        raise ParameterError(
            f"parameter 'target_link' is '{str(target)[:60]}', and '{path}' tells of '{content.get('target_link')}'; "
            'accepted: that one, or a result of the other'
        )
    return _begin(path, build(EstimatorConfig, values), urdf, str(content.get('status')), content.get('state'))


def _require_the_robot(path: str, made: dict[str, Any], model: str) -> None:
    """Refuse another robot description than the one a result was made with."""
    robot = made.get('robot') or {}
    if robot.get('sha256') and Path(model).is_file() and robot['sha256'] != sha256(Path(model)):
        raise DataError(
            f"'{path}' was made with another robot description, {robot.get('file')}, SHA-256 "
            f'{str(robot["sha256"])[:12]}...; accepted: that very file'
        )


def _given(arguments: argparse.Namespace) -> dict[str, object]:
    values = load_parameter_file(arguments.params, 'estimator') if arguments.params else {}
    return values | dict(map(parse_assignment, arguments.assignments))


def _content(path: str) -> dict[str, Any]:
    text = read_text(path, 'result', limits.JSON_CHARACTERS, _ACCEPTED, DataError)
    try:
        content = parse_json(text)
    except ValueError as error:
        raise DataError(f"'{path}' is not JSON: {error}; {_ACCEPTED}") from error
    if isinstance(content, list) and len(content) == 1:
        content = content[0]
    if not isinstance(content, dict) or 'status' not in content:
        raise DataError(f"'{path}' is no result of one run; {_ACCEPTED}")
    return content


def _begin(path: str, config: EstimatorConfig, urdf: str, status: str, state: Any) -> Begin:
    """Return the begin of a state as JSON has it."""
    if config.calibration.enabled:
        raise ParameterError(
            "parameter 'calibration.enabled' is true: what such a run learns of the robot is not in its result; "
            'accepted: false, or the service ~/plan of the estimator'
        )
    if not state:
        raise DataError(
            f"'{path}' tells no state to plan from: method trajectory has to have come to a solution (status {status})"
        )
    kernel = Robot(config, urdf).kernel
    try:
        return Begin(config, urdf, status, from_numbers(state, config, kernel))
    except DataError as error:
        raise DataError(f"'{path}': {error}") from error
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise DataError(f"'{path}' cannot be used ({type(error).__name__}: {error}); {_ACCEPTED}") from error
