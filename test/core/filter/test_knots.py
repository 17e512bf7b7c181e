"""Knots and midpoints of a smooth motion: fourth order, whatever the sample times."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.filter.knots import Knots, averages, bridged, midpoints
from mbaid_ros.core.filter.state import near_part
from mbaid_ros.core.geometry import Array, exp, log
from mbaid_ros.core.robot.momentum import standard
from mbaid_ros.core.samples import Samples

COUNT = 14
MIDDLE = 1.3  # s


def rotation(time: Array) -> Array:
    """Return a motion that turns about two axes at once."""
    zero = np.zeros_like(time)
    return exp(np.stack((np.sin(time), 0.4 * time, zero), 1)) @ exp(np.stack((zero, zero, np.cos(0.7 * time)), 1))


def position(time: Array) -> Array:
    return np.stack((np.sin(time), np.cos(0.8 * time), 0.3 * time**2), axis=1)


def angles(time: Array) -> Array:
    return np.stack((np.sin(1.1 * time), np.cos(0.6 * time)), axis=1)


def rates(time: Array) -> Array:
    return np.stack((1.1 * np.cos(1.1 * time), -0.6 * np.sin(0.6 * time)), axis=1)


def sampled(time: Array) -> Samples:
    count = len(time)
    identity = np.tile(np.eye(6), (count, 1, 1))
    return Samples(
        time, angles(time), rates(time), position(time), rotation(time), position(time), angles(time) @ np.ones((2, 3)),
        identity, identity,
    )  # fmt: skip


def averaged(samples: Samples, start: float, spacing: float, count: int, origin: Array) -> Knots:
    return averages([samples], np.array([start]), spacing, count, origin)


def knots_of(spacing: float, samples: int, jitter: float = 0.0, interval: int = 5, late: float = 0.0) -> Knots:
    """Return knots of so many samples each, one interval of them about MIDDLE.

    Sample times jitter by a part of their spacing, symmetric in each knot, and are `late` by a part of a knot.
    """
    start = MIDDLE - (interval + 1) * spacing
    inner = (np.arange(samples) + 0.5) / samples - 0.5
    inner = inner + late + jitter * np.sin(7.0 * inner) / samples
    time = (start + (np.arange(COUNT) + 0.5)[:, None] * spacing + inner * spacing).ravel()
    return averaged(sampled(time), start, spacing, COUNT, np.zeros(3))


def order(error: list[float]) -> float:
    return float(np.log2(error[0] / error[1]))


@pytest.mark.parametrize('samples', [1, 2, 5])
@pytest.mark.parametrize(('jitter', 'late'), [(0.0, 0.0), (0.5, 0.0), (0.0, 0.1)])
def test_midpoints_are_of_fourth_order(samples: int, jitter: float, late: float) -> None:
    found: dict[str, list[float]] = {}
    for spacing in (0.2, 0.1):
        inner = midpoints(knots_of(spacing, samples, jitter, late=late), spacing)[5:6]
        time = np.array([MIDDLE])
        ends = (time - spacing / 2, time + spacing / 2)
        for name, error in (
            ('joints', inner.joint_position - angles(time)),
            ('rates', inner.joint_velocity - rates(time)),
            ('position', inner.base_position - position(time)),
            ('twist', inner.base_twist[:, :3] - position(time)),
            ('rotation', log(inner.base_rotation @ np.swapaxes(rotation(time), 1, 2))),
            ('turn', (inner.turn - log(rotation(ends[1]) @ np.swapaxes(rotation(ends[0]), 1, 2))) / spacing),
            ('step', (inner.step - (position(ends[1]) - position(ends[0]))) / spacing),
        ):
            found.setdefault(name, []).append(float(np.abs(error).max()))
    for name, sizes in found.items():
        least = 2.7 if late and name == 'turn' else 3.3  # two rotations over the offset count as commuting
        assert sizes[1] < 2e-7 or order(sizes) > least, (name, sizes)
        assert sizes[0] < 3e-4, name


def test_ends_follow_the_line_of_their_neighbours_corrections() -> None:
    error = []
    for spacing in (0.1, 0.05):
        middle = midpoints(knots_of(spacing, 5, interval=0), spacing)
        error.append(float(np.abs(middle.base_position[0] - position(np.array([MIDDLE]))[0]).max()))
    assert order(error) > 3.3


@pytest.mark.parametrize('place', [1, 5, COUNT - 2])
def test_a_knot_without_samples_is_bridged(place: int) -> None:
    sizes = []
    for spacing in (0.1, 0.05):
        full = knots_of(spacing, 5)
        start = MIDDLE - 6.0 * spacing
        time = (start + (np.arange(COUNT) + 0.5)[:, None] * spacing + (np.arange(5) - 2.0) / 5.0 * spacing).ravel()
        knots = averaged(sampled(time[np.arange(len(time)) // 5 != place]), start, spacing, COUNT, np.zeros(3))
        assert np.flatnonzero(knots.empty).tolist() == [place]
        whole = bridged(knots)
        assert not np.any(whole.empty)
        assert np.array_equal(
            np.delete(whole.joint_position, place, axis=0), np.delete(full.joint_position, place, axis=0)
        )
        turned = log(whole.base_rotation @ np.swapaxes(full.base_rotation, 1, 2))
        sizes.append([np.abs(whole.joint_position - full.joint_position).max(), np.abs(turned).max()])
    # Fourth order from four neighbours, second from the two that a knot next to the end has.
    ratio = np.array(sizes[0]) / np.array(sizes[1])
    assert np.all(ratio > (3.2 if place in (1, COUNT - 2) else 13.0))


BODY = standard(np.array([10.0, 0.1, 0.2, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0]))
POINT = np.concatenate((np.zeros(6), BODY, np.zeros(3)))


def test_a_step_is_as_long_as_changes_the_body_by_half_of_its_size() -> None:
    step = np.zeros_like(POINT)
    step[6] = 20.0
    assert near_part(POINT, step) == pytest.approx(0.25)
    assert near_part(POINT, -step) == pytest.approx(0.25)
    assert near_part(POINT, 0.2 * step) == 1.0
