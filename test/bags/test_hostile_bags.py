"""Bags that mean harm: one line of error or one warning, soon, in little memory."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from hostile_bags import DAMAGED, REFUSED, many_bombs
from mbaid_ros.replay.replay import main

CONFIG = Path(__file__).resolve().parents[2] / 'config'
MEMORY = 800_000_000  # bytes, more than before, for any of them


@pytest.fixture(autouse=True)
def _little_memory() -> object:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < MEMORY


def replay(bag: Path) -> int:
    return main([str(bag), '--model', str(CONFIG / 'table1.urdf')])


@pytest.mark.timeout(30)
@pytest.mark.parametrize('name', REFUSED)
def test_refused_in_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = REFUSED[name](tmp_path)
    assert replay(path) == 2
    error = capsys.readouterr().err
    assert error.startswith('mbaid_ros replay: ')
    assert error.count('\n') == 1
    assert len(error) < 1_000


@pytest.mark.timeout(30)
@pytest.mark.parametrize('name', DAMAGED)
def test_read_as_far_as_it_goes(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay(DAMAGED[name](tmp_path)) in {2, 3}
    captured = capsys.readouterr()
    assert captured.err.count('\n') <= 1
    assert 'warning' in captured.out or 'no estimate' in captured.out or captured.err


@pytest.mark.timeout(60)
def test_messages_that_are_large_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay(many_bombs(tmp_path)) in {2, 3}
    assert capsys.readouterr().err.count('\n') <= 1
