"""Runs of robots that are not their URDF, and the attainable accuracy.

The attainable accuracy is the filter's posterior, linearised at the truth. All windows of the exact motion pass through
the information filter at the true robot, momentum and body. Priors and noise then leave the covariance of the best
estimate to first order. The mean for data without noise has the error that the robot itself makes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.data import (
    MAXIMUM_GAP,
    NOISE,
    Case,
    drawn,
    exact_samples,
    kernel,
    motion_of,
    observed,
    target,
    true_model,
)
from benchmarks.frame import Runs, declared
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.contracts import UNDISTURBED, Unknown, stacked
from mbaid_ros.core.filter.gaussian import SquareRootInformation, update
from mbaid_ros.core.filter.linearise import LinearisationCache
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.filter.time_update import advance
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.joints.model import JointPlacements
from mbaid_ros.core.links import KnownBodies, declared_errors, relative_factor
from mbaid_ros.core.odometry.model import OdometryMount
from mbaid_ros.core.pipeline import Identifier
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.core.robot.body import body_sizes, physical_jacobian
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import BODY, MOMENTUM, layout_of, variables
from mbaid_ros.core.windows import KnotAveraging, Window, Windows
from mbaid_ros.parameters import build
from mbaid_ros.replay.campaigns.statistics import coverage, mean, nees, nees_band
from mbaid_ros.session.catalogue import declaration
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.simulation.simulation import Truth, total_momentum
from mbaid_ros.simulation.true_robot import ErrorStds, ModelErrors

# The defaults of the estimator's parameters.
DEFAULT = ErrorStds(0.01, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3)
# By block, the fields of ErrorSizes and the parameters that declare them.
BLOCKS = {
    'links': {'links_relative_std': 'known_links.relative_std'},
    'zeros': {'zero_std': 'known_joints.zero_std'},
    'origins': {'origin_std': 'known_joints.origin_std'},
    'axes': {'axis_std': 'known_joints.axis_std'},
    'mount': {
        'mount_position_std': 'odometry_mount.position_std',
        'mount_orientation_std': 'odometry_mount.orientation_std',
    },
}
PLANAR = ('table1',)
# Distributions of a body's errors: that of `relative_factor`, one common factor, or each number by itself.
AS_DECLARED, WHOLE, APART = 'as declared', 'as a whole', 'each number by itself'
# Of a robot whose joints turn about z: m, h_x, h_y, I_zz.
_IN_PLANE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Variant:
    """One row of a table."""

    robot: str  # name of a URDF of config/
    name: str  # errors and priors, in words
    sizes: ErrorStds  # that robots are drawn with
    believed: ErrorStds  # the priors
    spatial: bool = False  # whether a planar robot's errors may lead out of its plane
    links: str = AS_DECLARED  # distribution of their errors

    def errors(self, seed: int) -> ModelErrors:
        """Return the errors of a seed; those of a planar robot keep it in its plane, as the table under it does."""
        errors = drawn(self.robot, self.sizes, seed)
        errors = replace(errors, bodies=self._bodies(errors.bodies))
        if self.robot not in PLANAR or self.spatial:
            return errors
        return replace(
            errors,
            bodies=errors.bodies * _IN_PLANE,
            origins=errors.origins * np.array([1.0, 1.0, 0.0]),
            tilts=np.zeros_like(errors.tilts),
            mount=errors.mount * np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0]),
        )

    def _bodies(self, drawn_ones: Array) -> Array:
        if self.links == AS_DECLARED:
            return drawn_ones
        changed = np.zeros_like(drawn_ones)
        for body, known in enumerate(kernel(self.robot).known):
            if known[0] > 0.0:
                std = self.sizes.links_relative_std
                numbers = np.linalg.solve(relative_factor(known, std), drawn_ones[body])
                changed[body] = std * (numbers[0] * known if self.links == WHOLE else numbers * body_sizes(known))
        return changed


def settings(sizes: ErrorStds) -> dict[str, object]:
    """Return the estimator's parameters that declare such robots, with the sensors' noise."""
    names = {field: name for block in BLOCKS.values() for field, name in block.items()}
    return {**{names[field]: value for field, value in vars(sizes).items()}, **declared(NOISE)}


def monte_carlo(robot: str) -> Iterator[Variant]:
    """Yield the variants of a robot: all blocks, one at a time, and with wrong priors."""
    yield Variant(robot, 'all', DEFAULT, DEFAULT)
    for name, fields in BLOCKS.items():
        block = ErrorStds(**{field: getattr(DEFAULT, field) for field in fields})
        yield Variant(robot, name, block, block)
    for words, factor in (('twice', 2.0), ('half', 0.5)):
        priors = ErrorStds(**{field: factor * value for field, value in vars(DEFAULT).items()})
        yield Variant(robot, f'all, priors {words} as large', DEFAULT, priors)
    for way in (WHOLE, APART):
        yield Variant(robot, f'all, links off {way}', DEFAULT, DEFAULT, links=way)
    if robot in PLANAR:
        yield Variant(robot, 'all, out of the plane too', DEFAULT, DEFAULT, spatial=True)


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
        return coverage(self.error, self.std)

    def over_bound(self, error: Array) -> Array:
        """Return RMSE over the root mean square of the bounds of the same runs, (10,)."""
        there = np.isfinite(error) & np.isfinite(self.bound)
        squares = [mean(np.where(there, values**2, np.nan)) for values in (error, self.bound)]
        return np.asarray(np.sqrt(squares[0] / squares[1]))

    @property
    def nees(self) -> tuple[float, float, float]:
        """Mean squared error in the metric of the covariance, a parameter, and the 95 % band of such means."""
        there = np.isfinite(self.error_norm)
        weight = np.sum(np.isfinite(self.z[there]), axis=1)
        freedom = int(np.sum(weight))
        mean_norm = float(np.sum(weight * self.error_norm[there]) / freedom) if freedom else np.nan
        return mean_norm, *nees_band(freedom)

    @property
    def largest(self) -> tuple[float, str, int]:
        """Largest |error| in standard deviations, its parameter, and its seed."""
        size = np.where(np.isfinite(self.z), np.abs(self.z), -1.0)
        seed, place = np.unravel_index(int(np.argmax(size)), size.shape)
        return float(size[seed, place]), PARAMETERS[int(place)], int(seed)


def run(variant: Variant, seed: int) -> Outcome:
    """Draw a robot, move it, and identify its target."""
    errors = variant.errors(seed)
    moved = motion_of(variant.robot, true_model(variant.robot, errors))
    config = build(EstimatorConfig, settings(variant.believed))
    identifier = Identifier(make_estimator(config, kernel(variant.robot)), config.window, MAXIMUM_GAP)
    last = identifier.push(*observed(moved, Case(variant.robot, 'mid'), seed, errors))[-1]
    best = attainable(variant.robot, moved, errors, variant.sizes)
    truth = target(variant.robot)
    norms = nees(last, truth), last.residual**2
    return Outcome(np.array(last.status), last.parameters - truth, last.std, *best, *map(np.asarray, norms))


def attainable(robot: str, truth: Truth, errors: ModelErrors, sizes: ErrorStds) -> Array:
    """Return (2, 10) attainable deviations, and errors without noise; NaN for what a planar motion leaves open."""
    config = build(EstimatorConfig, settings(sizes))
    own = kernel(robot)
    own = own.with_errors(declared_errors(own, config.known_links))
    uncertain = declaration(config, own)
    windows, origin, detector = _windows(robot, truth, errors, config.window)
    layout = layout_of(own, uncertain, detector)
    own_variables = variables(layout, detector, uncertain)
    state = np.zeros(layout.size)
    momentum = total_momentum(true_model(robot, errors), truth[:1])[0]
    momentum[3:] -= cross(origin, momentum[:3])
    state[MOMENTUM], state[BODY] = momentum, own.target.parameters
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        state[place] = np.linalg.lstsq(unknown.factor, _true(unknown, errors), rcond=None)[0]
    steps = LinearisationCache(layout, own_variables).all_whitened(stacked(windows), layout.point(state))
    gaussian = SquareRootInformation.prior(own_variables)
    for number, (_, step) in enumerate(steps):
        before = gaussian if number == 0 else advance(gaussian, steps[number - 1][1], own_variables, UNDISTURBED)
        gaussian = update(before, step)
    distribution = MeanAndCovariance.from_gaussian(gaussian, own_variables)
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
    taken = gathering.average(parts)
    both = [*(each.ready for each in taken), taken[-1].still_open]
    return [window for window in both if window is not None], gathering.origin, detector


def _true(unknown: Unknown, errors: ModelErrors) -> Array:
    if isinstance(unknown, KnownBodies):
        return errors.bodies[list(unknown.bodies)].ravel()
    if isinstance(unknown, JointPlacements):
        tilts = (errors.tilts[:, None] @ unknown.across)[:, 0]
        return np.column_stack((errors.zeros, errors.origins, tilts)).ravel()
    if isinstance(unknown, OdometryMount):
        return errors.mount
    return np.zeros(len(unknown.factor))
