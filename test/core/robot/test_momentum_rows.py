"""The rows by themselves: those of the kernel's states, and of a batch those of its samples to the last bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel, MomentumRows, momentum_rows
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import Samples
from random_robots import random_state, random_storage, random_urdf

SEEDS = range(4)
COUNT = 67


def random_case(seed: int, count: int = COUNT) -> tuple[MomentumKernel, Samples]:
    """Return a tree with two unknown links, and states of it."""
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=int(rng.integers(4, 10))))
    position, velocity, rotation, twist = random_state(rng, model.joints, count)
    none = np.zeros((count, 6, 6))
    place = rng.normal(size=(count, 3))
    samples = Samples(
        np.arange(count) * 0.01, position, velocity, place, rotation, twist[:, :3], twist[:, 3:], none, none
    )
    kernel = MomentumKernel(model, model.last_link, model.links[1].name)
    if seed % 2:
        kernel = kernel.storing(random_storage(rng, model))
        samples = replace(samples, stored=rng.normal(size=(count, kernel.storage.count)))
    return kernel, samples


def arrays(rows: MomentumRows) -> list[Array]:
    return [rows.known, *rows.regressors]


@pytest.mark.parametrize('seed', SEEDS)
def test_they_are_those_of_the_states(seed: int) -> None:
    kernel, samples = random_case(seed)
    rows, states = momentum_rows(kernel, samples), kernel.states(samples)
    assert pytest.approx(states.known_momentum, rel=1e-12, abs=1e-11) == rows.known.T
    for found, link in zip(rows.regressors, kernel.unknown, strict=True):
        assert np.moveaxis(found, -1, 0) == pytest.approx(states.regressor_of(link), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize('size', [1, 2, 5, 32])
@pytest.mark.parametrize('seed', SEEDS)
def test_a_batch_is_its_samples_to_the_last_bit(seed: int, size: int) -> None:
    kernel, samples = random_case(seed)
    together = arrays(momentum_rows(kernel, samples))
    parts = [arrays(momentum_rows(kernel, samples[k : k + size])) for k in range(0, COUNT, size)]
    for whole, cut in zip(together, zip(*parts, strict=True), strict=True):
        assert np.array_equal(np.concatenate(cut, axis=-1), whole)


def test_a_long_batch_is_its_parts_to_the_last_bit() -> None:
    kernel, samples = random_case(0, 7001)
    together = arrays(momentum_rows(kernel, samples))
    parts = [arrays(momentum_rows(kernel, part)) for part in (samples[:7], samples[7:4000], samples[4000:])]
    for whole, cut in zip(together, zip(*parts, strict=True), strict=True):
        assert np.array_equal(np.concatenate(cut, axis=-1), whole)
