from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.errors import DataError
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.simulation.steered import Followed

TIMES = np.array([0.0, 0.7, 2.0, 2.5])
NOTHING = np.zeros((0, 0))
INSIDE = np.linspace(0.0, 2.5, 41)


def of_polynomial(degree: int, orders: int) -> tuple[JointTrajectory, np.polynomial.Polynomial]:
    """Return a trajectory through points of a polynomial with so many of its derivatives, and the polynomial."""
    curve = np.polynomial.Polynomial(np.random.default_rng(degree).standard_normal(degree + 1))
    parts = [curve.deriv(order)(TIMES)[:, None] if order else curve(TIMES)[:, None] for order in range(orders)]
    return JointTrajectory(('joint',), TIMES, *parts, *[NOTHING] * (3 - orders)), curve


@pytest.mark.parametrize(('degree', 'orders'), [(5, 3), (3, 2), (1, 1)])
def test_what_is_known_at_the_points_gives_the_polynomial_that_ros2_controllers_follow(
    degree: int, orders: int
) -> None:
    trajectory, curve = of_polynomial(degree, orders)
    for found, expected in zip(trajectory.at(INSIDE), (curve, curve.deriv(), curve.deriv(2)), strict=True):
        assert found[:, 0] == pytest.approx(expected(INSIDE), abs=1e-9)


def test_joints_rest_before_the_first_point_and_after_the_last() -> None:
    trajectory, curve = of_polynomial(5, 3)
    position, velocity, acceleration = trajectory.at(np.array([-1.0, 3.0]))
    assert position[:, 0] == pytest.approx([curve(0.0), curve(2.5)])
    assert not velocity.any()
    assert not acceleration.any()


def test_a_single_point_is_a_place_to_stay() -> None:
    trajectory = JointTrajectory(('a', 'b'), np.array([1.0]), np.array([[0.1, 0.2]]), NOTHING, NOTHING)
    assert trajectory.at(np.array([0.0, 9.0]))[0] == pytest.approx(np.array([[0.1, 0.2], [0.1, 0.2]]))


@pytest.mark.parametrize(
    ('joints', 'times', 'position', 'words'),
    [
        (('a',), [0.0, 0.0], [[0.0], [1.0]], 'not in order'),
        (('a',), [-1.0, 0.0], [[0.0], [1.0]], 'not in order'),
        (('a', 'a'), [0.0], [[0.0, 1.0]], 'twice'),
        ((), [], [], 'at least one'),
        (('a',), [0.0], [[0.0, 1.0]], 'shape'),
        (('a',), [0.0], [[np.nan]], 'not finite'),
    ],
)
def test_points_that_are_no_motion_are_refused(
    joints: tuple[str, ...], times: list[float], position: list[list[float]], words: str
) -> None:
    with pytest.raises(DataError, match=words):
        JointTrajectory(joints, np.array(times), np.array(position), NOTHING, NOTHING)


def test_what_follows_a_trajectory_moves_its_joints_alone_and_later_begins_the_earlier() -> None:
    trajectory, curve = of_polynomial(5, 3)
    start = np.array([0.3, curve(0.0), -0.2])
    motion = Followed(trajectory, start, np.array([1]), begin=4.0)
    position, velocity, acceleration = motion.later(3.0).reference(1.5)
    assert position == pytest.approx([0.3, curve(0.5), -0.2])
    assert velocity == pytest.approx([0.0, curve.deriv()(0.5), 0.0])
    assert motion.command(4.5, position, velocity) == pytest.approx(acceleration)
