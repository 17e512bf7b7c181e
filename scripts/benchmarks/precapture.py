"""A servicer before and after its capture, and what its CAD values may say of it: for the calibration's figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from benchmarks.data import CONFIG, LEVELS, readings
from mbaid_ros.calibration.unknowns import LinkPrior, physical_std
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.physical_consistency import is_physical
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.robot.momentum import physical, standard
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.streams import Windows
from mbaid_ros.core.sensors.synchroniser import Synchroniser
from mbaid_ros.simulated_robot import make_initial_state, make_motion
from mbaid_ros.simulation.simulation import Simulation, Truth
from mbaid_ros.simulation.true_robot import true_robot

# The arm's own last link, without the target (the table in servicer7.urdf).
BARE_LINK7 = np.array([7.0, 0.010, -0.015, 0.150, 0.070, 0.001, -0.003, 0.075, 0.002, 0.040])
NOISE = LEVELS['mid']
RATE = 100.0  # Hz
MASS_STD, COM_STD, INERTIA_STD = 0.05, 0.01, 0.05  # relative, m, relative
BASE_MASS_STD = 0.001


@cache
def free_urdf() -> str:
    """Return the true servicer without its target."""
    return replace_inertial(read_robot_description(CONFIG / 'servicer7.urdf'), 'link7', BARE_LINK7)


@cache
def free_model() -> RobotModel:
    """Return the true servicer without its target."""
    return load_model(free_urdf())


def motion(seed: int, seconds: float, rate: float = RATE, model_errors: ModelErrors | None = None) -> Truth:
    """Return a random motion of the whole arm, the servicer turning slowly, without linear momentum.

    Errors of `servicer7`, as data.drawn draws them, are those of the same robot before the capture. That of the robot
    without any is made once.
    """
    if model_errors is None:
        return _exact_motion(seed, seconds, rate)
    return _motion(true_robot(free_model(), model_errors, ('link7',)), seed, seconds, rate)


@cache
def _exact_motion(seed: int, seconds: float, rate: float) -> Truth:
    return _motion(free_model(), seed, seconds, rate)


def _motion(moving: RobotModel, seed: int, seconds: float, rate: float) -> Truth:
    values: dict[str, object] = {
        'initial': {
            'joint_positions': [0.4, 0.7, -0.3, 0.9, 0.5, -0.6, 0.2],
            'base_angular_velocity': [0.01, -0.015, 0.02],
            'zero_linear_momentum': True,
        },
        'motion': {
            'kind': 'random',
            'within_limits': False,
            'seed': seed,
            'amplitude': 1.0,
            'period_min': 12.0,
            'period_max': 30.0,
        },
    }
    config = build(SimulatorConfig, values)
    driven = make_motion(config, moving)
    simulation = Simulation(moving, driven, make_initial_state(config, moving, driven), 0.05)
    return simulation.advance(np.arange(round(seconds * rate)) / rate)


def windows(truth: Truth, seed: int | None, model_errors: ModelErrors | None = None) -> list[Samples]:
    """Return what sensors say of a motion, in windows; without a seed without noise."""
    cutter = Windows(0.5)
    samples = Synchroniser(0.1).push(*readings(truth, NOISE, seed, model_errors))
    return [*cutter.push(samples), *cutter.flush()] if samples is not None else []


def perturbed(model: RobotModel, priors: Sequence[LinkPrior], seed: int) -> RobotModel:
    """Return a robot whose links are off by random parts of what their priors allow: what CAD may say of it."""
    rng = np.random.default_rng(seed)
    links = []
    for link, prior in zip(model.links, priors, strict=True):
        true = physical(link.parameters)
        size = np.where(prior.given, physical_std(link, prior), 0.0)
        drawn = (_off(true, size * rng.normal(size=10)) for _ in range(100))
        links.append(replace(link, parameters=next(each for each in drawn if is_physical(each))))
    return replace(model, links=tuple(links))


def _off(true: Array, change: Array) -> Array:
    """Return the standard parameters (10,) of a body that is off by so much; the inertia's is at the wrong mass."""
    wrong = true + change
    wrong[4:] += (wrong[0] / true[0] - 1.0) * true[4:]
    return standard(wrong)


def cad_urdf(seed: int, base_mass_std: float = BASE_MASS_STD) -> str:
    """Return what CAD may say of the servicer."""
    general = LinkPrior(MASS_STD, COM_STD, INERTIA_STD)
    base = replace(general, mass=base_mass_std)
    model, urdf = free_model(), free_urdf()
    priors = [base if link.name == 'base_link' else general for link in model.links]
    for link in perturbed(model, priors, seed).links:
        urdf = replace_inertial(urdf, link.name, physical(link.parameters))
    return urdf


def with_link(model: RobotModel, name: str, parameters: Array) -> RobotModel:
    """Return a robot with other (10,) standard parameters of one link."""
    links = tuple(replace(link, parameters=parameters) if link.name == name else link for link in model.links)
    return replace(model, links=links)
