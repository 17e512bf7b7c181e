"""Bags of simulated motions with fresh noise; of any length, of the endless motion of servicer7."""

from collections.abc import Iterable
from pathlib import Path

from benchmarks.data import DURATION, NOISE, RATE, START, endless_motion, model
from mbaid_ros.bags import BAG_TYPES, BagWriter
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.sensor_messages import joints_of, poses_of
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth

ROBOT = 'servicer7'
JOINTS, ODOMETRY = '/joint_states', '/odom'


def write_bag(path: Path, robot: RobotModel, sensors: Sensors, parts: Iterable[tuple[float, Truth]]) -> None:
    """Write a bag, a JointState and an Odometry a sample; parts of the motion with the times (s) when they begin."""
    with BagWriter(path) as bag:
        bag.add_topic(JOINTS, 'sensor_msgs/msg/JointState')
        bag.add_topic(ODOMETRY, 'nav_msgs/msg/Odometry')
        for begin, truth in parts:
            joints = joints_of(sensors.joints(truth), robot.joint_names)
            base = poses_of(sensors.base(truth), robot.base_link)
            for index, time in enumerate(truth.time.tolist()):
                stamp = START + round((begin + time) * 1e9)
                bag.write(ODOMETRY, base.message(BAG_TYPES, index, stamp), stamp)
                bag.write(JOINTS, joints.message(BAG_TYPES, index, stamp), stamp)


def make_bag(path: Path, minutes: float, rate: float = RATE) -> None:
    """Write a bag of the endless motion."""
    truth = endless_motion(ROBOT, rate, min(60.0 * minutes, DURATION))
    samples = round(minutes * 60.0 * rate)
    parts = ((begin / rate, truth[: samples - begin]) for begin in range(0, samples, len(truth)))
    write_bag(path, model(ROBOT), Sensors(NOISE, seed=0), parts)
