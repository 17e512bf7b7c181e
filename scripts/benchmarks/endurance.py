"""docs/endurance.md: its head, the order of its sections, and how memory and time of a process are measured."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.methods import METHODS

WEEK, LIVE = 'A week in `replay`', 'Hours on a live graph'
ORDER = (*(f'Method `{method}`' for method in METHODS), WEEK, LIVE)
HEAD = """\
# A day without a break

24 hours of data at 100 Hz, joints and odometry, half a second at a time, as the node takes them. Time is processor time
of one core, reading and synchronising included. `make benchmark-day` measures it anew, for `trajectory` with
`ARGS="--method trajectory"`; `make benchmark-week` the week of a bag, `make benchmark-live` the hours on a live graph.
The week is one at 10 Hz: at 100 Hz its bag would hold 121 million messages.
"""


def resident(pid: int | str = 'self') -> float:
    """Return the resident memory of a process, MB."""
    pages = int(Path(f'/proc/{pid}/statm').read_text(encoding='ascii').split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def processor_time(pid: int | str = 'self') -> float:
    """Return the processor time of a running process, s."""
    values = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(values[11]) + int(values[12])) / os.sysconf('SC_CLK_TCK')


def slope(times: Sequence[float], values: Sequence[float]) -> float:
    """Return how much values (N,) grow in a unit of their times (N,): the line of least squares."""
    return float(np.polyfit(times, values, 1)[0])
