"""Covariances of messages: what is used of them, and whether that is all that they give."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.sensors.base import usable_covariance

DEFAULT = 1e-4 * np.eye(6)


def given(diagonal: tuple[float, ...], entry: tuple[int, int, float] | None = None) -> Array:
    matrix = np.diag(diagonal)
    if entry is not None:
        matrix[entry[:2]] = entry[2]
    return matrix


@pytest.mark.parametrize(
    ('matrix', 'own', 'wrong'),
    [
        (np.zeros((6, 6)), (False, False), False),
        (given((2.0,) * 6), (True, True), False),
        (given((2.0, 2.0, 2.0, 0.0, 0.0, 0.0)), (True, False), False),
        (given((2.0,) * 6, (0, 4, np.nan)), (True, True), True),  # the correlation of position and orientation
        (given((2.0, 2.0, 0.0, 0.0, 0.0, 2.0)), (False, False), True),  # of a planar robot
        (given((2.0,) * 6, (0, 1, 0.5)), (False, True), True),  # not symmetric
        (given((-1.0, 0.0, 0.0, 0.0, 0.0, 0.0)), (False, False), True),
        (given((2.0, 2.0, 2.0, 2.0, np.inf, 2.0)), (True, False), True),
        (np.full((6, 6), 2.0), (False, False), True),
    ],
)
def test_what_is_used_of_a_covariance(matrix: Array, own: tuple[bool, bool], *, wrong: bool) -> None:
    found = usable_covariance(matrix, DEFAULT)
    assert (found.own, found.wrong) == (own, wrong)
    assert np.all(np.linalg.eigvalsh(found.matrix) > 0.0)
    for block, kept in zip((slice(0, 3), slice(3, 6)), own, strict=True):
        assert np.array_equal(found.matrix[block, block], (matrix if kept else DEFAULT)[block, block])
