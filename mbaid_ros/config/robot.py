"""The file a robot description is in."""

from __future__ import annotations

from pathlib import Path

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.robot.urdf import LARGEST_URDF


def read_robot_description(path: str | Path) -> str:
    """Return the text of a URDF file.

    Raises
    ------
    ModelError
        The file cannot be read, or is not text.
    """
    try:
        # One character more than is accepted tells that it is too long; the rest need not be read.
        with Path(path).open(encoding='utf-8') as file:
            return file.read(LARGEST_URDF + 1)
    except OSError as error:
        raise ModelError(f"cannot read robot description '{path}': {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ModelError(f"robot description '{path}' is not text in UTF-8; a URDF file is accepted") from error
