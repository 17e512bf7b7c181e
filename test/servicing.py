"""The seven-joint servicer before its capture, what CAD may say of it, and a motion of its free arm."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from benchmarks.precapture import GENERAL, WEIGHED, free_model
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.simulation.motion import random_sinusoids
from mbaid_ros.simulation.simulation import Simulation, Truth, without_linear_momentum
from simulated import state

LINKS = ('base_link', *(f'link{index}' for index in range(1, 8)))
PRIORS = (WEIGHED, *(GENERAL,) * 7)


@cache
def free_motion(seed: int, seconds: float, rate: float = 20.0, joints: tuple[int, ...] = tuple(range(7))) -> Truth:
    """Return a random motion of all joints, or of some, the servicer turning slowly."""
    model = free_model()
    motion = random_sinusoids(np.linspace(0.5, -0.4, 7), seed, 2, 1.0, 12.0, 30.0)
    motion = replace(motion, amplitude=motion.amplitude * np.isin(np.arange(7), joints)[:, None])
    start = without_linear_momentum(model, state(motion.start, motion.reference(0.0)[1], (0.01, -0.015, 0.02)))
    return Simulation(model, motion, start).advance(np.arange(round(seconds * rate)) / rate)


def all_unknown(model: RobotModel) -> MomentumKernel:
    """Return the momentum of a robot none of whose links are known."""
    return MomentumKernel(model, *(link.name for link in model.links))


def standard_parameters(model: RobotModel) -> Array:
    """Return the (10 k,) standard parameters of all links."""
    return np.concatenate([link.parameters for link in model.links])
