"""Messages of a bag as columns: what is the same for many is done for many at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.samples import Stamps

Raw = tuple[str, bytes, int]  # topic, CDR bytes, and the time it was recorded at, ns

_AT_ONCE = 1_000
LATEST = 2**63 - 1  # ns: later times, which are none, count as this


@dataclass(frozen=True)
class Block:
    """N messages in the order they were recorded.

    Attributes
    ----------
    topics : names
    contents : CDR bytes
    times : (N,) ns, when each was recorded
    """

    topics: list[str]
    contents: list[bytes]
    times: Stamps

    def __len__(self) -> int:
        return len(self.topics)

    def __iter__(self) -> Iterator[Raw]:
        return zip(self.topics, self.contents, self.times.tolist(), strict=True)

    def part(self, begin: int, end: int | None = None) -> Block:
        """Return some that follow one another."""
        return Block(self.topics[begin:end], self.contents[begin:end], self.times[begin:end])

    def with_more(self, other: Block) -> Block:
        """Return these and what follows them."""
        times = np.concatenate((self.times, other.times))
        return Block(self.topics + other.topics, self.contents + other.contents, times)


def in_blocks(messages: Iterable[Raw]) -> Iterator[Block]:
    """Yield messages in blocks; where reading them fails, those before come first."""
    part: list[Raw] = []
    size = 0
    try:
        for message in messages:
            part.append(message)
            size += len(message[1])
            if len(part) == _AT_ONCE or size > limits.BLOCK_BYTES:
                yield _block(part)
                part, size = [], 0
    except Exception:
        yield _block(part)
        raise
    yield _block(part)


def of_length(blocks: Iterable[Block], length: int) -> Iterator[Block]:
    """Yield the same messages in blocks of a length, the last one shorter, and those of very large messages."""
    waiting = _block([])
    for block in blocks:
        waiting = waiting.with_more(block)
        whole = len(waiting) // length * length
        for begin in range(0, whole, length):
            yield waiting.part(begin, begin + length)
        waiting = waiting.part(whole)
        if sum(map(len, waiting.contents)) > limits.BLOCK_BYTES:
            yield waiting
            waiting = waiting.part(len(waiting))
    if len(waiting):
        yield waiting


def _block(messages: Sequence[Raw]) -> Block:
    topics, contents, times = zip(*messages, strict=True) if messages else ((), (), ())
    return Block(list(topics), list(contents), np.array([min(time, LATEST) for time in times], dtype=np.int64))
