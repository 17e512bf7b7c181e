"""Five sensors of 2 to 1,000 Hz beside the odometry: each result comes as soon as with two of them."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.data import simulator_config
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.parameters import build, topic_of
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun
from streams import EPOCH, urdf

SIMULATED = {
    'imu.rate': 200.0, 'gyros.names': ['hand'], 'gyros.hand.rate': 1000.0, 'gyros.hand.link': 'link3',
    'poses.names': ['tracker', 'camera', 'mocap'], 'poses.tracker.rate': 2.0, 'poses.tracker.measures': 'orientation',
    'poses.camera.rate': 5.0, 'poses.camera.link': 'link3', 'poses.mocap.rate': 100.0,
}  # fmt: skip
TWO = {'imu.noise_density': 1e-4, 'poses.names': ['tracker'], 'poses.tracker.measures': 'orientation'}
FIVE = TWO | {
    'gyros.names': ['hand'], 'gyros.hand.noise_density': 1e-4, 'gyros.hand.frame': 'link3',
    'poses.names': ['tracker', 'camera', 'mocap'], 'poses.camera.frame': 'link3',
}  # fmt: skip


def waited(used: Mapping[str, object], names: list[str]) -> list[float]:
    """Return how long after its last sample each estimate of a run comes, s, where messages come as they are made."""
    made = SimulatedRun(simulator_config('table1', SIMULATED), urdf('table1'), BAG_TYPES)
    made.start = EPOCH
    session, found, due = Session(build(EstimatorConfig, used), urdf('table1')), [], 0.0
    named = {topic_of(name): name for name in names}
    for each in made.read(3.3):
        if each.topic in named:
            session.add_named(each.message, named[each.topic])
        elif each.topic in ('joint_states', 'odom'):
            (session.add_joint_state if each.topic == 'joint_states' else session.add_odometry)(each.message)
        if each.time >= due:
            due = each.time + 0.01
            found += [each.time - estimate.time for estimate in session.process()]
    return found


def test_results_of_five_sensors_come_as_soon_as_of_two() -> None:
    two = waited(TWO, ['imu', 'poses.tracker'])
    five = waited(FIVE, ['imu', 'gyros.hand', 'poses.tracker', 'poses.camera', 'poses.mocap'])
    assert len(two) == len(five) == 6
    assert max(two) < 0.05
    assert max(five) < max(two) + 0.011
