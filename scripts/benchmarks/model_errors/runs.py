"""Runs of robots that are not their URDF, and the attainable accuracy.

The attainable accuracy is the filter's posterior, linearised at the truth. All windows of the exact motion pass through
the information filter at the true robot, momentum and body. Priors and noise then leave the covariance of the best
estimate to first order. The mean for data without noise has the error that the robot itself makes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from benchmarks.data import (
    DURATION,
    MAXIMUM_GAP,
    NOISE,
    RATE,
    Case,
    exact_samples,
    kernel,
    momentum_of,
    motion,
    observed,
    target,
)
from benchmarks.frame import Runs
from benchmarks.model_errors.variant import Variant, settings
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.filter.averaging import KnotAveraging
from mbaid_ros.core.filter.square_root import MeanAndCovariance, SquareRootInformation, update
from mbaid_ros.core.filter.state import BODY, MOMENTUM, Layout, layout_of
from mbaid_ros.core.filter.time_update import UNDISTURBED, advance
from mbaid_ros.core.filter.variables import Variables, variables
from mbaid_ros.core.filter.whitened import LinearisationCache
from mbaid_ros.core.filter.window import Window, stacked
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.identifier import Identifier
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import BAND, PARAMETERS
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.robot.momentum import physical_jacobian
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.streams import Windows
from mbaid_ros.core.unknowns.base import OdometryMount
from mbaid_ros.core.unknowns.bodies import KnownBodies
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.joints import JointPlacements
from mbaid_ros.replay.campaigns.statistics import mean, nees
from mbaid_ros.session.known_robot import declared_errors
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.settings import declared_uncertainty
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ErrorSizes

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Outcome(Runs):
    """Ends of runs of a minute."""

    status: Array
    error: Array  # (..., 10) NaN where not published
    std: Array  # (..., 10)
    bound: Array  # (..., 10) attainable standard deviations
    robots_own: Array  # (..., 10) errors of the best estimate without noise
    error_norm: Array  # NEES, a parameter
    nis: Array  # mean normalised innovation squared

    @property
    def z(self) -> Array:
        """Errors over standard deviations, (S, 10)."""
        return np.asarray(self.error / self.std)

    @property
    def coverage(self) -> Array:
        """Share of the 95 % intervals that hold the truth, of each parameter, (10,)."""
        return mean(np.where(np.isfinite(self.z), np.abs(self.z) < BAND, np.nan))

    def over_bound(self, error: Array) -> Array:
        """Return RMSE over the root mean square of the bounds of the same runs, (10,)."""
        there = np.isfinite(error) & np.isfinite(self.bound)
        squares = [mean(np.where(there, values**2, np.nan)) for values in (error, self.bound)]
        return np.asarray(np.sqrt(squares[0] / squares[1]))

    @property
    def nees(self) -> tuple[float, float, float]:
        """Mean squared error in the metric of the covariance, a parameter, and the 95 % band of such means."""
        there = np.isfinite(self.error_norm)
        freedom = float(np.sum(np.isfinite(self.z[there])))
        if not freedom:
            return np.nan, np.nan, np.nan
        weight = np.sum(np.isfinite(self.z[there]), axis=1)
        low, high = (float(chi2.ppf(tail, freedom)) / freedom for tail in (0.025, 0.975))
        return float(np.sum(weight * self.error_norm[there]) / freedom), low, high

    @property
    def largest(self) -> tuple[float, str, int]:
        """Largest |error| in standard deviations, its parameter, and its seed."""
        size = np.where(np.isfinite(self.z), np.abs(self.z), -1.0)
        seed, place = np.unravel_index(int(np.argmax(size)), size.shape)
        return float(size[seed, place]), PARAMETERS[int(place)], int(seed)


def run(work: tuple[Variant, int]) -> Outcome:
    """Draw a robot, move it, and identify its target: variant, seed."""
    variant, seed = work
    errors = variant.errors(seed)
    moved = motion(variant.robot, RATE, errors)
    last = _estimates(variant, seed, errors, moved)[-1]
    best = attainable(variant.robot, moved, errors, variant.sizes)
    truth = target(variant.robot)
    norms = nees(last, truth), last.residual**2
    return Outcome(np.array(last.status), last.parameters - truth, last.std, *best, *map(np.asarray, norms))


def estimates(variant: Variant, seed: int) -> list[Estimate]:
    """Return all estimates of a run."""
    errors = variant.errors(seed)
    return _estimates(variant, seed, errors, motion(variant.robot, RATE, errors))


def _estimates(variant: Variant, seed: int, errors: ModelErrors, truth: Truth) -> list[Estimate]:
    truth = truth[: int(np.searchsorted(truth.time, DURATION + 1e-9))]
    config = build(EstimatorConfig, settings(variant.believed))
    identifier = Identifier(make_estimator(config, kernel(variant.robot)), config.window, MAXIMUM_GAP)
    return identifier.push(*observed(truth, Case(variant.robot, 'mid'), seed, errors))


def attainable(robot: str, truth: Truth, errors: ModelErrors, sizes: ErrorSizes) -> Array:
    """Return (2, 10) attainable deviations, and errors without noise; NaN for what a planar motion leaves open."""
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
    gaussian = _followed(layout, own_variables, windows, state)
    distribution = MeanAndCovariance.of(gaussian, own_variables)
    jacobian = physical_jacobian(own.target.parameters)
    deviation = np.sqrt(np.sum((jacobian @ distribution.factor[BODY]) ** 2, axis=1))
    error = jacobian @ (distribution.mean - state)[BODY]
    plane = detector.plane(own.target)
    if plane is not None:
        beside = np.any(np.abs(plane.basis @ plane.basis.T - np.eye(10)) > _ROUNDING, axis=1)
        deviation[beside] = error[beside] = np.nan
    return np.stack((deviation, error))


def _windows(robot: str, truth: Truth, errors: ModelErrors, length: float) -> tuple[list[Window], Array, PlaneDetector]:
    """Return the windows of a motion measured without noise, the first position of its base, and its plane."""
    cutter, own = Windows(length), kernel(robot)
    samples = exact_samples(truth, NOISE, errors)
    samples = samples[: round(samples.time[-1] / length) * round(length / (samples.time[1] - samples.time[0]))]
    parts: list[Samples] = [*cutter.push(samples), *cutter.flush()]
    detector = PlaneDetector(own.model)
    for part in parts:
        detector.update(part)
    gathering = KnotAveraging(NOISE, length)
    taken = gathering.take(parts)
    both = [*(each.ready for each in taken), taken[-1].still_open]
    return [window for window in both if window is not None], gathering.origin, detector


def _followed(layout: Layout, own: Variables, windows: list[Window], state: Array) -> SquareRootInformation:
    """Return the posterior after windows, all linearised at a state."""
    steps = LinearisationCache(layout, own).all_whitened(stacked(windows), layout.point(state))
    gaussian = SquareRootInformation.prior(own)
    for place, (_, step) in enumerate(steps):
        gaussian = update(gaussian if place == 0 else advance(gaussian, steps[place - 1][1], own, UNDISTURBED), step)
    return gaussian


def _true(unknown: Unknown, errors: ModelErrors) -> Array:
    """Return the true (k,) values of an unknown."""
    if isinstance(unknown, KnownBodies):
        return errors.bodies[list(unknown.bodies)].ravel()
    if isinstance(unknown, JointPlacements):
        tilts = (errors.tilts[:, None] @ unknown.across)[:, 0]
        return np.column_stack((errors.zeros, errors.origins, tilts)).ravel()
    if isinstance(unknown, OdometryMount):
        return errors.mount
    return np.zeros(len(unknown.factor))
