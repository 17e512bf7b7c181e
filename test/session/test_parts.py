"""When a session asks to work: in small parts while a window is open, and with the very message that completes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

import defects
from defects import JOINTS, ODOMETRY, Arrival, arrivals, in_order
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.session import Session
from mbaid_ros.session.session import PART
from simulated import CONFIG

ROBOT, SECONDS, WINDOW = 'table1', 2.1, 0.5


def times(rate: float, offset: float = 0.0) -> Array:
    return np.arange(0.1 + offset, SECONDS - 1e-9, 1.0 / rate)


def delayed(messages: Sequence[Arrival], topic: str, by: float) -> list[Arrival]:
    """Return messages of which those of one topic take longer on their way, s."""
    later = (replace(m, time=m.time + round(by * 1e9)) if m.topic == topic else m for m in messages)
    return in_order(list(later))


STREAMS: dict[str, Callable[[], list[Arrival]]] = {
    'equal stamps': lambda: arrivals(ROBOT, SECONDS, 1),
    'joints later': lambda: arrivals(ROBOT, SECONDS, 1, times(100.0, 0.004), times(100.0, 0.002)),
    'joints earlier': lambda: arrivals(ROBOT, SECONDS, 1, times(100.0, 0.002), times(100.0, 0.004)),
    'joints often': lambda: arrivals(ROBOT, SECONDS, 1, times(250.0), times(20.0, 0.002)),
    'joints seldom': lambda: arrivals(ROBOT, SECONDS, 1, times(20.0, 0.004), times(250.0)),
    'joints on their way for 45 ms': lambda: delayed(arrivals(ROBOT, SECONDS, 1), JOINTS, 0.045),
    'odometry on its way for 45 ms': lambda: delayed(arrivals(ROBOT, SECONDS, 1), ODOMETRY, 0.045),
    'joints in halves': lambda: defects.in_halves(arrivals(ROBOT, SECONDS, 1)),
}


def worked(messages: Sequence[Arrival], *, always: bool) -> tuple[list[int], list[int]]:
    """Return after which messages estimates came, and how many messages were worked through in each call.

    Parameters
    ----------
    messages : in the order of arrival
    always : whether to work after every message, not only when the session asks for it
    """
    session = Session(EstimatorConfig(window=WINDOW), (CONFIG / f'{ROBOT}.urdf').read_text(encoding='utf-8'))
    came, parts = [], []
    for index, arrival in enumerate(messages):
        take = session.add_joint_state if arrival.topic == JOINTS else session.add_odometry
        if take(arrival.message) or always:
            before = sum(session.received.values())
            came += [index] * len(session.process())
            parts.append(sum(session.received.values()) - before)
    return came, parts


@pytest.mark.parametrize('stream', STREAMS)
def test_an_estimate_comes_with_the_message_that_completes_its_window(stream: str) -> None:
    messages = STREAMS[stream]()
    came, parts = worked(messages, always=False)
    assert len(came) >= 3
    # Halves of the joints are told apart only when they are read.
    late = 2 if stream == 'joints in halves' else 0
    assert np.all(np.subtract(came, worked(messages, always=True)[0]) <= late)
    # Hardly any work in vain.
    assert len(parts) <= 5 * (len(came) + 1) + len(messages) / PART


def test_no_more_is_left_for_the_end_of_a_window_at_high_rates() -> None:
    messages = arrivals(ROBOT, SECONDS, 1, times(500.0), times(500.0))
    assert len(messages) > 4 * PART
    came, parts = worked(messages, always=False)
    assert len(came) == 3
    assert max(parts) <= PART


def test_a_stream_without_the_other_is_worked_through_in_parts_too() -> None:
    messages = [m for m in arrivals(ROBOT, SECONDS, 1, times(500.0)) if m.topic == JOINTS]
    assert worked(messages, always=False)[1] == [PART] * (len(messages) // PART)


def test_a_window_is_closing_from_its_last_messages_to_its_estimate() -> None:
    messages = STREAMS['equal stamps']()
    session = Session(EstimatorConfig(window=WINDOW), (CONFIG / f'{ROBOT}.urdf').read_text(encoding='utf-8'))
    seen = []
    for arrival in messages:
        take = session.add_joint_state if arrival.topic == JOINTS else session.add_odometry
        if take(arrival.message):
            session.process()
        seen.append(session.closing is not None)
    assert session.closing is None
    # In a tenth of the time, and once a window.
    assert 0.05 < np.mean(seen) < 0.15
    assert np.sum(np.diff(np.array(seen, dtype=int)) > 0) == 4
