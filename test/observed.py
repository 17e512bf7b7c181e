"""Simulated motions and what sensors make of them, as the samples that the core works on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from benchmarks.data import LEVELS, sampled, simulator_config
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.windows import Windows
from mbaid_ros.parameters import build
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ModelErrors, true_robot
from simulated import robot

# One standard deviation of a sample: the encoders' as the names say, the base's the same in all.
LOW, MID, HIGH = LEVELS.values()
LIMIT = float(chi2.isf(1e-3, 10))  # of the NEES of ten parameters: one run in a thousand exceeds it


def configured_motion(name: str, seconds: float, rate: float, model_errors: ModelErrors | None = None) -> Truth:
    """Return the run that config/ describes for a robot, sampled at a rate (Hz)."""
    model = robot(name)
    if model_errors is not None:
        model = true_robot(model, model_errors, (model.last_link,))
    return make_simulation(simulator_config(name), model).advance(np.arange(round(seconds * rate)) / rate)


def drifting(truth: Truth, velocity: Array, start: Array | None = None) -> Truth:
    """Return the same motion seen from a frame that moves with -velocity (m/s), the base beginning at `start` (m).

    Without external forces both are motions of the same robot: mechanics is the same in every inertial frame.
    """
    back = quaternions.conjugate(truth.base_orientation)
    position = truth.base_position + truth.time[:, None] * velocity
    linear = truth.base_linear_velocity + quaternions.rotate(back, np.broadcast_to(velocity, position.shape))
    return replace(truth, base_position=position + (0.0 if start is None else start), base_linear_velocity=linear)


def observe(
    truth: Truth, noise: SensorNoise, seed: int | None = None, model_errors: ModelErrors | None = None
) -> Samples:
    """Return the samples that sensors give of a motion; without a seed exact ones that claim that noise."""
    none = SensorNoise(*(0.0,) * 6)
    sensors = Sensors(none if seed is None else noise, seed or 0, model_errors)
    return sampled(truth, sensors, noise)


def windows(samples: Samples, length: float = 0.5) -> list[Samples]:
    """Return the samples cut into windows."""
    cutter = Windows(length)
    return [*cutter.push(samples), *cutter.flush()]


def kernel(name: str) -> MomentumKernel:
    """Return the momentum of a robot of config/ with its last link unknown."""
    model = robot(name)
    return MomentumKernel(model, model.last_link)


def estimator(unknown: MomentumKernel, noise: SensorNoise, **parameters: object) -> Estimator:
    """Return a method, `difference` unless the estimator's parameters (with __ for the dot) name it; noise declared."""
    given = {'method': 'difference', **{name.replace('__', '.'): value for name, value in parameters.items()}}
    return make_estimator(
        build(EstimatorConfig, {**EXACT, **{f'noise.{k}': v for k, v in vars(noise).items()}, **given}), unknown
    )


def identify(
    unknown: MomentumKernel, truth: Truth, noise: SensorNoise, seed: int | None = None, **parameters: object
) -> list[Estimate]:
    """Return the estimates of a motion as sensors see it; without a seed exactly."""
    return estimator(unknown, noise, **parameters).update(windows(observe(truth, noise, seed)), 0)


def true_body(unknown: MomentumKernel) -> Array:
    """Return the target link's true (m, r_c, I_c)."""
    return physical(unknown.target.parameters)


def nees(estimate: Estimate, true: Array) -> float:
    """Return the squared error of what is identifiable, normalised by the covariance: chi-square of as many numbers."""
    known = estimate.identifiable
    error = (estimate.parameters - true)[known]
    return float(error @ np.linalg.solve(estimate.covariance[np.ix_(known, known)], error))
