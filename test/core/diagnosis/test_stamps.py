"""Stamps that are plainly wrong: batches that are stamped on arrival, and clocks that were set."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.diagnosis.plain_faults import StampPattern
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Stamps

COUNT, SPACING = 600, 20_000_000
REGULAR: Stamps = 1_700_000_000_000_000_000 + SPACING * np.arange(COUNT)
TIME = 1e-9 * SPACING * np.arange(COUNT)
RANDOM = np.random.default_rng(5)


def found(stamp: Stamps, pieces: int = 1, position: Array | None = None) -> list[str]:
    """Return what is found, by its symptom."""
    moving = np.column_stack((np.sin(0.3 * TIME), np.cos(0.2 * TIME)))[: len(stamp)]
    pattern = StampPattern('the joint states', 1e-4)
    lines: dict[str, str] = {}
    for piece in np.array_split(np.arange(len(stamp)), pieces):
        part = (moving if position is None else position)[piece]
        for symptom, _, text in pattern.add(stamp[piece], part):
            lines.setdefault(symptom, text)
    return list(lines.values())


@pytest.mark.parametrize('pieces', [1, 13, COUNT])
def test_regular_jittering_late_and_missing_messages_are_no_fault(pieces: int) -> None:
    order = np.arange(COUNT)
    order[[200, 201, 300, 310]] = order[[201, 200, 310, 300]]
    jitter = np.round(4e6 * RANDOM.standard_normal(COUNT)).astype(np.int64)
    random = REGULAR[0] + np.cumsum(np.round(SPACING * RANDOM.exponential(size=COUNT)).astype(np.int64) + 1)
    for stamp in (REGULAR, REGULAR + jitter, REGULAR[order], random):
        assert found(stamp, pieces) == []
    kept = np.r_[0:200, 240:COUNT]
    position = np.column_stack((np.sin(0.3 * TIME), np.cos(0.2 * TIME)))
    assert found(REGULAR[kept], pieces, position[kept]) == []


@pytest.mark.parametrize('pieces', [1, 13, COUNT])
@pytest.mark.parametrize('size', [3, 5, 20])
def test_batches_are_named(size: int, pieces: int) -> None:
    number = np.arange(COUNT)
    stamp = REGULAR[np.minimum(number - number % size + size - 1, COUNT - 1)] + 100_000 * (number % size)
    (text,) = found(stamp, pieces)
    assert text.startswith('the joint states come in batches of about ')


@pytest.mark.parametrize('pieces', [1, 13, COUNT])
@pytest.mark.parametrize(
    ('step', 'how'), [(-0.4, 'went back by 0.4 s at 6.0 s'), (0.4, 'went forward by 0.42 s at 6.0 s')]
)
def test_a_clock_that_was_set_is_named(step: float, how: str, pieces: int) -> None:
    stamp = REGULAR + round(1e9 * step) * (np.arange(COUNT) > 300)
    (text,) = found(stamp, pieces)
    assert f'the stamps of the joint states {how}' in text
