"""Rotations by the axioms of their group, products by their identities, and every function batch by batch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mbaid_ros.core.geometry import (
    Array,
    bracket,
    cross,
    exp,
    log,
    quaternion_from_rotation,
    rotate,
    rotate_back,
    rotation_from_quaternion,
    skew,
    solve_symmetric,
    unvec,
    vec,
)
from mbaid_ros.simulation import quaternions

COUNT = 200
# A few rounding errors of numbers of size one.
ROUNDING = 1e-14


def rotation_vectors(count: int = COUNT, seed: int = 0) -> Array:
    """Return rotation vectors in all directions, with angles from 0 to just below pi."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    angle = np.linspace(0.0, np.pi - 1e-6, count)
    return angle[:, None] * direction / np.linalg.norm(direction, axis=1)[:, None]


def rotations(count: int = COUNT, seed: int = 0) -> Array:
    return exp(rotation_vectors(count, seed))


def vectors(seed: int) -> Array:
    return np.random.default_rng(seed).normal(size=(COUNT, 3))


def symmetric(seed: int) -> Array:
    matrix = np.random.default_rng(seed).normal(size=(COUNT, 3, 3))
    return np.asarray(matrix + np.swapaxes(matrix, 1, 2))


def test_the_logarithm_inverts_the_exponential_at_every_angle() -> None:
    vector = rotation_vectors()
    # Near pi the angle is as well conditioned as elsewhere: the quaternion, not the trace, gives it.
    assert log(exp(vector)) == pytest.approx(vector, abs=10.0 * ROUNDING)


@pytest.mark.parametrize('angle', [0.0, 1e-300, 1e-12, 1e-8, 1e-4])
def test_the_logarithm_of_a_small_turn(angle: float) -> None:
    vector = angle * np.array([0.6, 0.0, -0.8])
    found = log(exp(vector))
    # 1 is added to the elements: an angle has the absolute precision of 1.
    assert found == pytest.approx(vector, rel=1e-15, abs=2e-16)
    assert np.isfinite(found).all()


@pytest.mark.parametrize('axis', [*np.eye(3), *-np.eye(3), np.array([0.6, -0.8, 0.0]), -np.ones(3) / np.sqrt(3.0)])
def test_half_a_turn_comes_back_as_half_a_turn(axis: Array) -> None:
    matrix = exp(np.pi * axis)
    vector = log(matrix)
    assert np.linalg.norm(vector) == pytest.approx(np.pi, abs=ROUNDING)
    # Both directions of the axis are the same half turn.
    assert exp(vector) == pytest.approx(matrix, abs=ROUNDING)


def test_quaternions_and_rotations_convert_into_each_other() -> None:
    matrix = rotations()
    quaternion = quaternion_from_rotation(matrix)
    assert np.linalg.norm(quaternion, axis=1) == pytest.approx(np.ones(COUNT), abs=ROUNDING)
    assert rotation_from_quaternion(quaternion) == pytest.approx(matrix, abs=ROUNDING)
    assert rotation_from_quaternion(-3.0 * quaternion) == pytest.approx(matrix, abs=ROUNDING)


def test_the_quaternion_has_the_order_of_ros() -> None:
    quarter_about_x = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # x, y, z, w
    assert rotation_from_quaternion(quarter_about_x) == pytest.approx(
        np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), abs=ROUNDING
    )


def test_products_of_vectors() -> None:
    a, b, rotation = vectors(1), vectors(2), rotations()
    product = np.cross(a, b)
    assert cross(a, b) == pytest.approx(product, abs=ROUNDING)
    assert rotate(skew(a), b) == pytest.approx(product, abs=ROUNDING)
    # R (a x b) = R a x R b
    assert rotate(rotation, product) == pytest.approx(
        cross(rotate(rotation, a), rotate(rotation, b)), abs=10.0 * ROUNDING
    )
    assert rotate_back(rotation, rotate(rotation, a)) == pytest.approx(a, abs=10.0 * ROUNDING)


def test_the_bracket_turns_the_product_of_inertia_and_vector_round() -> None:
    inertia, vector = symmetric(3), vectors(4)
    product = rotate(inertia, vector)
    assert rotate(bracket(vector), vec(inertia)) == pytest.approx(product, abs=ROUNDING)
    # The paper's correction: R I R^T w = R bracket(R^T w) vec(I).
    rotation = rotations()
    turned = rotation @ inertia @ np.swapaxes(rotation, 1, 2)
    back = bracket(rotate_back(rotation, vector))
    assert rotate(rotation @ back, vec(inertia)) == pytest.approx(rotate(turned, vector), abs=10.0 * ROUNDING)


FUNCTIONS: list[tuple[Callable[..., Array], tuple[Array, ...]]] = [
    (skew, (vectors(6),)),
    (bracket, (vectors(6),)),
    (unvec, (np.random.default_rng(7).normal(size=(COUNT, 6)),)),
    (vec, (symmetric(8),)),
    (exp, (rotation_vectors(),)),
    (log, (rotations(),)),
    (quaternion_from_rotation, (rotations(),)),
    (rotation_from_quaternion, (np.random.default_rng(9).normal(size=(COUNT, 4)),)),
    (cross, (vectors(10), vectors(11))),
    (rotate, (rotations(), vectors(12))),
    (rotate_back, (rotations(), vectors(12))),
    (quaternions.product, (np.random.default_rng(14).normal(size=(COUNT, 4)), np.ones((COUNT, 4)))),
    (quaternions.rotate, (np.random.default_rng(15).normal(size=(COUNT, 4)), vectors(12))),
]


@pytest.mark.parametrize(('function', 'arguments'), FUNCTIONS, ids=lambda value: getattr(value, '__name__', ''))
def test_a_batch_is_its_elements_to_the_last_bit(function: Callable[..., Array], arguments: tuple[Array, ...]) -> None:
    together = function(*arguments)
    for size in (1, 3, 16):
        cuts = range(0, COUNT, size)
        parts = [function(*(argument[cut : cut + size] for argument in arguments)) for cut in cuts]
        assert np.array_equal(np.concatenate(parts), together)
    # Without the leading axis, and with two of them.
    assert np.array_equal(function(*(argument[17] for argument in arguments)), together[17])
    folded = function(*(argument.reshape(4, COUNT // 4, *argument.shape[1:]) for argument in arguments))
    assert np.array_equal(folded.reshape(together.shape), together)


PAIRS = 50


@pytest.mark.parametrize('size', [0.0, 1e-12, 1e-3, 1.0, 3.0])
def test_exp_is_the_matrix_exponential(size: float) -> None:
    vector = size * np.random.default_rng(2).normal(size=(PAIRS, 3))
    turned = rotation_from_quaternion(quaternions.exp(vector))
    assert turned == pytest.approx(exp(vector), abs=1e-14)


# -- Records of arrays, queues of them, and symmetric systems with empty directions.


def test_directions_without_information_are_left_alone() -> None:
    basis = np.linalg.qr(np.random.default_rng(10).normal(size=(3, 3)))[0]
    information = (basis * np.array([4.0, 1.0, 0.0])) @ basis.T
    right_side = information @ np.array([1.0, 2.0, 3.0])
    found = solve_symmetric(information, right_side)
    assert information @ found == pytest.approx(right_side, rel=1e-9)
    assert np.abs(found).max() < 10.0


def test_unknowns_of_very_different_size_are_solved_for() -> None:
    full = np.diag([1e12, 1.0, 1e-12])
    assert solve_symmetric(full, np.array([1e12, 2.0, 3e-12])) == pytest.approx([1.0, 2.0, 3.0])
