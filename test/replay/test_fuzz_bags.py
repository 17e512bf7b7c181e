"""Damaged bags through `replay`; `make fuzz` sends two thousand."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest
from mcap.writer import CompressionType

from mbaid_ros.bags import BagReader
from mbaid_ros.core.errors import DataError
from simulated import CONFIG


def test_damaged_bags_end_with_an_exit_code_and_a_line() -> None:
    fuzz = runpy.run_path(str(CONFIG.parent / 'scripts' / 'fuzz_bags.py'))['fuzz']
    codes, _, wrong = fuzz(30, 1)
    assert wrong == []
    assert sum(codes.values()) == 30
    assert len(codes) > 1


def test_damaged_files_end_with_an_exit_code_and_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(CONFIG.parent / 'scripts'))
    fuzz = runpy.run_path(str(CONFIG.parent / 'scripts' / 'fuzz_files.py'))['fuzz']
    outcome = fuzz(14, 2)
    assert set(outcome) == {'URDF', 'YAML', 'metadata', 'JSON', 'sqlite'}
    for found in outcome.values():
        assert found.wrong == []
        assert sum(found.codes.values()) == 14
    assert all(outcome[kind].codes[2] for kind in ('URDF', 'YAML', 'JSON', 'sqlite'))


def test_damaged_messages_leave_the_node_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing comes out of a callback, and a clean stream after ~/reset leads to the same bits as before."""
    monkeypatch.syspath_prepend(str(CONFIG.parent / 'scripts'))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    found = runpy.run_path(str(CONFIG.parent / 'scripts' / 'fuzz_messages.py'))['on_a_graph'](20, 0, 20)
    assert found.wrong == []
    assert found.inputs == 20


def test_a_definition_that_lacks_what_its_type_has_is_told(tmp_path: Path) -> None:
    whole_bag = runpy.run_path(str(CONFIG.parent / 'scripts' / 'fuzz_bags.py'))['whole_bag']
    path = tmp_path / 'bag.mcap'
    path.write_bytes(
        whole_bag(
            CompressionType.NONE,
            lambda text: text.replace('Vector3  linear', 'Vector3  lin').replace('Vector3 linear', 'Vector3 lin'),
        )
    )
    with (
        BagReader(path) as bag,
        pytest.raises(DataError, match=r"the bag defines geometry_msgs/msg/Twist without 'linear'"),
    ):
        list(bag.read(['/odom']))
