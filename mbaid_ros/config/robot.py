"""The file a robot description is in."""

from __future__ import annotations

from pathlib import Path

from mbaid_ros import limits
from mbaid_ros.core.errors import ModelError
from mbaid_ros.files import read_text


def read_robot_description(path: str | Path) -> str:
    """Return the text of a URDF file.

    Raises ModelError: The file cannot be read, is not text, or is too long.
    """
    return read_text(path, 'robot description', limits.URDF_CHARACTERS, 'a URDF file is accepted', ModelError)
