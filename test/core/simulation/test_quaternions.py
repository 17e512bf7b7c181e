"""Quaternions against rotation matrices, and their independence of the batch."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core import geometry
from mbaid_ros.core.geometry import Array
from mbaid_ros.simulation import quaternions

COUNT = 50


@pytest.fixture(name='pair')
def random_pair() -> tuple[Array, Array]:
    rng = np.random.default_rng(0)
    return quaternions.normalised(rng.normal(size=(COUNT, 4))), quaternions.normalised(rng.normal(size=(COUNT, 4)))


def test_the_product_turns_by_one_then_the_other(pair: tuple[Array, Array]) -> None:
    left, right = pair
    product = geometry.rotation_from_quaternion(quaternions.product(left, right))
    assert product == pytest.approx(
        geometry.rotation_from_quaternion(left) @ geometry.rotation_from_quaternion(right), abs=1e-14
    )


def test_rotate_is_the_matrix(pair: tuple[Array, Array]) -> None:
    left, _ = pair
    vector = np.random.default_rng(1).normal(size=(COUNT, 3))
    matrix = geometry.rotation_from_quaternion(left)
    assert quaternions.rotate(left, vector) == pytest.approx(geometry.rotate(matrix, vector), abs=1e-14)
    back = quaternions.rotate(quaternions.conjugate(left), vector)
    assert back == pytest.approx(geometry.rotate_back(matrix, vector), abs=1e-14)


@pytest.mark.parametrize('size', [0.0, 1e-12, 1e-3, 1.0, 3.0])
def test_exp_is_the_matrix_exponential(size: float) -> None:
    vector = size * np.random.default_rng(2).normal(size=(COUNT, 3))
    turned = geometry.rotation_from_quaternion(quaternions.exp(vector))
    assert turned == pytest.approx(geometry.exp(vector), abs=1e-14)


def test_no_batch_differs(pair: tuple[Array, Array]) -> None:
    left, right = pair
    vector = right[:, :3]
    for function, second in ((quaternions.product, right), (quaternions.rotate, vector)):
        one_by_one = [function(left[index : index + 1], second[index : index + 1])[0] for index in range(COUNT)]
        assert np.array_equal(function(left, second), np.array(one_by_one))
