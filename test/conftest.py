"""What all tests share: one thread of BLAS, as the executables have, for results that are theirs to the last bit."""

from __future__ import annotations

import sys

assert 'numpy' not in sys.modules, 'NumPy reads the number of threads when it is imported first'

import mbaid_ros  # noqa: E402, F401 - says it
