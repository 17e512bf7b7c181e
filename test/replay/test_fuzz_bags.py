"""Damaged bags through `replay`; `make fuzz` sends thousands."""

from __future__ import annotations

from pathlib import Path

import pytest

import fuzz_files
from fuzzing.mcap_files import TYPES, recorded, written
from mbaid_ros.bags.types import deserialize, serialize
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.run import replay_bag
from simulated import CONFIG


@pytest.mark.parametrize(('inputs', 'apart'), [(8, ['MCAP schemas']), pytest.param(40, None, marks=pytest.mark.long)])
def test_damaged_files_end_with_an_exit_code_and_a_line(inputs: int, apart: list[str] | None) -> None:
    outcome = fuzz_files.fuzz(inputs, 2)
    assert len(outcome) == 11
    for found in outcome.values():
        assert found.wrong == []
        assert sum(found.codes.values()) == inputs
    assert all(found.codes[2] for kind, found in outcome.items() if kind != 'metadata')
    # An executable in a process of its own does the same: of one kind, or of each.
    assert not any(found.wrong for found in fuzz_files.fuzz(1, 2, apart, every=1).values())


@pytest.mark.parametrize('size', [1e300, float('nan'), 0.0])
def test_a_last_pose_that_is_none_is_not_told(size: float, tmp_path: Path) -> None:
    """Whatever the last Odometry says of where the base is, it is no more than a pose that is not known."""
    path = tmp_path / 'bag.mcap'
    *others, (topic, data, time) = [each for each in recorded() if each[0] == 'odom']
    last = deserialize(data, TYPES[topic])
    last.pose.pose.orientation.x = last.pose.pose.orientation.w = size
    joints = [each for each in recorded() if each[0] == 'joint_states']
    messages = sorted([*others, *joints, (topic, serialize(last, TYPES[topic]), time)], key=lambda each: each[2])
    path.write_bytes(written(messages))
    config = build(EstimatorConfig, {'method': 'difference'})
    run = replay_bag(str(path), config, (CONFIG / 'table1.urdf').read_text(), Inputs())
    assert run.final.samples > 0
    assert run.pose is None
