"""Symmetric systems, some of whose directions may be empty."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.linear_algebra import solve_symmetric


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


def test_several_right_sides_at_once() -> None:
    rng = np.random.default_rng(11)
    factor = rng.normal(size=(4, 4))
    right_side = rng.normal(size=(4, 6))
    expected = np.linalg.solve(factor @ factor.T, right_side)
    assert solve_symmetric(factor @ factor.T, right_side) == pytest.approx(expected, rel=1e-9)
    assert solve_symmetric(factor @ factor.T, right_side[:, 0]) == pytest.approx(expected[:, 0], rel=1e-9)


def test_nothing_known_gives_nothing() -> None:
    assert not solve_symmetric(np.zeros((3, 3)), np.zeros(3)).any()
