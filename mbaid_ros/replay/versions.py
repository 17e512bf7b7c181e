"""The versions of what made a result."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

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
