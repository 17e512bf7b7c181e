"""By which command, and from which files, a result was made: enough to make it again."""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from mbaid_ros.core.robot.urdf_document import parse_document
from mbaid_ros.replay.versions import version_of

LARGEST_HASHED = 1_000_000_000  # bytes; more would take longer to read twice than a result is worth waiting for
_DATA = ('.mcap', '.db3')  # files of a bag's folder that hold messages
_BLOCK = 1 << 20


@dataclass(frozen=True)
class RobotFile:
    """A robot description.

    Attributes
    ----------
    name : of the robot in it
    file : path as the user gave it
    sha256 : of its bytes, hexadecimal
    """

    name: str
    file: str
    sha256: str


@dataclass(frozen=True)
class MadeBy:
    """What a result was made by.

    Attributes
    ----------
    version : of mbaid_ros
    command : as a shell takes it
    date : ISO 8601, UTC
    robot : RobotFile
    """

    version: str
    command: str
    date: str
    robot: RobotFile


def made_by(executable: str, argv: Sequence[str], model: str, urdf: str) -> MadeBy:
    """Return what the results of this command, now, are made by.

    Parameters
    ----------
    executable, argv : the command
    model : path of the robot description
    urdf : its text: of a pipe, which can be read but once, what there is
    """
    path = Path(model)
    found = sha256(path) if path.is_file() else hashlib.sha256(urdf.encode()).hexdigest()
    return MadeBy(
        version=version_of('mbaid_ros'),
        command=shlex.join(('ros2', 'run', 'mbaid_ros', executable, *argv)),
        date=datetime.now(timezone.utc).isoformat(timespec='seconds'),
        robot=RobotFile(parse_document(urdf).get('name', ''), model, found),
    )


def hashes(bag: str) -> dict[str, str | None]:
    """Return the SHA-256 of each file of a bag that holds messages, by its name; None for more than LARGEST_HASHED."""
    path = Path(bag)
    files = sorted(each for each in path.iterdir() if each.suffix in _DATA) if path.is_dir() else [path]
    if sum(file.stat().st_size for file in files) > LARGEST_HASHED:
        return {file.name: None for file in files}
    return {file.name: sha256(file) for file in files}


def sha256(file: Path) -> str:
    """Return the SHA-256 of a file's bytes, which are never in memory all at once."""
    found = hashlib.sha256()
    with file.open('rb') as content:
        while block := content.read(_BLOCK):
            found.update(block)
    return found.hexdigest()


def as_json(made: MadeBy, parameters: Mapping[str, object], files: Mapping[str, str | None]) -> dict[str, Any]:
    """Return what a result was made by, with every parameter and the files of its bag, as scripts read it."""
    return {**asdict(made), 'parameters': dict(parameters), 'bag_sha256': dict(files)}


def in_words(made: MadeBy) -> list[str]:
    """Return what a result was made by, a line each."""
    robot = made.robot
    return [
        f'mbaid_ros {made.version}, {made.date}: {made.command}',
        f'Robot {robot.name}, {robot.file}: SHA-256 {robot.sha256}',
    ]


def files_in_words(bag: str, files: Mapping[str, str | None]) -> list[str]:
    """Return what tells the files of a bag from others, a line each."""
    return [f'{bag}, {name}: {_hash_in_words(found)}' for name, found in files.items()]


def _hash_in_words(found: str | None) -> str:
    return f'SHA-256 {found}' if found else f'SHA-256 not taken, for the bag is larger than {LARGEST_HASHED / 1e9:g} GB'
