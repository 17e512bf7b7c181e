"""First solutions: right where nothing is known yet, and near enough for the search to find the maximum."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from linear_problems import TRUE, UNKNOWNS, linear_blocks, noise_information, noisy_blocks
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.errors_in_variables import Blocks, Sums, first_solutions
from mbaid_ros.core.geometry import Array

NOWHERE = np.zeros(UNKNOWNS)
NOTHING = 1e-12 * np.eye(UNKNOWNS)


def test_exact_coefficients_leave_the_weighted_least_squares() -> None:
    """And what is known besides enters as it does there."""
    blocks, known = linear_blocks(12, 1), np.diag([1.0, 4.0, 2.0, 3.0])
    right_side = known @ np.array([1.0, 2.0, 3.0, 4.0])
    information, right = Sums(blocks, TRUE).weighted(compensate=False)
    expected = np.linalg.solve(information + known, right + right_side)
    assert Sums(blocks, TRUE).total_least_squares(known, right_side) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize('seed', range(5))
def test_noise_in_the_coefficients_does_not_bias_it(seed: int) -> None:
    blocks = noisy_blocks(4000, seed, 0.3, 0.3)
    found = Sums(blocks, TRUE).total_least_squares(NOTHING, NOWHERE)
    linear = eiv.maximum_likelihood(blocks, TRUE)
    own = linear.information - noise_information(blocks, TRUE)
    # Chi-square of four unknowns: 18 is exceeded once in a thousand draws. Plain least squares is 500 and more off.
    assert float((found - TRUE) @ own @ (found - TRUE)) < 18.0


def test_no_scale_of_the_unknowns_matters() -> None:
    blocks, size = noisy_blocks(30, 2), np.array([1e-6, 1.0, 1e3, 1e7])
    scaled = blocks.restrict(np.eye(blocks.offset.shape[1]), np.diag(size))
    found = Sums(blocks, NOWHERE).total_least_squares(NOTHING, NOWHERE)
    same = Sums(scaled, NOWHERE).total_least_squares(NOTHING * size * size[:, None], NOWHERE)
    assert size * same == pytest.approx(found, rel=1e-6)


def test_equations_without_noise_are_refused() -> None:
    plain = linear_blocks(3, 1)
    flat = Blocks(plain.rows, plain.offset, 0.0 * plain.noise, plain.noise_rows)
    with pytest.raises(FloatingPointError):
        Sums(flat, NOWHERE).total_least_squares(NOTHING, NOWHERE)
    assert not first_solutions(flat, NOTHING, NOWHERE)


def test_a_run_does_not_stay_with_a_body_that_its_data_refuse(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that is known too little for twenty seconds: 301 kg +- 20 and an inertia below -1e7 kg m^2, once."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / 'scripts'))
    from benchmarks.data import Case, kernel, momentum_of, motion, observed  # noqa: PLC0415 - found by the line above
    from benchmarks.methods import Identification  # noqa: PLC0415

    case, truth = Case('table1', 'high'), motion('table1')
    truth = truth[: int(np.searchsorted(truth.time, 20.0))]
    task = Identification(kernel(case.robot), case.noise, momentum_of(case.robot, truth))
    residuals: Array = np.array([one.residual for one in task.estimates('difference', *observed(truth, case, 15))])
    assert residuals[-10:].max() < 1.5
