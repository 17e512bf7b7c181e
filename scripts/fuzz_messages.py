"""Send damaged messages into the node `estimator`: CDR bytes as they come from the middleware, and their contents.

An input is a stretch of messages of a robot, some with damaged bytes or invalid names, stamps, numbers and covariances;
with wrenches and stored momenta among them. No callback may raise, and estimates stay numbers. After each hundred
inputs the node is reset and receives a clean stream: its estimates have to be those before all inputs, to the last bit.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from tqdm import tqdm

from fuzzing.damage import of_bytes, one
from fuzzing.formats import BAG
from fuzzing.mcap_files import CONFIG
from fuzzing.meanings import FRAMES, NUMBERS, SECONDS, TYPES, meaning
from fuzzing.trial import MEMORY, Found, TooLongError, bounded, memory_begins, memory_peak
from mbaid_ros.bags import BagReader
from mbaid_ros.nodes.estimator import EstimatorNode

MESSAGES = 1200  # of the robot
METHODS = ('difference', 'trajectory')  # by the seed
STRETCH = 60  # messages of an input
EVERY = 100  # inputs, after which the node has to be as it was
OTHERS = {'thrust': WrenchStamped, 'stored_momentum': Vector3Stamped, 'robot_description': String}
RMWError = rclpy_implementation.RMWError


class Node:
    """The node, its callbacks called as the middleware calls them, and its publications."""

    def __init__(self) -> None:
        self.node = EstimatorNode()
        self.published: list[Any] = []
        work = self.node._estimator  # noqa: SLF001 - what is looked for is what its callbacks do
        self.work = work
        keep = work._publication._publishers.publish  # noqa: SLF001

        def publish(estimate: Any, frames: Any, urdf: str) -> None:
            self.published.append(estimate)
            keep(estimate, frames, urdf)

        work._publication._publishers.publish = publish  # type: ignore[method-assign] # noqa: SLF001
        inlets = {**work._subscriptions, 'thrust': work._thrust, 'stored_momentum': work._stored_momentum}  # noqa: SLF001
        self._callbacks: dict[str, Callable[[Any], None]] = {}
        for name, inlet in inlets.items():
            self._callbacks[name] = inlet._on_message  # noqa: SLF001
        self._callbacks['robot_description'] = work._on_description  # noqa: SLF001

    def send(self, topic: str, data: bytes) -> None:
        """Hand over a message as its bytes; bytes that the middleware itself refuses do not arrive."""
        if topic in OTHERS:
            with contextlib.suppress(RMWError):
                self._callbacks[topic](deserialize_message(data, OTHERS[topic]))
        else:
            self._callbacks[topic](data)

    def serve(self, which: int) -> None:
        """Call one of its services."""
        if which == 0:
            self.work._on_capture(Trigger.Request(), Trigger.Response())  # noqa: SLF001
        else:
            self.work._on_pause(SetBool.Request(data=which == 1), SetBool.Response())  # noqa: SLF001

    def of_clean(self, messages: list[tuple[str, bytes]]) -> list[bytes]:
        """Return the bits of its publications for a stream, from ~/reset on."""
        self.work._on_pause(SetBool.Request(data=False), SetBool.Response())  # noqa: SLF001
        self.work._on_reset(Trigger.Request(), Trigger.Response())  # noqa: SLF001
        self.published.clear()
        for topic, data in messages:
            self.send(topic, data)
        return [bits(estimate) for estimate in self.published if estimate.samples]


def bits(estimate: Any) -> bytes:
    """Return all numbers and words of an estimate."""
    numbers = (estimate.parameters, estimate.covariance, estimate.momentum, estimate.momentum_covariance)
    words = [word.encode() for word in (estimate.status, estimate.stage, *estimate.warnings)]
    return b''.join((*(np.asarray(each, dtype=float).tobytes() for each in numbers), *words))


def recorded() -> list[tuple[str, bytes]]:
    """Return the first messages of a robot, as their bytes."""
    topics = [f'/{topic}' for topic in TYPES]
    with BagReader(BAG) as bag:
        return [
            (topic.lstrip('/'), data) for _, (topic, data, _) in zip(range(MESSAGES), bag.raw(topics), strict=False)
        ]


def of_others(generator: np.random.Generator) -> tuple[str, bytes]:
    """Return a message of one of the other topics."""
    topic = one(('thrust', 'stored_momentum'), generator)
    message = OTHERS[topic]()
    message.header.frame_id = one(FRAMES, generator)
    message.header.stamp.sec = one(SECONDS, generator)
    vector = message.vector if topic == 'stored_momentum' else message.wrench.force
    vector.x = one(NUMBERS, generator)
    return topic, bytes(serialize_message(message))


def attacked(clean: list[tuple[str, bytes]], generator: np.random.Generator) -> Iterator[tuple[str, bytes]]:
    """Yield a stretch of messages of which some are damaged."""
    begin = int(generator.integers(0, len(clean) - STRETCH))
    share = one((0.02, 0.2, 1.0), generator)
    for topic, data in clean[begin : begin + STRETCH]:
        if generator.random() >= share:
            yield topic, data
        elif generator.random() < 0.1:
            other, content = of_others(generator)
            damaged = generator.random() < 0.5
            yield other, of_bytes(content, generator) if damaged else content
        elif generator.random() < 0.5:
            yield topic, meaning(topic, data, generator)
        else:
            yield topic, of_bytes(data, generator)


def fuzz(count: int, seed: int, every: int = EVERY) -> Found:
    """Return the outcomes of so many inputs, after each `every` of which the node has to be as it was."""
    found, clean, node = Found(), recorded(), Node()
    expected = node.of_clean(clean)
    for number in tqdm(range(count), unit=' stretches', disable=None, leave=False):
        generator = np.random.default_rng([seed, number])
        stretch = list(attacked(clean, generator))
        at_first, begin = memory_begins(), time.process_time()
        try:
            with bounded():
                for topic, data in stretch:
                    node.send(topic, data)
                if generator.random() < 0.1:
                    node.serve(int(generator.integers(0, 3)))
                node.work._report()  # noqa: SLF001 - a second is over
        except (Exception, TooLongError) as reason:  # noqa: BLE001 - that none comes out is what is tested
            found.wrong.append(f'messages {number}: {type(reason).__name__}: {reason}'[:500])
        found.measured(time.process_time() - begin, memory_peak() - at_first)
        for estimate in node.published:
            if not np.all(np.isfinite(estimate.parameters[estimate.identifiable])):
                found.wrong.append(f'messages {number}: {estimate.parameters} with status {estimate.status}')
        node.published.clear()
        if (number + 1) % every == 0 and node.of_clean(clean) != expected:
            found.wrong.append(f'messages {number}: after ~/reset, a clean stream leads to another estimate')
    if not expected:
        found.wrong.append('the clean stream leads to no estimate')
    if found.largest > MEMORY:
        found.wrong.append(f'{found.largest / 1e6:.0f} MB')
    return found


def on_a_graph(count: int, seed: int, every: int = EVERY) -> Found:
    """Return the outcomes of so many inputs of a node alone on a graph of its own."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    model, method = f'robot_description_file:={CONFIG / "table1.urdf"}', f'method:={METHODS[seed % len(METHODS)]}'
    rclpy.init(args=['', '--ros-args', '-p', model, '-p', method, '--log-level', 'error'])
    usual = os.dup(2)
    try:
        with tempfile.TemporaryFile() as log:
            os.dup2(log.fileno(), 2)  # the log of node and middleware
            return fuzz(count, seed, every)
    finally:
        os.dup2(usual, 2)
        os.close(usual)
        rclpy.try_shutdown()  # type: ignore[attr-defined]


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--inputs', type=int, default=400, metavar='N', help='stretches (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, metavar='N')
    asked = parser.parse_args()
    result = on_a_graph(asked.inputs, asked.seed)
    print(f'messages: {result}')
    sys.exit(bool(result.wrong))
