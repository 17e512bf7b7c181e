"""Trajectories, splines and simple motions within limits; collisions and effort limits of planned ones."""

from __future__ import annotations

import numpy as np
import pytest

from checked import generic
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel, Storage
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.errors import DataError, ParameterError
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.planning.collisions import Collisions, no_mesh
from mbaid_ros.planning.efforts import JointEfforts
from mbaid_ros.planning.requirements import BaseLimits, JointLimits, joint_limits, speed_held
from mbaid_ros.planning.splines import Splines
from mbaid_ros.session.robot import mesh_points
from mbaid_ros.simulation.dynamics import Dynamics, State
from mbaid_ros.simulation.steered import TrajectoryMotion
from planned import Begun, planner
from random_robots import two_links
from servicers import wheeled_urdf
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
    for found, expected in zip(trajectory.state_at(INSIDE), (curve, curve.deriv(), curve.deriv(2)), strict=True):
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
    motion = TrajectoryMotion(trajectory, start, np.array([1]), begin=4.0)
    position, velocity, acceleration = motion.from_time(3.0).reference(1.5)
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
    moved = SPLINES.limited(DRAWN, START, LIMITS)
    assert np.max(SPLINES.limit_use(moved, START, LIMITS)) <= 1.0
    position = START + SPLINES.basis(TWELVE) @ moved
    assert np.all((position[..., 0] >= -1.0) & (position[..., 0] <= 0.5))
    assert np.abs(SPLINES.basis(TWELVE, 1) @ moved).max() <= 0.2
    assert np.abs(SPLINES.basis(TWELVE, 2) @ moved).max() <= 0.1
    assert not moved[:, :, 2].any()  # a joint that must not be moved
    assert SPLINES.limited(moved, START, LIMITS) == pytest.approx(moved)


def test_the_largest_motion_of_a_form_is_at_one_limit_of_each_joint() -> None:
    for size in (1e-3, 1e3):
        use = SPLINES.limit_use(SPLINES.scaled_to_limits(size * DRAWN, START, LIMITS), START, LIMITS)
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
    model = load_model(wheeled_urdf())
    names = ('wheel0_joint', 'wheel1_joint', 'wheel2_joint')
    rate = np.array([90.0 if name == 'wheel0_joint' else 1.0 for name in model.independent_joints])
    found = speed_held(model, rate, velocity, held)
    assert [bool(found[model.independent_joints.index(name)]) for name in names] == kept
    with pytest.raises(ParameterError, match=r"'plan\.held' names 'rotor'; accepted: "):
        speed_held(model, rate, velocity, ('rotor',))


INERTIAL = '<inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
BOX, BALL = '<box size="1 1 1"/>', '<sphere radius="0.1"/>'


def link(name: str, shape: str = '', place: str = '0 0 0') -> str:
    collision = f'<collision><origin xyz="{place}"/><geometry>{shape}</geometry></collision>' if shape else ''
    return f'<link name="{name}">{INERTIAL}{collision}</link>'


def joint(name: str, parent: str, child: str, place: str, kind: str = 'revolute') -> str:
    limit = '<limit lower="-3.1" upper="3.1" effort="1" velocity="1"/>' if kind == 'revolute' else ''
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="0 0 1"/>{limit}</joint>'
    )


def arm(kind: str = 'revolute', hand: str = BALL) -> RobotModel:
    """Return a box with two links of 1 m at its side, the hand at the end of the second."""
    parts = [
        link('base', BOX), link('upper'), link('lower', hand, '1 0 0'),
        joint('shoulder', 'base', 'upper', '0.5 0 0'), joint('elbow', 'upper', 'lower', '1 0 0', kind),
    ]  # fmt: skip
    return load_model(f'<robot name="arm">{"".join(parts)}</robot>')


@pytest.mark.parametrize('kind', ['revolute', 'continuous'])
def test_an_arm_that_folds_back_onto_its_base_is_not_clear(kind: str) -> None:
    shapes = Collisions(arm(kind), 0.02, np.zeros(2), no_mesh)
    assert shapes.pairs == 1
    stretched, folded = np.array([0.0, 0.5]), np.array([0.0, np.pi - 0.01])
    assert shapes.clear(np.stack([stretched, stretched]))
    assert not shapes.clear(np.stack([stretched, folded]))


@pytest.mark.parametrize(('clearance', 'clear'), [(0.0, True), (0.1, True), (0.2, False)])
def test_shapes_keep_the_clearance_that_is_asked_for(clearance: float, clear: bool) -> None:
    # The upper arm stands off the base's side, the lower one comes back over it: the hand is 0.15 m above the box.
    over = np.array([np.pi / 2.0, np.pi - np.arccos(0.25)])
    assert Collisions(arm(), clearance, np.zeros(2), no_mesh).clear(over[None]) == clear


def test_links_that_touch_at_the_begin_are_reported_and_left_out() -> None:
    folded = np.array([0.0, np.pi - 0.01])
    shapes = Collisions(arm(), 0.02, folded, no_mesh)
    assert shapes.notes == ('touch where the motion begins, and are not compared: base and lower',)
    assert shapes.clear(folded[None])


@pytest.mark.parametrize(('clearance', 'clear'), [(0.0, True), (0.1, True), (0.2, False)])
def test_a_mesh_keeps_it_as_its_hull(clearance: float, clear: bool) -> None:
    """An octahedron, of the ball's height, given ten times as large."""
    corners = np.concatenate((np.eye(3), -np.eye(3)))
    over = np.array([np.pi / 2.0, np.pi - np.arccos(0.25)])
    made = arm(hand='<mesh filename="octahedron.stl" scale="0.1 0.1 0.1"/>')
    shapes = Collisions(made, clearance, np.zeros(2), {'octahedron.stl': corners}.__getitem__)
    assert (shapes.shapes, shapes.notes) == (2, ())
    assert shapes.clear(over[None]) == clear


def test_a_mesh_that_cannot_be_read_is_left_out_and_named_with_the_reason() -> None:
    made = arm(hand='<mesh filename="package://none/hand.stl"/>')
    shapes = Collisions(made, 0.02, np.zeros(2), mesh_points)
    (note,) = shapes.notes
    assert note.startswith("collision meshes of lower are left out: mesh 'package://none/hand.stl': AMENT_PREFIX_PATH")
    assert not shapes.pairs
    flat = Collisions(made, 0.02, np.zeros(2), lambda _: np.zeros((4, 3)))
    assert flat.notes[0].startswith(
        "collision meshes of lower are left out: mesh 'package://none/hand.stl' has no hull"
    )


BODY = np.array([90.0, 0.2, 0.1, -0.3, 20.0, 1.0, -2.0, 25.0, 0.5, 30.0])


@pytest.mark.parametrize('name', ['servicer7', 'ets7', 'table1'])
def test_torques_are_those_that_drive_the_simulated_robot_with_the_estimated_body(name: str) -> None:
    model = robot(name)
    kernel = MomentumKernel(model, model.last_link)
    heavy = load_model(replace_inertial(model.urdf, model.last_link, BODY), model.base_link)
    bodies = kernel.body_parameters(MomentumKernel(heavy, model.last_link).target.parameters)
    generator = np.random.default_rng(0)
    place, rate, bend = generator.standard_normal((3, 5, model.joints))
    twist = generator.standard_normal((5, 6))
    found = JointEfforts(model, bodies).torques(place, rate, bend, twist)
    driven = Dynamics(heavy)
    for index, torque in enumerate(found):
        state = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), place[index], np.append(twist[index], rate[index]))
        assert torque == pytest.approx(driven.torque(state, bend[index]), rel=1e-9, abs=1e-9)


def test_stored_momentum_asks_torques_of_the_joints_that_turn_it() -> None:
    """As a wheel that turns at a constant speed does, which is a joint of the same robot."""
    model = load_model(two_links('type="revolute"', 'type="continuous"').replace('0 0 1', '0 1 0', 1))
    bodies, speed = model.body_parameters(), 300.0  # rad/s, of 1 kg m^2
    place, rate, bend, twist = generic(0, 5, 2), generic(1, 5, 2), generic(2, 5, 2), generic(3, 5, 6)
    rate[:, 1] = bend[:, 1] = 0.0
    parts = Storage((1, 1), np.array([[0.0, 0.0, 1.0]] * 2), np.array([0.25, 0.75]), np.zeros(2))
    found = JointEfforts(model, bodies, parts, np.full(2, speed)).torques(place, rate, bend, twist)
    wheel = JointEfforts(model, bodies).torques(place, rate + np.array([0.0, speed]), bend, twist)
    resting = JointEfforts(model, bodies).torques(place, rate, bend, twist)
    assert found[:, 0] == pytest.approx(wheel[:, 0])
    assert np.all(np.abs(found - resting)[:, 0] > 1.0)


def test_a_link_without_mass_leaves_the_limits_of_all_others() -> None:
    model, place = robot('servicer7'), np.full((1, 1, 7), 0.1)
    bodies = MomentumKernel(model, 'link7').body_parameters(BODY)
    bodies[3] = 0.0
    use = JointEfforts(model, bodies).limit_use(place, 0.0 * place, place, np.zeros((1, 1, 6)))
    assert np.all(use[0] > 0.0)


def test_a_motion_keeps_the_effort_limits_and_names_them_where_they_bind(identified: Begun) -> None:
    strong, weak = planner(identified, duration=6.0), planner(identified, duration=6.0)
    weak.motions.efforts.limits = np.full(7, 2.0)
    plan, held = strong.plan(), weak.plan()
    assert plan.use[3].max() > 0.05
    assert held.use[3].max() * 2.0 < 0.9 * (plan.use[3] * strong.motions.efforts.limits).max()
    assert 0.9 < held.use[3].max() <= 1.0
    assert 'the effort limits of the joints' in held.binding
    assert held.verdict.endswith('the effort limits of the joints')
    assert held.ratio > plan.ratio


@pytest.mark.long
def test_efforts_hold_beside_limits_of_the_base(identified: Begun) -> None:
    weak = planner(identified, duration=6.0, base=BaseLimits(rotation=np.radians(1.0)))
    weak.motions.efforts.limits = np.full(7, 3.0)
    plan = weak.plan()
    assert plan.use[3].max() <= 1.0
    assert plan.bounds.robust[0] <= np.radians(1.0) + 1e-9


def test_what_it_takes_to_hold_joints_is_no_motions_to_make_smaller(identified: Begun) -> None:
    weak = planner(identified, duration=6.0)
    holding = weak.motions.holding * weak.motions.efforts.limits
    weak.motions.efforts.limits = 2.0 * holding + 0.01
    del weak.motions.__dict__['holding']
    plan = weak.plan()
    assert 0.9 < plan.use[3].max() <= 1.0
    assert np.ptp(plan.trajectory.position, axis=0).max() > 1e-4


def test_joints_that_cannot_be_held_are_named(identified: Begun) -> None:
    weak = planner(identified, duration=6.0)
    weak.motions.efforts.limits[2] = 1e-4
    del weak.motions.__dict__['holding']
    with pytest.raises(ParameterError, match="joint 'joint3' at rest while the base tumbles needs"):
        weak.motions.require_hold()
    assert planner(identified, duration=6.0, stuck=('joint3',)).motions.holding[2] == 0.0
