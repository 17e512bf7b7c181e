"""Poses, twists and states, against pinocchio; and planar robots, recognised by mechanism and motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.difference import subspace, window_rows
from mbaid_ros.core.geometry import Array, exp, rotate, unvec
from mbaid_ros.core.robot.model import Kinematics, PlaneDetector, RobotModel, express, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel, inertia_matrix, inverse_inertia_and_momentum, momentum
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.simulation import Truth
from observed import MID, kernel, observe, windows
from random_robots import Motion, Peer, random_inertial, random_state, random_urdf
from simulated import robot

INSTANTS = 33


@pytest.mark.parametrize('seed', range(4))
def test_the_whole_is_the_sum_of_the_bodies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=int(rng.integers(2, 10))))
    position, velocity, rotation, twist = random_state(rng, model.joints, INSTANTS)
    kinematics, parameters = Kinematics(model), model.body_parameters()
    bodies = kinematics.configure(rotation, position)
    twists = kinematics.body_twists(bodies, velocity, twist)
    inverse_inertia, total = inverse_inertia_and_momentum(express(parameters, bodies.rotation, bodies.position), twists)
    expressed = express(parameters, bodies.rotation, bodies.position)
    locked = np.sum(inertia_matrix(expressed), axis=1)
    assert inverse_inertia @ locked == pytest.approx(np.broadcast_to(np.eye(6), locked.shape), abs=1e-11)
    assert total == pytest.approx(np.sum(momentum(expressed, twists), axis=1), rel=1e-12, abs=1e-10)
    for size in (1, 2, 7):
        for begin in range(0, INSTANTS, size):
            part = slice(begin, begin + size)
            alone = kinematics.configure(rotation[part], position[part])
            own = express(parameters, alone.rotation, alone.position)
            found = inverse_inertia_and_momentum(own, kinematics.body_twists(alone, velocity[part], twist[part]))
            assert np.array_equal(found[0], inverse_inertia[part])
            assert np.array_equal(found[1], total[part])


def test_mass_on_a_line_is_refused() -> None:
    rng = np.random.default_rng(0)
    model = load_model(random_urdf(rng, joints=3))
    position, velocity, rotation, twist = random_state(rng, model.joints, 2)
    kinematics = Kinematics(model)
    bodies = kinematics.configure(rotation, position)
    point = np.zeros_like(model.body_parameters())
    point[0, 0] = 1.0  # all of it in the base's origin
    with pytest.raises(np.linalg.LinAlgError):
        inverse_inertia_and_momentum(
            express(point, bodies.rotation, bodies.position), kinematics.body_twists(bodies, velocity, twist)
        )


TREES = range(8)
STATES = 20
# Positions and velocities of size one at the end of up to nine joints.
ROUNDING = 1e-12


def tree_in_motion(seed: int) -> tuple[Kinematics, Motion]:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng, joints=9))
    position, velocity, rotation, twist = random_state(rng, model.joints, STATES)
    return Kinematics(model), Motion(rotation, position, velocity, twist)


@pytest.mark.parametrize('seed', TREES)
def test_poses_and_twists_are_those_of_pinocchio(seed: int) -> None:
    kinematics, motion = tree_in_motion(seed)
    model, peer = kinematics.model, Peer(kinematics.model)
    configuration = kinematics.configure(motion.base_rotation, motion.joint_position)
    twists = kinematics.body_twists(configuration, motion.joint_velocity, motion.base_twist)
    for index in range(STATES):
        peer.to(motion, index)
        for body in range(model.joints + 1):
            rotation, position = peer.placement(body)
            assert configuration.rotation[index, body] == pytest.approx(rotation, abs=ROUNDING)
            assert configuration.position[index, body] == pytest.approx(position, abs=ROUNDING)
            assert twists[index, body] == pytest.approx(peer.twist(body), abs=10.0 * ROUNDING)
        for link in model.links:
            rotation, position = peer.link(link.name)
            found_rotation, found_position = configuration.link_pose(link)
            assert found_rotation[index] == pytest.approx(rotation, abs=ROUNDING)
            assert found_position[index] == pytest.approx(position, abs=ROUNDING)


@pytest.mark.parametrize('seed', TREES)
def test_joint_twists_are_the_velocities_of_one_joint_alone(seed: int) -> None:
    kinematics, motion = tree_in_motion(seed)
    configuration = kinematics.configure(motion.base_rotation, motion.joint_position)
    for joint in range(kinematics.model.joints):
        velocity = np.zeros((STATES, kinematics.model.joints))
        velocity[:, joint] = 1.0
        twists = kinematics.body_twists(configuration, velocity, np.zeros((STATES, 6)))
        moved = kinematics.ancestors[:, joint] == 1.0
        assert np.array_equal(twists[:, ~moved], np.zeros_like(twists[:, ~moved]))
        expected = np.repeat(configuration.joint_twist[:, joint, None], int(moved.sum()), axis=1)
        assert np.array_equal(twists[:, moved], expected)


@pytest.mark.parametrize(('name', 'rank'), [('table1', 16), ('servicer7', 59), ('ets7', 52)])
def test_the_momentum_of_all_bodies_depends_on_as_many_combinations_as_in_theory(name: str, rank: int) -> None:
    model, rng, count = robot(name), np.random.default_rng(20), 200
    kernel = MomentumKernel(model, *(link.name for link in model.links))
    turn, twist = rng.normal(size=(count, 3)), rng.normal(size=(count, 6))
    if name == 'table1':  # in its plane
        turn[:, :2] = twist[:, 2:5] = 0.0
    joints = rng.uniform(-1.0, 1.0, (count, model.joints)), rng.normal(size=(count, model.joints))
    states = kernel.states_of(exp(turn), *joints, twist)
    rows = np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=-1)
    rows = (rows[:, [0, 1, 5]] if name == 'table1' else rows).reshape(-1, 10 * len(model.links))
    size = np.sqrt(np.sum(rows**2, axis=0))
    assert np.linalg.matrix_rank(rows / np.where(size > 0.0, size, 1.0), tol=1e-6) == rank


def arm(axes: list[str], kinds: list[str], turn: str = '0 0 0') -> RobotModel:
    """Return a chain with one joint for each axis, its links turned by `turn` to their parents at the first joint."""
    rng = np.random.default_rng(0)
    parts = [f'<robot name="r"><link name="link0">{random_inertial(rng)}</link>']
    for index, (axis, kind) in enumerate(zip(axes, kinds, strict=True)):
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind == 'prismatic' else ''
        parts += [
            f'<link name="link{index + 1}">{random_inertial(rng)}</link><joint name="j{index}" type="{kind}">',
            f'<origin xyz="1 0.1 0" rpy="{turn if index == 0 else "0 0 0"}"/><axis xyz="{axis}"/>{limit}',
            f'<parent link="link{index}"/><child link="link{index + 1}"/></joint>',
        ]
    return load_model(''.join([*parts, '</robot>']))


def turning_about(axis: Array, count: int = 25) -> Samples:
    """Return samples of a base that turns about a fixed axis."""
    model = robot('table1')
    time = 0.02 * np.arange(count)
    zero = np.zeros((count, 3))
    truth = Truth(
        time, *(np.zeros((count, model.joints)),) * 3, zero, np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), zero, zero
    )
    return replace(
        observe(truth, MID),
        base_rotation=exp(0.3 * time[:, None] * axis),
        base_angular_velocity=np.tile(0.3 * axis, (count, 1)),
    )


Z = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ('axes', 'kinds', 'planar'),
    [
        (['0 0 1', '0 0 -1'], ['continuous', 'continuous'], True),
        (['0 0 1', '1 0 0'], ['continuous', 'prismatic'], True),
        (['1 1 0', '0 0 1'], ['prismatic', 'continuous'], True),
        (['0 0 1', '0 1 0'], ['continuous', 'continuous'], False),
        (['0 0 1', '0 0 1'], ['continuous', 'prismatic'], False),
        (['1 0 0', '0 1 0'], ['prismatic', 'prismatic'], False),  # nothing fixes the plane
    ],
)
def test_the_mechanism_decides_first(axes: list[str], kinds: list[str], planar: bool) -> None:
    assert PlaneDetector(arm(axes, kinds)).planar == planar


def test_parallel_in_one_posture_is_not_planar() -> None:
    # The third axis is parallel to the first at zero angles only.
    assert not PlaneDetector(arm(['0 0 1', '1 0 0', '0 0 1'], ['continuous'] * 3)).planar
    assert not PlaneDetector(robot('servicer7')).planar
    # Without joints the motion decides: a body on a table turns about one axis.
    assert PlaneDetector(load_model('<robot name="r"><link name="base"/></robot>')).planar
    assert not any(PlaneDetector(load_model(random_urdf(np.random.default_rng(seed)))).planar for seed in range(5))


def test_the_plane_in_the_links_own_frame() -> None:
    model = robot('table1')
    detector = PlaneDetector(model)
    plane = some(detector.plane(model.link('link4')))
    assert plane.normal == pytest.approx(Z)
    assert plane.axes == pytest.approx(np.eye(3)[:2])
    # A link that is mounted askew: the normal is none of its axes.
    model = arm(['0.6 0 0.8', '0.6 0 0.8'], ['continuous', 'continuous'], turn='0.3 0.4 0.5')
    plane = some(PlaneDetector(model).plane(model.link('link2')))
    assert plane.normal == pytest.approx([0.6, 0.0, 0.8])
    frame = np.vstack((plane.axes, plane.normal))
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
    assert plane.basis.T @ plane.basis == pytest.approx(np.eye(4), abs=1e-12)
    inertia = unvec(plane.basis[4:, 3])
    assert inertia / np.trace(inertia) == pytest.approx(plane.normal[:, None] * plane.normal)


def test_three_equations_hold_in_a_plane() -> None:
    detector = PlaneDetector(robot('table1'))
    assert np.array_equal(detector.equation_selection(), np.eye(6))  # before the first window
    detector.update(turning_about(Z))
    rows = detector.equation_selection()
    assert rows @ rows.T == pytest.approx(np.eye(3), abs=1e-12)
    assert rows[:2, [2, 3, 4, 5]] == pytest.approx(np.zeros((2, 4)), abs=1e-12)
    assert rows[2] == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], abs=1e-12)


def test_a_base_that_starts_askew_moves_in_a_plane_too() -> None:
    tilt = exp(np.array([0.5, -0.3, 0.2]))
    samples = turning_about(Z)
    samples = replace(
        samples,
        base_rotation=tilt @ samples.base_rotation,
        base_angular_velocity=samples.base_angular_velocity @ tilt.T,
    )
    detector = PlaneDetector(robot('table1'))
    detector.update(samples)
    assert detector.planar
    assert detector.equation_selection()[2, 3:] == pytest.approx(rotate(tilt, Z))


@pytest.mark.parametrize('axis', [np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.1, 1.0])])
def test_turning_out_of_the_plane_is_spatial_for_good(axis: Array) -> None:
    detector = PlaneDetector(robot('table1'))
    detector.update(turning_about(Z))
    detector.update(turning_about(axis))
    assert not detector.planar
    assert detector.plane(robot('table1').link('link4')) is None
    detector.update(turning_about(Z))
    assert not detector.planar
    assert np.array_equal(detector.equation_selection(), np.eye(6))


@pytest.mark.parametrize(
    ('inside', 'outside', 'pushed', 'planar'),
    [
        (2.0, 0.20, 0.0, True),
        (2.0, 0.22, 0.0, False),
        (0.0, 0.009, 0.0, True),
        (0.0, 0.011, 0.0, False),
        (2.0, 0.0, 0.011, False),
    ],
)
def test_a_body_without_joints_leaves_the_plane_by_a_tenth_of_its_motion_and_a_centimetre(
    inside: float, outside: float, pushed: float, planar: bool
) -> None:
    detector = PlaneDetector(arm([], []))
    still = replace(turning_about(Z), base_position=np.tile([3.0, 4.0, 5.0], (25, 1)))
    detector.update(still)
    assert detector.planar
    along = np.linspace(0.0, 1.0, 25)[:, None] * np.array([-0.6 * inside, 0.8 * inside, -outside])
    impulse = np.zeros((25, 6))
    impulse[-1, 2] = pushed
    detector.update(replace(still, base_position=still.base_position + along, impulse=impulse))
    assert detector.planar is planar


@pytest.mark.parametrize(('tilt', 'planar'), [(1.0, True), (3.0, False), (10.0, False)])
def test_a_plane_is_left_by_a_tilt_beyond_the_noise_of_a_windows_mean(tilt: float, planar: bool) -> None:
    """By standard deviations of one sample: of fifty a limit of 6 sqrt(2) sqrt(3 / 50) of them."""
    still = turning_about(Z, 50)
    detector = PlaneDetector(robot('table1'))
    detector.update(still)
    lean = exp(np.array([tilt * MID.base_orientation, 0.0, 0.0]))
    detector.update(replace(still, base_rotation=lean @ still.base_rotation))
    assert detector.planar is planar


@pytest.mark.parametrize(('rate', 'planar'), [(0.5, True), (2.0, False)])
def test_a_plane_is_left_by_a_rate_beyond_the_noise_of_a_windows_mean(rate: float, planar: bool) -> None:
    still = turning_about(Z, 50)
    detector = PlaneDetector(robot('table1'))
    detector.update(still)
    turning = still.base_angular_velocity + np.array([0.0, rate * MID.base_angular_velocity, 0.0])
    detector.update(replace(still, base_angular_velocity=turning))
    assert detector.planar is planar


@pytest.mark.parametrize(('declared', 'planar'), [(0.0, False), (5e-3, True), (1e-4, False)])
def test_a_frame_that_is_mounted_askew_turns_in_the_plane_all_the_same(declared: float, planar: bool) -> None:
    """A marker 5 mrad askew leans another way as the base turns, and the table would then carry what tilts it."""
    detector = PlaneDetector(robot('table1'), declared)
    askew = exp(np.array([5e-3, 0.0, 0.0]))
    for heading in (0.0, 1.5):
        turned = exp(np.array([0.0, 0.0, heading]))
        samples = turning_about(Z, 50)
        detector.update(
            replace(
                samples,
                base_rotation=turned @ samples.base_rotation @ askew,
                base_angular_velocity=samples.base_angular_velocity @ turned.T,
            )
        )
    assert detector.planar is planar


def test_the_unknowns_of_a_plane(planar: Truth) -> None:
    servicer = kernel('table1')
    part = windows(observe(planar, MID))[:3]
    detector = PlaneDetector(servicer.model)
    detector.update(part[0])
    chosen = subspace(detector, servicer)
    assert chosen.planar
    assert chosen.basis.shape == (16, 7)
    assert chosen.basis.T @ chosen.basis == pytest.approx(np.eye(7), abs=1e-12)
    blocks = window_rows(servicer, part, MID, np.zeros(3))
    reduced = chosen.restricted(blocks)
    assert reduced.rows.shape == (3, 3, 7)
    # What the plane leaves out of the unknowns has no part in its equations.
    outside = np.eye(16) - chosen.basis @ chosen.basis.T
    assert chosen.rows @ blocks.rows @ outside == pytest.approx(np.zeros((3, 3, 16)), abs=1e-12)
    covariance = chosen.lift(np.diag(np.arange(1.0, 8.0)), np.full(16, 1e6))
    assert chosen.basis.T @ covariance @ chosen.basis == pytest.approx(np.diag(np.arange(1.0, 8.0)))
    assert outside @ covariance @ outside == pytest.approx(1e6 * outside)
