"""Recursive least squares: its definition, its forgetting, and what it does where nothing is excited."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.paper.estimator import RecursiveLeastSquares

UNKNOWNS = 4
PRIOR = 1e3


def problem(steps: int = 60, seed: int = 0) -> tuple[Array, Array]:
    """Return rows (N, 2, 4) and right sides (N, 2) with errors."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(steps, 2, UNKNOWNS))
    return rows, rows @ np.array([1.0, -2.0, 0.5, 3.0]) + 0.1 * rng.normal(size=(steps, 2))


def recursion(rows: Array, right_side: Array, factor: float, prior: float = PRIOR) -> RecursiveLeastSquares:
    rls = RecursiveLeastSquares(UNKNOWNS, factor, prior)
    for block, value in zip(rows, right_side, strict=True):
        rls.step(block, value)
    return rls


@pytest.mark.parametrize('factor', [1.0, 0.99, 0.7])
def test_step_by_step_is_the_weighted_least_squares_with_a_prior(factor: float) -> None:
    rows, right_side = problem()
    rls = recursion(rows, right_side, factor)
    # min sum_k factor^(N - k) |A_k x - b_k|^2 + factor^N / PRIOR |x|^2, by its normal equations.
    steps = len(rows)
    weight = factor ** np.arange(steps - 1, -1, -1)
    information = np.einsum('k,kri,krj->ij', weight, rows, rows) + np.eye(UNKNOWNS) * factor**steps / PRIOR
    solution = np.linalg.solve(information, np.einsum('k,kri,kr->i', weight, rows, right_side))
    # Condition numbers of ten, a hundred roundings.
    assert rls.estimate == pytest.approx(solution, rel=1e-12)
    assert rls.covariance == pytest.approx(np.linalg.inv(information), rel=1e-11, abs=1e-13)


def test_what_remains_of_the_start() -> None:
    rows, _ = problem(steps=3)
    true = np.array([1.0, -2.0, 0.5, 3.0])
    rls = recursion(rows, rows @ true, 0.9)
    assert rls.estimate - true == pytest.approx(rls.remaining @ -true, rel=1e-9, abs=1e-13)
    assert recursion(rows[:1], rows[:1] @ true, 0.9).remaining == pytest.approx(
        np.eye(UNKNOWNS) - rows[0].T @ np.linalg.solve(rows[0] @ rows[0].T + 0.9 / PRIOR * np.eye(2), rows[0]),
        abs=1e-12,
    )


def test_forgetting_follows_a_change() -> None:
    rows, _ = problem(steps=400)
    before, after = np.array([1.0, -2.0, 0.5, 3.0]), np.array([2.0, -1.0, 0.5, -3.0])
    right_side = np.concatenate((rows[:200] @ before, rows[200:] @ after))
    # 0.9^200 = 7e-10 of the past is left.
    assert recursion(rows, right_side, 0.9).estimate == pytest.approx(after, rel=1e-8)
    assert np.abs(recursion(rows, right_side, 1.0).estimate - after).max() > 0.1


@pytest.mark.parametrize('excited', [0, 2])
def test_the_covariance_stays_bounded_symmetric_and_positive_without_excitation(excited: int) -> None:
    """One step with a factor of 0.01 forgets as much as 458 steps of 0.99: 2200 of them as much as a million."""
    rng = np.random.default_rng(1)
    rls = RecursiveLeastSquares(UNKNOWNS, 0.01, PRIOR)
    for _ in range(2200):
        rows = np.zeros((2, UNKNOWNS))
        rows[:, :excited] = rng.normal(size=(2, excited))
        rls.step(rows, rows @ np.array([1.0, -2.0, 0.5, 3.0]))
    assert np.isfinite(rls.covariance).all()
    assert rls.covariance == pytest.approx(rls.covariance.T, rel=1e-12)
    assert np.linalg.eigvalsh(rls.covariance)[0] > 0.0
    assert np.diag(rls.covariance).max() < 1e7 * PRIOR
    assert rls.estimate[:excited] == pytest.approx([1.0, -2.0][:excited], rel=1e-8)
    # What was never excited has not moved from its start.
    assert not rls.estimate[excited:].any()
    assert np.array_equal(rls.remaining[excited:, excited:], np.eye(UNKNOWNS - excited))
    # When it is excited at last, one complete block of equations is enough.
    full = rng.normal(size=(UNKNOWNS, UNKNOWNS))
    assert rls.step(full, full @ np.array([1.0, -2.0, 0.5, 3.0])) == pytest.approx([1.0, -2.0, 0.5, 3.0], rel=1e-4)


def test_large_rows_keep_the_covariance_symmetric_and_positive() -> None:
    rng = np.random.default_rng(2)
    rls = RecursiveLeastSquares(UNKNOWNS, 0.99, 1e6)
    # Unknowns of very different size, as 1/m beside a moment of inertia.
    size = np.array([1e3, 1.0, 1e-1, 1e-3])
    for _ in range(3000):
        rows = rng.normal(size=(3, UNKNOWNS)) * size
        rls.step(rows, rows @ (1.0 / size))
    scaled = rls.covariance * size * size[:, None]
    assert scaled == pytest.approx(scaled.T, abs=1e-12 * np.abs(scaled).max())
    assert np.linalg.eigvalsh(scaled)[0] > 0.0
    assert rls.estimate * size == pytest.approx(np.ones(UNKNOWNS), rel=1e-8)
