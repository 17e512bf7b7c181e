from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.errors import ParameterError
from mbaid_ros.planning.limits import JointLimits, joint_limits
from mbaid_ros.planning.splines import Splines
from simulated import robot

LIMITS = JointLimits(
    lower=np.array([-1.0, -np.inf, 0.0]),
    upper=np.array([0.5, np.inf, 1.0]),
    velocity=np.full(3, 0.2),
    acceleration=np.full(3, 0.1),
    moved=np.array([True, True, False]),
)
START = np.array([0.2, 4.0, 0.5])
SPLINES = Splines(10, 12.0)  # pieces of 1 s
INSIDE = np.linspace(0.0, 12.0, 481)
DRAWN = np.random.default_rng(0).standard_normal((20, 10, 3)) * 0.3


def test_motions_rest_at_both_ends_and_go_at_the_speeds_between() -> None:
    ends = np.array([0.0, 12.0])
    assert SPLINES.basis(ends[:1]) @ DRAWN == pytest.approx(0.0, abs=1e-12)
    for order in (1, 2):
        assert SPLINES.basis(ends, order) @ DRAWN == pytest.approx(0.0, abs=1e-9)
    steady = SPLINES.basis(INSIDE, 1) @ np.ones(10)
    assert steady[(INSIDE >= 2.0) & (INSIDE <= 10.0)] == pytest.approx(1.0)
    assert SPLINES.basis(ends[1:]) @ np.ones(10) == pytest.approx(10.0)  # a speed acts for a piece


def test_rates_and_accelerations_are_those_of_the_positions() -> None:
    step = 1e-4
    for order in (0, 1):
        ahead, behind = (SPLINES.basis(INSIDE[1:-1] + side * step, order) for side in (0.5, -0.5))
        assert (ahead - behind) / step == pytest.approx(SPLINES.basis(INSIDE[1:-1], order + 1), abs=1e-3)


def test_the_points_of_a_trajectory_make_the_very_same_motion() -> None:
    trajectory = SPLINES.trajectory(DRAWN[0], START, ('a', 'b', 'c'))
    for order, found in enumerate(trajectory.at(INSIDE)):
        expected = SPLINES.basis(INSIDE, order) @ DRAWN[0]
        assert found == pytest.approx(expected + (START if order == 0 else 0.0), abs=1e-9)


def test_motions_are_cut_off_at_the_limits_of_velocity_and_acceleration() -> None:
    moved = SPLINES.within(DRAWN, START, LIMITS)
    assert np.max(SPLINES.use(moved, START, LIMITS)) <= 1.0
    position = START + SPLINES.basis(INSIDE) @ moved
    assert np.all((position[..., 0] >= -1.0) & (position[..., 0] <= 0.5))
    assert np.abs(SPLINES.basis(INSIDE, 1) @ moved).max() <= 0.2
    assert np.abs(SPLINES.basis(INSIDE, 2) @ moved).max() <= 0.1
    assert not moved[:, :, 2].any()  # a joint that must not be moved
    assert SPLINES.within(moved, START, LIMITS) == pytest.approx(moved)


def test_a_joint_goes_at_full_speed_but_for_its_ramps() -> None:
    there_and_back = 9.0 * np.repeat([1.0, -1.0], 5)[:, None] * np.ones(3)
    rate = np.abs(SPLINES.basis(INSIDE, 1) @ SPLINES.within(there_and_back, START, LIMITS))[:, 1]
    # Of 0.2 rad/s at 0.1 rad/s^2: 2 s to come from rest, as long to go back to it, twice that to turn.
    assert np.mean(rate > 0.99 * 0.2) > 0.15
    gentle = SPLINES.within(there_and_back, START, LIMITS, np.array([0.5, 0.5, 0.5]))
    assert SPLINES.use(gentle, START, LIMITS)[2, 1] == pytest.approx(0.5, abs=0.01)


def test_the_largest_motion_of_a_form_is_at_one_limit_of_each_joint() -> None:
    for size in (1e-3, 1e3):
        use = SPLINES.use(SPLINES.filling(size * DRAWN, START, LIMITS), START, LIMITS)
        assert use[:, :, :2].max(axis=1) == pytest.approx(0.999)


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
