"""The paper's equations: each correction is needed, as printed they identify something else.

Everything here is written out in the paper's own terms (positions and moments about the inertial origin), next to the
form in the core, and solved by least squares on an exact spatial motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, bracket, cross, rotate_back, skew
from mbaid_ros.core.paper import forms
from mbaid_ros.core.robot.kernel import BodyStates
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.simulation.simulation import Truth, total_momentum
from observed import MID, drifting, kernel, observe


@dataclass(frozen=True)
class Terms:
    """The terms of eqs. 20 to 25 for N samples, as corrected; a test replaces one by what is printed.

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


def run_of(truth: Truth) -> Run:
    servicer = kernel('servicer7')
    samples = observe(truth, MID)
    states = servicer.states(samples)
    known = states.known_momentum.copy()
    known[:, 3:] += cross(samples.base_position, known[:, :3])  # about the inertial origin
    total = total_momentum(servicer.model, truth[:1])[0, 3:]
    place = samples.base_position + states.position
    return Run(states, place, -known[:, :3], total - known[:, 3:], physical(servicer.target.parameters))


@pytest.fixture(scope='module', name='run')
def exact_run(spatial: Truth) -> Run:
    return run_of(spatial)


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


# Eq. 22 with one correction undone at a time.
PRINTED_MAIN: dict[str, Callable[[Run, Terms], Terms]] = {
    'the inertia is not turned': lambda run, terms: replace(terms, inertia=bracket(run.spin)),
    'B is [w]x without the orientation': lambda run, terms: replace(terms, motion=skew(run.spin)),
    'R_n stands in the first row': lambda run, terms: replace(terms, linear=rotate_back(run.rotation, run.linear)),
    'R_n is missing from the second row': lambda run, terms: replace(terms, lever=transposed(run.linear)),
    'the tilde of P is not transposed': lambda _, terms: replace(terms, lever=-terms.lever),
    'p P is no cross product': lambda run, terms: replace(terms, moment=run.angular - run.place * run.linear),
    'p x P is missing': lambda run, terms: replace(terms, moment=run.angular),
    'L is missing': lambda run, terms: replace(terms, moment=-cross(run.place, run.linear)),
}

# Eq. 25 likewise. As L = L_0 - L_k, its change is the one of the known bodies with the opposite sign.
PRINTED_DIFFERENCE: dict[str, Callable[[Run, Terms], Terms]] = {
    'R_n is missing beside the difference of P': lambda run, terms: replace(
        terms, lever=transposed(change(run.linear))
    ),
    'R_n stands outside the difference of P': lambda run, terms: replace(
        terms, lever=transposed(change(run.linear)) @ run.rotation
    ),
    'the inertia is not turned': lambda run, terms: replace(terms, inertia=change(bracket(run.spin))),
    'R_n stands outside the difference of the rates': lambda run, terms: replace(
        terms, inertia=run.rotation @ bracket(change(rotate_back(run.rotation, run.spin)))
    ),
    'the velocity is differenced': lambda _, terms: replace(terms, velocity=change(terms.velocity)),
    'the change of L has the sign of the known bodies': lambda run, terms: replace(
        terms, moment=-change(run.angular + cross(run.place, run.linear))
    ),
    'the change of L is zero': lambda run, terms: replace(terms, moment=-change(cross(run.place, run.linear))),
}


@pytest.mark.parametrize('printed', PRINTED_MAIN)
def test_the_main_form_as_printed_finds_another_body(run: Run, printed: str) -> None:
    assert run.error(PRINTED_MAIN[printed](run, run.main())) > 0.1


@pytest.mark.parametrize('printed', PRINTED_DIFFERENCE)
def test_the_difference_form_as_printed_finds_another_body(run: Run, printed: str) -> None:
    assert run.error(PRINTED_DIFFERENCE[printed](run, run.difference())) > 0.1


def test_accelerations_have_no_place_in_a_momentum(run: Run, spatial: Truth) -> None:
    """Eq. 14 is printed with [J_p X''] for the hinge's velocity J_p X'."""
    states, target = run.states, kernel('servicer7').target.parameters
    momentum = states.regressor @ target
    acceleration = np.gradient(states.hinge_velocity, spatial.time, axis=0)
    printed = states.regressor.copy()
    printed[:, 3:, 1:4] += (skew(states.hinge_velocity) - skew(acceleration)) @ states.rotation
    error = np.abs(printed @ target - momentum)[:, 3:].max() / np.abs(momentum[:, 3:]).max()
    assert error > 0.1


def test_the_momentum_is_zero_only_in_a_frame_that_moves_with_the_centre_of_mass(spatial: Truth, drift: Array) -> None:
    """Eq. 23: matched velocities alone do not make it so; 10 mm/s of drift are enough for another body."""
    drifted = run_of(drifting(spatial, 0.01 * drift))
    assert drifted.error(drifted.main()) > 0.1
    assert drifted.error(drifted.difference()) > 0.1
