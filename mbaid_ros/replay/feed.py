"""A bag's messages, handed over some thousands at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from mbaid_ros.bags import BagReader
from mbaid_ros.session import Session

JOINT_STATE_TYPE = 'sensor_msgs/msg/JointState'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'
THRUST_TYPE = 'geometry_msgs/msg/WrenchStamped'
THRUST = '/thrust'  # read where a bag has it, even if not asked for

# How the calls are spread does not change the numbers; this many messages keep the arrays long and the memory short.
_MESSAGES_AT_ONCE = 2_000

# Called now and then with the number of messages read and that of all.
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Inputs:
    """The topics to read.

    Attributes
    ----------
    joint_states : of type sensor_msgs/JointState
    odometry : of type nav_msgs/Odometry
    thrust : of type geometry_msgs/WrenchStamped; empty is /thrust, where there is one
    """

    joint_states: str = '/joint_states'
    odometry: str = '/odom'
    thrust: str = ''

    def topics(self, bag: BagReader) -> tuple[str, ...]:
        """Return what of a bag is to be read, joint states and odometry first.

        Raises
        ------
        DataError
            The bag lacks a topic, or has it with another type.
        """
        bag.require(self.joint_states, JOINT_STATE_TYPE)
        bag.require(self.odometry, ODOMETRY_TYPE)
        if self.thrust:
            bag.require(self.thrust, THRUST_TYPE)
            return self.joint_states, self.odometry, self.thrust
        present = THRUST in bag.topics and bag.topics[THRUST].type == THRUST_TYPE
        return (self.joint_states, self.odometry, *((THRUST,) if present else ()))

    def add_to(self, session: Session, topic: str, message: Any) -> None:
        """Hand a message of one of the topics to a session."""
        if topic == self.joint_states:
            session.add_joint_state(message)
        elif topic == self.odometry:
            session.add_odometry(message)
        else:
            session.add_thrust(message)


def feed(
    bag: BagReader, inputs: Inputs, add: Callable[[str, Any, int], None], progress: Progress | None
) -> Iterator[None]:
    """Hand over a bag's messages; yield where it is time to work through them, the last time at the end.

    Parameters
    ----------
    bag : an open bag
    inputs : the topics to read
    add : takes topic, message and the time it was recorded at, ns
    progress : Progress

    Raises
    ------
    DataError
        The bag lacks a topic, or has it with another type.
    """
    topics = inputs.topics(bag)
    total = sum(bag.topics[topic].count for topic in topics)
    for count, message in enumerate(bag.read(topics), start=1):
        add(*message)
        if count % _MESSAGES_AT_ONCE == 0:
            yield
            if progress:
                progress(count, total)
    yield
    if progress:
        progress(total, total)


@contextmanager
def progress_bar(bag: str) -> Iterator[Progress]:
    """Show a bar on a terminal, nothing when piped."""
    with tqdm(desc=Path(bag).name, unit=' messages', disable=None, leave=False) as bar:

        def advance(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield advance
