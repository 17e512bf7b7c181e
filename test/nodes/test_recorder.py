"""The recorder without a graph: when it ends."""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from mbaid_ros.bags import BagWriter
from mbaid_ros.config.recorder import RecorderConfig
from mbaid_ros.nodes.recorder import RecorderNode, record
from mbaid_ros.nodes.runner import Interrupt


class Endless:
    """An executor whose node is handed another message at every turn."""

    turns = 0

    def add_node(self, node: RecorderNode) -> None:
        """Take the node whose messages come."""
        self._take = partial(node._take, '/joint_states', bytes(8))

    def spin_once(self, timeout_sec: float) -> None:
        """Hand it one that has just been received."""
        self.turns += 1
        assert self.turns < 1_000_000, f'goes on, with {timeout_sec} s a turn'
        self._take({'received_timestamp': time.time_ns()})


def test_a_stream_without_a_pause_does_not_keep_a_recorder_from_ending(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('mbaid_ros.nodes.recorder.SingleThreadedExecutor', Endless)
    node = RecorderNode.__new__(RecorderNode)  # of no graph
    writer = BagWriter(tmp_path / 'run')
    writer.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
    vars(node).update(_config=RecorderConfig(), _begin=None, _until=sys.maxsize, _offers={}, _writer=writer)
    interrupt = Interrupt.__new__(Interrupt)  # without a handler of signals
    interrupt.requested = True
    record(node, interrupt)
    assert 0 < node.messages < 1_000_000
    node.close()


def test_a_topic_of_a_type_that_is_none_is_told_and_left_out() -> None:
    node = RecorderNode.__new__(RecorderNode)  # of no graph
    told: list[str] = []
    refused: set[str] = set()
    vars(node).update(_log=SimpleNamespace(warning=told.append), _offers={}, _refused=refused)
    node._follow('/odd', 'odd', [])
    assert told == ["topic '/odd' is not recorded: its type odd is not installed"]
    assert refused == {'/odd'}
