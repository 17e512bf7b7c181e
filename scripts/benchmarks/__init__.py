"""What the benchmarks share: simulated data, methods, the statistical limit, statistics, pages and figures."""

import os

# Small matrices are what they spend their time on: several threads would only wait for each other. Has to be said
# before NumPy is loaded.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
