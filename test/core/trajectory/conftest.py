"""The runs that the tests of the trajectory-level estimator share: each is computed once."""

from __future__ import annotations

import pytest

from floating import RATE
from mbaid_ros.simulation.simulation import Truth
from observed import configured_motion

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
