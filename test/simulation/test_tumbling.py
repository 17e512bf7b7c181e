"""The free body before its capture: what its flight conserves, and what its camera measures."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.precapture import free_urdf
from checked import some
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.geometry import log, rotation_from_quaternion, unvec
from mbaid_ros.core.robot.model import Kinematics
from mbaid_ros.errors import DataError, ParameterError
from mbaid_ros.joint_trajectory import JointTrajectory
from mbaid_ros.parameters import build
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulated_run import SimulatedRun
from mbaid_ros.simulation.changes import CaptureSimulation, Target
from mbaid_ros.simulation.simulation import total_momentum
from mbaid_ros.simulation.tumbling import FreeMotion

TARGET = Target(
    10.0,
    'link7',
    np.array([155.0, 0.34, -0.22, 0.78, 24.0, -2.5, 2.0, 33.0, -0.5, 29.0]),
    np.array([0.004, -0.006, 0.003]),
    np.array([0.3, -0.5, 0.2]),
)
CAPTURE = {
    'duration': 12.0,
    'motion.kind': 'random',
    'capture.time': 10.0,
    'capture.mass': 155.0,
    'capture.com': [0.34, -0.22, 0.78],
    'capture.inertia': [24.0, -2.5, 2.0, 33.0, -0.5, 29.0],
    'capture.angular_velocity': [0.3, -0.5, 0.2],
    'target_pose.rate': 5.0,
    'target_pose.position': [0.1, 0.0, 0.2],
}


def test_a_free_body_keeps_its_momentum() -> None:
    place, at = np.array([1.0, 2.0, 3.0]), rotation_from_quaternion(np.array([0.1, 0.5, -0.3, np.sqrt(0.65)]))
    motion, step = FreeMotion(TARGET, at, place), 1e-3
    time = np.repeat(np.linspace(0.0, 9.9, 12), 2) + np.tile([0.0, step], 12)
    com, turned = motion.poses(time, TARGET.body[1:4])
    velocity = (com[1::2] - com[::2]) / step
    assert velocity == pytest.approx(np.tile(TARGET.velocity, (12, 1)), abs=1e-9)
    before, after = turned[::2], turned[1::2]
    spin = log(np.swapaxes(before, 1, 2) @ after) / step
    momentum = (before @ (unvec(TARGET.body[4:]) @ spin[..., None]))[..., 0]
    expected = at @ unvec(TARGET.body[4:]) @ at.T @ TARGET.spin
    assert momentum == pytest.approx(np.tile(expected, (12, 1)), abs=0.02)
    assert np.ptp(spin, axis=0).max() > 0.1  # it tumbles
    (end,), (turn,) = motion.poses(np.array([10.0]), np.zeros(3))
    assert end == pytest.approx(place, abs=1e-9)
    assert turn == pytest.approx(at, abs=1e-9)


def run(**options: object) -> SimulatedRun:
    return SimulatedRun(build(SimulatorConfig, CAPTURE | options), free_urdf(), BAG_TYPES)


def test_poses_come_late_and_with_gaps_until_the_capture() -> None:
    made = run(**{'target_pose.delay': 0.3, 'target_pose.missing': 0.4, 'seed': 3})
    assert made.topics['target_pose'] == 'geometry_msgs/msg/PoseStamped'
    parts = [made.read(until) for until in (4.0, 4.05, 12.0)]
    poses = [each for part in parts for each in part if each.topic == 'target_pose']
    stamps = np.array([each.message.header.stamp.sec + 1e-9 * each.message.header.stamp.nanosec for each in poses])
    assert np.array([each.time for each in poses]) == pytest.approx(stamps + 0.3)
    assert 20 < len(stamps) < 45
    assert (stamps[0] < 0.5, stamps[-1] <= 10.0) == (True, True)
    assert np.diff(stamps).min() == pytest.approx(0.2, abs=1e-6)
    again = [each for each in run(**{'target_pose.missing': 0.4, 'seed': 3}).read(12.0) if each.topic == 'target_pose']
    assert [each.message.pose.position.x for each in again] == [each.message.pose.position.x for each in poses]


def test_noise_is_as_asked_for_and_the_other_sensors_keep_theirs() -> None:
    noise = {'target_pose.position_noise': 5e-3, 'target_pose.orientation_noise': 5e-3, 'noise.base_position': 1e-3}
    noisy, exact = (run(**more).read(10.0) for more in (noise, {'noise.base_position': 1e-3}))
    both = zip(noisy, exact, strict=True)
    away = []
    for one, other in both:
        if one.topic == 'odom':
            assert one.message.pose.pose.position.x == other.message.pose.pose.position.x
        if one.topic == 'target_pose':
            there, here = one.message.pose.position, other.message.pose.position
            away += [there.x - here.x, there.y - here.y, there.z - here.z]
    assert np.std(away) == pytest.approx(5e-3, rel=0.2)


def test_what_is_not_captured_is_not_tracked() -> None:
    with pytest.raises(ParameterError, match='accepted: a capture'):
        run(**{'capture.time': 0.0})
    assert some(run().captured).time == 10.0


def test_a_trajectory_is_refused_until_the_capture_and_the_poses_after_it_have_been() -> None:
    made = run(**{'target_pose.after': 1.0})
    order = JointTrajectory(('joint1',), np.array([3.0]), np.zeros((1, 1)), *2 * (np.zeros((0, 0)),))
    for until in (1.0, 10.5):
        made.read(until)
        with pytest.raises(DataError, match=r'until 11 s is fixed by capture\.time and target_pose\.after'):
            made.add_trajectory(order)
    made.read(11.0)
    assert made.add_trajectory(order) > 11.0


def test_a_body_that_slips_takes_along_its_momentum_and_is_held_where_it_shall_be() -> None:
    slips = {'capture.settling': 2.0, 'target_pose.after': 4.0, 'capture.linear_velocity': [0.02, -0.03, 0.05]}
    made = run(**slips, **{'duration': 15.0, 'initial.base_angular_velocity': [0.01, -0.02, 0.01]})
    read = [*made.read(12.0), *made.read(14.5)]  # the second part is after the capture
    poses = [each.message for each in read if each.topic == 'target_pose']
    time = np.array([each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in poses])
    place = np.array([[each.pose.position.x, each.pose.position.y, each.pose.position.z] for each in poses])
    assert time[-1] == pytest.approx(14.0)
    # The camera's frame moves on without a jump: by speed times time, and as fast before the capture as after it.
    speed = np.diff(place, axis=0) / np.diff(time)[:, None]
    at = int(np.flatnonzero(np.abs(time - 10.0) < 1e-6)[0])
    assert np.abs(np.diff(speed[at - 3 : at + 3], axis=0)).max() < 0.05
    simulation = make_simulation(made.config, made.robot)
    assert isinstance(simulation, CaptureSimulation)
    instants = np.array([9.0, 12.0, 12.5, 14.0])
    truth = simulation.advance(instants)
    alone, after = total_momentum(made.robot, truth[:1]), total_momentum(simulation.joined_model, truth[1:])
    assert after == pytest.approx(np.tile(alone + simulation.target_momentum, (3, 1)), abs=1e-6)
    configuration = Kinematics(made.robot).configure(
        rotation_from_quaternion(truth.base_orientation), truth.joint_position
    )
    rotation, position = configuration.link_pose(made.robot.link('link7'))
    held = truth.base_position + position + rotation @ np.array([0.1, 0.0, 0.2])
    for index in (1, 3):
        nearest = int(np.argmin(np.abs(time - instants[index])))
        assert place[nearest] == pytest.approx(held[index], abs=1e-6)


def test_a_body_that_is_tracked_in_an_orbit_falls_as_the_robot_does() -> None:
    """Its poses, in a frame that turns, lead to the path that Clohessy and Wiltshire have."""
    rate = 0.02
    made = run(**{'orbit.mean_motion': rate, 'orbit.frame': 'hill', 'capture.time': 10.0})
    poses = [each.message for each in made.read(10.0) if each.topic == 'target_pose']
    time = np.array([each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in poses])
    turn = rotation_from_quaternion(np.array([[q.x, q.y, q.z, q.w] for q in (each.pose.orientation for each in poses)]))
    place = np.array([[each.pose.position.x, each.pose.position.y, each.pose.position.z] for each in poses])
    centre = place + turn @ (TARGET.body[1:4] - np.array([0.1, 0.0, 0.2]))
    step, middle = time[1] - time[0], slice(1, -1)
    pull = np.diff(centre, n=2, axis=0) / step**2
    speed = (centre[2:] - centre[:-2]) / (2.0 * step)
    x, _, z = centre[middle].T
    expected = np.column_stack(
        (3.0 * rate**2 * x + 2.0 * rate * speed[:, 1], -2.0 * rate * speed[:, 0], -(rate**2) * z)
    )
    assert np.abs(expected).max() > 5e-4
    assert pull == pytest.approx(expected, abs=1e-6)
