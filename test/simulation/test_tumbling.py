"""The free body before its capture: what its flight conserves, and what its camera measures."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.precapture import free_urdf
from checked import some
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.geometry import log, rotation_from_quaternion, unvec
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.simulated_run import SimulatedRun
from mbaid_ros.simulation.changes import Target
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
    with pytest.raises(ParameterError, match='accepted: a capture, and no orbit'):
        run(**{'capture.time': 0.0})
    assert some(run().captured).time == 10.0
