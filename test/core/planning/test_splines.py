from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.planning.limits import JointLimits, joint_limits
from mbaid_ros.core.planning.splines import Splines
from simulated import robot

LIMITS = JointLimits(
    lower=np.array([-1.0, -np.inf, 0.0]),
    upper=np.array([0.5, np.inf, 1.0]),
    velocity=np.full(3, 0.2),
    acceleration=np.full(3, 0.1),
    moved=np.array([True, True, False]),
)
START = np.array([0.2, 4.0, 0.5])
SPLINES = Splines(5, 12.0)
INSIDE = np.linspace(0.0, 12.0, 481)
DRAWN = np.random.default_rng(0).standard_normal((20, 5, 3)) * 3.0


def test_motions_pass_their_waypoints_and_rest_at_both_ends() -> None:
    passed = SPLINES.basis(np.linspace(0.0, 12.0, 6)) @ DRAWN
    assert passed[:, 1:] == pytest.approx(DRAWN)
    assert passed[:, 0] == pytest.approx(0.0, abs=1e-12)
    for order in (1, 2):
        assert SPLINES.basis(np.array([0.0, 12.0]), order) @ DRAWN == pytest.approx(0.0, abs=1e-9)


def test_the_points_of_a_trajectory_make_the_very_same_motion() -> None:
    trajectory = SPLINES.trajectory(DRAWN[0], START, ('a', 'b', 'c'))
    for order, found in enumerate(trajectory.at(INSIDE)):
        expected = SPLINES.basis(INSIDE, order) @ DRAWN[0]
        assert found == pytest.approx(expected + (START if order == 0 else 0.0), abs=1e-9)


def test_motions_are_made_as_much_smaller_as_a_limit_asks_for() -> None:
    moved = SPLINES.within(DRAWN, START, LIMITS)
    use = SPLINES.use(moved, START, LIMITS)
    assert np.max(use) <= 1.0
    assert use[:, :, :2].max(axis=1) == pytest.approx(0.995, abs=1e-6)  # drawn ones exceed each joint's
    position = START + SPLINES.basis(INSIDE) @ moved
    assert np.all((position[..., 0] >= -1.0) & (position[..., 0] <= 0.5))
    assert np.abs(SPLINES.basis(INSIDE, 1) @ moved).max() <= 0.2
    assert np.abs(SPLINES.basis(INSIDE, 2) @ moved).max() <= 0.1
    assert not moved[:, :, 2].any()  # a joint that must not be moved


def test_a_motion_is_known_by_the_waypoints_of_another_pace() -> None:
    slower = Splines(5, 30.0)
    assert SPLINES.passed(DRAWN, slower) == pytest.approx(DRAWN)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'stuck': ('elbow',)}, "'elbow'; accepted: joint1, joint2"),
        ({'stuck': tuple(f'joint{k}' for k in range(1, 8))}, 'no joint can be moved'),
        ({'position': np.full(7, 2.5)}, "joint 'joint2' is at 2.5, outside its limits -2.2 to 2.2"),
    ],
)
def test_limits_that_no_motion_can_keep_are_refused(changes: dict[str, object], words: str) -> None:
    given: dict[str, object] = {'position': np.zeros(7), 'velocity': 0.1, 'acceleration': 0.1, 'stuck': ()}
    with pytest.raises(ParameterError, match=words):
        joint_limits(robot('servicer7'), **{**given, **changes})  # type: ignore[arg-type]


def test_a_joint_keeps_the_slower_of_its_own_limit_and_the_one_for_all() -> None:
    limits = joint_limits(robot('servicer7'), np.zeros(7), np.inf, 0.1, ('joint4',))
    assert limits.velocity == pytest.approx(0.25)
    assert limits.moved.tolist() == [True] * 3 + [False] + [True] * 3
