"""Principal axes and the uniform bodies of an inertia, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, exp, vec
from mbaid_ros.core.robot.momentum import box_sizes, ellipsoid_radii, principal


def parameters(moments: list[float], turn: list[float]) -> Array:
    rotation = exp(np.array(turn))
    return np.concatenate(([5.0], [0.1, 0.2, 0.3], vec(rotation @ np.diag(moments) @ rotation.T)))


def test_the_axes_diagonalise_the_inertia_and_are_a_rotation() -> None:
    found = principal(parameters([3.0, 1.0, 2.5], [0.3, -0.4, 0.9]))
    assert found.moments == pytest.approx([1.0, 2.5, 3.0], rel=1e-13)
    assert np.linalg.det(found.axes) == pytest.approx(1.0, rel=1e-14)
    tensor = found.axes @ np.diag(found.moments) @ found.axes.T
    assert vec(tensor) == pytest.approx(parameters([3.0, 1.0, 2.5], [0.3, -0.4, 0.9])[4:], abs=1e-14)


def test_a_small_change_does_not_flip_the_axes() -> None:
    first = principal(parameters([3.0, 1.0, 2.5], [0.3, -0.4, 0.9]))
    second = principal(parameters([3.0, 1.0, 2.5], [0.3, -0.4, 0.9001]))
    assert first.axes == pytest.approx(second.axes, abs=1e-3)


def test_the_uniform_bodies_have_the_moments() -> None:
    mass, moments = 5.0, np.array([1.0, 2.5, 3.0])
    a, b, c = ellipsoid_radii(mass, moments)
    assert mass / 5.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) == pytest.approx(moments, rel=1e-14)
    a, b, c = box_sizes(mass, moments)
    assert mass / 12.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) == pytest.approx(moments, rel=1e-14)


def test_a_flat_body_has_no_thickness() -> None:
    assert ellipsoid_radii(1.0, np.array([1.0, 1.0, 2.1]))[2] == 0.0
    assert box_sizes(1.0, np.array([1.0, 1.0, 2.1]))[2] == 0.0
