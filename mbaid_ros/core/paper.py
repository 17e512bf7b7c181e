"""The paper's estimator: recursive least squares on its main or difference form, one step a sample.

The two forms (eqs. 22 and 25, corrected) are linear equations of (1/m, r_c, I_c): rows and right sides. P' and L' are
the momentum of the target link: the total minus that of the known bodies. The paper sets the total linear momentum to
zero. The moment equations are then the same about every fixed point, and here they are written with L_k about the base
link's origin and r the target's hinge relative to it, so that the base's own position drops out:
L' - p x P' = L_0 - L_k - r x P'.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, bracket, cross, rotate_back, skew
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.verdict import status_of
from mbaid_ros.core.robot.body import LENGTH, standard
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import BodyStates, MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.errors import ParameterError
from mbaid_ros.tasks import Method

UNKNOWNS = 10  # parameters of the body
# The covariance of unexcited parameters grows without limit: it is held at this many times the initial one. Excited
# parameters, however weakly, stay below: differenced rows at 100 Hz bring Izz of the paper's case to 2e4 times.
_LARGEST_GROWTH = 1e6
# An unknown counts as determined once the start, zero, makes less than this of its size. Its variance would not decide:
# differenced rows are small, and in the paper's case the variance of Izz stays above the initial one. A smaller share
# holds back by a second values that are right to 1 % already.
_REMAINING = 0.02
_SETTLED_WINDOWS = 10  # whose estimates have to agree for a run to be converged
THRUST = 'the methods of the paper ignore the commanded thrust: use method trajectory or difference'


def linear_rows(states: BodyStates) -> tuple[Array, Array]:
    """Return P' (1/m) - [w]x R r_c = v (eq. 21 with B' = [w]x R): (N, 3, 10), (N, 3)."""
    linear = -states.known_momentum[:, :3]  # P' = P_0 - P_k with P_0 = 0 (eq. 24)
    rows = np.zeros((len(linear), 3, UNKNOWNS))
    rows[..., 0] = linear
    rows[..., 1:4] = -skew(states.twist[:, 3:]) @ states.rotation
    return rows, states.hinge_velocity


def angular_rows(states: BodyStates) -> tuple[Array, Array]:
    """Return -[P']x R r_c + R bracket(R^T w) vec(I_c) = L_0 + (-L_k - r x P'), without L_0: (N, 3, 10), (N, 3).

    Eq. 20, with the rotation of the inertia.
    """
    known = states.known_momentum
    linear = -known[:, :3]
    rows = np.zeros((len(known), 3, UNKNOWNS))
    rows[..., 1:4] = -skew(linear) @ states.rotation
    rows[..., 4:] = states.rotation @ bracket(rotate_back(states.rotation, states.twist[:, 3:]))
    return rows, -known[:, 3:] - cross(states.position, linear)


def main_form(states: BodyStates, total_angular_momentum: Array) -> tuple[Array, Array]:
    """Return the main form (eq. 22, corrected) with L_0 (3,) kg m^2/s, odometry axes: (N, 6, 10), (N, 6)."""
    linear, velocity = linear_rows(states)
    angular, moment = angular_rows(states)
    right_side = np.concatenate((velocity, moment + total_angular_momentum), axis=1)
    return np.concatenate((linear, angular), axis=1), right_side


def difference_form(
    linear: tuple[Array, Array], angular: tuple[Array, Array], reference: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the difference form (eq. 25, corrected): the angular rows minus those of each reference sample.

    The unknown L_0 cancels; the linear rows are not differenced: (N, 6, 10), (N, 6).
    """
    return (
        np.concatenate((linear[0], angular[0] - reference[0]), axis=1),
        np.concatenate((linear[1], angular[1] - reference[1]), axis=1),
    )


class RecursiveLeastSquares:
    """Least squares with exponential forgetting, a block of equations a step.

    Parameters
    ----------
    unknowns : number u
    forgetting_factor : weight of each step relative to the next one, 0 < factor <= 1 (paper: 0.99)
    initial_covariance : variance of each unknown at the start, about the estimate 0 (paper: 1e6)

    Attributes
    ----------
    estimate, covariance : (u,), (u, u)
    remaining : (u, u) remaining influence of the start: without noise the error is this times the first one
    """

    def __init__(self, unknowns: int, forgetting_factor: float, initial_covariance: float) -> None:
        self._forgetting_factor = forgetting_factor
        self._largest_variance = _LARGEST_GROWTH * initial_covariance
        self.estimate: Array = np.zeros(unknowns)
        self.covariance: Array = np.eye(unknowns) * initial_covariance
        self.remaining: Array = np.eye(unknowns)

    def step(self, rows: Array, right_side: Array) -> Array:
        """Add a block of equations rows (k, u) @ x = right_side (k,); return the new estimate."""
        # K = P A^T (lambda 1 + A P A^T)^-1,  P <- (1 - K A) P / lambda, in Joseph's form: symmetric, positive
        spread = self.covariance @ rows.T
        innovation = rows @ spread
        innovation[np.diag_indices_from(innovation)] += self._forgetting_factor
        gain = np.linalg.solve(innovation, spread.T).T
        self.estimate = self.estimate + gain @ (right_side - rows @ self.estimate)
        contraction = np.eye(len(self.estimate)) - gain @ rows
        self.remaining = contraction @ self.remaining
        covariance = (contraction @ self.covariance @ contraction.T) / self._forgetting_factor + gain @ gain.T
        largest = np.diag(covariance)
        if np.any(largest > self._largest_variance):
            scale = np.sqrt(np.minimum(1.0, self._largest_variance / np.maximum(largest, 1e-300)))
            covariance = covariance * scale * scale[:, None]
        self.covariance = covariance
        return self.estimate


@dataclass(frozen=True)
class PaperSettings:
    """Settings of the paper's methods."""

    form: Literal['main', 'difference']  # 'main' (eq. 22) or 'difference' (eq. 25)
    forgetting_factor: float  # of the recursive least squares
    initial_covariance: float  # of the recursive least squares
    # sample that the difference form compares with: the one before, or the first
    reference: Literal['previous', 'first']
    lag: int  # samples between the two; 0 takes `reference`
    # (L_x, L_y, L_z) kg m^2/s about the odometry origin, needed by the main form
    total_angular_momentum: tuple[float, ...]
    settled: float  # largest relative change over the last ten windows that counts as converged


class PaperEstimator(Method):
    """Identifies one link by the paper's recursion (total linear momentum zero).

    Raises ParameterError: The main form without the total angular momentum.
    """

    needs_rates = True

    def __init__(self, kernel: MomentumKernel, settings: PaperSettings) -> None:
        if settings.form == 'main' and len(settings.total_angular_momentum) != 3:
            raise ParameterError(
                'method paper_main needs paper.total_angular_momentum: three numbers, kg m^2/s (odometry origin)'
            )
        self.method = f'paper_{settings.form}'
        self._kernel = kernel
        self._settings = settings
        self._rls = RecursiveLeastSquares(UNKNOWNS, settings.forgetting_factor, settings.initial_covariance)
        self._plane = PlaneDetector(kernel.model)
        self._references: deque[tuple[Array, Array]] = deque()
        self._settled: deque[Array] = deque(maxlen=_SETTLED_WINDOWS)
        self._samples = 0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Add closed windows and return one estimate a sample; `origin` is the stamp at time 0, ns."""
        return [estimate for window in windows for estimate in self._window(window, origin)]

    def _window(self, window: Samples, origin: int) -> list[Estimate]:
        self._plane.update(window)
        states = self._kernel.states(window)
        rows, right_side = self._equations(states)
        selection = self._plane.equation_selection()
        rows, right_side = selection @ rows, right_side @ selection.T
        solutions, determined = np.empty((len(window), UNKNOWNS)), np.empty((len(window), UNKNOWNS), bool)
        skipped = len(window) - len(rows)  # samples without a reference yet
        solutions[:skipped], determined[:skipped] = np.nan, False
        for index in range(len(rows)):
            solutions[skipped + index] = self._rls.step(rows[index], right_side[index])
            determined[skipped + index] = self._determined()
        return self._estimates(window, states, solutions, determined, origin)

    def _determined(self) -> Flags:
        solution = self._rls.estimate
        # At first the inertia is still near its start, zero: a body of that mass and the given size is no smaller.
        inertia = np.maximum(_inertia_scale(solution), LENGTH**2 / max(abs(solution[0]), 1e-12))
        size = np.concatenate((np.abs(solution[:1]), np.full(3, LENGTH), inertia))
        return np.asarray(np.abs(self._rls.remaining) @ size < _REMAINING * size)

    def _equations(self, states: BodyStates) -> tuple[Array, Array]:
        if self._settings.form == 'main':
            return main_form(states, np.array(self._settings.total_angular_momentum))
        linear, angular = linear_rows(states), angular_rows(states)
        references = self._reference_rows(angular)
        late = len(linear[0]) - len(references[0])
        newest = (linear[0][late:], linear[1][late:]), (angular[0][late:], angular[1][late:])
        return difference_form(*newest, references)

    def _reference_rows(self, angular: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return the reference of the angular rows of each of the last samples; the first samples have none."""
        past = list(self._references)
        rows = np.concatenate([*(row for row, _ in past), angular[0]])
        right_side = np.concatenate([*(value for _, value in past), angular[1]])
        if not self._settings.lag and self._settings.reference == 'first':
            if not past:
                self._references.append((rows[:1], right_side[:1]))
            count = len(angular[0]) - (0 if past else 1)
            first = self._references[0]
            return np.repeat(first[0], count, axis=0), np.repeat(first[1], count, axis=0)
        lag = self._settings.lag or 1
        self._references = deque([(rows[-lag:], right_side[-lag:])])
        return rows[:-lag], right_side[:-lag]

    def _estimates(
        self, window: Samples, states: BodyStates, solutions: Array, determined: Array, origin: int
    ) -> list[Estimate]:
        """Return one estimate a sample from (N, 10) solutions of (1/m, r_c, I_c)."""
        with np.errstate(divide='ignore'):
            parameters = np.concatenate((1.0 / solutions[:, :1], solutions[:, 1:]), axis=1)
        parameters[~np.isfinite(parameters[:, 0]), 0] = np.nan
        momentum = np.zeros((len(window), 6))
        if self._settings.form == 'main':
            momentum[:, 3:] = self._settings.total_angular_momentum
        else:
            body = np.nan_to_num(standard(parameters))
            momentum[:, 3:] = (states.known_momentum + (states.regressor @ body[..., None])[..., 0])[:, 3:]
        steady = self._is_steady(parameters[-1], determined[-1])
        warnings = (THRUST,) if np.any(window.impulse) else ()
        first = self._samples
        self._samples += len(window)
        return [
            Estimate(
                method=self.method,
                status=status_of(
                    determined=bool(np.any(determined[index])), precise=steady and index == len(window) - 1
                ),
                time=float(window.time[index]),
                stamp=origin + round(window.time[index] * 1e9),
                parameters=np.where(determined[index], parameters[index], np.nan),
                identifiable=determined[index],
                momentum=momentum[index],
                samples=first + index + 1,
                warnings=warnings,
            )
            for index in range(len(window))
        ]

    def _is_steady(self, parameters: Array, determined: Array) -> bool:
        """Return whether nothing determined has moved for ten windows."""
        self._settled.append(np.where(determined, parameters, np.nan))
        if not np.any(determined) or len(self._settled) < _SETTLED_WINDOWS:
            return False
        scale = np.concatenate((np.abs(parameters[:1]), np.full(3, LENGTH), _inertia_scale(parameters)))
        change = np.abs(np.array(self._settled) - parameters)[:, determined] / scale[determined]
        return bool(np.all(change < self._settings.settled))


def _inertia_scale(parameters: Array) -> Array:
    """Return the unit of changes of the six elements of inertia: the largest known moment."""
    return np.full(6, np.max(np.abs(parameters[[4, 7, 9]]), initial=1e-12))
