"""Motions of the joints from files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mbaid_ros.config.parameter_files import read_yaml
from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import DataError, ParameterError
from mbaid_ros.joint_trajectory import JointTrajectory

_ACCEPTED = 'accepted: a trajectory_msgs/JointTrajectory in YAML, as plan --yaml writes it'


def read_trajectory(path: str | Path) -> JointTrajectory:
    """Return the motion in a file.

    Raises ParameterError: The file cannot be read, or holds no motion.
    """
    content = read_yaml(path, 'joint trajectory')
    try:
        return _read(content)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        reason = f'it lacks {error}' if isinstance(error, KeyError) else ' '.join(str(error).split())
        raise ParameterError(f"'{path}' is no joint trajectory: {reason}; {_ACCEPTED}") from error
    except DataError as error:
        raise ParameterError(f"'{path}': {error}") from error


def _read(content: Any) -> JointTrajectory:
    if not isinstance(content, dict):
        raise TypeError('it is no mapping')
    joints = content['joint_names']
    if not isinstance(joints, list) or not all(isinstance(name, str) for name in joints):
        raise TypeError('joint_names are no strings')
    points = content['points']
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise TypeError('points are no list of mappings')
    starts = [point['time_from_start'] for point in points]
    time = np.array([int(each['sec']) + 1e-9 * int(each.get('nanosec', 0)) for each in starts])
    names = ('positions', 'velocities', 'accelerations')
    return JointTrajectory(tuple(joints), time, *(_numbers(points, name, name == 'positions') for name in names))


def _numbers(points: list[dict[str, Any]], name: str, required: bool) -> Array:  # noqa: FBT001 - passed by name
    given = [point.get(name) or [] for point in points]
    if not required and not any(given):
        return np.zeros((0, 0))
    if len({len(each) for each in given}) > 1:
        raise ValueError(f'its points have different numbers of {name}')
    return np.array(given, dtype=float).reshape(len(points), -1)


def as_yaml(trajectory: JointTrajectory) -> str:
    """Return a motion as such a file, to the last bit of its numbers."""
    parts = {
        'positions': trajectory.position,
        'velocities': trajectory.velocity,
        'accelerations': trajectory.acceleration,
    }
    points = []
    for place, time in enumerate(trajectory.time.tolist()):
        seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
        numbers = {name: part[place].tolist() for name, part in parts.items() if part.size}
        points.append({**numbers, 'time_from_start': {'sec': seconds, 'nanosec': nanoseconds}})
    header = {'stamp': {'sec': 0, 'nanosec': 0}, 'frame_id': ''}
    content = {'header': header, 'joint_names': list(trajectory.joints), 'points': points}
    text: str = yaml.safe_dump(content, default_flow_style=None, sort_keys=False, width=math.inf)
    return f'# trajectory_msgs/msg/JointTrajectory, as ros2 topic pub takes it: ... "$(cat FILE)"\n{text}'
