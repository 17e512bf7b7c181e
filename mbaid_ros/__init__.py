"""Momentum-based identification of the inertia of captured debris, by free-floating robots.

`from mbaid_ros import identify` takes NumPy arrays and needs no ROS.
"""

import os
from typing import TYPE_CHECKING

# The matrices here are small (16 x 16, many at a time): a second BLAS thread only waits for the first, which costs more
# than it brings. It takes effect where numpy has not been loaded yet, as in all executables of this package.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

if TYPE_CHECKING:
    from mbaid_ros.identification import Identification, identify

__all__ = ['Identification', 'identify']


def __getattr__(name: str) -> object:
    """Return what `__all__` names; it is loaded when it is first asked for, since executables need little of it."""
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from mbaid_ros import identification  # noqa: PLC0415 - see above

    return getattr(identification, name)
