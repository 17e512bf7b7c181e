"""A servicer before its capture, and CAD descriptions of it, drawn from their priors."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from benchmarks.data import NOISE, RATE, model, readings
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import BodyDeviations
from mbaid_ros.core.pipeline import Synchroniser
from mbaid_ros.core.robot.body import is_physical, physical
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.windows import Windows
from mbaid_ros.parameters import build
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ModelErrors, true_robot

# The arm's own last link, without the target (the table in servicer7.urdf).
BARE_LINK7 = np.array([7.0, 0.010, -0.015, 0.150, 0.070, 0.001, -0.003, 0.075, 0.002, 0.040])
GENERAL = BodyDeviations(0.05, 0.01, 0.05)  # of a link in CAD: mass, relative; CoM, m; inertia, relative
WEIGHED = BodyDeviations(0.001, 0.01, 0.05)  # of a base that was weighed
POSTURE = [0.4, 0.7, -0.3, 0.9, 0.5, -0.6, 0.2]  # rad, of the arm
_MOTION: dict[str, object] = {
    'initial.joint_positions': POSTURE,
    'initial.base_angular_velocity': [0.01, -0.015, 0.02],
    'initial.zero_linear_momentum': True,
    'motion.kind': 'random',
    'motion.within_limits': False,
    'motion.amplitude': 1.0,
    'motion.period_min': 12.0,
    'motion.period_max': 30.0,
}


@cache
def free_urdf() -> str:
    """Return the true servicer without its target."""
    return replace_inertial(model('servicer7').urdf, 'link7', BARE_LINK7)


@cache
def free_model() -> RobotModel:
    """Return the true servicer without its target."""
    return load_model(free_urdf())


def motion(seed: int, seconds: float, rate: float = RATE, model_errors: ModelErrors | None = None) -> Truth:
    """Return a random motion of the whole arm; the servicer with these errors turns slowly, without linear momentum."""
    moving = free_model() if model_errors is None else true_robot(free_model(), model_errors, ('link7',))
    run = make_simulation(build(SimulatorConfig, {**_MOTION, 'motion.seed': seed}), moving)
    return run.advance(np.arange(round(seconds * rate)) / rate)


def windows(truth: Truth, seed: int | None, model_errors: ModelErrors | None = None) -> list[Samples]:
    """Return the readings of a motion, in windows; without a seed they are exact."""
    cutter = Windows(0.5)
    samples = Synchroniser(0.1).push(*readings(truth, NOISE, seed, model_errors))
    return [*cutter.push(samples), *cutter.flush()] if samples is not None else []


def factors(kernel: MomentumKernel, priors: Sequence[BodyDeviations]) -> tuple[Array, ...]:
    """Return the covariance factors of the links of a kernel, as a calibration takes them."""
    return tuple(prior.factor(link.parameters) for link, prior in zip(kernel.unknown, priors, strict=True))


def perturbed(robot: RobotModel, priors: Sequence[BodyDeviations], seed: int) -> RobotModel:
    """Return a robot whose links are drawn from their priors."""
    rng = np.random.default_rng(seed)
    links = []
    for link, prior in zip(robot.links, priors, strict=True):
        factor = prior.factor(link.parameters)
        drawn = (link.parameters + factor @ rng.normal(size=factor.shape[1]) for _ in range(100))
        links.append(replace(link, parameters=next(each for each in drawn if is_physical(each))))
    return replace(robot, links=tuple(links))


def cad_model(seed: int, base: BodyDeviations) -> RobotModel:
    """Return the servicer as a CAD model may describe it."""
    robot, urdf = free_model(), free_urdf()
    priors = [base if link.name == 'base_link' else GENERAL for link in robot.links]
    for link in perturbed(robot, priors, seed).links:
        urdf = replace_inertial(urdf, link.name, physical(link.parameters))
    return load_model(urdf)
