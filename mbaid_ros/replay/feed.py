"""A bag's messages, handed over some thousands at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from mbaid_ros.bags import BagReader, Recorded
from mbaid_ros.replay.inputs import Inputs

# How the calls are spread does not change the numbers; this many messages keep the arrays long and the memory short.
_MESSAGES_AT_ONCE = 4_000

# Called now and then with the number of messages read and that of all.
Progress = Callable[[int, int], None]


def feed(bag: BagReader, inputs: Inputs, add: Callable[[Recorded], None], progress: Progress | None) -> Iterator[None]:
    """Hand over a bag's messages; yield where it is time to work through them, the last time at the end.

    Parameters
    ----------
    bag : an open bag
    inputs : the topics to read
    add : takes messages, in order
    progress : Progress

    Raises
    ------
    DataError
        The bag lacks a topic, or has it with another type.
    """
    topics = inputs.topics(bag)
    total = sum(bag.topics[topic].count for topic in topics)
    count = 0
    for part in bag.read_packed(topics, _MESSAGES_AT_ONCE):
        add(part)
        count += len(part)
        if len(part) == _MESSAGES_AT_ONCE:
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
