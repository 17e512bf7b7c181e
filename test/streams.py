"""The robots of config/ as streams of rclpy's messages, for the tests of the nodes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

from rclpy.serialization import serialize_message

from benchmarks.data import simulator_config
from mbaid_ros.bags import deserialize, serialize
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.nodes.subscriptions import TYPES
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from sessions import feed
from simulated import CONFIG

EPOCH = 1_700_000_000_000_000_000  # ns, stamp of the first sample
TABLE1_MOMENTUM = (0.0, 0.0, 4597.634)


def urdf(robot: str) -> str:
    """Return a robot description of config/."""
    return (CONFIG / f'{robot}.urdf').read_text(encoding='utf-8')


@cache
def run(robot: str, seconds: float, rate: float = 100.0, start: int = EPOCH) -> tuple[TimedMessage, ...]:
    """Return what the sensors of a robot say during its run of config/.

    Parameters
    ----------
    robot : 'table1', 'ets7', 'servicer7'
    seconds, rate : s, and samples a second: the first at 0, the last before `seconds`
    start : ns, first stamp
    """
    config = simulator_config(robot, {'joint_rate': rate, 'odometry_rate': rate})
    simulated = SimulatedRun(config, urdf(robot), TYPES)
    simulated.start = start
    return tuple(simulated.read(seconds - 0.5 / rate))


def offline(config: EstimatorConfig, robot: str, messages: Sequence[TimedMessage]) -> list[Estimate]:
    """Return what the core makes of the messages."""
    return feed(messages, Session(config, urdf(robot)))


def every_bit(message: Any, type_name: str) -> bytes:
    """Return an rclpy message as what can be compared: NaN is not equal to itself, and serialisers pad as they like."""
    return serialize(deserialize(serialize_message(message), type_name), type_name)
