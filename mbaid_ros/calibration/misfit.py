"""Correction of a calibration for noise that rows share with values, where a torque or force from outside varies.

The rows of the bodies hold the predicted motion, whose momentum lacks that of the torque, as the values do. So least
squares prefers other bodies (errors in variables): by a standard deviation in the space station's telemetry. Rows at
the measured motion have the noise of the gyro, and at a filtered momentum part of both.

The least misfit of the windows, with the bodies given and all else eliminated, has no such error: its gradient holds
the smoothed motion (total least squares; Van Huffel and Vandewalle 1991). It is taken by differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.calibration.iteration import CalibrationSolution, Motion, filter_motions, point_of
from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.state import BODY, Point

_STEP = 0.1  # standard deviations, of the differences: the misfit is nearly quadratic within one
_SEEN = 0.05  # part of a direction's prior variance, from which data determine it


def bias_corrected(motions: Sequence[Motion], solution: CalibrationSolution) -> CalibrationSolution:
    """Return a solution at which the misfit, not least squares over noisy rows, has no gradient.

    Parameters
    ----------
    motions : of the solution
    solution : of iterations that have converged; others are returned as they are
    """
    if not solution.converged or not any(motion.has_disturbance for motion in motions):
        return solution
    own = motions[0].variables
    deviation = np.linalg.norm(own.to_state[BODY.start :, own.moving :] @ solution.iteration.factor, axis=1)
    misfit = Misfit(motions, solution.common, deviation, solution.momenta)
    iteration = filter_motions(motions, misfit.points(solution.common))
    score = misfit.score(iteration.gaussian.root[own.moving :, own.moving :])
    return replace(solution, iteration=filter_motions(motions, misfit.points(solution.common), score))


@dataclass(frozen=True)
class Misfit:
    """The misfit of all windows as a function of the bodies, near a point."""

    motions: Sequence[Motion]
    # common, deviation: (s - 12,) the point, target link and unknowns, and standard deviations
    common: Array
    deviation: Array
    momenta: Array  # (R, 6) of each motion

    @property
    def bodies(self) -> Integers:
        """Indices of the numbers that rows depend on by the motion, among the variables that all motions share."""
        layout, own = self.motions[0].layout, self.motions[0].variables
        first = own.first_unknown - own.moving
        places = [
            np.arange(place.start, place.stop) - BODY.stop + first
            for unknown, place in zip(layout.unknowns, layout.places, strict=True)
            if not unknown.of_measurement and not unknown.changes_momentum
        ]
        return np.concatenate((np.arange(first), *places))

    def points(self, common: Array) -> list[Point]:
        """Return the linearisation point of each motion."""
        return [point_of(self.motions[0].layout, common, each, self.deviation) for each in self.momenta]

    def score(self, root: Array) -> Array:
        """Return (w,) the gradient of the misfit less that of the least squares of a root (w, w + 2)."""
        own, bodies = self.motions[0].variables, self.bodies
        prior_mean, triangle, _ = own.prior()
        prior = np.column_stack((triangle, np.zeros(len(triangle)), triangle @ prior_mean))[own.moving :, own.moving :]
        before, after = (_marginal(each, bodies) for each in (prior, root))
        at = self._values(self.common)[bodies]
        deviation = np.linalg.inv(after[:, :-1])
        left, along = np.linalg.eigh((before[:, :-1] @ deviation).T @ (before[:, :-1] @ deviation))
        left, along = left[left < 1.0 - _SEEN], along[:, left < 1.0 - _SEEN]
        slopes = [_gradient(each, at) @ deviation @ along for each in (before, after)]
        steps = _STEP * own.to_state[BODY.start :, own.moving + bodies] @ deviation @ along
        here = self.value_at(self.common)
        lost = np.array([self.value_at(self.common + step) - here for step in steps.T])
        # The curvature is that of least squares: 1, less that of the prior.
        gradient = 0.5 * (_STEP * (1.0 - left) - lost / _STEP) + slopes[0] - slopes[1]
        score = np.zeros(len(root))
        score[bodies] = after[:, :-1].T @ along @ gradient
        return score

    def _values(self, common: Array) -> Array:
        """Return the variables (w,) that all motions share."""
        own = self.motions[0].variables
        state = np.concatenate((np.zeros(BODY.start), common))
        return np.concatenate((own.from_state[own.moving : own.first_unknown] @ state, state[BODY.stop :]))

    def value_at(self, common: Array) -> float:
        """Return the normalised innovations squared of all windows, with the bodies given."""
        given = np.full(self.motions[0].variables.scale.size - self.motions[0].variables.moving, np.nan)
        given[self.bodies] = self._values(common)[self.bodies]
        return filter_motions(self.motions, self.points(common), given=given).gaussian.nis


def _marginal(root: Array, kept: Integers) -> Array:
    """Return the (k, k + 1) square-root information, and z, of some variables of a root (w, w + 2)."""
    others = np.setdiff1d(np.arange(len(root)), kept)
    columns = np.column_stack((root[:, others], root[:, kept], root[:, -2] + root[:, -1]))
    triangle = np.asarray(np.linalg.qr(columns, mode='r'))
    return triangle[len(others) : len(root), len(others) :]


def _gradient(root: Array, at: Array) -> Array:
    """Return the gradient (k,) of a log-likelihood with square-root information (k, k + 1) at some values (k,)."""
    return np.asarray(root[:, :-1].T @ (root[:, -1] - root[:, :-1] @ at))
