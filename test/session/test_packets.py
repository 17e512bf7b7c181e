"""A session that is given bytes in lists, as a replay gives them, and one that is given objects one by one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

import defects
from defects import JOINTS, ODOMETRY, Arrival, arrivals, estimates
from mbaid_ros.bags import Recorded
from mbaid_ros.cdr import JOINT_STATE_TYPE, ODOMETRY_TYPE, packer
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.session import Session
from simulated import CONFIG
from wire import as_bytes, joint_state, odometry

ROBOT, SECONDS = 'servicer7', 2.6
INPUTS = Inputs(JOINTS, ODOMETRY)


def jump_back(messages: list[Arrival]) -> list[Arrival]:
    return [*messages, *messages]


def stray(messages: list[Arrival]) -> list[Arrival]:
    messages = list(messages)
    for place in (40, 141, 142, 260):
        (late,) = defects.changed(messages[place].topic, defects.shifted(100.0))([messages[place]])
        messages[place] = late
    return messages


def unset(messages: list[Arrival]) -> list[Arrival]:
    messages = list(messages)
    for place in (0, 77, 200):
        stamp = defects.stamp_of(messages[place])
        (zero,) = defects.changed(messages[place].topic, defects.shifted(-stamp * 1e-9))([messages[place]])
        messages[place] = zero
    return messages


STREAMS: dict[str, Callable[[list[Arrival]], list[Arrival]]] = {
    'as they come': lambda messages: messages,
    'jump back': jump_back,
    'stray stamps': stray,
    'stamps not set': unset,
    'halves': defects.in_halves,
    'without rates': defects.changed(JOINTS, defects.no_rates),
    'in another order': lambda messages: [messages[k ^ 1] for k in range(len(messages))],
}


def packed(messages: Sequence[Arrival]) -> list[tuple[str, bytes, int]]:
    """Return messages as bytes, with their topics and times."""
    made = []
    for arrival in messages:
        message = arrival.message
        stamp = defects.stamp_of(arrival)
        if arrival.topic == JOINTS:
            position, velocity = (np.asarray(x, dtype=float) for x in (message.position, message.velocity))
            data = as_bytes(joint_state(message.name, position, velocity, stamp=stamp))
        else:
            pose, twist = message.pose, message.twist
            place, turn, motion = pose.pose.position, pose.pose.orientation, twist.twist
            numbers = [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]
            numbers += [getattr(part, axis) for part in (motion.linear, motion.angular) for axis in 'xyz']
            covariances = np.array([pose.covariance, twist.covariance])
            data = as_bytes(odometry(np.array(numbers), covariances, stamp=stamp, child=message.child_frame_id))
        made.append((arrival.topic, data, arrival.time))
    return made


class Packing:
    """Makes of bytes what a bag's reader makes of them: packets together, or one by one."""

    def __init__(self) -> None:
        self._packers = {JOINTS: packer(JOINT_STATE_TYPE), ODOMETRY: packer(ODOMETRY_TYPE)}

    def recorded(self, messages: Sequence[tuple[str, bytes, int]]) -> Recorded:
        """Return messages by their topics."""
        by_topic: dict[str, Sequence[Any]] = {}
        for topic, pack in self._packers.items():
            assert pack is not None
            given = [data for name, data, _ in messages if name == topic]
            if given:
                together = pack.many(given)
                by_topic[topic] = [pack(data) for data in given] if together is None else together
        times = {name: np.array([time for topic, _, time in messages if topic == name]) for name in by_topic}
        return Recorded([topic for topic, _, _ in messages], by_topic, times)


def said(found: Sequence[Estimate]) -> list[tuple[Any, ...]]:
    return [(e.stamp, e.status, e.parameters.tobytes(), e.covariance.tobytes(), e.warnings) for e in found]


@pytest.mark.parametrize('at_once', [37, 300, 100_000])
@pytest.mark.parametrize('stream', STREAMS)
def test_the_estimates_are_the_same_to_the_last_bit(stream: str, at_once: int) -> None:
    messages = STREAMS[stream](arrivals(ROBOT, SECONDS, 1))
    expected, singly = estimates(ROBOT, messages)
    session = Session(build(EstimatorConfig, dict(EXACT)), (CONFIG / f'{ROBOT}.urdf').read_text(encoding='utf-8'))
    given, packing, found = packed(messages), Packing(), []
    for begin in range(0, len(given), at_once):
        INPUTS.add_to(session, packing.recorded(given[begin : begin + at_once]))
        found += session.process()
    assert len(expected) >= 2
    assert said(found) == said(expected)
    assert (session.used, session.dropped, session.restarts) == (singly.used, singly.dropped, singly.restarts)
    assert session.received == singly.received


def test_a_jump_back_stops_the_session_where_it_is_an_error() -> None:
    given = packed(jump_back(arrivals(ROBOT, SECONDS, 1)))
    urdf = (CONFIG / f'{ROBOT}.urdf').read_text(encoding='utf-8')
    session = Session(build(EstimatorConfig, {'time_jump': 'error'}), urdf)
    INPUTS.add_to(session, Packing().recorded(given))
    assert session.process()
    with pytest.raises(DataError, match='jumped back by'):
        session.process()
