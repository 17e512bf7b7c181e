"""The simulator's messages and the parameters behind them; and messages of estimates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mbaid_ros.bags import BAG_TYPES, deserialize, serialize
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.geometry import exp, rotate, rotation_from_quaternion
from mbaid_ros.core.results.estimate import ErrorBudget, Estimate, Event, PassiveJoint
from mbaid_ros.core.robot.model import Kinematics
from mbaid_ros.core.target import Debris
from mbaid_ros.errors import MbaidError, ModelError, ParameterError
from mbaid_ros.estimate_messages import Frames, debris_message, estimate_message
from mbaid_ros.parameters import build
from mbaid_ros.simulated_robot import make_initial_state, make_motion, make_simulation
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from mbaid_ros.simulation.changes import with_target
from mbaid_ros.simulation.sensors import PoseErrors, PoseTracker
from mbaid_ros.simulation.simulation import Simulation, total_momentum
from simulated import CONFIG, robot

NAMES = {'joint_states': 'sensor_msgs/msg/JointState', 'odom': 'nav_msgs/msg/Odometry'}


def run(name: str = 'ets7', **values: Any) -> SimulatedRun:
    return SimulatedRun(build(SimulatorConfig, values), (CONFIG / f'{name}.urdf').read_text(), BAG_TYPES)


def payloads(messages: list[TimedMessage]) -> list[bytes]:
    return [serialize(timed.message, NAMES[timed.topic]) for timed in messages]


def test_messages_come_in_order_with_their_stamps() -> None:
    made = run(joint_rate=100.0, odometry_rate=30.0)
    made.start = 5_000_000_123
    messages = made.read(1.0)
    assert [timed.time for timed in messages] == sorted(timed.time for timed in messages)
    assert [sum(timed.topic == topic for timed in messages) for topic in NAMES] == [101, 31]
    for timed in messages:
        stamp = timed.message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == made.stamp(timed.time) == 5_000_000_123 + round(timed.time * 1e9)


def test_a_message_says_what_the_state_is() -> None:
    turn = (0.5, -0.5, 0.5, 0.5)
    moving = {'base_position': (1.0, 2.0, 3.0), 'base_orientation': turn, 'base_linear_velocity': (0.1, 0.2, 0.3)}
    angular = {'base_angular_velocity': (0.01, -0.02, 0.03), 'joint_positions': (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)}
    odometry, joints = (timed.message for timed in run(initial=moving | angular, odom_frame='inertial').read(0.0))
    assert (odometry.header.frame_id, odometry.child_frame_id) == ('inertial', 'base_link')
    pose, twist = odometry.pose.pose, odometry.twist.twist
    assert (pose.position.x, pose.position.y, pose.position.z) == (1.0, 2.0, 3.0)
    assert (pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w) == turn
    # The twist of an Odometry is in the child frame.
    rotation = rotation_from_quaternion(np.array(turn))
    linear = np.array([twist.linear.x, twist.linear.y, twist.linear.z])
    assert rotate(rotation, linear) == pytest.approx([0.1, 0.2, 0.3])
    assert rotate(rotation, np.array([twist.angular.x, twist.angular.y, twist.angular.z])) == pytest.approx(
        [0.01, -0.02, 0.03]
    )
    assert joints.name == [f'joint{number}' for number in range(1, 7)]
    assert joints.position.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert len(joints.velocity) == len(joints.effort) == 6


def test_motion_capture_publishes_poses_alone() -> None:
    values: dict[str, Any] = {'noise': {'base_position': 1e-3}, 'joint_rate': 50.0, 'odometry_rate': 120.0, 'seed': 3}
    bare, whole = run(pose_only=True, **values), run(**values)
    assert (bare.topics['pose'], 'odom' in bare.topics) == ('geometry_msgs/msg/PoseStamped', False)
    poses = [timed.message for timed in bare.read(0.5) if timed.topic == 'pose']
    full = [timed.message for timed in whole.read(0.5) if timed.topic == 'odom']
    assert len(poses) == len(full) == 61
    for one, other in zip(poses, full, strict=True):
        assert (one.header, one.pose) == (other.header, other.pose.pose)


FURTHER: dict[str, Any] = {
    'gyros.names': ['arm'], 'gyros.arm.rate': 50.0, 'gyros.arm.link': 'link3', 'gyros.arm.noise_density': 1e-4,
    'poses.names': ['tracker', 'camera'], 'poses.tracker.rate': 2.0, 'poses.tracker.measures': 'orientation',
    'poses.tracker.orientation_noise': 1e-5, 'poses.camera.rate': 5.0, 'poses.camera.link': 'link6',
    'poses.camera.delay': 0.25, 'poses.camera.position': [0.1, 0.2, 0.3], 'poses.camera.world_turn': [0.0, 0.0, 0.5],
    'poses.camera.world_position': [1.0, 2.0, 3.0],
}  # fmt: skip


def test_named_sensors_speak_on_topics_of_their_own() -> None:
    made = run(motion={'kind': 'random'}, **FURTHER)
    topics = {'arm': 'Imu', 'tracker': 'QuaternionStamped', 'camera': 'PoseStamped'}
    assert {name: made.topics[name].rpartition('/')[2] for name in topics} == topics
    messages = made.read(2.0)
    assert [sum(each.topic == name for each in messages) for name in topics] == [101, 5, 11]
    again = run(motion={'kind': 'random'}, **{**FURTHER, 'poses.names': ['camera', 'tracker']})
    cut = [each for until in (0.7, 2.0) for each in again.read(until)]
    for name in topics:
        one, other = ([serialize(each.message, made.topics[name]) for each in part if each.topic == name]
                      for part in (messages, cut))  # fmt: skip
        assert one == other  # in any order of the names


def test_a_camera_sees_the_place_of_its_link_in_its_own_world_later() -> None:
    made = run(motion={'kind': 'random'}, **FURTHER)
    seen = [each.message for each in made.read(2.0) if each.topic == 'camera']
    model, config = robot('ets7'), build(SimulatorConfig, {'motion': {'kind': 'random'}})
    truth = make_simulation(config, model).advance(np.array([0.4]))
    placed = Kinematics(model).configure(rotation_from_quaternion(truth.base_orientation), truth.joint_position)
    turned, away = (each[0] for each in placed.link_pose(model.link('link6')))
    world = exp(np.array([0.0, 0.0, 0.5]))
    place = world @ (truth.base_position[0] + away + turned @ [0.1, 0.2, 0.3]) + [1.0, 2.0, 3.0]
    third = seen[2]  # at .4 s, stamped a quarter of a second later
    assert third.header.stamp.sec + 1e-9 * third.header.stamp.nanosec == pytest.approx(0.65)
    point, turn = third.pose.position, third.pose.orientation
    assert [point.x, point.y, point.z] == pytest.approx(place, abs=1e-9)
    assert rotation_from_quaternion(np.array([turn.x, turn.y, turn.z, turn.w])) == pytest.approx(world @ turned)


def test_correlated_errors_of_a_camera_have_their_time_and_size() -> None:
    errors = PoseErrors(position=2e-3, correlation_time=0.5)
    model = robot('ets7')
    tracker = PoseTracker(10.0, errors, (0, 1), model, model.link('base_link'))
    still = make_simulation(build(SimulatorConfig, {'initial.joint_positions': [0.0] * 6}), model)
    truth = still.advance(np.arange(2000) / 10.0)
    off = tracker.readings(truth).position - truth.base_position
    assert np.std(off) == pytest.approx(2e-3, rel=0.15)
    assert np.mean(off[1:] * off[:-1]) == pytest.approx(4e-6 * np.exp(-0.2), rel=0.25)


def test_one_seed_gives_one_run_to_the_last_bit_however_it_is_cut() -> None:
    values: dict[str, Any] = {'noise': {'joint_position': 1e-4, 'base_orientation': 1e-4}, 'motion': {'kind': 'random'}}
    whole = payloads(run(seed=7, **values).read(2.0))
    pieces = run(seed=7, **values)
    assert payloads([timed for until in (0.0, 0.35, 1.0, 2.0) for timed in pieces.read(until)]) == whole
    assert payloads(run(seed=8, **values).read(2.0)) != whole


def test_the_truth_is_the_urdfs() -> None:
    made = run('servicer7')
    truth = made.truth()
    assert truth.header.frame_id == 'link7'
    inertia = truth.inertia
    assert inertia.m == 162.0
    assert [inertia.com.x, inertia.com.y, inertia.com.z] == pytest.approx([0.325741, -0.211142, 0.752778])
    assert [inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz] == pytest.approx(
        [27.6097, -2.9459, 1.3046, 37.2626, -1.0330, 30.1508]
    )
    assert run('servicer7', target_link='link2').truth().header.frame_id == 'link2'


@pytest.mark.parametrize('kind', ['passive', 'random'])
def test_zero_linear_momentum(kind: str) -> None:
    made = run(initial={'zero_linear_momentum': True, 'base_angular_velocity': [0.1, 0.0, 0.2]}, motion={'kind': kind})
    assert made.momentum[:3] == pytest.approx(np.zeros(3), abs=1e-9)
    assert np.linalg.norm(made.momentum[3:]) > 100.0


def test_the_momentum_is_about_the_odometry_origin() -> None:
    model = robot('ets7')
    config = build(
        SimulatorConfig, {'initial': {'base_position': [10.0, 0.0, 0.0], 'base_linear_velocity': [0.0, 1.0, 0.0]}}
    )
    motion = make_motion(config, model)
    truth = Simulation(model, motion, make_initial_state(config, model, motion)).advance(np.zeros(1))
    total = total_momentum(model, truth)[0]
    mass = model.body_parameters()[:, 0].sum()
    assert total[1] == pytest.approx(mass)
    assert total[5] == pytest.approx(10.0 * mass, rel=0.1)  # the arm carries the rest of the lever


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'initial': {'joint_positions': [0.1]}}, 'initial.joint_positions.* 1 .*6, for joint1'),
        ({'initial': {'joint_velocities': [0.1] * 6}, 'motion': {'kind': 'random'}}, 'initial.joint_velocities'),
        ({'initial': {'base_orientation': [0.0, 0.0, 0.0, 2.0]}}, 'length 2;'),
        ({'initial': {'zero_linear_momentum': True, 'base_linear_velocity': [1.0, 0.0, 0.0]}}, 'zero is accepted'),
        ({'motion': {'kind': 'sinusoids'}}, 'motion.amplitudes has 0 numbers'),
        ({'motion': {'kind': 'sinusoids', 'amplitudes': [1.0], 'frequencies': [1.0, 2.0]}}, 'of one length'),
        ({'motion': {'kind': 'random', 'period_min': 50.0}}, 'period_min is 50 s'),
        ({'target_link': 'hand'}, "'hand'.*links: base_link"),
        ({'poses': {'names': ['odom'], 'odom': {'rate': 1.0}}}, "'poses.names' has 'odom'"),
        ({**FURTHER, 'poses.names': ['arm', 'tracker', 'camera']}, "'poses.names' has 'arm'; .*none of 'gyros.names'"),
    ],
)
def test_what_does_not_fit_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(MbaidError, match=words) as error:
        run(**values)
    assert isinstance(error.value, ModelError if 'target_link' in values else ParameterError)


DRAWN = {
    'links_relative_std': 0.02, 'zero_std': 1e-3, 'origin_std': 1e-3, 'axis_std': 1e-3,
    'mount_position_std': 2e-3, 'mount_orientation_std': 2e-3,
}  # fmt: skip
MOVING: dict[str, Any] = {'motion': {'kind': 'random'}, 'noise': {'joint_position': 1e-4, 'base_position': 1e-3}}


def test_a_drawn_robot_is_that_of_its_seed_and_the_description_the_urdfs() -> None:
    runs = [run(**MOVING, model_errors={**DRAWN, 'seed': seed}) for seed in (4, 4, 5)]
    first, again, other = (payloads(made.read(1.0)) for made in runs)
    assert first == again
    assert first != other
    assert runs[0].description().data == (CONFIG / 'ets7.urdf').read_text()
    # The truth: of a target that is not drawn, in a robot that is.
    exact = run(**MOVING)
    assert np.array_equal(runs[0].target_inertia, exact.target_inertia)
    start = make_simulation(runs[0].config, runs[0].robot).advance(np.zeros(1))
    assert np.array_equal(runs[0].momentum, total_momentum(runs[0].robot, start)[0])
    assert not np.allclose(runs[0].momentum, exact.momentum, rtol=1e-3)


@pytest.mark.parametrize('what', ['capture', 'thrust'])
def test_a_drawn_robot_captures_and_fires_thrusters(what: str) -> None:
    values: dict[str, Any] = {
        'capture': {'time': 0.5, 'mass': 100.0, 'inertia': [9.0, 0.0, 0.0, 9.0, 0.0, 9.0]},
        'thrust': {'time': 0.5, 'duration': 0.3, 'force': [1.0, 0.0, 0.0], 'link': 'link2'},
    }
    made = run(motion={'kind': 'random'}, model_errors=DRAWN, **{what: values[what]})
    truth = make_simulation(made.config, made.robot).advance(np.array([0.0, 0.4, 0.9, 1.0]))
    if what == 'capture':
        exact = run(motion={'kind': 'random'}, **{what: values[what]})
        assert made.target_inertia == pytest.approx(exact.target_inertia, rel=1e-12)
        assert made.captured is not None
        total = total_momentum(with_target(made.robot, made.captured), truth[2:])
        assert total == pytest.approx(np.tile(made.momentum, (2, 1)), abs=1e-8)
    else:
        total = total_momentum(made.robot, truth)
        assert total[1] == pytest.approx(total[0], abs=1e-9)
        assert np.linalg.norm((total[3] - total[0])[:3]) == pytest.approx(0.3, rel=1e-3)


FRAMES = Frames(target_link='link7', odometry='odom')
PANEL = PassiveJoint('panel', 0.3, 0.001, 0.01, 0.002, deflection=0.02, resolved=True)


def example() -> Estimate:
    covariance = np.linspace(0.0, 99.0, 100, dtype=np.float64).reshape(10, 10)
    return Estimate(
        method='trajectory',
        status='converged',
        time=1.25,
        stamp=1_700_000_000_123_456_789,
        parameters=np.linspace(1.0, 10.0, 10, dtype=np.float64),
        covariance=covariance,
        identifiable=np.arange(10) != 3,
        momentum=np.arange(6.0, dtype=np.float64),
        momentum_covariance=np.eye(6),
        residual=1.1,
        samples=125,
        stage='trajectory',
        budget=ErrorBudget(
            ('sensor noise', 'mount'), np.column_stack((np.linspace(0.0, 0.9, 10), np.linspace(1.0, 0.1, 10)))
        ),
        events=(Event(1.0, 'step', np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), 'a thruster'),),
        warnings=('of the estimate',),
        flexible=(PANEL,),
    )


def test_an_estimate_survives_the_wire_in_full() -> None:
    estimate = example()
    message = estimate_message(estimate, BAG_TYPES, FRAMES, ['of the run'])
    type_name = 'mbaid_msgs/msg/InertiaEstimate'
    read = deserialize(serialize(message, type_name), type_name)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert (read.header.frame_id, read.momentum_frame) == ('link7', 'odom')
    assert (read.method, read.stage, read.status, read.samples) == ('trajectory', 'trajectory', 'converged', 125)
    inertia = read.inertia
    assert (inertia.m, inertia.com.x, inertia.com.y, inertia.com.z) == (1.0, 2.0, 3.0, 4.0)
    assert (inertia.ixx, inertia.ixy, inertia.ixz) == (5.0, 6.0, 7.0)
    assert (inertia.iyy, inertia.iyz, inertia.izz) == (8.0, 9.0, 10.0)
    np.testing.assert_array_equal(read.covariance.reshape(10, 10), estimate.covariance)
    np.testing.assert_array_equal(read.identifiable, estimate.identifiable)
    np.testing.assert_array_equal(read.standard_deviation, estimate.std)
    assert estimate.budget is not None
    assert read.budget_causes == ['sensor noise', 'mount']
    np.testing.assert_array_equal(read.budget_shares.reshape(10, 2), estimate.budget.shares)
    assert (read.angular_momentum.x, read.angular_momentum.z) == (3.0, 5.0)
    np.testing.assert_array_equal(read.momentum_covariance.reshape(6, 6), np.eye(6))
    assert (read.span.sec, read.span.nanosec) == (1, 250_000_000)
    assert (read.phase, read.stale) == ('post_capture', False)
    (event,) = read.events
    assert (event.kind, event.time, event.cause) == ('step', 1.0, 'a thruster')
    assert (event.linear.x, event.angular.z) == (1.0, 6.0)
    # A quarter of a second before the last sample.
    assert (event.stamp.sec, event.stamp.nanosec) == (1_699_999_999, 873_456_789)
    assert np.isnan(read.time_offset)
    assert read.warnings == ['of the estimate', 'of the run', str(PANEL)]


def test_an_estimate_of_nothing_is_nan() -> None:
    message = estimate_message(Estimate(method='difference', status='waiting'), BAG_TYPES, FRAMES)
    assert np.isnan(message.inertia.m)
    assert not np.any(message.identifiable)
    assert np.all(np.isnan(message.standard_deviation))
    assert (message.stage, message.budget_causes, len(message.budget_shares)) == ('', [], 0)


def test_the_captured_body_alone_has_its_own_standard_deviations_and_no_budget() -> None:
    estimate = example()
    alone = Debris(estimate.parameters, 4.0 * estimate.covariance)
    message = debris_message(alone, estimate, BAG_TYPES, FRAMES)
    np.testing.assert_allclose(message.standard_deviation, 2.0 * estimate.std)
    assert (message.stage, message.budget_causes) == ('trajectory', [])
