"""The runs that the tests of the trajectory-level estimator share: each is computed once."""

from __future__ import annotations

import pytest

from floating import RATE
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.simulation.motion import Sinusoids
from mbaid_ros.core.simulation.run import Truth
from mbaid_ros.simulated_run import make_motion
from observed import configured_motion
from simulated import CONFIG, robot

STEP = 0.05  # s, of the integrator


@pytest.fixture(scope='session')
def servicer() -> Truth:
    """Return 20 s of the seven-joint servicer."""
    return configured_motion('servicer7', 20.0, RATE, STEP)


@pytest.fixture(scope='session')
def satellite() -> Truth:
    """Return 10 s of ETS-VII."""
    return configured_motion('ets7', 10.0, RATE, STEP)


@pytest.fixture(scope='session')
def plane() -> Truth:
    """Return 20 s of the paper's planar case."""
    return configured_motion('table1', 20.0, RATE, STEP)


@pytest.fixture(scope='session')
def joints() -> Sinusoids:
    """Return how the servicer's joints are driven."""
    config = build(SimulatorConfig, load_parameter_file(CONFIG / 'servicer7_simulator.yaml', 'simulator'))
    motion = make_motion(config, robot('servicer7'))
    assert isinstance(motion, Sinusoids)
    return motion
