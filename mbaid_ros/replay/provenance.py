"""The versions of the programs that made a result."""

from __future__ import annotations

import hashlib
import platform
import shlex
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from mbaid_ros.core.robot.urdf import parse_document

_PACKAGES = (
    ('mbaid_ros', 'mbaid_ros'),
    ('numpy', 'NumPy'),
    ('scipy', 'SciPy'),
    ('pin', 'Pinocchio'),
    ('rosbags', 'rosbags'),
    ('mcap', 'mcap'),
    ('matplotlib', 'Matplotlib'),
)


def versions() -> list[tuple[str, str]]:
    """Return (name, version) of each package that has a part in the numbers."""
    return [*((shown, version_of(name)) for name, shown in _PACKAGES), ('Python', platform.python_version())]


def version_of(name: str) -> str:
    """Return the version of an installed package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return 'not known'  # installed by other means than pip, as Pinocchio by apt


LARGEST_HASHED = 1_000_000_000  # bytes; more would take longer to read twice than a result is worth waiting for
_BLOCK = 1 << 20


def made_by(executable: str, argv: Sequence[str], model: str, urdf: str) -> dict[str, Any]:
    """Return the origin of the results of a command, now, as scripts read it.

    It has the version of mbaid_ros, the command as a shell takes it, the date (ISO 8601, UTC), and the robot: name,
    path as the user gave it, and SHA-256 of the file's bytes.
    """
    return {
        'version': version_of('mbaid_ros'),
        'command': shlex.join(('ros2', 'run', 'mbaid_ros', executable, *argv)),
        'date': datetime.now(timezone.utc).isoformat(timespec='seconds'),
        'robot': {'name': parse_document(urdf).get('name', ''), 'file': model, 'sha256': sha256_of(model, urdf)},
    }


def sha256_of(model: str, urdf: str) -> str:
    """Return the SHA-256 of a robot description's file; of its text where that is a pipe."""
    path = Path(model)
    return sha256(path) if path.is_file() else hashlib.sha256(urdf.encode()).hexdigest()


def hashes(bag: str) -> dict[str, str | None]:
    """Return the SHA-256 of each file of a bag that holds messages, by its name; None for more than LARGEST_HASHED."""
    from mbaid_ros.bags.opening import BAG_FILES  # noqa: PLC0415 - `identify` needs no library for bags

    path, files = Path(bag), [Path(bag)]
    if path.is_dir():
        files = sorted(each for each in path.iterdir() if each.name.endswith(BAG_FILES) and each.is_file())
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


def in_words(made: Mapping[str, Any]) -> list[str]:
    """Return the origin of a result, a line each."""
    robot = made['robot']
    return [
        f'mbaid_ros {made["version"]}, {made["date"]}: {made["command"]}',
        f'Robot {robot["name"]}, {robot["file"]}: SHA-256 {robot["sha256"]}',
    ]


def files_in_words(bag: str, files: Mapping[str, str | None]) -> list[str]:
    """Return the identity of each file of a bag, a line each."""
    missing = f'no SHA-256: the bag is larger than {LARGEST_HASHED / 1e9:g} GB'
    return [f'{bag}, {name}: {f"SHA-256 {digest}" if digest else missing}' for name, digest in files.items()]
