"""What is attainable with a robot that is not its URDF: the filter's posterior, linearised at the truth.

All windows of the exact motion go through the information filter, each linearised at the true robot, momentum and body;
what is left of the priors and the noise is the covariance of the best estimate to first order. Nothing of an estimate
enters it: no start, no point that moves, no noise drawn. What the mean of data without noise is off by is the error
that the robot itself makes, by being elsewhere than the priors' means.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.data import exact_samples, kernel, momentum_of
from benchmarks.model_errors.variant import NOISE, settings
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.filter.averaging import KnotAveraging
from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.square_root import advance, update
from mbaid_ros.core.filter.state import (
    BODY,
    MOMENTUM,
    Layout,
    layout_of,
)
from mbaid_ros.core.filter.variables import Variables, variables
from mbaid_ros.core.filter.whitened import LinearisationCache
from mbaid_ros.core.filter.window import Window, stacked
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.robot.inertia import physical_jacobian
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.streams import Windows
from mbaid_ros.core.unknowns.base import OdometryMount
from mbaid_ros.core.unknowns.bodies import KnownBodies
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.hypotheses import UNDISTURBED
from mbaid_ros.core.unknowns.joints import JointPlacements
from mbaid_ros.session.posterior import declared_errors
from mbaid_ros.session.settings import declared_uncertainty
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ErrorSizes

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Attainable:
    """The best estimate of the physical parameters to first order; NaN for what a planar motion leaves open.

    Attributes
    ----------
    std : (10,) smallest standard deviations
    error : (10,) what it is off by where the sensors have no noise
    """

    std: Array
    error: Array


def attainable(robot: str, truth: Truth, errors: ModelErrors, sizes: ErrorSizes) -> Attainable:
    """Return what can be known at the end of a motion.

    Parameters
    ----------
    robot : name of a URDF of config/
    truth : motion of the robot with these errors
    errors : of the robot
    sizes : what robots are known to be drawn with
    """
    config = build(EstimatorConfig, settings(sizes))
    own = kernel(robot)
    own = own.with_uncertainty(declared_errors(own, config.known_links))
    uncertainty = declared_uncertainty(config, own.model)
    windows, origin, detector = _windows(robot, truth, errors, config.window)
    layout = layout_of(own, uncertainty, detector)
    own_variables = variables(layout, detector, uncertainty)
    state = np.zeros(layout.size)
    momentum = momentum_of(robot, truth, errors)
    momentum[3:] -= cross(origin, momentum[:3])
    state[MOMENTUM], state[BODY] = momentum, own.target.parameters
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        state[place] = np.linalg.lstsq(unknown.factor, _true(unknown, errors), rcond=None)[0]
    belief = _followed(layout, own_variables, windows, state)
    moments = MeanAndCovariance.of(belief, own_variables)
    jacobian = physical_jacobian(own.target.parameters)
    deviation = np.sqrt(np.sum((jacobian @ moments.factor[BODY]) ** 2, axis=1))
    error = jacobian @ (moments.mean - state)[BODY]
    plane = detector.plane(own.target)
    if plane is not None:
        beside = np.any(np.abs(plane.basis @ plane.basis.T - np.eye(10)) > _ROUNDING, axis=1)
        deviation[beside] = error[beside] = np.nan
    return Attainable(deviation, error)


def _windows(robot: str, truth: Truth, errors: ModelErrors, length: float) -> tuple[list[Window], Array, PlaneDetector]:
    """Return the windows of a motion that is measured without noise, where its base was at first, and its plane."""
    cutter, own = Windows(length), kernel(robot)
    samples = exact_samples(truth, NOISE, errors)
    samples = samples[: round(samples.time[-1] / length) * round(length / (samples.time[1] - samples.time[0]))]
    parts: list[Samples] = [*cutter.push(samples), *cutter.flush()]
    detector = PlaneDetector(own.model)
    for part in parts:
        detector.update(part)
    gathering = KnotAveraging(own.model.joints, NOISE, length)
    taken = gathering.take(parts)
    both = [*(each.ready for each in taken), taken[-1].still_open]
    return [window for window in both if window is not None], gathering.origin, detector


def _followed(layout: Layout, own: Variables, windows: list[Window], state: Array) -> SquareRootInformation:
    """Return the belief after windows, all linearised at a state."""
    steps = LinearisationCache(layout, own).all_whitened(stacked(windows), layout.point(state))
    belief = SquareRootInformation.prior(own)
    for place, (_, step) in enumerate(steps):
        belief = update(belief if place == 0 else advance(belief, steps[place - 1][1], own, UNDISTURBED), step)
    return belief


def _true(unknown: Unknown, errors: ModelErrors) -> Array:
    """Return the (k,) numbers of an unknown that a robot truly has."""
    if isinstance(unknown, KnownBodies):
        return errors.bodies[list(unknown.bodies)].ravel()
    if isinstance(unknown, JointPlacements):
        tilts = (errors.tilts[:, None] @ unknown.across)[:, 0]
        return np.column_stack((errors.zeros, errors.origins, tilts)).ravel()
    if isinstance(unknown, OdometryMount):
        return errors.mount
    return np.zeros(len(unknown.factor))
