"""Damaged bags through `replay`; `make fuzz` sends thousands."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

import fuzz_files
from fuzzing.mcap_files import recorded, written
from mbaid_ros.bags import BagReader
from mbaid_ros.core.errors import DataError
from simulated import CONFIG


def test_damaged_files_end_with_an_exit_code_and_a_line() -> None:
    outcome = fuzz_files.fuzz(12, 2, every=12)
    assert len(outcome) == 13
    for found in outcome.values():
        assert found.wrong == []
        assert sum(found.codes.values()) == 12
    assert all(found.codes[2] for kind, found in outcome.items() if kind not in {'metadata', 'MCAP messages'})


def test_damaged_messages_leave_the_node_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing comes out of a callback, and a clean stream after ~/reset leads to the same bits as before."""
    monkeypatch.syspath_prepend(str(CONFIG.parent / 'scripts'))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    found = runpy.run_path(str(CONFIG.parent / 'scripts' / 'fuzz_messages.py'))['on_a_graph'](20, 0, 20)
    assert found.wrong == []
    assert found.inputs == 20


def test_a_definition_that_lacks_what_its_type_has_is_told(tmp_path: Path) -> None:
    path = tmp_path / 'bag.mcap'
    path.write_bytes(written(recorded(), lie=lambda found: re.sub('Vector3( +)linear', r'Vector3\1lin', found)))
    with (
        BagReader(path) as bag,
        pytest.raises(DataError, match=r"the bag defines geometry_msgs/msg/Twist without 'linear'"),
    ):
        list(bag.read(['/odom']))
