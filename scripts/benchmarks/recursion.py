"""The paper's recursion on noise-free data, step by step, without the estimator's rules of what to publish."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.data import LEVELS, exact_samples, kernel, momentum_of, motion
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.paper import forms
from mbaid_ros.core.paper.estimator import RecursiveLeastSquares
from mbaid_ros.core.robot.kernel import BodyStates
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import physical, regressor

FORMS = ('main', 'difference, previous sample', 'difference, first sample')
FORGETTING_FACTOR = 0.99
INITIAL_COVARIANCE = 1e6


@dataclass(frozen=True)
class History:
    """What the recursion says after each sample.

    Attributes
    ----------
    time : (N,) s
    error : (N, 10) relative errors of (m, r_c, I_c); NaN where the true value is zero
    """

    time: Array
    error: Array

    def settled(self, tolerance: float) -> Array:
        """Return the time (s) from which each parameter stays within a relative tolerance, NaN if it does not."""
        outside = ~(np.abs(self.error) <= tolerance)
        last = len(outside) - np.argmax(outside[::-1], axis=0)  # index after the last one outside
        ever = np.any(outside, axis=0)
        index = np.where(ever, last, 0)
        return np.where(index < len(self.time), self.time[np.minimum(index, len(self.time) - 1)], np.nan)


def equations(form: str, states: BodyStates, total_angular_momentum: Array) -> tuple[Array, Array]:
    """Return rows (N, 6, 10) and right sides (N, 6) of one of the forms."""
    if form == 'main':
        return forms.main_form(states, total_angular_momentum)
    linear, angular = forms.linear_rows(states), forms.angular_rows(states)
    first = form.endswith('first sample')
    reference = tuple(np.broadcast_to(part[:1], part[1:].shape) if first else part[:-1] for part in angular)
    return forms.difference_form(
        (linear[0][1:], linear[1][1:]), (angular[0][1:], angular[1][1:]), (reference[0], reference[1])
    )


def recursion(robot: str, form: str, rate: float, *, scaled: bool = False) -> History:
    """Run the paper's recursive least squares over a robot's noise-free run.

    Parameters
    ----------
    robot : of config/
    form : one of FORMS
    rate : samples a second
    scaled : divide each unknown by its true size first
    """
    truth = motion(robot, rate)
    states = kernel(robot).states(exact_samples(truth, LEVELS['mid']))
    detector = PlaneDetector(kernel(robot).model)
    detector.update(exact_samples(truth, LEVELS['mid']))
    rows, right_side = equations(form, states, momentum_of(robot, truth)[3:])
    rows, right_side = detector.rows() @ rows, right_side @ detector.rows().T
    target = physical(kernel(robot).target.parameters)
    goal = np.concatenate(([1.0 / target[0]], target[1:]))
    size = np.where(goal != 0.0, np.abs(goal), 1.0) if scaled else np.ones(len(goal))
    solver = RecursiveLeastSquares(len(goal), FORGETTING_FACTOR, INITIAL_COVARIANCE)
    found = np.array([size * solver.step(row * size, value) for row, value in zip(rows, right_side, strict=True)])
    with np.errstate(divide='ignore', invalid='ignore'):
        found[:, 0] = 1.0 / found[:, 0]
        error = np.where(target != 0.0, found / target - 1.0, np.nan)
    return History(truth.time[-len(rows) :], error)


def all_bodies_rank(robot: str) -> tuple[int, int]:
    """Return rank and number of columns of the momentum of all bodies as a linear form of all their parameters."""
    samples = exact_samples(motion(robot, 10.0), LEVELS['mid'])
    states = kernel(robot).states(samples)
    configuration = states.configuration
    matrix = regressor(configuration.rotation, configuration.position, states.body_twist)  # (N, n + 1, 6, 10)
    columns = np.moveaxis(matrix, 1, 2).reshape(6 * len(samples), -1)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return int(np.linalg.matrix_rank(columns, tol=1e-9 * np.sqrt(len(columns)))), columns.shape[1]
