"""How far a point may move before what is linear there no longer holds."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.filter.state import near_part
from mbaid_ros.core.robot.momentum import standard

BODY = standard(np.array([10.0, 0.1, 0.2, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0]))
POINT = np.concatenate((np.zeros(6), BODY, np.zeros(3)))


def test_a_step_is_as_long_as_changes_the_body_by_half_of_its_size() -> None:
    step = np.zeros_like(POINT)
    step[6] = 20.0
    assert near_part(POINT, step) == pytest.approx(0.25)
    assert near_part(POINT, -step) == pytest.approx(0.25)
    assert near_part(POINT, 0.2 * step) == 1.0


def test_momentum_and_unknowns_may_change_by_anything() -> None:
    step = np.full_like(POINT, 1e6)
    step[6:16] = 0.0
    assert near_part(POINT, step) == 1.0


def test_a_body_without_any_inertia_is_not_left() -> None:
    point, step = np.zeros(16), np.zeros(16)
    step[6] = 1.0
    assert near_part(point, step) == 1.0  # without a mass there is nothing to stay near to
    point[6] = 3.0
    step[6] = 0.03
    assert near_part(point, step) == 1.0
    step[10] = 1e-9
    assert near_part(point, step) == 0.0
