"""Messages of a bag in blocks: whatever their lengths, the messages are the same."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from mbaid_ros.bags.chunks import (
    Block,
    Raw,
    in_blocks,
    of_length,
)


def messages(count: int) -> list[Raw]:
    return [(f'/{"ab"[k % 3 % 2]}', bytes([k % 251]), 10 * k) for k in range(count)]


def content(blocks: list[Block]) -> list[Raw]:
    return [message for block in blocks for message in block]


@pytest.mark.parametrize('count', [0, 1, 999, 1000, 1001, 2500])
def test_blocks_hold_the_messages(count: int) -> None:
    assert content(list(in_blocks(messages(count)))) == messages(count)


@pytest.mark.parametrize('count', [0, 5, 1000, 1700])
def test_what_was_read_before_an_error_comes_first(count: int) -> None:
    def failing() -> Iterator[Raw]:
        yield from messages(count)
        raise EOFError('cut off')

    found: list[Block] = []
    with pytest.raises(EOFError, match='cut off'):
        found.extend(in_blocks(failing()))
    assert content(found) == messages(count)


@pytest.mark.parametrize('length', [1, 7, 64, 1000])
@pytest.mark.parametrize('seed', range(3))
def test_blocks_of_a_length(length: int, seed: int) -> None:
    (whole,) = in_blocks(messages(300))
    cuts = [0, *np.sort(np.random.default_rng(seed).integers(0, 300, 9)).tolist(), 300]
    found = list(of_length([whole.part(*pair) for pair in pairwise(cuts)], length))
    assert [len(block) for block in found[:-1]] == [length] * (len(found) - 1)
    assert 0 < len(found[-1]) <= length
    assert content(found) == messages(300)


def test_a_time_that_no_clock_shows_is_no_failure() -> None:
    (block,) = in_blocks([('/a', b'', 2**64 - 1)])
    assert block.times.tolist() == [2**63 - 1]
