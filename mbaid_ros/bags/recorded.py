"""Messages of several topics as they were recorded: those of each topic together, and their order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from mbaid_ros.core.samples import Stamps

Timed = tuple[str, Any, int]  # topic, message, and the time it was recorded at, ns


@dataclass(frozen=True)
class Recorded:
    """Some messages.

    Attributes
    ----------
    topics : N names, the topic of each message in the order they were recorded
    times : (N,) ns, when each was recorded
    messages : those of each topic, in order: a list, or `Packets`
    """

    topics: Sequence[str]
    times: Stamps
    messages: Mapping[str, Sequence[Any]]

    def __len__(self) -> int:
        return len(self.topics)

    def __iter__(self) -> Iterator[Timed]:
        left = {topic: iter(messages) for topic, messages in self.messages.items()}
        return ((topic, next(left[topic]), time) for topic, time in zip(self.topics, self.times.tolist(), strict=True))

    def of(self, topic: str) -> Sequence[Any]:
        """Return the messages of a topic."""
        return self.messages.get(topic, ())

    def times_of(self, topic: str) -> Stamps:
        """Return when the messages of a topic were recorded, (n,) ns."""
        return self.times[list(map(topic.__eq__, self.topics))]

    def runs(self, topic: str) -> Iterator[Recorded]:
        """Yield the same messages in parts: those of a topic that follow one another, and those between them."""
        if topic not in self.messages:
            yield self
            return
        done = dict.fromkeys(self.messages, 0)
        begin = 0
        for _, group in groupby(self.topics, key=topic.__eq__):
            names = list(group)
            counts = {name: names.count(name) for name in dict.fromkeys(names)}
            parts = {name: self.messages[name][done[name] : done[name] + count] for name, count in counts.items()}
            yield Recorded(names, self.times[begin : begin + len(names)], parts)
            begin += len(names)
            done.update({name: done[name] + count for name, count in counts.items()})
