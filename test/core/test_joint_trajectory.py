"""Motions of joints through points: their derivatives, what they do outside of the points, and refused ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import assert_derivative, generic
from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import DataError
from mbaid_ros.joint_trajectory import JointTrajectory

NONE = np.zeros((0, 0))
TIME = np.array([0.5, 1.0, 2.5])
WHOLE = JointTrajectory(('elbow', 'wrist'), TIME, generic(0, 3, 2), generic(1, 3, 2), generic(2, 3, 2))


@pytest.mark.parametrize('given', [0, 1, 2])
def test_a_motion_passes_its_points_with_the_given_derivatives(given: int) -> None:
    left = (WHOLE.velocity, NONE)[given < 1], (WHOLE.acceleration, NONE)[given < 2]
    made = JointTrajectory(WHOLE.joints, TIME, WHOLE.position, *left)
    assert made.duration == 2.5
    found = made.state_at(TIME)
    for values, points in list(zip(found, (WHOLE.position, WHOLE.velocity, WHOLE.acceleration), strict=True))[
        : given + 1
    ]:
        assert values == pytest.approx(points)


def test_velocity_and_acceleration_are_the_derivatives() -> None:
    at = np.array([1.3])
    _, velocity, acceleration = WHOLE.state_at(at)
    assert_derivative(velocity[0][:, None], lambda time: WHOLE.state_at(time)[0][0], at)
    assert_derivative(acceleration[0][:, None], lambda time: WHOLE.state_at(time)[1][0], at)


def test_joints_rest_before_the_first_point_and_after_the_last() -> None:
    position, velocity, acceleration = WHOLE.state_at(np.array([0.0, 9.0]))
    assert position == pytest.approx(WHOLE.position[[0, -1]])
    assert not velocity.any()
    assert not acceleration.any()
    single = JointTrajectory(('elbow',), np.array([1.0]), np.array([[0.3]]), NONE, NONE)
    position, velocity, _ = single.state_at(np.array([0.0, 1.0, 2.0]))
    assert position.tolist() == [[0.3]] * 3
    assert not velocity.any()


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'joints': ('elbow', 'elbow')}, 'names a joint twice'),
        ({'joints': ()}, '3 points of 0 joints'),
        ({'time': np.array([0.5, 1.0])}, 'position of shape'),
        ({'position': NONE}, 'position of shape'),
        ({'velocity': np.zeros((2, 2))}, 'velocity of shape'),
        ({'acceleration': np.full((3, 2), np.nan)}, 'acceleration that is not finite'),
        ({'time': np.array([-0.5, 1.0, 2.5])}, 'not in order'),
        ({'time': np.array([0.5, 0.5, 2.5])}, 'not in order'),
        ({'time': np.array([0.5, np.nan, 2.5])}, 'not in order'),
    ],
)
def test_points_that_are_no_motion_are_refused(changes: dict[str, Array], words: str) -> None:
    with pytest.raises(DataError, match=words):
        replace(WHOLE, **changes)  # type: ignore[arg-type]
