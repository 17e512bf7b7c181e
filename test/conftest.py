"""What all tests share: one thread of BLAS, as the executables have, for results that are theirs to the last bit."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

assert 'numpy' not in sys.modules, 'NumPy reads the number of threads when it is imported first'

import mbaid_ros  # noqa: E402, F401 - says it


@pytest.fixture
def _little_memory(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let a test take no more than MEMORY bytes of its module at any time, beyond what the process had before."""
    Path('/proc/self/clear_refs').write_text('5', encoding='ascii')  # counts the peak anew
    before = _memory('VmRSS')
    yield
    assert _memory('VmHWM') - before < request.module.MEMORY


def _memory(name: str) -> int:
    lines = Path('/proc/self/status').read_text(encoding='ascii').splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(f'{name}:'))
