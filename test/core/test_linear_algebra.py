"""Symmetric systems with empty directions, roots and inverses, and limits of chi-square."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from mbaid_ros.core.geometry import (
    Array,
    chi_square_limit,
    composed,
    inverse,
    inverse_factor,
    inverse_factors,
    inverse_root,
    is_positive,
    solve_definite,
    solve_symmetric,
    square_root,
)

SIZES = 10.0 ** np.array([-4.0, 0.0, 3.0, 5.0])  # of unknowns in quite other units


def definite(seed: int) -> Array:
    """Return information of unknowns in other units."""
    rows = np.random.default_rng(seed).normal(size=(9, 4)) * SIZES
    return rows.T @ rows


@pytest.mark.parametrize('seed', range(3))
def test_a_definite_system_has_its_solution_root_and_inverse(seed: int) -> None:
    matrix, right = definite(seed), np.random.default_rng([seed, 1]).normal(size=(4, 2)) * SIZES[:, None]
    expected = np.linalg.solve(matrix, right)
    assert solve_symmetric(matrix, right) == pytest.approx(expected, rel=1e-8)
    assert solve_symmetric(matrix, right[:, 0]) == pytest.approx(expected[:, 0], rel=1e-8)
    assert solve_definite(matrix, right[:, 1]) == pytest.approx(expected[:, 1], rel=1e-8)
    root, half = square_root(matrix), inverse_root(matrix)
    assert root.T @ matrix @ root == pytest.approx(np.eye(4), abs=1e-8)
    assert half is not None
    size = np.outer(SIZES, SIZES)
    assert half.T @ half * size == pytest.approx(np.linalg.inv(matrix) * size, rel=1e-8)
    assert inverse(matrix, matrix) * size == pytest.approx(np.linalg.inv(matrix) * size, rel=1e-8)
    factor, both = inverse_factor(matrix), inverse_factors(np.array([matrix, 4.0 * matrix]))
    assert factor is not None
    assert both is not None
    assert factor @ matrix @ factor.T == pytest.approx(np.eye(4), abs=1e-8)
    assert both[1] * 2.0 == pytest.approx(both[0])
    assert is_positive(matrix)


def test_a_direction_without_information_is_left_at_zero() -> None:
    rows = np.random.default_rng(0).normal(size=(2, 4)) * SIZES
    matrix = rows.T @ rows
    x = rows.T @ np.array([1.0, 2.0]) / SIZES**2
    found = solve_symmetric(matrix, matrix @ x)
    assert rows @ found == pytest.approx(rows @ x)
    assert square_root(matrix).shape == (4, 2)
    assert inverse_root(matrix) is None
    assert solve_definite(matrix, matrix @ x) == pytest.approx(found)


def test_what_is_not_positive_has_no_factor_and_a_variance_of_next_to_no_information() -> None:
    reference, matrix = np.diag([4.0, 9.0]), np.diag([4.0, -1.0])
    assert inverse(reference, matrix) == pytest.approx(np.diag([0.25, 1e12 / 9.0]))
    assert inverse_factor(matrix) is None
    assert inverse_factor(np.full((2, 2), np.nan)) is None
    assert inverse_factors(np.array([reference, matrix])) is None
    assert not is_positive(matrix)


def test_steps_one_after_the_other_are_composed() -> None:
    rng = np.random.default_rng(1)
    transition, gain = rng.normal(size=(3, 2, 4, 4)), rng.normal(size=(3, 2, 4, 5))
    x, numbers = rng.normal(size=(2, 4)), rng.normal(size=(2, 5))
    found = composed(transition, gain)
    assert found.shape == (4, 2, 4, 9)
    for place in range(4):
        assert (found[place] @ np.concatenate((x, numbers), axis=1)[..., None])[..., 0] == pytest.approx(
            _stepped(transition[:place], gain[:place], x, numbers)
        )


def _stepped(transition: Array, gain: Array, x: Array, numbers: Array) -> Array:
    for one, other in zip(transition, gain, strict=True):
        x = (one @ x[..., None] + other @ numbers[..., None])[..., 0]
    return x


@pytest.mark.parametrize(('chance', 'degrees'), [(0.05, 1), (1e-8, 12), (0.5, 3)])
def test_the_limit_of_chi_square_is_exceeded_by_its_chance(chance: float, degrees: int) -> None:
    assert chi2.sf(chi_square_limit(chance, degrees), degrees) == pytest.approx(chance)
