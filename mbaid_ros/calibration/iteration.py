"""Batch iteration of the trajectory filter over several motions, with a prior of the target link.

Each motion has a pose error and a momentum of its own; target link and all other unknowns carry over with their
correlations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.contracts import UNDISTURBED, in_stacks
from mbaid_ros.core.filter.gauss_newton import is_converged, reverses
from mbaid_ros.core.filter.gaussian import SquareRootInformation, update
from mbaid_ros.core.filter.linearise import LinearisationCache, WhitenedWindow
from mbaid_ros.core.filter.time_update import advance, at_window_start, new_motion
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.gyro import angular_momentum
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.state import BODY, MOMENTUM, Declared, Layout, Point, Variables, layout_of, trust_region, variables
from mbaid_ros.core.windows import KnotAveraging, Window

_ITERATIONS = 24  # at most: Gauss-Newton steps, halved where they turn back
_TOGETHER = 30  # windows linearised in one call: the arrays of a whole long motion would fill the memory
_FEW = 60  # windows of the first iterations, which take most of the way for a part of the work
# Parts of the windows that iterations begin with where no pose locates the base, and their fewest windows.
_PARTS, _FEWEST = (8, 4, 2), 3
_SWINGING = 8  # windows that iterations begin with where joints swing: a few periods at most
_HALVINGS = 20  # of a step that would leave a body no mass


@dataclass(frozen=True, eq=False)
class Motion:
    """One motion, its momentum constant."""

    layout: Layout  # of the state
    windows: list[Window]  # of knots, in order
    origin: Array  # (3,) m, which positions and angular momentum are relative to
    variables: Variables  # of the filter

    @property
    def has_disturbance(self) -> bool:
        """Whether a varying torque or force is declared."""
        return any(each.changes_momentum and np.isfinite(each.time_constants).any() for each in self.layout.unknowns)

    @staticmethod
    def from_windows(
        run: list[Samples],
        kernel: MomentumKernel,
        detector: PlaneDetector,
        declared: Declared,
        sensing: tuple[SensorNoise, float, bool],
    ) -> Motion:
        """Return the motion in some windows of samples.

        Parameters
        ----------
        run : windows
        kernel : of the robot
        detector : decides whether the motion is planar, and in which plane
        declared : unknowns, the errors of known bodies included, and priors, that of the target link included
        sensing : noise of the joint sensors, length of a window in s, whether anything but a gyro measures the
        orientation of the base
        """
        layout = layout_of(kernel, declared, detector)
        noise, length, orientation_measured = sensing
        fastest = kernel.springs.highest_frequency
        averaging = KnotAveraging(noise, length, orientation_measured=orientation_measured, fastest=fastest)
        taken = averaging.average(run)
        windows = [each.ready for each in taken if each.ready is not None]
        if taken[-1].still_open is not None:
            windows.append(taken[-1].still_open)
        return Motion(layout, windows, averaging.origin, variables(layout, detector, declared))


@dataclass(frozen=True, eq=False)
class CalibrationIteration:
    """The outcome of one iteration over all motions."""

    gaussian: SquareRootInformation  # at the end of the last motion
    # mean, factor: (v - h,), (v - h, v - h) of target link and unknowns, which all motions share
    mean: Array
    factor: Array
    momenta: Array  # (R, 6) of each motion, about its origin
    momentum_factors: list[Array]  # R factors of their covariances, (6, w) each


@dataclass(frozen=True, eq=False)
class CalibrationSolution:
    """The last iteration, whether it has converged, and the next point."""

    iteration: CalibrationIteration
    converged: bool  # whether it has converged
    # common, momenta: (s - 12,), (R, 6) the point: target link and unknowns, momentum of each motion
    common: Array
    momenta: Array


def converge(motions: Sequence[Motion], start: Array) -> CalibrationSolution:
    """Iterate over all motions until their solution converges.

    Raises LinAlgError: The windows cannot be linearised at the start.

    Parameters
    ----------
    start : (10,) standard parameters of the target link to begin at
    """
    first = motions[0]
    common = np.concatenate((start, first.layout.known.mean))
    momenta: Array = np.zeros((len(motions), 6))
    for momentum, motion in zip(momenta, motions, strict=True):
        momentum[3:] = angular_momentum(first.layout.kernel, start, motion.windows)
    begun = common, momenta
    for count in _beginnings(motions):
        near = _iterate([replace(first, windows=first.windows[:count])], common, momenta[:1])
        if near.converged:
            common, momenta = near.common, np.concatenate((near.momenta, momenta[1:]))
    result = _iterate(motions, common, momenta)
    if result.converged or common is begun[0]:
        return result
    # Few windows determine little: what fits them under a wide prior may be far off.
    again = _iterate(motions, *begun)
    return again if again.converged else result


def _beginnings(motions: Sequence[Motion]) -> list[int]:
    """Return the numbers of first windows that iterations begin with: most of the way for a part of the work.

    Where no pose locates the base, the error of the start grows with time until nothing is linear: each part is then
    twice the one before.
    """
    windows = motions[0].windows
    if motions[0].layout.kernel.springs.count:
        # A swing of a frequency that is a little off is out of phase soon: as many windows again each time.
        return [_SWINGING * 2**power for power in range(20) if _SWINGING * 2**power < len(windows)]
    if windows and not np.isfinite(windows[0].noise.pose[:3, :3]).all():
        return [count for count in (len(windows) // part for part in _PARTS) if count >= _FEWEST]
    return [_FEW] if sum(len(motion.windows) for motion in motions) > 2 * _FEW else []


def _iterate(motions: Sequence[Motion], common: Array, momenta: Array) -> CalibrationSolution:
    layout = motions[0].layout
    deviation: Array = np.zeros(len(common))
    before: Array = np.zeros(len(common))
    pace = 1.0
    result: CalibrationSolution | None = None
    for _ in range(_ITERATIONS):
        points = [point_of(layout, common, momentum, deviation) for momentum in momenta]
        try:
            iteration = filter_motions(motions, points)
        except np.linalg.LinAlgError:
            if result is None:
                raise
            return result  # the step has led to where nothing can be linearised
        step, deviation = _step(motions[0].variables, iteration, common)
        near = trust_region(*(np.concatenate((np.zeros(6), each)) for each in (common, step)))
        part = min(_part_with_mass(layout, common, step), near)
        sizes = np.array([np.sqrt(np.sum(factor**2, axis=1)) for factor in iteration.momentum_factors])
        converged = is_converged(step, deviation) and is_converged(iteration.momenta - momenta, sizes) and part == 1.0
        pace = 0.5 * pace if reverses(step, before, deviation) else min(1.0, 1.5 * pace)
        part *= pace
        common, momenta, before = common + part * step, momenta + part * (iteration.momenta - momenta), step
        result = CalibrationSolution(iteration, converged, common, momenta)
        if result.converged:
            break
    assert result is not None, 'there was an iteration'
    return result


def _step(shared: Variables, iteration: CalibrationIteration, common: Array) -> tuple[Array, Array]:
    """Return the Gauss-Newton step of an iteration, and the standard deviations."""
    spread = shared.to_state[BODY.start :, shared.moving :]
    # Numbers of a planar target link that the variables leave out do not move.
    step = spread @ (iteration.mean - np.linalg.pinv(spread) @ common)
    return step, np.sqrt(np.sum((spread @ iteration.factor) ** 2, axis=1))


def point_of(layout: Layout, common: Array, momentum: Array, deviation: Array) -> Point:
    """Return the linearisation point of a motion: shared state (s - 12,), momentum (6,), deviations (s - 12,)."""
    state, deviations = np.zeros((2, layout.size))
    state[MOMENTUM], state[BODY.start :], deviations[BODY.start :] = momentum, common, deviation
    return layout.point(state, deviations)


def _part_with_mass(layout: Layout, common: Array, step: Array) -> float:
    """Return the part of a step that leaves each moving body a mass."""
    part = 1.0
    body = layout.kernel.target.body
    for _ in range(_HALVINGS):
        there = common + part * step
        masses = point_of(layout, there, np.zeros(6), np.zeros(len(there))).nominal.kernel.known[:, 0].copy()
        masses[body] += there[0]
        before = layout.kernel.known[:, 0].copy()
        before[body] += common[0]
        if np.all((masses > 0.0) | (before <= 0.0)):
            break
        part *= 0.5
    return part


def filter_motions(
    motions: Sequence[Motion], points: Sequence[Point], score: Array | None = None, given: Array | None = None
) -> CalibrationIteration:
    """Return the outcome of the filter over all motions, each linearised at its point.

    Parameters
    ----------
    score : (v - h,) to add to that of least squares, of the variables that all motions share
    given : (v - h,) values of some of this, known exactly; NaN elsewhere
    """
    gaussian: SquareRootInformation | None = None
    heads = []
    for motion, point in zip(motions, points, strict=True):
        own = motion.variables
        if gaussian is None:
            gaussian = SquareRootInformation.prior(own)
            gaussian = gaussian if score is None else _scored(gaussian, score)
        else:
            gaussian = new_motion(gaussian, own)
        for number, (window, linearised) in enumerate(_linearised(motion, point), start=1):
            white = (
                linearised if given is None else linearised.with_known(np.append(np.full(own.moving, np.nan), given))
            )
            gaussian = update(at_window_start(gaussian, window, white, own, UNDISTURBED), white)
            if number < len(motion.windows):
                gaussian = advance(gaussian, white, own, UNDISTURBED)
        heads.append(_momentum_rows(gaussian, own))
    assert gaussian is not None, 'there is a motion'
    head = motions[0].variables.moving
    mean, factor = gaussian.mean_and_shift()[0][head:], gaussian.factor[head:, head:]
    found = [_momentum(rows, motion.variables, mean, factor) for rows, motion in zip(heads, motions, strict=True)]
    momenta = np.array([momentum for momentum, _ in found])
    return CalibrationIteration(gaussian, mean, factor, momenta, [each for _, each in found])


def _scored(gaussian: SquareRootInformation, score: Array) -> SquareRootInformation:
    """Return the Gaussian with a score (w,) of its last variables beside that of least squares."""
    root, size = gaussian.conditional, len(score)
    right = root.right.copy(order='F')
    right[-size:, 0] += np.linalg.solve(root.triangle[-size:, -size:].T, score)
    return replace(gaussian, conditional=replace(root, right=right))


def _linearised(motion: Motion, point: Point) -> Iterator[tuple[Window, WhitenedWindow]]:
    """Yield windows, as they are and linearised, some at a time."""
    linearised = LinearisationCache(motion.layout, motion.variables)
    for part in in_stacks(motion.windows, _TOGETHER):
        yield from linearised.all_whitened(part, point)


def _momentum_rows(gaussian: SquareRootInformation, own: Variables) -> Array:
    """Return the (p, v + 2) rows of the momentum at a motion's end, given the unknowns that all motions share.

    The motion's own unknowns are eliminated: their columns are zero.
    """
    root, mine = gaussian.root, own.motion_change.any(axis=1)
    if own.time_constants.size:
        mine = mine | np.isfinite(own.time_constants)
    if not mine.any():
        return root[own.pose_size : own.moving]
    first = np.concatenate((np.zeros(own.first_unknown, dtype=bool), mine, np.zeros(2, dtype=bool)))
    count = int(np.sum(mine))
    order = np.concatenate((np.flatnonzero(first), np.flatnonzero(~first)))
    triangle = np.asarray(np.linalg.qr(root[:, order], mode='r'))
    rows = np.zeros((own.moving - own.pose_size, root.shape[1]))
    rows[:, ~first] = triangle[count + own.pose_size : count + own.moving, count:]
    return rows


def _momentum(rows: Array, own: Variables, mean: Array, factor: Array) -> tuple[Array, Array]:
    """Return the momentum of a motion, (6,), and a covariance factor (6, w).

    Parameters
    ----------
    rows, own : (p, v + 2) of the triangle at the motion's end, given all else; variables of the motion
    mean, factor : (v - h,), (v - h, v - h) of all else
    """
    back = np.linalg.inv(rows[:, own.pose_size : own.moving])
    others = rows[:, own.moving : -2]
    value = back @ (rows[:, -2:].sum(axis=1) - others @ mean)
    spread = own.to_state[MOMENTUM, own.pose_size : own.moving]
    return spread @ value, spread @ np.concatenate((back, -back @ others @ factor), axis=1)
