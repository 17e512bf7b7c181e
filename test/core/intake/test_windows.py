"""Samples cut into windows by their stamps alone, whatever the pieces they come in."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.sensors.streams import Windows


def samples_at(time: Array) -> Samples:
    count = len(time)
    three = np.arange(3.0 * count).reshape(count, 3)
    noise = SensorNoise(*(1e-3,) * 6)
    return Samples(
        time=time,
        joint_position=three[:, :2],
        joint_velocity=three[:, 1:],
        base_position=three,
        base_rotation=np.tile(np.eye(3), (count, 1, 1)),
        base_linear_velocity=three,
        base_angular_velocity=three,
        pose_covariance=np.tile(noise.pose_covariance(), (count, 1, 1)),
        twist_covariance=np.tile(noise.twist_covariance(), (count, 1, 1)),
    )


def same(left: Samples, right: Samples) -> bool:
    return all(
        np.array_equal(getattr(left, item.name), getattr(right, item.name), equal_nan=True) for item in fields(Samples)
    )


@given(
    steps=st.lists(st.floats(0.001, 0.9), min_size=1, max_size=60),
    cuts=st.lists(st.integers(1, 60), max_size=20),
)
@settings(max_examples=80, deadline=None, derandomize=True)
def test_pieces_do_not_matter(steps: list[float], cuts: list[int]) -> None:
    samples = samples_at(np.cumsum(steps) - steps[0])
    whole, pieces = Windows(0.5), Windows(0.5)
    expected = [*whole.push(samples), *whole.flush()]
    found = []
    for part in np.split(np.arange(len(samples)), sorted({cut for cut in cuts if cut < len(samples)})):
        found += pieces.push(samples[part])
    found += pieces.flush()
    assert len(found) == len(expected)
    assert all(same(left, right) for left, right in zip(found, expected, strict=True))
    assert same(Samples.concatenate(expected), samples)


@pytest.mark.parametrize('length', [0.5, 0.1, 0.7])
def test_a_sample_at_a_limit_opens_the_next_window(length: float) -> None:
    # Multiples of the period in ns, as stamps give them: they round either way.
    time = np.arange(140) * 100_000_000 * 1e-9
    cutter = Windows(length)
    cut = [*cutter.push(samples_at(time)), *cutter.flush()]
    per_window = round(length / 0.1)
    assert [len(window) for window in cut] == [per_window] * (140 // per_window)
    assert [round(window.time[0] / length, 6) for window in cut] == list(range(len(cut)))


def test_a_window_is_released_by_the_first_sample_after_it() -> None:
    cutter = Windows(1.0)
    assert cutter.push(samples_at(np.array([0.0, 0.4, 0.9]))) == []
    closed = cutter.push(samples_at(np.array([1.0])))
    assert [window.time.tolist() for window in closed] == [[0.0, 0.4, 0.9]]
    assert cutter.push(samples_at(np.array([1.5]))) == []


def test_empty_windows_are_left_out() -> None:
    cutter = Windows(0.5)
    closed = cutter.push(samples_at(np.array([0.0, 0.1, 7.3, 9.9])))
    assert [window.time.tolist() for window in closed] == [[0.0, 0.1], [7.3]]
    assert [window.time.tolist() for window in cutter.flush()] == [[9.9]]
    assert cutter.flush() == []
