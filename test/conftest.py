"""What all tests share: one thread of BLAS, as the executables have, for results that are theirs to the last bit."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

assert 'numpy' not in sys.modules, 'NumPy reads the number of threads when it is imported first'

import mbaid_ros  # noqa: E402, F401 - says it
from fuzzing.trial import memory_of  # noqa: E402
from shared_motions import (  # noqa: E402, F401 - fixtures
    drift,
    identified,
    joints,
    planar,
    plane,
    robot,
    satellite,
    servicer,
    servicer7,
    spatial,
    spatial_minute,
    start,
    tumbling,
)
from unchanged import unchanged  # noqa: E402, F401 - fixture


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what writes the estimates that tests compare with anew."""
    parser.addoption('--write-estimates', action='store_true', help='write the estimates of test/estimates anew')


@pytest.fixture
def _little_memory(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let a test take no more than MEMORY bytes of its module at any time, beyond what the process had before."""
    Path('/proc/self/clear_refs').write_text('5', encoding='ascii')  # counts the peak anew
    before = memory_of('VmRSS')
    yield
    assert memory_of('VmHWM') - before < request.module.MEMORY
