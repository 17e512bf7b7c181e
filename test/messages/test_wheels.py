"""Wheels beside the joints in JointState: their speeds are read, their positions are not."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.messages import NOT_FINITE, JointReader
from recorded import joint_state

NAMES = ('wheel', 'elbow', 'finger', 'shoulder')


def test_their_speeds_come_after_the_joints() -> None:
    reader = JointReader(('shoulder', 'elbow'), ('wheel',))
    message = joint_state(5, NAMES, [np.nan, 0.2, 9.0, 0.4], [300.0, 2.0, 9.0, 4.0])
    streams, dropped = reader.read([message])
    assert not dropped
    (joints, stream), *others = streams.items()
    assert joints == reader.all == (0, 1, 2)
    assert not others
    assert stream.position.tolist() == [[0.4, 0.2, 0.0]]
    assert stream.velocity.tolist() == [[4.0, 2.0, 300.0]]


@pytest.mark.parametrize('velocity', [[np.nan, 2.0, 9.0, 4.0], []])
def test_a_message_without_their_speed_is_not_used(velocity: list[float]) -> None:
    reader = JointReader(('shoulder', 'elbow'), ('wheel',))
    streams, dropped = reader.read([joint_state(5, NAMES, [1e9, 0.2, 9.0, 0.4], velocity)])
    assert not streams
    assert dropped == {NOT_FINITE: 1}


def test_wheels_may_have_messages_of_their_own() -> None:
    reader = JointReader(('shoulder', 'elbow'), ('wheel',))
    messages = [joint_state(5, ('shoulder', 'elbow'), [0.1, 0.2], [1.0, 2.0]), joint_state(6, ('wheel',), [0.0], [7.0])]
    streams, dropped = reader.read(messages)
    assert not dropped
    assert set(streams) == {(0, 1), (2,)}
    assert streams[2,].velocity.tolist() == [[7.0]]
