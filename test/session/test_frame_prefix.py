"""Frames whose names have a prefix, as one robot of several has them."""

from __future__ import annotations

from copy import deepcopy

import numpy as np

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.messages import WRONG_CHILD_FRAME
from mbaid_ros.outgoing import Frames, estimate_message
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.session import Session, explain
from streams import run, urdf

PREFIX = 'servicer/'


def taken(prefix: str, child_prefix: str) -> tuple[Session, list[Estimate]]:
    """Return a session that has taken four seconds of a robot whose odometry names its frame with a prefix."""
    session = Session(build(EstimatorConfig, {'frame_prefix': prefix, 'method': 'difference'}), urdf('table1'))
    for timed in run('table1', 4.0):
        if timed.topic == 'odom':
            message = deepcopy(timed.message)
            message.child_frame_id = child_prefix + message.child_frame_id
            session.add_odometry(message)
        else:
            session.add_joint_state(timed.message)
    return session, session.process()


def test_the_estimates_are_those_without() -> None:
    _, plain = taken('', '')
    session, prefixed = taken(PREFIX, PREFIX)
    assert not session.dropped[WRONG_CHILD_FRAME]
    assert len(prefixed) == len(plain) > 0
    np.testing.assert_array_equal(prefixed[-1].parameters, plain[-1].parameters)
    np.testing.assert_array_equal(prefixed[-1].momentum, plain[-1].momentum)


def test_a_frame_without_it_is_refused_and_the_accepted_one_named() -> None:
    session, made = taken(PREFIX, '')
    assert not made
    assert "accepted: 'servicer/base_link'" in explain(session, [WRONG_CHILD_FRAME])[0]


def test_messages_have_it() -> None:
    message = estimate_message(Estimate('difference', 'waiting'), BAG_TYPES, Frames('link7', 'odom', PREFIX))
    assert message.header.frame_id == 'servicer/link7'
    assert message.momentum_frame == 'odom'
