"""The paper's equations, corrected.

Everything here is written out in the paper's own terms (positions and moments about the inertial origin), next to the
form in the core, and solved by least squares on an exact spatial motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, bracket, cross, rotate_back, skew
from mbaid_ros.core.paper import forms
from mbaid_ros.core.robot.kernel import BodyStates
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.simulation.simulation import Truth, total_momentum
from observed import MID, kernel, observe


@dataclass(frozen=True)
class Terms:
    """The terms of eqs. 20 to 25 for N samples, as corrected.

    Attributes
    ----------
    linear : (N, 3) P', where it multiplies 1/m
    motion : (N, 3, 3) B'_n
    lever : (N, 3, 3) what multiplies r_c in the moment equations
    inertia : (N, 3, 6) what multiplies I_n
    velocity : (N, 3) right side of the linear equations
    moment : (N, 3) right side of the moment equations
    """

    linear: Array
    motion: Array
    lever: Array
    inertia: Array
    velocity: Array
    moment: Array

    def solution(self) -> Array:
        """Return the least squares solution (m, r_c, I_n)."""
        count = len(self.linear)
        rows = np.zeros((count, 6, 10))
        rows[:, :3, 0], rows[:, :3, 1:4] = self.linear, -self.motion
        rows[:, 3:, 1:4], rows[:, 3:, 4:] = self.lever, self.inertia
        right_side = np.concatenate((self.velocity, self.moment), axis=1)
        # Columns of equal size: the unknowns are 1e-2 (1/m) to 1e1.
        size = np.sqrt(np.sum(rows**2, axis=(0, 1)))
        found = np.linalg.lstsq((rows / size).reshape(-1, 10), right_side.ravel(), rcond=None)[0] / size
        return np.concatenate(([1.0 / found[0]], found[1:]))


@dataclass(frozen=True)
class Run:
    """A motion as the paper's equations need it.

    Attributes
    ----------
    states : of the N samples
    place : (N, 3) p, of the hinge from the inertial origin
    linear, angular : (N, 3) P' and L', of the target link, L' about the inertial origin
    truth : (10,) (m, r_c, I_c)
    """

    states: BodyStates
    place: Array
    linear: Array
    angular: Array
    truth: Array

    @property
    def rotation(self) -> Array:
        """R_n of the target link, (N, 3, 3)."""
        return self.states.rotation

    @property
    def spin(self) -> Array:
        """Angular velocity of the target link, (N, 3), inertial axes."""
        return self.states.twist[:, 3:]

    def main(self) -> Terms:
        """Return eq. 22, corrected."""
        return Terms(
            linear=self.linear,
            motion=skew(self.spin) @ self.rotation,
            lever=transposed(self.linear) @ self.rotation,
            inertia=self.rotation @ bracket(rotate_back(self.rotation, self.spin)),
            velocity=self.states.hinge_velocity,
            moment=self.angular - cross(self.place, self.linear),
        )

    def difference(self) -> Terms:
        """Return eq. 25, corrected: the moment equations less those of the first sample."""
        main = self.main()
        return replace(main, lever=change(main.lever), inertia=change(main.inertia), moment=change(main.moment))

    def error(self, terms: Terms) -> float:
        """Return how far the solution is from the truth, relative to mass, length of r_c and largest moment."""
        scale = np.concatenate(
            (self.truth[:1], np.full(3, np.linalg.norm(self.truth[1:4])), np.full(6, self.truth[4:].max()))
        )
        return float(np.max(np.abs(terms.solution() - self.truth) / scale))


def change(values: Array) -> Array:
    return values - values[0]


@pytest.fixture(scope='module', name='run')
def exact_run(spatial: Truth) -> Run:
    servicer = kernel('servicer7')
    samples = observe(spatial, MID)
    states = servicer.states(samples)
    known = states.known_momentum.copy()
    known[:, 3:] += cross(samples.base_position, known[:, :3])  # about the inertial origin
    total = total_momentum(servicer.model, spatial[:1])[0, 3:]
    place = samples.base_position + states.position
    return Run(states, place, -known[:, :3], total - known[:, 3:], physical(servicer.target.parameters))


def test_the_corrected_forms_find_the_body(run: Run) -> None:
    assert run.error(run.main()) < 1e-8
    assert run.error(run.difference()) < 1e-8


def test_the_core_has_the_corrected_forms(run: Run, spatial: Truth) -> None:
    # There about the base's origin: with P = 0 the same for every point.
    total = total_momentum(kernel('servicer7').model, spatial[:1])[0, 3:]
    rows, right_side = forms.main_form(run.states, total)
    main = run.main()
    assert rows[:, :3, 0] == pytest.approx(main.linear, abs=1e-12)
    assert rows[:, :3, 1:4] == pytest.approx(-main.motion, abs=1e-12)
    assert rows[:, 3:, 1:4] == pytest.approx(main.lever, abs=1e-12)
    assert rows[:, 3:, 4:] == pytest.approx(main.inertia, abs=1e-12)
    assert not rows[:, :3, 4:].any()
    assert not rows[:, 3:, 0].any()
    assert right_side == pytest.approx(np.concatenate((main.velocity, main.moment), axis=1), abs=1e-9)
    linear, angular = forms.linear_rows(run.states), forms.angular_rows(run.states)
    first = tuple(np.repeat(part[:1], len(rows), axis=0) for part in angular)
    rows, right_side = forms.difference_form(linear, angular, (first[0], first[1]))
    difference = run.difference()
    assert rows[:, 3:, 1:4] == pytest.approx(difference.lever, abs=1e-12)
    assert rows[:, 3:, 4:] == pytest.approx(difference.inertia, abs=1e-12)
    assert right_side == pytest.approx(np.concatenate((difference.velocity, difference.moment), axis=1), abs=1e-9)


def transposed(vector: Array) -> Array:
    return np.swapaxes(skew(vector), 1, 2)
