"""The files of collision meshes that a robot description names."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import unquote

import coal
import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.parser_words import kept_words
from mbaid_ros.files import require_regular

_PACKAGE, _FILE = 'package://', 'file://'


def mesh_points(name: str) -> Array:
    """Return the vertices (V, 3) of a mesh, in the units of its file.

    Parameters
    ----------
    name : as a robot description has it: package://, file:// or a path that is not relative

    Raises
    ------
    ModelError
        There is no such file, or it cannot be read.
    """
    path = _path(name)
    require_regular(path, 'mesh', ModelError)
    if path.stat().st_size > limits.MESH_BYTES:
        raise ModelError(f"mesh '{name}' has more than {limits.MESH_BYTES} bytes, which is the limit")
    try:
        with kept_words([]):
            return np.asarray(coal.MeshLoader().load(str(path), np.ones(3)).vertices())
    except (ValueError, RuntimeError) as error:
        told = [line for line in str(error).splitlines() if not line.startswith('Hint:')]
        raise ModelError(f"mesh '{name}' cannot be read: {told[-1]}") from error


def _path(name: str) -> Path:
    """Return where a mesh is."""
    path = Path(unquote(name.removeprefix(_FILE)))
    if name.startswith(_PACKAGE):
        package, _, rest = name.removeprefix(_PACKAGE).partition('/')
        shares = [Path(prefix) / 'share' / package for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':')]
        share = next((each for each in shares if each.is_dir()), None)
        if share is None:
            raise ModelError(f"mesh '{name}': AMENT_PREFIX_PATH has no package '{package}'")
        return share / unquote(rest)
    if not path.is_absolute():
        raise ModelError(f"mesh '{name}' is relative; accepted: package://, file:// or an absolute path")
    return path
