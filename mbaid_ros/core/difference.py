"""Method `difference`: momentum equations of windows, differenced, solved over a sliding window."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from mbaid_ros.core.contracts import NominalModel, Unknown
from mbaid_ros.core.difference_solver import Blocks, SlidingWindow
from mbaid_ros.core.geometry import Array, chi_square_limit, cross, inverse, inverse_root, skew, square_root
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.verdict import Reason, Reporting, Solution
from mbaid_ros.core.robot.model import Plane, PlaneDetector, express
from mbaid_ros.core.robot.momentum import (
    MomentumKernel,
    link_columns,
    momentum_change,
    sensitivity,
    summed_over_bodies,
    unknown_scale,
)
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.state import UnknownsPrior
from mbaid_ros.tasks import Method

UNKNOWNS = 16  # ten parameters of the body, and six of the momentum
BODY, LINEAR, ANGULAR = slice(0, 10), slice(10, 13), slice(13, 16)
Counts = npt.NDArray[np.intp]
# Places in a window, from 0 to 1: the mean over both is exact for cubic polynomials.
_GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
# Samples of a window whose mean stands for that of all, where only the width of intervals depends on it.
_ENOUGH_SAMPLES = 50
# Chance of an undisturbed window to be taken for a jump, and of all together to seem too far from their predictions:
# once in years of windows.
_FALSE_ALARM = 1e-9
_ENOUGH = 50  # redundant equations from which the tests can be trusted
# Normalised innovation squared, of an equation: noise a fifth larger than specified is no contradiction.
_LARGEST_MEAN = 1.5
_NEAR = 1.0  # s, within which it is the same jump
# Part of the information about a jump that is added to its remainder: without a remainder, none shows.
_FLOOR = 1e-9
# Standard deviation of the start in typical sizes: far too much to be a prior, and enough to keep every step finite.
NO_PRIOR = 100.0
# Share of the variance due to consider parameters: from here on the model decides, not the sensors.
_WORTH_TELLING = 0.5
_CAUSE = 'thrust, contact, a slip of the grasp, or a force that lasts'
# The noise's own information fluctuates: anything below twice it is not signal.
_NOISE_MARGIN = 2.0


@dataclass(frozen=True)
class Subspace:
    """A selection of the equations and a basis of the unknowns."""

    rows: Array  # (k, 6) Pi, the equations used are Pi f
    basis: Array  # (u, v) orthonormal B, the unknowns are x = B x'
    plane: Plane | None  # in the target link's frame; None in space

    @property
    def planar(self) -> bool:
        """Whether equations and unknowns out of the plane are left out."""
        return self.plane is not None

    def restricted(self, blocks: Blocks) -> Blocks:
        """Return the blocks' equations in the unknowns of this subspace."""
        return blocks.restrict(self.rows, self.basis) if self.planar else blocks

    def lift(self, covariance: Array, open_variance: Array) -> Array:
        """Return the (u, u) covariance of x from that of x' (v, v), with (u,) variances where x' has none."""
        if not self.planar:
            return covariance
        outside = np.eye(len(self.basis)) - self.basis @ self.basis.T
        return np.asarray(self.basis @ covariance @ self.basis.T + (outside * open_variance) @ outside.T)


def subspace(detector: PlaneDetector, kernel: MomentumKernel) -> Subspace:
    """Return the subspace that the motion has excited.

    In a plane: mass, first moment in the plane, moment of inertia about its normal, linear momentum in the plane and
    angular momentum about its normal.
    """
    rows, plane = detector.equation_selection(), detector.plane(kernel.target)
    if plane is None:
        return Subspace(rows, np.eye(UNKNOWNS), None)
    return Subspace(rows, np.asarray(block_diag(plane.basis, rows.T)), plane)


def window_rows(kernel: MomentumKernel, windows: list[Samples], noise: SensorNoise, origin: Array) -> Blocks:
    """Return one block of six equations f = A x + y for each window (method.md, eq. 3).

    Parameters
    ----------
    windows : K of them, none empty
    noise : of the joints; the samples hold that of the base
    origin : (3,) m, about which L_0 is taken, odometry frame

    Returns
    -------
    Blocks of K windows, 6 equations, 10 unknowns a link and 6, twice 2 n + 12 + c error sources
    """
    samples, counts = concatenated(windows)
    known, target = _mean_rows(kernel, samples, counts)
    position = mean_of_each(samples.base_position - origin, counts)
    equations = np.concatenate((target, -_transport(position)), axis=2)
    # The noise of a window's mean is the mean of its samples' over their number. Two samples at Gauss's points stand
    # for all of them: the mid one alone omits how much the equations change in a window (23 % of the variance of a fast
    # arm's estimate after a minute). Their mean weighs the mean of the errors, their difference the tilt.
    points = [_starts(counts) + np.rint(part * (counts - 1)).astype(np.intp) for part in _GAUSS]
    first, second = zip(*map(np.split, _derivatives(kernel, samples[np.concatenate(points)]), (2, 2)), strict=True)
    mean = _error_factors(samples, counts, noise, kernel.storage.noises)
    tilt = np.sqrt(_tilts(samples, counts))[..., None] * mean
    noise_known, noise_rows = (
        np.concatenate((_by_unit_errors(0.5 * (a + b), mean), _by_unit_errors(0.5 * (a - b), tilt)), axis=2)
        for a, b in zip(first, second, strict=True)
    )
    return Blocks(equations, known, noise_known[..., 0], noise_rows)


def concatenated(windows: Sequence[Samples]) -> tuple[Samples, Counts]:
    """Return the samples of K windows, none empty, and the number in each, (K,)."""
    return Samples.concatenate(windows), np.array([len(window) for window in windows])


def mean_of_each(values: Array, counts: Counts) -> Array:
    """Return the means (K, ...) of values (N, ...) over each window."""
    return np.add.reduceat(values, _starts(counts), axis=0) / counts.reshape(-1, *[1] * (values.ndim - 1))


def _starts(counts: Counts) -> Counts:
    """Return the index of each window's first sample."""
    return np.cumsum(counts) - counts


def _thinned(samples: Samples, counts: Counts) -> tuple[Samples, Counts]:
    """Return at most `_ENOUGH` samples of each window, evenly spread, and the number in each, (K,)."""
    kept = np.minimum(counts, _ENOUGH_SAMPLES)
    if np.array_equal(kept, counts):
        return samples, counts
    each = zip(_starts(counts), counts, kept, strict=True)
    places = [first + ((np.arange(few) + 0.5) * count / few).astype(np.intp) for first, count, few in each]
    return samples[np.concatenate(places)], kept


def _mean_rows(kernel: MomentumKernel, samples: Samples, counts: Counts) -> tuple[Array, Array]:
    """Return the means of the known momentum (K, 6) and of the regressors of the k unknown links (K, 6, 10 k)."""
    states = kernel.states(samples)
    # Known thrust is momentum that neither body nor P_0, L_0 explain; about the base's origin like the rest.
    thrust = samples.impulse.copy()
    thrust[:, 3:] -= cross(samples.base_position, thrust[:, :3])
    known = states.known_momentum - thrust
    regressors = np.concatenate([states.regressor_of(link) for link in kernel.unknown], axis=2)
    if samples.gravity_columns.shape[1]:  # without the momentum that an orbit adds, the rest is constant
        known -= summed_over_bodies(states.gravity_columns, kernel.known)
        regressors -= np.concatenate([link_columns(states.gravity_columns, link) for link in kernel.unknown], axis=2)
    return mean_of_each(known, counts), mean_of_each(regressors, counts)


def _transport(position: Array) -> Array:
    """Return T with (P, L about p) = T (P_0, L_0): [[1, 0], [-[p]x, 1]], (K, 6, 6)."""
    matrix = np.zeros((len(position), 6, 6))
    matrix[:] = np.eye(6)
    matrix[:, 3:, :3] = -skew(position)
    return matrix


def _derivatives(kernel: MomentumKernel, point: Samples) -> tuple[Array, Array]:
    """Return the derivatives of K samples' equations by each measurement: of y (K, 6, z, 1), of A (K, 6, z, u).

    Order of z: joint positions and velocities, base position and orientation, base velocities, stored momentum.
    """
    states = kernel.states(point)
    derivative = sensitivity(kernel, states)
    joints, stored = kernel.model.joints, kernel.storage.count
    count, sources, bodies = len(point), 2 * joints + 12 + stored, derivative.target.shape[-1]
    known, target = np.zeros((count, 6, sources, 1)), np.zeros((count, 6, sources, bodies + 6))
    place, rest = slice(2 * joints, 2 * joints + 3), slice(2 * joints + 3, 2 * joints + 12)
    for there, here in ((slice(2 * joints), slice(2 * joints)), (rest, slice(2 * joints, None))):
        known[:, :, there, 0] = derivative.known[:, :, here]
        target[:, :, there, :bodies] = derivative.target[:, :, here]
    # Only L_0 - p x P_0 depends on the base's position: d/dp_k of -(L_0 - p x P_0) is e_k x P_0.
    target[:, 3:, place, bodies : bodies + 3] = np.swapaxes(skew(np.eye(3)), 0, 1)
    known[:, 3:, place, 0] = -skew(point.impulse[:, :3])
    if point.gravity_columns.shape[1]:  # likewise L - p x P of the momentum that an orbit adds
        known[:, 3:, place, 0] -= skew(summed_over_bodies(states.gravity_columns, kernel.known)[:, :3])
        linear = np.concatenate([link_columns(states.gravity_columns, link)[:, :3] for link in kernel.unknown], axis=-1)
        target[:, 3:, place, :bodies] -= np.moveaxis(skew(np.moveaxis(linear, 1, -1)), 1, -1)
    known[:, :, rest.stop :, 0] = kernel.storage.jacobian(states.configuration.rotation)
    return known, target


def _by_unit_errors(derivative: Array, factor: Array) -> Array:
    """Return derivatives (K, 6, z, u) by unit errors, from those by measurements with factors (K, z, z)."""
    return np.asarray(np.swapaxes(factor, 1, 2)[:, None] @ derivative)


def _tilts(samples: Samples, counts: Counts) -> Array:
    """Return the variance of the tilt of each window's errors over that of their mean, (K, z)."""
    joints = samples.joint_position.shape[1]
    tilt = np.ones((len(counts), 2 * joints + 12 + samples.stored.shape[1]))
    velocities = [*range(joints, 2 * joints), *range(2 * joints + 6, 2 * joints + 12)]
    tilt[:, velocities] = mean_of_each(samples.rate_tilt, counts)
    return tilt


def _error_factors(samples: Samples, counts: Counts, noise: SensorNoise, stored: Array) -> Array:
    """Return the (K, z, z) factors F with F F^T the covariance of the means of a window's measurements."""
    joints = samples.joint_position.shape[1]
    sources = 2 * joints + 12 + len(stored)
    factor = np.zeros((len(counts), sources, sources))
    diagonal, readings = np.arange(joints), np.arange(2 * joints + 12, sources)
    own = samples.noise[_starts(counts)].T if samples.noise.shape[1] else None
    position, velocity = (noise.joint_position, noise.joint_velocity) if own is None else own[:2, :, None]
    factor[:, diagonal, diagonal] = position
    # Rates derived from positions carry these positions' noise.
    gain = mean_of_each(samples.joint_rate_gain, counts)
    derived = position * np.sqrt(gain)
    factor[:, joints + diagonal, joints + diagonal] = np.where(np.isnan(gain), velocity, derived)
    pose, twist = slice(2 * joints, 2 * joints + 6), slice(2 * joints + 6, 2 * joints + 12)
    factor[:, readings, readings] = stored
    # White noise: the covariance of a mean is the mean covariance over the number of samples.
    factor[:, pose, pose] = np.linalg.cholesky(mean_of_each(samples.pose_covariance, counts))
    factor[:, twist, twist] = np.linalg.cholesky(mean_of_each(samples.twist_covariance, counts))
    return factor / np.sqrt(counts)[:, None, None]


class ConsiderParameters:
    """Unknowns that the equations depend on and that are not solved for (Schmidt 1966): they widen the covariance.

    They add E e to the equations of every window: e independent numbers of variance one, E the columns of the unknowns
    times a factor of their prior covariance, which a calibration may have made dependent.

    Parameters
    ----------
    kernel : of the robot at the prior's mean
    unknowns : those that the equations do not depend on are left out
    prior : joint prior of all unknowns' numbers; None where they are independent

    Attributes
    ----------
    count : number e of independent numbers
    """

    def __init__(self, kernel: MomentumKernel, unknowns: Sequence[Unknown], prior: UnknownsPrior | None = None) -> None:
        self._kernel = kernel
        self._start: Array | None = None  # of the base, about which momentum changes are counted
        self._before: dict[Unknown, tuple[float, Array, Array]] = {}  # time, rates and total at the last sample
        self._unknowns = [unknown for unknown in unknowns if unknown.in_equations]
        factor = block_diag(np.zeros((0, 0)), *(unknown.factor for unknown in self._unknowns))
        self._joint_factor: Array | None = None
        if prior is not None:
            used = np.repeat([unknown.in_equations for unknown in unknowns], [unknown.count for unknown in unknowns])
            joint = prior.factor[used]
            wide = len(joint) < joint.shape[1]
            self._joint_factor = np.asarray(np.linalg.qr(joint.T, mode='r')).T if wide else joint
            factor = factor @ self._joint_factor
        self.count = factor.shape[1]

    def columns(self, windows: Sequence[Samples], body: Array) -> Array:
        """Return the means of E over each of K windows, (K, 6, e), with a target body (10,) (m, h, I_o).

        The windows follow those of the call before.
        """
        if not self.count:
            return np.zeros((len(windows), 6, 0))
        samples, counts = concatenated(windows)
        target = self._kernel.target
        change = np.zeros_like(self._kernel.known)
        change[target.body] = express(body, target.rotation, target.position)
        kernel = self._kernel.with_body_changes(change)
        few, kept = _thinned(samples, counts)
        states = kernel.states(few)
        # What a force or torque adds up to takes every sample.
        thinned = few is not samples and any(unknown.changes_momentum for unknown in self._unknowns)
        whole = np.sum((kernel.states(samples) if thinned else states).known, axis=1)
        means = []
        for unknown in self._unknowns:
            if unknown.changes_momentum:
                means.append(mean_of_each(self._momentum_changes(unknown, samples, whole), counts) @ unknown.factor)
            else:
                means.append(mean_of_each(unknown.equation_columns(kernel, states), kept) @ unknown.factor)
        columns = np.concatenate(means, axis=2)
        return columns if self._joint_factor is None else columns @ self._joint_factor

    def _momentum_changes(self, unknown: Unknown, samples: Samples, robot: Array) -> Array:
        """Return the equations' dependence on a force since the first sample, (N, 6, k).

        `robot` holds the (N, 10) standard parameters of the whole robot about the base.
        """
        if self._start is None:
            self._start = samples.base_position[0].copy()
        place = samples.base_position - self._start
        robot = express(robot, np.broadcast_to(np.eye(3), (len(place), 3, 3)), place)
        rates = unknown.momentum_rates(robot, self._start, samples.time, samples.base_rotation)
        time, rate, total = self._before.get(unknown, (samples.time[0], rates[0], np.zeros_like(rates[0])))
        steps = np.diff(samples.time, prepend=time)[:, None, None]
        totals = total + np.cumsum(0.5 * steps * (rates + np.concatenate((rate[None], rates[:-1]))), axis=0)
        self._before[unknown] = (float(samples.time[-1]), rates[-1], totals[-1])
        columns = -totals
        columns[:, 3:] -= skew(place) @ columns[:, :3]
        return columns


@dataclass(frozen=True)
class Jump:
    """A change of the momentum."""

    time: float  # s since the first sample, start of the first window after it
    value: Array  # (c,) in the unknowns that the momentum is
    cost_reduction: float  # of the sum of squared residuals, over the scale of the noise
    first_seen: float  # s, its time when it was first found


class Conservation:
    """Tests a run for a momentum, at some places among the unknowns, that is not constant, window by window.

    Attributes
    ----------
    jump : the first, None where there is none
    mean : normalised innovation squared of an equation, mean over all tested windows
    """

    def __init__(self, momentum: slice) -> None:
        self._momentum = momentum
        self._size = momentum.stop - momentum.start
        self._limit = chi_square_limit(_FALSE_ALARM, self._size)
        self._starts: list[float] = []
        self._innovations = 0.0
        self._equations = 0
        self.jump: Jump | None = None
        self.mean = 1.0

    @property
    def excessive(self) -> bool:
        """Whether the windows differ more from their predictions than the noise explains."""
        enough = self._equations >= _ENOUGH and self.mean > _LARGEST_MEAN
        return enough and self._innovations > chi_square_limit(_FALSE_ALARM, self._equations)

    def update(self, window: SlidingWindow, start: float, covariance: Array, surplus: float) -> None:
        """Test a run after another window.

        Parameters
        ----------
        start : s since the first sample, of the newest window
        covariance : (u, u) of the unknowns by noise alone
        surplus : expected part of the consider parameters in the sum of squared residuals
        """
        self._starts = [*self._starts, start][-len(window.windows) :]
        redundancy = window.linear.equations - len(window.x)
        if redundancy < _ENOUGH or not window.certain or len(self._starts) < 2:
            return
        falls, changes = momentum_jumps(window, self._momentum, covariance)
        self._innovations += falls[-1]
        self._equations += self._size
        self.mean = self._innovations / self._equations
        # Later windows determine its size better; only near its first place, since a solution astray finds others.
        starts, jump = np.array(self._starts[1:]), self.jump
        best = int(
            np.argmax(falls if jump is None else np.where(np.abs(starts - jump.first_seen) <= _NEAR, falls, 0.0))
        )
        # Noise that is larger than declared is no jump: the scale of the residuals of a jump.
        scale = max((window.linear.cost - falls[best]) / (redundancy + surplus), 1.0)
        fall, time = float(falls[best]) / scale, float(starts[best])
        if fall > (self._limit if jump is None else jump.cost_reduction):
            self.jump = Jump(time, changes[best], fall, time if jump is None else jump.first_seen)


def momentum_jumps(window: SlidingWindow, momentum: slice, covariance: Array) -> tuple[Array, Array]:
    """Return by how much a jump before each of the K windows but the first would lower the cost, and its size.

    Parameters
    ----------
    momentum : c places of the momentum among the unknowns
    covariance : (u, u) of the unknowns by noise alone

    Returns
    -------
    (K - 1,), (K - 1, c)
    """
    windows, count = window.windows, len(window.x)
    white, step = windows.white, window.x - windows.x
    bordered = np.concatenate((white.rows, white.residual[..., None], windows.columns), axis=2)[1:]
    sums = np.cumsum((np.swapaxes(bordered[..., momentum], 1, 2) @ bordered)[::-1], axis=0)[::-1]
    cross, own = sums[..., :count], sums[..., momentum]
    weighed = cross @ covariance
    slope = sums[..., count] + cross @ step - weighed @ window.linear.gradient
    left = own - weighed @ np.swapaxes(cross, 1, 2)
    considered = sums[..., count + 1 :] - weighed @ window.cross_information.cross
    left = left + considered @ np.swapaxes(considered, 1, 2)
    diagonal = np.arange(left.shape[1])
    left[:, diagonal, diagonal] += _FLOOR * own[:, diagonal, diagonal]
    changes = -np.linalg.solve(left, slope[..., None])[..., 0]  # (9)
    return -np.sum(slope * changes, axis=1), changes


def noise_covariance(information: Array) -> Array:
    """Return the (u, u) inverse of the information that was solved; empty directions are left out."""
    root = inverse_root(information)
    root = square_root(information).T if root is None else root
    return np.asarray(root.T @ root)


@dataclass(frozen=True)
class DifferenceSettings:
    """Settings of the weighted difference form."""

    noise: SensorNoise  # of the joint sensors (the samples hold that of the base)
    kept_windows: int  # length of the sliding window; older windows are marginalised
    linear_momentum_std: float  # N s, of the total linear momentum about zero; 0 is no prior


class DifferenceRun:
    """The likelihood of the unknowns x = (m, h, I_o, P_0, L_0), as far as the motion excites them, and its tests.

    Parameters
    ----------
    space : which equations hold, in which unknowns
    origin : (3,) m, about which L_0 is taken
    scale : (16,) typical sizes of x
    considered : the consider parameters
    restarted : whether earlier windows had to be given up
    """

    def __init__(
        self,
        space: Subspace,
        origin: Array,
        scale: Array,
        settings: DifferenceSettings,
        considered: ConsiderParameters,
        *,
        restarted: bool,
    ) -> None:
        self.space = space
        self.origin = origin
        self._considered = considered
        self._restarted = restarted
        deviation = NO_PRIOR * scale
        self._open_variance = deviation**2  # (16,) of x without information
        if settings.linear_momentum_std > 0.0:
            deviation[LINEAR] = settings.linear_momentum_std
        basis = space.basis
        prior = np.asarray((basis.T * (1.0 / deviation**2)) @ basis)
        self._momentum = slice(len(prior) - len(space.rows), len(prior))
        self._window = SlidingWindow(prior, settings.kept_windows, np.abs(basis.T) @ scale, considered.count)
        self._conservation = Conservation(self._momentum)

    @property
    def body(self) -> Array:
        """The target body (10,) at which consider parameters are linearised: zeros while it is uncertain."""
        body = (self.space.basis @ self._window.x)[:10]
        return body if body[0] > 0.0 and self._window.certain else np.zeros(10)

    def add(self, block: Blocks, columns: Array, start: float) -> Solution:
        """Add a window that starts at a time (s): equations and columns (1, r, e) in the unknowns of the subspace."""
        window = self._window
        linear = window.add(block, columns)
        covariance = noise_covariance(window.linear.information)
        surplus = window.cross_information.surplus(covariance) if self._considered.count else 0.0
        self._conservation.update(window, start, covariance, surplus)
        redundancy = linear.equations - len(window.x)
        information, cross_information = linear.information, window.cross_information.cross
        covariances, share = [], 0.0
        for margin in (1.0, _NOISE_MARGIN):
            plain = inverse(information, information - margin * window.noise_information)
            by_considered = (plain @ cross_information) @ (plain @ cross_information).T
            total = plain + by_considered  # method.md, eq. 8
            if margin == 1.0:
                body = slice(0, self._momentum.start)
                share = float(np.mean(np.diag(by_considered)[body] / np.diag(total)[body]))
            covariances.append(self.space.lift(total, self._open_variance))
        return Solution(
            x=self.space.basis @ window.x,
            covariance=covariances[0],
            covariance_for_identifiability=covariances[1],
            # Uncertain parameters leave residuals that the noise does not explain.
            cost=linear.cost * max(redundancy, 1) / (max(redundancy, 1) + surplus),
            redundancy=redundancy,
            origin=self.origin,
            plane=self.space.plane,
            reasons=tuple(self._reasons(share)),
        )

    @property
    def events(self) -> tuple[Event, ...]:
        """The first jump of the momentum, about the odometry's origin; none where there was none."""
        jump = self._conservation.jump
        if jump is None:
            return ()
        change = self.space.rows.T @ jump.value
        return (Event(jump.time, 'step', change[:3], change[3:] + cross(self.origin, change[:3]), _CAUSE),)

    def _reasons(self, share: float) -> Iterator[Reason]:
        """Yield the reasons to distrust the run: a jump of the momentum, excess innovations, a dominant model error.

        `share` is that of the consider parameters in the variance of the body.
        """
        if self._restarted:
            yield Reason('the motion is not planar: the planar solution was dropped')
        test = self._conservation
        for event in self.events:
            yield Reason(f'the momentum is not constant: {event}', 'contradiction')
        if test.excessive:
            yield Reason(
                f'windows are {test.mean:.1f} times as far from their predictions as the noise parameters explain '
                '(mean normalised innovation squared)',
                'contradiction',
            )
        if share > _WORTH_TELLING:
            yield Reason(f'{100.0 * share:.0f} % of the variance is due to the uncertainty of the robot model')


class DifferenceEstimator(Method):
    """Identifies one link and the total momentum, which may have any constant value.

    Parameters
    ----------
    unknowns : consider parameters, which widen the covariance
    prior : joint prior of the unknowns, whose mean the robot is taken at; None for independent ones about zero
    """

    method = 'difference'
    needs_rates = True

    def __init__(
        self,
        kernel: MomentumKernel,
        settings: DifferenceSettings,
        reporting: Reporting,
        unknowns: Sequence[Unknown],
        prior: UnknownsPrior | None,
    ) -> None:
        self._nominal = NominalModel.nominal(kernel) if prior is None else prior.nominal_model(kernel, unknowns)
        self._kernel = self._nominal.kernel
        self._settings = settings
        self._reporting = reporting
        self._considered = ConsiderParameters(self._kernel, unknowns, prior)
        self._plane = PlaneDetector(kernel.model, max((each.tilt for each in unknowns), default=0.0))
        self._run: DifferenceRun | None = None
        self._samples = 0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Add closed windows and return one estimate a window; `origin` is the stamp at time 0, ns."""
        windows = [self._nominal.corrected(window) for window in windows]
        start = windows[0].base_position[0].copy() if self._run is None else self._run.origin
        rows = window_rows(self._kernel, windows, self._settings.noise, start)
        estimates = []
        for k, window in enumerate(windows):
            self._plane.update(window)
            run = self._run = self._current_run(start)
            columns = self._considered.columns([window], run.body)
            block = run.space.restricted(rows[k : k + 1])
            solution = run.add(block, run.space.rows @ columns, float(window.time[0]))
            self._samples += len(window)
            time = float(window.time[-1])
            stamp = origin + round(time * 1e9)
            now = Estimate(self.method, 'waiting', time, stamp, samples=self._samples, events=run.events)
            impulse = momentum_change(window, self._kernel.body_parameters(solution.x[BODY]))
            estimates.append(self._reporting.estimate(solution, now).after_thrust(impulse))
        return estimates

    def _current_run(self, start: Array) -> DifferenceRun:
        """Return the run; a new one where the motion has turned out spatial: its past had half the equations."""
        if self._run is not None and self._run.space.planar == self._plane.planar:
            return self._run
        space, scale = subspace(self._plane, self._kernel), unknown_scale(self._kernel)
        restarted = self._run is not None
        return DifferenceRun(space, start, scale, self._settings, self._considered, restarted=restarted)
