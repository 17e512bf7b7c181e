"""Trajectories, splines and simple motions within limits."""

from __future__ import annotations

import numpy as np
import pytest

import wheels
from mbaid_ros.core.errors import DataError, ParameterError
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.planning.goal import JointLimits, joint_limits, keeping_speed
from mbaid_ros.planning.splines import Splines
from mbaid_ros.simulation.steered import Followed
from simulated import robot

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


LIMITS = JointLimits(
    lower=np.array([-1.0, -np.inf, 0.0]),
    upper=np.array([0.5, np.inf, 1.0]),
    velocity=np.full(3, 0.2),
    acceleration=np.full(3, 0.1),
    moved=np.array([True, True, False]),
    held=np.zeros(3, dtype=bool),
)
START = np.array([0.2, 4.0, 0.5])
SPLINES = Splines(10, 12.0)  # pieces of 1 s
TWELVE = np.linspace(0.0, 12.0, 481)
DRAWN = np.random.default_rng(0).standard_normal((20, 10, 3)) * 0.3


def test_motions_rest_at_both_ends_and_go_at_the_speeds_between() -> None:
    ends = np.array([0.0, 12.0])
    assert SPLINES.basis(ends[:1]) @ DRAWN == pytest.approx(0.0, abs=1e-12)
    for order in (1, 2):
        assert SPLINES.basis(ends, order) @ DRAWN == pytest.approx(0.0, abs=1e-9)
    steady = SPLINES.basis(TWELVE, 1) @ np.ones(10)
    assert steady[(TWELVE >= 2.0) & (TWELVE <= 10.0)] == pytest.approx(1.0)
    assert SPLINES.basis(ends[1:]) @ np.ones(10) == pytest.approx(10.0)  # a speed acts for a piece


def test_motions_are_cut_off_at_the_limits_of_velocity_and_acceleration() -> None:
    moved = SPLINES.within(DRAWN, START, LIMITS)
    assert np.max(SPLINES.use(moved, START, LIMITS)) <= 1.0
    position = START + SPLINES.basis(TWELVE) @ moved
    assert np.all((position[..., 0] >= -1.0) & (position[..., 0] <= 0.5))
    assert np.abs(SPLINES.basis(TWELVE, 1) @ moved).max() <= 0.2
    assert np.abs(SPLINES.basis(TWELVE, 2) @ moved).max() <= 0.1
    assert not moved[:, :, 2].any()  # a joint that must not be moved
    assert SPLINES.within(moved, START, LIMITS) == pytest.approx(moved)


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


@pytest.mark.parametrize(
    ('velocity', 'held', 'kept'),
    [
        (np.inf, (), [True, True, True]),  # nothing limits them
        (5.0, (), [True, False, False]),  # the first is faster than joints may be
        (np.inf, ('wheel1_joint',), [False, True, False]),
    ],
)
def test_wheels_keep_their_speed(velocity: float, held: tuple[str, ...], kept: list[bool]) -> None:
    model = load_model(wheels.urdf())
    names = ('wheel0_joint', 'wheel1_joint', 'wheel2_joint')
    rate = np.array([90.0 if name == 'wheel0_joint' else 1.0 for name in model.independent_joints])
    found = keeping_speed(model, rate, velocity, held)
    assert [bool(found[model.independent_joints.index(name)]) for name in names] == kept
    with pytest.raises(ParameterError, match=r"'plan\.held' names 'rotor'; accepted: "):
        keeping_speed(model, rate, velocity, ('rotor',))
