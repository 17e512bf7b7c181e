"""Bags of any length: the endless motion of servicer7, with fresh noise."""

from __future__ import annotations

from pathlib import Path

from benchmarks.data import DURATION, NOISE, RATE, START, endless_motion, model
from mbaid_ros.bags import BAG_TYPES, BagWriter
from mbaid_ros.sensor_messages import joints_of, poses_of
from mbaid_ros.simulation.sensors import Sensors

ROBOT = 'servicer7'
TOPICS = {'/joint_states': 'sensor_msgs/msg/JointState', '/odom': 'nav_msgs/msg/Odometry'}


def make_bag(path: Path, minutes: float, rate: float = RATE) -> None:
    """Write a bag, a JointState and an Odometry a sample."""
    truth = endless_motion(ROBOT, rate, min(60.0 * minutes, DURATION))
    sensors, robot = Sensors(NOISE, seed=0), model(ROBOT)
    left = round(minutes * 60.0 * rate)
    with BagWriter(path) as bag:
        for topic, kind in TOPICS.items():
            bag.add_topic(topic, kind)
        for minute in range(-(-left // len(truth))):
            part = truth[: left - minute * len(truth)]
            joints = joints_of(sensors.joints(part), robot.joint_names)
            base = poses_of(sensors.base(part), robot.base_link)
            for index, time in enumerate(part.time):
                stamp = START + round((minute * DURATION + time) * 1e9)
                bag.write('/odom', base.message(BAG_TYPES, index, stamp), stamp)
                bag.write('/joint_states', joints.message(BAG_TYPES, index, stamp), stamp)
