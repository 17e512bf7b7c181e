"""Garbage on every topic of the estimator, among the messages of a clean recording."""

from __future__ import annotations

import re
import struct
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from attack.victim import BEFORE, KINDS, Victim
from benchmarks.bags import ROBOT
from benchmarks.frame import table
from fuzzing.damage import of_bytes, one
from streams import urdf

FLOOD, LONG = 5000.0, 4.0  # Hz, s
SILENCE = 30.0  # s without a report, at most
NUMBERS = (np.nan, np.inf, -np.inf, 1e300)
STAMPS = ((0, 0), (2**31 - 1, 999_999_999), (-(2**31), 0), (-1, 4_000_000_000))  # s, ns
_STAMP = struct.Struct('<iI')  # of a message's header, after four bytes for the encoding
_APART = 100  # s, between the clocks of two publishers
_COUNTS = re.compile(r'^\d+ samples used, \d+ messages dropped( and \d+ not used wholly)? since the last report: ')
_LONGEST = 150  # characters of a complaint in the table
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
    """Send the next messages of the recording, every other one of a topic changed."""
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
    """Send messages with damaged bytes."""
    part = victim.recording[BEFORE : BEFORE + 1000]
    for topic, data in part:
        victim.send(topic, of_bytes(data, generator) or data[:1])
    return len(part)


def _stamped(data: bytes, stamp: int) -> bytes:
    """Return the bytes of a message with another stamp, ns."""
    return data[:4] + _STAMP.pack(*divmod(stamp, 1_000_000_000)) + data[4 + _STAMP.size :]


def _ahead(data: bytes) -> bytes:
    seconds, rest = _STAMP.unpack_from(data, 4)
    return _stamped(data, (seconds + _APART) * 1_000_000_000 + rest)


def _second_publisher(change: Callable[[bytes], bytes], victim: Victim, _generator: np.random.Generator) -> int:
    """Send each message, changed, from a second publisher, too.

    Fast DDS delivers no message without bytes, nor later ones of its publisher: those of the first have to go on.
    """
    others = {topic: victim.graph.publisher(topic, kind) for topic, kind in KINDS.items()}
    part = victim.recording[BEFORE : BEFORE + 1000]
    for topic, data in part:
        others[topic].publish(change(data))
        victim.send(topic, data)
    victim.drained()
    for publisher in others.values():
        victim.graph.node.destroy_publisher(publisher)
    return len(part)


def _flood(victim: Victim, _generator: np.random.Generator) -> int:
    """Send both topics as fast as FLOOD, stamped with the due times."""
    begin = time.time_ns()
    messages = {topic: [data for of, data in victim.recording if of == topic] for topic in KINDS}
    for number in range(round(FLOOD * LONG)):
        due = begin + round(number / FLOOD * 1e9)
        time.sleep(max(0.0, 1e-9 * (due - time.time_ns())))
        for topic, queue in messages.items():
            victim.send(topic, _stamped(queue[number % len(queue)], due))
    return 2 * round(FLOOD * LONG)


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
    'invalid covariances': partial(_changed, 'odom', _covariances, 1000),
    'damaged bytes': _bytes,
    'messages of no bytes, from a second publisher': partial(_second_publisher, lambda _: b''),
    'a flood of 5 kHz on each topic, or as fast as the sender manages': _flood,
    'two publishers with clocks 100 s apart': partial(_second_publisher, _ahead),
    'other robot descriptions in the middle': _descriptions,
}


def garbage(victim: Victim, seed: int, wrong: list[str]) -> str:
    """Return a table of all kinds of garbage; faults are added to a list."""
    rows = []
    for number, (name, send) in enumerate(WAYS.items()):
        victim.begin()
        begin = time.monotonic()
        count = send(victim, np.random.default_rng([seed, 1, number]))
        sent = time.monotonic() - begin
        victim.drained()
        silence = victim.silence()
        if silence > SILENCE:
            wrong.append(f'{name}: nothing in /diagnostics for {silence:.0f} s')
        # Without counts, which vary.
        text = max((_COUNTS.sub('', text) for text in victim.complaints()), key=len, default='-').replace('|', '/')
        text = text if len(text) <= _LONGEST else f'{text[:_LONGEST]} ...'
        rows.append([name, str(count), f'{sent:.1f}', f'{silence:.1f}', f'{victim.memory():.0f}', text])
    header = ['garbage', 'messages', 'sent in, s', 'longest silence, s', 'MB after', 'reported in /diagnostics']
    return table(header, rows, words=True)
