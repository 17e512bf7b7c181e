"""Noisy runs of the simulated servicer through a session, for the tests of orbits, wheels, thrusters and springs."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.data import simulator_config
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from observed import MID
from simulated import CONFIG

URDF = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
NOISE = {f'noise.{channel}': size for channel, size in vars(MID).items() if channel != 'base_correlation_time'}
MEAN_MOTION = 1.1308e-3  # rad/s, at 400 km
NADIR, NORMAL = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
AWAY = [12.0, -10.0, 13.0]  # m: 20 m from the origin


def orbit(mean_motion: float = MEAN_MOTION) -> Orbit:
    """Return an orbit whose directions are those of no axes."""
    return Orbit.inertial(mean_motion, NADIR, NORMAL)


def declared(frame: str = 'inertial', mean_motion: float = MEAN_MOTION) -> dict[str, object]:
    """Return the parameters of an orbit, of the simulator and the estimator alike."""
    directions = {'orbit.nadir': NADIR.tolist(), 'orbit.normal': NORMAL.tolist()} if frame == 'inertial' else {}
    return {'orbit.mean_motion': mean_motion, 'orbit.frame': frame, **directions}


def _dotted(parameters: dict[str, object]) -> dict[str, object]:
    return {name.replace('__', '.'): value for name, value in parameters.items()}


def simulated(seconds: float, **parameters: object) -> SimulatedRun:
    """Return a noisy run at 20 Hz; in names of parameters, two underlines are a dot."""
    values = {'duration': seconds, 'joint_rate': 20.0, 'odometry_rate': 20.0, **NOISE, **_dotted(parameters)}
    return SimulatedRun(simulator_config('servicer7', values), URDF, BAG_TYPES)


def session(**parameters: object) -> Session:
    """Return a session of an estimator that takes the robot as exact."""
    return Session(build(EstimatorConfig, {**EXACT, **NOISE, 'target_link': 'link7', **_dotted(parameters)}), URDF)


def fed(into: Session, messages: Iterable[tuple[str, Any]], at_once: int = 1_000_000) -> list[Estimate]:
    """Return all estimates of messages with their topics, so many before each time that the session works."""
    take = {
        'joint_states': into.add_joint_state,
        'odom': into.add_odometry,
        'imu': into.add_named,
        'stored_momentum': into.add_stored_momentum,
        'thrust': into.add_thrust,
    }
    found: list[Estimate] = []
    for place, (topic, message) in enumerate(messages, start=1):
        take.get(topic, partial(into.add_named, name=topic))(message)
        if place % at_once == 0:
            found += into.process()
    return [*found, *into.process()]


def feed(messages: Iterable[TimedMessage], into: Session) -> list[Estimate]:
    """Return all estimates of messages."""
    return fed(into, ((each.topic, each.message) for each in messages))


def history(run: SimulatedRun, into: Session) -> list[Estimate]:
    """Return all estimates of a run."""
    return feed(run.read(run.config.duration), into)


def identify(run: SimulatedRun, into: Session) -> Estimate:
    """Return the last estimate of a run."""
    return history(run, into)[-1]


def first_columns(result: list[Estimate]) -> Array:
    """Return the published numbers and texts, NaN as a number, for comparison to the last bit."""
    rows = [np.concatenate((each.parameters, np.ravel(each.covariance), each.momentum)) for each in result]
    return np.nan_to_num(np.array(rows), nan=-1.0)
