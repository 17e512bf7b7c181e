"""Garbage on every topic of the estimator, among the messages of a clean recording."""

from __future__ import annotations

import re
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from tqdm import tqdm

from attack.victim import KINDS, Victim
from benchmarks.pages import table
from benchmarks.speed_bag import ROBOT
from fuzzing.damage import of_bytes, one
from streams import urdf

BEFORE = 1200  # messages of the recording that come first
FLOOD, LONG = 5000.0, 4.0  # Hz, s
NUMBERS = (np.nan, np.inf, -np.inf, 1e300)
STAMPS = ((0, 0), (2**31 - 1, 999_999_999), (-(2**31), 0), (-1, 4_000_000_000))  # s, ns
_STAMP = struct.Struct('<iI')  # of a message's header: after the four bytes that say how it is encoded
_APART = 100  # s, between the clocks of two publishers
_COUNTS = re.compile(r'^\d+ samples used, \d+ messages dropped( and \d+ not used wholly)? since the last report: ')
_LONGEST = 150  # characters of what is told in the table
Change = Callable[[Any, np.random.Generator], None]


def _many_names(message: Any, _generator: np.random.Generator) -> None:
    message.name = [f'n{number}' for number in range(100_000)]
    message.position = message.velocity = [0.0] * 100_000


def _lengths(message: Any, generator: np.random.Generator) -> None:
    name = one(('name', 'position', 'velocity'), generator)
    setattr(message, name, getattr(message, name)[: int(generator.integers(0, 7))])


def _other_names(message: Any, generator: np.random.Generator) -> None:
    message.name = [f'{name}_{generator.integers(0, 1000)}' for name in message.name]


def _numbers(message: Any, generator: np.random.Generator) -> None:
    values = one((message.position, message.velocity), generator)
    values[int(generator.integers(0, len(values)))] = one(NUMBERS, generator)


def _poses(message: Any, generator: np.random.Generator) -> None:
    part = one((message.pose.pose.position, message.pose.pose.orientation, message.twist.twist.angular), generator)
    setattr(part, one('xyz', generator), one(NUMBERS, generator))


def _stamps(message: Any, generator: np.random.Generator) -> None:
    message.header.stamp.sec, message.header.stamp.nanosec = one(STAMPS, generator)


def _frames(message: Any, _generator: np.random.Generator) -> None:
    message.header.frame_id = 'x' * 1_000_000


def _covariances(message: Any, generator: np.random.Generator) -> None:
    part = one((message.pose, message.twist), generator)
    part.covariance = generator.choice([-1.0, 0.0, 1.0, *NUMBERS], 36)


def _changed(topic: str, change: Change, count: int, victim: Victim, generator: np.random.Generator) -> int:
    """Send the next messages of the recording, every other one of a topic changed, so many in all."""
    of_topic = 0
    for of, data in victim.recording[BEFORE:]:
        of_topic += of == topic
        if of == topic and of_topic % 2 and of_topic < 2 * count:
            message = deserialize_message(data, KINDS[of])
            change(message, generator)
            victim.send(of, message)
        else:
            victim.send(of, data)
    return min(count, (of_topic + 1) // 2)


def _bytes(victim: Victim, generator: np.random.Generator) -> int:
    """Send messages whose bytes are damaged."""
    part = victim.recording[BEFORE : BEFORE + 1000]
    for topic, data in part:
        victim.send(topic, of_bytes(data, generator) or data[:1])  # what none leads to is an attack of its own
    return len(part)


def _no_bytes(victim: Victim, _generator: np.random.Generator) -> int:
    """Send messages of no bytes from a second publisher, between clean ones of the first.

    Fast DDS takes no such message from its publisher, nor any that comes after it: what the node gets from others has
    to go on.
    """
    others = {topic: victim.graph.publisher(topic, kind) for topic, kind in KINDS.items()}
    for topic, data in victim.recording[BEFORE : BEFORE + 1000]:
        others[topic].publish(b'')
        victim.send(topic, data)
    victim.drained()
    for publisher in others.values():
        victim.graph.node.destroy_publisher(publisher)
    return 1000


def _stamped(data: bytes, stamp: int) -> bytes:
    """Return the bytes of a message with another stamp, ns."""
    return data[:4] + _STAMP.pack(*divmod(stamp, 1_000_000_000)) + data[4 + _STAMP.size :]


def _flood(victim: Victim, _generator: np.random.Generator) -> int:
    """Send both topics as fast as FLOOD, stamped with the time they are due."""
    begin = time.time_ns()
    messages = {topic: [data for of, data in victim.recording if of == topic] for topic in KINDS}
    for number in range(round(FLOOD * LONG)):
        due = begin + round(number / FLOOD * 1e9)
        time.sleep(max(0.0, 1e-9 * (due - time.time_ns())))
        for topic, queue in messages.items():
            victim.send(topic, _stamped(queue[number % len(queue)], due))
    return 2 * round(FLOOD * LONG)


def _two_clocks(victim: Victim, _generator: np.random.Generator) -> int:
    """Send each message from a second publisher, too, whose clock is ahead."""
    others = {topic: victim.graph.publisher(topic, kind) for topic, kind in KINDS.items()}
    part = victim.recording[BEFORE : BEFORE + 2000]
    for topic, data in part:
        victim.send(topic, data)
        seconds, rest = _STAMP.unpack_from(data, 4)
        others[topic].publish(_stamped(data, (seconds + _APART) * 1_000_000_000 + rest))
    for publisher in others.values():
        victim.graph.node.destroy_publisher(publisher)
    return len(part)


def _descriptions(victim: Victim, generator: np.random.Generator) -> int:
    """Replace the robot description in the middle of a run: by none, half of one, other robots, the same."""
    right = urdf(ROBOT)
    texts = ['', '<robot/>', right[: len(right) // 2], urdf('table1'), right.replace('servicer7', 'other'), right]
    for place, (topic, data) in enumerate(victim.recording[BEFORE : BEFORE + 3000]):
        victim.send(topic, data)
        if place % 50 == 0:
            victim.describe(one(texts, generator))
    return 60


WAYS: dict[str, Callable[[Victim, np.random.Generator], int]] = {
    '100 000 names': partial(_changed, 'joint_states', _many_names, 20),
    'lengths that do not match': partial(_changed, 'joint_states', _lengths, 1000),
    'names that change': partial(_changed, 'joint_states', _other_names, 1000),
    'joints: NaN, infinite, 1e300': partial(_changed, 'joint_states', _numbers, 1000),
    'odometry: NaN, infinite, 1e300': partial(_changed, 'odom', _poses, 1000),
    'joint stamps: 0, far future, negative': partial(_changed, 'joint_states', _stamps, 1000),
    'odometry stamps: the same': partial(_changed, 'odom', _stamps, 1000),
    'frame_id of 1 MB, joints': partial(_changed, 'joint_states', _frames, 50),
    'frame_id of 1 MB, odometry': partial(_changed, 'odom', _frames, 50),
    'covariances that are none': partial(_changed, 'odom', _covariances, 1000),
    'damaged bytes': _bytes,
    'messages of no bytes, from a second publisher': _no_bytes,
    'a flood of 5 kHz on each topic, or what the sender manages': _flood,
    'two publishers with clocks 100 s apart': _two_clocks,
    'other robot descriptions in the middle': _descriptions,
}


@dataclass(frozen=True)
class Answer:
    """What the node did about one kind of garbage.

    Attributes
    ----------
    count : messages of garbage
    sent : s, in which they and the clean ones among them were sent
    silence : s, the longest between two reports in /diagnostics
    memory : MB, resident afterwards
    complaints : what was said to be wrong
    """

    count: int
    sent: float
    silence: float
    memory: float
    complaints: list[str]


def garbage(victim: Victim, seed: int, only: str = '') -> dict[str, Answer]:
    """Return, by kind, what the node did about it; each comes after ~/reset and the beginning of a clean run.

    Parameters
    ----------
    victim : the node
    seed : of what is drawn, for each kind by itself
    only : a part of the names of the kinds that are sent
    """
    answers = {}
    chosen = [(number, name, send) for number, (name, send) in enumerate(WAYS.items()) if only in name]
    for number, name, send in tqdm(chosen, unit=' kinds', disable=None, leave=False):
        victim.describe(urdf(ROBOT))
        victim.drained()
        victim.reset()
        for topic, data in victim.recording[:BEFORE]:
            victim.send(topic, data)
        victim.drained()
        victim.forget()
        begin = time.monotonic()
        count = send(victim, np.random.default_rng([seed, 1, number]))
        sent = time.monotonic() - begin
        victim.drained()
        answers[name] = Answer(count, sent, victim.silence(), victim.memory(), victim.complaints())
    return answers


def garbage_table(answers: dict[str, Answer]) -> str:
    """Return the table of the page."""
    rows = []
    for name, answer in answers.items():
        # The one that says most of what is wrong, without the counts, which would be others at another time.
        said = max((_COUNTS.sub('', text) for text in answer.complaints), key=len, default='-').replace('|', '/')
        said = said if len(said) <= _LONGEST else f'{said[:_LONGEST]} ...'
        numbers = (f'{answer.sent:.1f}', f'{answer.silence:.1f}', f'{answer.memory:.0f}')
        rows.append([name, str(answer.count), *numbers, said])
    header = ['garbage', 'messages', 'sent in, s', 'longest silence, s', 'MB after', 'said in /diagnostics']
    return table(header, rows, words=True)
