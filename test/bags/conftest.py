"""The bag that most tests of the bags read."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorded import write_bag


@pytest.fixture(scope='session')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp('bags') / 'recorded')


@pytest.fixture
def mcap(recorded: Path) -> Path:
    return recorded / 'recorded.mcap'
