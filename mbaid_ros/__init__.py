"""Momentum-based identification of the inertia of a captured body by a free-floating space robot."""

import os

# The matrices here are small (16 x 16, many at a time): a second BLAS thread only waits for the first, which costs more
# than it brings. It takes effect where numpy has not been loaded yet, as in all executables of this package.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
