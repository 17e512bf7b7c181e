"""What a solution owes to the point at which equations were linearised."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.results.reporting import Curvature

MASS, IXX = 0, 4


def curvature(shift: float, place: int) -> Curvature:
    shifts = np.zeros((3, 10))
    shifts[1, place] = shift
    return Curvature(shifts, np.diag(np.arange(1.0, 11.0) ** 2))


def test_a_parameter_that_follows_the_point_is_not_straight() -> None:
    bent = curvature(-3.0, IXX)  # of a standard deviation of 5
    assert bent.anywhere
    assert np.flatnonzero(~bent.straight(np.eye(10))).tolist() == [IXX]


def test_a_small_part_of_a_standard_deviation_is_as_good_as_none() -> None:
    assert not curvature(1.0, IXX).anywhere


def test_numbers_that_mix_parameters_are_judged_by_their_own_deviation() -> None:
    mixed = np.eye(10)
    mixed[IXX, MASS] = 100.0  # I_xx about a distant point: its deviation is the mass's
    assert curvature(-3.0, IXX).straight(mixed).all()


def test_what_is_known_exactly_and_does_not_move_is_straight() -> None:
    assert Curvature(np.zeros((3, 10)), np.zeros((10, 10))).straight(np.eye(10)).all()
