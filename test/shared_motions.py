"""Simulated runs that several tests share, as fixtures: each is computed once."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.honesty import paths
from floating import float_freely
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import independent_errors
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth
from observed import configured_motion, kernel
from planned import Begun, begun
from wrong_robots import LINKS

RATE, FAST = 20.0, 100.0  # Hz


@pytest.fixture(scope='session')
def spatial_minute() -> Truth:
    """Return a minute of the seven-joint servicer, all its joints in motion, without linear momentum."""
    return configured_motion('servicer7', 60.0, RATE)


@pytest.fixture(scope='session')
def spatial(spatial_minute: Truth) -> Truth:
    """Return the first 20 s of that minute."""
    return spatial_minute[spatial_minute.time < 20.0 - 1e-9]


@pytest.fixture(scope='session')
def planar() -> Truth:
    """Return a minute of the paper's case, 50 samples a second."""
    return configured_motion('table1', 60.0, 50.0)


@pytest.fixture(scope='session')
def drift() -> Array:
    """Return the direction that drifting systems drift in."""
    return np.array([0.6, -0.3, np.sqrt(0.55)])


@pytest.fixture(scope='session')
def joints() -> Sinusoids:
    """Return how the servicer's joints are driven."""
    return paths.servicer()


@pytest.fixture(scope='session')
def servicer() -> Truth:
    """Return 20 s of the seven-joint servicer, 100 samples a second."""
    return configured_motion('servicer7', 20.0, FAST)


@pytest.fixture(scope='session')
def satellite() -> Truth:
    """Return 10 s of ETS-VII, 100 samples a second."""
    return configured_motion('ets7', 10.0, FAST)


@pytest.fixture(scope='session')
def plane() -> Truth:
    """Return 20 s of the paper's planar case, 100 samples a second."""
    return configured_motion('table1', 20.0, FAST)


@pytest.fixture(scope='session')
def robot() -> MomentumKernel:
    """Return the momentum of the seven-joint servicer, exactly its URDF."""
    return kernel('servicer7')


@pytest.fixture(scope='session')
def servicer7() -> MomentumKernel:
    """Return the momentum of the seven-joint servicer, whose known bodies are in doubt."""
    robot = kernel('servicer7')
    return robot.with_errors(independent_errors(robot.known, LINKS))


@pytest.fixture(scope='session')
def start() -> Array:
    """Return the momentum (6,) about the odometry's origin of a servicer that tumbles and drifts."""
    return np.array([4.0, -3.0, 2.0, 30.0, -12.0, 190.0])


@pytest.fixture(scope='session')
def tumbling(servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> Truth:
    """Return 6 s of a servicer that is as its URDF says, as it tumbles and drifts."""
    return float_freely(servicer7, joints, start, 6.0)


@pytest.fixture(scope='session')
def identified() -> Begun:
    """Return the seven-joint servicer after 8.5 s, as motions are planned from. Its method must not go on."""
    return begun()
