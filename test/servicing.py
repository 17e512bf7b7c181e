"""The seven-joint servicer before its capture, what CAD may say of it, and a motion of its free arm."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from mbaid_ros.core.calibration.prior import LinkPrior
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.consistency import is_physical
from mbaid_ros.core.robot.inertia import physical, standard
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.urdf_values import change_inertial
from mbaid_ros.core.simulation.motion import random_sinusoids
from mbaid_ros.core.simulation.run import Simulation, Truth, without_linear_momentum
from simulated import CONFIG, state

# The arm's own last link (the table in servicer7.urdf).
BARE_LINK7 = np.array([7.0, 0.010, -0.015, 0.150, 0.070, 0.001, -0.003, 0.075, 0.002, 0.040])
GENERAL = LinkPrior(mass=0.05, com=0.01, inertia=0.05)
WEIGHED = replace(GENERAL, mass=0.001)
NOTHING = LinkPrior(0.0, 0.0, 0.0)
LINKS = ('base_link', *(f'link{index}' for index in range(1, 8)))
PRIORS = (WEIGHED, *(GENERAL,) * 7)
_ROWS, _COLUMNS = np.array([4, 4, 4, 7, 7, 9]), np.array([4, 7, 9, 7, 9, 9])


@cache
def free_urdf() -> str:
    """Return the true servicer with an empty hand."""
    return change_inertial((CONFIG / 'servicer7.urdf').read_text(encoding='utf-8'), 'link7', BARE_LINK7)


@cache
def free_servicer() -> RobotModel:
    """Return the true servicer with an empty hand."""
    return load_model(free_urdf())


@cache
def free_motion(seed: int, seconds: float, rate: float = 20.0, joints: tuple[int, ...] = tuple(range(7))) -> Truth:
    """Return a random motion of all joints, or of some, the servicer turning slowly."""
    model = free_servicer()
    motion = random_sinusoids(np.linspace(0.5, -0.4, 7), seed, 2, 1.0, 12.0, 30.0)
    motion = replace(motion, amplitude=motion.amplitude * np.isin(np.arange(7), joints)[:, None])
    start = without_linear_momentum(model, state(motion.start, motion.reference(0.0)[1], (0.01, -0.015, 0.02)))
    return Simulation(model, motion, start, 0.05).advance(np.arange(round(seconds * rate)) / rate)


def perturbed(model: RobotModel, priors: tuple[LinkPrior, ...], seed: int) -> RobotModel:
    """Return a robot whose links are off by random parts of what their priors allow: what CAD may say of it."""
    rng = np.random.default_rng(seed)
    links = []
    for link, prior in zip(model.links, priors, strict=True):
        true = physical(link.parameters)
        size = np.concatenate(
            (
                [prior.mass * true[0]],
                np.full(3, prior.com),
                prior.inertia * np.sqrt(true[_ROWS] * true[_COLUMNS]),
            )
        )
        drawn = (_off(true, size * rng.normal(size=10)) for _ in range(100))
        wrong = next(x for x in drawn if is_physical(standard(x)))
        links.append(replace(link, parameters=standard(wrong)))
    return replace(model, links=tuple(links))


def _off(true: Array, change: Array) -> Array:
    """Return a body's (10,) mass, CoM and inertia about it with errors; the inertia's is at the wrong mass."""
    wrong = true + change
    wrong[4:] += (wrong[0] / true[0] - 1.0) * true[4:]
    return wrong


def all_unknown(model: RobotModel) -> MomentumKernel:
    """Return the momentum of a robot none of whose links are known."""
    return MomentumKernel(model, *(link.name for link in model.links))


def standard_parameters(model: RobotModel) -> Array:
    """Return the (10 k,) standard parameters of all links."""
    return np.concatenate([link.parameters for link in model.links])
