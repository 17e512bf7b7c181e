"""Jumps of wrapped angles, of joints that turn slowly and of wheels that turn by more than a half between readings."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import JointStream
from mbaid_ros.core.sensors.joints import JointMerge

COUNT, SPACING = 200, 20_000_000  # ns
RANDOM = np.random.default_rng(2)


def merged(position: Array, velocity: Array, pieces: int) -> Array:
    """Return the positions (N, 1) that one turning joint has after the merge."""
    merge = JointMerge(np.array([True]), 100_000_000, 0)
    parts = []
    for piece in np.array_split(np.arange(COUNT), pieces):
        found = merge.push({(0,): JointStream(piece * SPACING, position[piece, None], velocity[piece, None])})
        parts += [] if found is None else [found.position[:, 0]]
    return np.concatenate(parts)


@pytest.mark.parametrize('pieces', [1, 9, COUNT])
@pytest.mark.parametrize('speed', [-400.0, -170.0, 0.3, 1000.0])
@pytest.mark.parametrize('wrapped', [True, False])
def test_positions_follow_the_velocity(speed: float, pieces: int, *, wrapped: bool) -> None:
    angle = 0.3 + speed * 1e-9 * SPACING * np.arange(COUNT)
    read = np.angle(np.exp(1j * angle)) if wrapped else angle
    read += 1e-3 * RANDOM.standard_normal(COUNT)
    velocity = speed + 0.1 * RANDOM.standard_normal(COUNT)
    found = merged(read, velocity, pieces)
    assert np.ptp(found - angle) < 0.01


@pytest.mark.parametrize('velocity', [np.nan, 0.0, 1e4])
def test_a_velocity_that_is_missing_or_wrong_turns_nothing(velocity: float) -> None:
    angle = np.pi - 0.05 * np.cos(0.1 * np.arange(COUNT))
    found = merged(np.angle(np.exp(1j * angle)), np.full(COUNT, velocity), 1)
    assert np.ptp(found - angle) < 1e-9
