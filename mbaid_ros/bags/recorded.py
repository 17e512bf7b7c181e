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
    """N messages.

    Attributes
    ----------
    topics : N names, the topic of each message in the order they were recorded
    messages : those of each topic, in order: a list, or `Packets`
    times : of each topic, ns, when they were recorded
    """

    topics: Sequence[str]
    messages: Mapping[str, Sequence[Any]]
    times: Mapping[str, Stamps]

    def __len__(self) -> int:
        return len(self.topics)

    def __iter__(self) -> Iterator[Timed]:
        left = {topic: zip(self.of(topic), self.times[topic].tolist(), strict=True) for topic in self.messages}
        return ((topic, *next(left[topic])) for topic in self.topics)

    def of(self, topic: str) -> Sequence[Any]:
        """Return the messages of a topic."""
        return self.messages.get(topic, ())

    def runs(self, topic: str) -> Iterator[Recorded]:
        """Yield the same messages in parts: those of a topic that follow one another, and those between them."""
        if topic not in self.messages:
            yield self
            return
        done = dict.fromkeys(self.messages, 0)
        for _, group in groupby(self.topics, key=topic.__eq__):
            names = list(group)
            some = {name: slice(done[name], done[name] + names.count(name)) for name in dict.fromkeys(names)}
            yield Recorded(
                names,
                {name: self.messages[name][part] for name, part in some.items()},
                {name: self.times[name][part] for name, part in some.items()},
            )
            done.update({name: part.stop for name, part in some.items()})
