"""What the tests of the unknowns share: a robot whose bodies are in doubt, and the momentum that it moves with."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model_errors import declared
from observed import kernel
from wrong_robots import LINKS


@pytest.fixture(scope='session')
def servicer7() -> MomentumKernel:
    """Return the seven-joint servicer."""
    robot = kernel('servicer7')
    return robot.with_uncertainty(declared(robot.known, LINKS))


@pytest.fixture(scope='session')
def start() -> Array:
    """Return its (6,) momentum about the odometry's origin: it tumbles and drifts."""
    return np.array([4.0, -3.0, 2.0, 30.0, -12.0, 190.0])
