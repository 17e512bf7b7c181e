"""The origin of a result: command, version, date and robot description."""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mbaid_ros.core.robot.urdf_document import parse_document


def made_by(executable: str, argv: Sequence[str], model: str, urdf: str) -> dict[str, Any]:
    """Return the origin of the results of a command, now, as scripts read it.

    It has the version of mbaid_ros, the command as a shell takes it, the date (ISO 8601, UTC), and the robot: name,
    path as the user gave it, and SHA-256 of the file's bytes.
    """
    return {
        'version': version('mbaid_ros'),
        'command': shlex.join(('ros2', 'run', 'mbaid_ros', executable, *argv)),
        'date': datetime.now(timezone.utc).isoformat(timespec='seconds'),
        'robot': {'name': parse_document(urdf).get('name', ''), 'file': model, 'sha256': sha256_of(model, urdf)},
    }


def sha256_of(model: str, urdf: str) -> str:
    """Return the SHA-256 of a robot description's file; of its text where that is a pipe."""
    path = Path(model)
    return hashlib.sha256(path.read_bytes() if path.is_file() else urdf.encode()).hexdigest()


def in_words(made: Mapping[str, Any]) -> list[str]:
    """Return the origin of a result, a line each."""
    robot = made['robot']
    return [
        f'mbaid_ros {made["version"]}, {made["date"]}: {made["command"]}',
        f'Robot {robot["name"]}, {robot["file"]}: SHA-256 {robot["sha256"]}',
    ]
