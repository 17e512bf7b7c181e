"""What a clock does not do, on /clock, among the messages of a clean recording to a node with use_sim_time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from attack.garbage import BEFORE
from attack.victim import KINDS, Victim
from benchmarks.pages import table
from benchmarks.speed_bag import ROBOT
from fuzzing.damage import of_bytes
from mbaid_ros.messages import stamp_of
from streams import urdf

PARAMETERS = ('use_sim_time:=true',)
SECOND = 1_000_000_000  # ns
HOUR = 3600 * SECOND
LATEST = 2**31 * SECOND - 1  # ns
STILL = 3.0  # s, without a word on /clock
_PART = 1000  # messages of the recording that come with each kind
Times = Callable[[int, np.random.Generator], Clock | bytes | None]


def _clock(stamp: int) -> Clock:
    message = Clock()
    message.clock.sec, message.clock.nanosec = divmod(stamp, SECOND)
    return message


def _odd_nanoseconds(stamp: int, _generator: np.random.Generator) -> Clock:
    message = _clock(stamp)
    message.clock.nanosec = 4_000_000_000
    return message


def _damaged(stamp: int, generator: np.random.Generator) -> bytes:
    data = b'\0\1\0\0' + np.array(divmod(stamp, SECOND), dtype='<i4').tobytes()
    damaged = of_bytes(data, generator)[: len(data)]  # the middleware sends no longer ones of a type of one length
    return damaged or data[:1]  # and no bytes at all block who sends them


# The time after each message of the recording, from its stamp; None is none.
WAYS: dict[str, Times] = {
    'nothing on `/clock`': lambda _stamp, _generator: None,
    'a clock that stands still': lambda _stamp, _generator: _clock(SECOND),
    '10 s back': lambda stamp, _generator: _clock(stamp - 10 * SECOND),
    'an hour ahead': lambda stamp, _generator: _clock(stamp + HOUR),
    'up to an hour back and ahead, another time with each message': lambda stamp, generator: _clock(
        stamp + int(generator.integers(-HOUR, HOUR))
    ),
    '0, and as late as there is, by turns': lambda stamp, _generator: _clock(stamp % 2 * LATEST),
    'negative': lambda stamp, _generator: _clock(-stamp),
    'four seconds of nanoseconds': _odd_nanoseconds,
    'damaged bytes': _damaged,
}


@dataclass(frozen=True)
class Told:
    """What the node did about one kind of time.

    Attributes
    ----------
    count : messages on /clock
    reports, seconds : in /diagnostics, and in what time
    problems : what they said of the clock, each text once
    """

    count: int
    reports: int
    seconds: float
    problems: list[str]


def clocks(victim: Victim, seed: int) -> dict[str, Told]:
    """Return, by kind, what the node did; each comes after ~/reset and the beginning of a clean run."""
    publisher = victim.graph.publisher('/clock', Clock)
    found = {}
    for number, (name, times) in enumerate(tqdm(WAYS.items(), unit=' clocks', disable=None, leave=False)):
        victim.describe(urdf(ROBOT))
        victim.drained()
        victim.reset()
        for stamp in _sent(victim, 0, BEFORE):
            publisher.publish(_clock(stamp))
        victim.drained()
        victim.forget()
        generator, sent, begin = np.random.default_rng([seed, 3, number]), count(), time.monotonic()
        for stamp in _sent(victim, BEFORE, BEFORE + _PART):
            message = times(stamp, generator)
            if message is not None:
                publisher.publish(message)
                next(sent)
        victim.drained()
        victim.rest(STILL)
        seconds = time.monotonic() - begin
        found[name] = Told(next(sent), victim.reports(), seconds, victim.complaints(('time',)))
    return found


def _sent(victim: Victim, begin: int, end: int) -> Iterator[int]:
    """Send messages of the recording, and yield the stamp (ns) of each."""
    for topic, data in victim.recording[begin:end]:
        victim.send(topic, data)
        yield stamp_of(deserialize_message(data, KINDS[topic]))


def clock_table(found: dict[str, Told]) -> str:
    """Return the table of the page."""
    rows = []
    for name, told in found.items():
        said = max(told.problems, key=len, default='-')
        rows.append([name, str(told.count), f'{told.reports} in {told.seconds:.0f} s', said])
    return table(['on `/clock`', 'messages', 'reports', 'said of it in `/diagnostics`'], rows, words=True)
