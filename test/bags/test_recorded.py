"""Messages of several topics that are read together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from mbaid_ros.bags import Recorded, Timed
from mbaid_ros.cdr import JOINT_STATE_TYPE, packer
from mbaid_ros.core.samples import Stamps
from wire import as_bytes, joint_state


def recorded(names: str) -> tuple[list[Timed], Recorded]:
    """Return messages of topics with names of a letter; those of `p` are packets that are together."""
    pack = packer(JOINT_STATE_TYPE)
    assert pack is not None
    data = [as_bytes(joint_state(['x'], np.ones(1), np.ones(1), stamp=k)) for k in range(len(names))]
    messages: dict[str, Sequence[Any]] = {}
    times: dict[str, Stamps] = {}
    for name in dict.fromkeys(names):
        places = [k for k, each in enumerate(names) if each == name]
        together = pack.many([data[k] for k in places]) if name == 'p' else None
        messages[name] = places if together is None else together
        times[name] = 7 * np.array(places)
    expected = [(name, k, 7 * k) for k, name in enumerate(names)]
    return expected, Recorded(names, messages, times)


def content(messages: Recorded) -> list[Timed]:
    return [(name, message.stamp if name == 'p' else message, time) for name, message, time in messages]


@pytest.mark.parametrize('names', ['', 'a', 'p', 'papbp', 'aab', 'tpapttbpat', 'ppppt'])
def test_messages_come_in_the_order_they_were_recorded(names: str) -> None:
    expected, found = recorded(names)
    assert len(found) == len(names)
    assert content(found) == expected
    for name in 'abpt':
        assert len(found.of(name)) == names.count(name)


@pytest.mark.parametrize('names', ['', 'p', 'papbp', 'tpapttbpat', 'ppppt', 'ttt'])
def test_runs_are_all_of_a_topic_or_none(names: str) -> None:
    expected, found = recorded(names)
    runs = list(found.runs('t'))
    assert [each for run in runs for each in content(run)] == expected
    for run in runs:
        assert set(run.topics) == {'t'} or 't' not in run.topics
        assert set(run.messages) == set(run.topics)
