"""The filter's variables: their priors, numbers drawn anew, and the mass of a robot that was weighed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import generic
from mbaid_ros.core.filter.gauss_newton import reverses
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import TotalMass, independent_errors, known_bodies
from mbaid_ros.core.odometry.model import odometry_mount
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import inertia_matrix, inverse_inertia_and_momentum
from mbaid_ros.core.state import (
    BODY,
    Declared,
    Layout,
    UnknownsPrior,
    Variables,
    _drawn_anew,
    _walks,
    trust_region,
    variables,
)
from mbaid_ros.core.target import TargetPrior
from mbaid_ros.errors import DataError
from mbaid_ros.session.catalogue import hypotheses
from observed import kernel
from windowed import covariance_of, prepare, window
from windowed import variables as drawn_variables

SERVICER = kernel('servicer7')
DOUBTED = SERVICER.with_errors(independent_errors(SERVICER.known, 0.01))
LAYOUT = Layout.from_unknowns(DOUBTED, (known_bodies(DOUBTED.model, DOUBTED.errors),))
TARGET = TargetPrior(50.0, 20.0, (0.1, -0.2, 0.3), 0.01)


def space(**declared: object) -> Variables:
    """Return the variables of the servicer."""
    return variables(LAYOUT, PlaneDetector(SERVICER.model), Declared(**declared))  # type: ignore[arg-type]


def state_of(made: Variables, mass: float | None = None) -> tuple[Array, Array]:
    """Return mean and covariance of the state by the prior, near a mass if given."""
    mean, _, _ = made.prior(mass)
    return made.state_columns(mean[:, None])[:, 0], covariance_of(SquareRootInformation.prior(made, mass=mass), made)


def test_numbers_drawn_anew_differ_by_twice_their_variance() -> None:
    """Two independent draws of unit variance: their difference, which is added, has a variance of two."""
    which = np.array([True, False, True, False])
    change = _drawn_anew(which)
    assert change.shape == (4, 2)
    assert change @ change.T == pytest.approx(np.diag([2.0, 0.0, 2.0, 0.0]))


def test_only_what_walks_gets_less_certain_with_time() -> None:
    """Numbers of unknowns that stay have no part in it; SI numbers walk as their unknown says."""
    factors = generic(0, 3, 2), generic(1, 4, 4), generic(2, 2, 2)
    walks = np.zeros((3, 0)), generic(3, 4, 2), generic(4, 2, 1)
    pairs = zip(factors, walks, strict=True)
    layout: Any = SimpleNamespace(unknowns=[SimpleNamespace(factor=one, random_walk=walk) for one, walk in pairs])
    found = _walks(layout)
    assert found.shape == (8, 3)
    assert not found[:2].any()
    assert factors[1] @ found[2:6] == pytest.approx(np.column_stack((walks[1], np.zeros(4))))
    assert factors[2] @ found[6:] == pytest.approx(np.column_stack((np.zeros((2, 2)), walks[2])))
    layout.unknowns = layout.unknowns[:1]
    assert not _walks(layout).size


@pytest.mark.parametrize('with_target', [False, True])
def test_a_robot_that_was_weighed_has_that_mass(with_target: bool) -> None:
    """The masses of its links, and of the target if it was on the scales, add up to the reading: one measurement."""
    total = float(SERVICER.known[:, 0].sum()) + 50.0 * with_target + 3.0
    mean, covariance = state_of(space(target=TARGET))
    found, after = state_of(space(target=TARGET, total_mass=TotalMass(total, 0.5, with_target)))
    (unknown,) = LAYOUT.unknowns
    row = np.concatenate((np.zeros(BODY.stop), unknown.factor[::10].sum(axis=0)))
    row[BODY.start] = with_target
    gain = covariance @ row / (row @ covariance @ row + 0.25)
    assert found == pytest.approx(mean + 3.0 * gain, rel=1e-6, abs=1e-6)
    assert np.sqrt(np.diag(after)) == pytest.approx(
        np.sqrt(np.diag(covariance - np.outer(gain, row @ covariance))), rel=1e-5, abs=1e-9
    )


@pytest.mark.parametrize(('mass', 'std'), [(70.0, 7.0), (300.0, 20.0)])
def test_a_prior_near_a_mass_takes_the_centre_of_mass_along(mass: float, std: float) -> None:
    """By a tenth, or as declared: the first moment goes with the mass, and varies around it as before."""
    made = space(target=TARGET)
    mean, covariance = state_of(made, mass)
    centre = np.array([0.1, -0.2, 0.3])
    assert mean[BODY][:4] == pytest.approx([mass, *(mass * centre)])
    own = covariance[BODY, BODY][:4, :4]
    assert own[0, 0] == pytest.approx(std**2)
    assert own[0, 1:] == pytest.approx(centre * std**2)
    assert own[1:, 1:] == pytest.approx(0.25 * np.eye(3) + np.outer(centre, centre) * std**2)
    assert made.prior(mass)[2] == pytest.approx(np.log(std / 20.0))
    assert made.prior()[2] == 0.0


def test_a_mass_is_held_beside_what_a_run_has_left() -> None:
    made = space(target=TARGET)
    left = np.column_stack((np.diag(1.0 + np.abs(generic(0, len(made.scale)))), generic(1, len(made.scale))))
    after = replace(made, previous_information=left)
    mean, root, likelihood = after.prior(70.0)
    row = made.to_state[BODY.start] / 7.0
    information = left[:, :-1].T @ left[:, :-1] + np.outer(row, row)
    assert root.T @ root == pytest.approx(information)
    assert information @ mean == pytest.approx(left[:, :-1].T @ left[:, -1] + row * 10.0)
    assert likelihood == pytest.approx(np.log(7.0 / 20.0))


@pytest.mark.parametrize(
    ('constant', 'adapt', 'forces'),
    [
        ('none', True, ['none', 'inertial', 'inertial on the base', 'body', 'none', 'none']),
        ('none', False, ['none']),
        ('inertial', True, ['inertial', 'inertial on the base']),
        ('body', False, ['body']),
    ],
)
def test_the_hypotheses_of_a_run(constant: str, adapt: bool, forces: list[str]) -> None:
    found = hypotheses(2.0, 0.1, constant, adapt=adapt)
    assert [each.force for each in found] == forces
    assert [each.physical for each in found] == [True, True, True, True, False, False][: len(found)]
    walks = [(each.momentum, each.position) for each in found if not each.physical]
    assert walks == ([(1e-4, 0.0), (0.0, 0.1)] if len(found) > 4 else [])


@pytest.mark.parametrize(
    ('step', 'before', 'back'),
    [
        ([-1.0, 0.1, 0.0], [1.0, 0.1, 0.0], True),
        ([1.0, 0.1, 0.0], [1.0, 0.1, 0.0], False),
        ([-0.4, 1.0, 0.0], [1.0, 0.0, 0.0], False),  # aside rather than back
        ([0.1, 1.0, -9.0], [0.1, 1.0, 9.0], False),  # in units of its deviation the last is none
    ],
)
def test_a_step_turns_back_in_units_of_the_deviations(step: list[float], before: list[float], back: bool) -> None:
    deviation = np.array([1.0, 1.0, 0.0])
    assert reverses(np.array(step), np.array(before), deviation) is back


def test_variables_that_are_known_are_taken_off_a_window() -> None:
    space = drawn_variables(np.random.default_rng(0))
    white = prepare(window(np.random.default_rng(1), 0.1), space)
    x = generic(0, len(space.scale))
    values = np.where(np.arange(len(x)) % 3 == 0, x, np.nan)
    left, rest = white.with_known(values), np.where(np.isnan(values), x, 0.0)
    assert left.value - left.rows @ rest == pytest.approx(white.value - white.rows @ x)
    assert left.drift + left.transition @ rest == pytest.approx(white.drift + white.transition @ x)
    assert left.rows @ np.nan_to_num(values) == pytest.approx(np.zeros(len(white.value)))
    assert left.transition @ np.nan_to_num(values) == pytest.approx(np.zeros(6))


def test_a_robot_in_a_plane_turns_and_moves_within_it_alone() -> None:
    """A constraint takes up the rest: the twist lies in the plane, and its momentum there is the one that is given.

    The second body has no moments about axes in the plane: its locked inertia in space has no inverse.
    """
    flat = [2.0, 0.3, -0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5]  # about the base's origin
    whole = [5.0, 0.1, 0.2, 0.3, 1.0, 0.1, 0.2, 1.5, 0.0, 2.0]
    bodies, plane = np.array([whole, flat])[:, None], np.eye(6)[[0, 1, 5]]
    found, _ = inverse_inertia_and_momentum(bodies, np.zeros((2, 1, 6)), plane)
    twist = found @ generic(0, 6)
    assert twist[:, [2, 3, 4]] == pytest.approx(np.zeros((2, 3)), abs=1e-12)
    within = inertia_matrix(bodies[:, 0]) @ twist[..., None]
    assert (plane @ within)[..., 0] == pytest.approx(np.tile(plane @ generic(0, 6), (2, 1)))


def test_no_step_takes_a_body_further_than_half_its_size() -> None:
    """Where windows are linearised the prediction is linear no further."""
    body = SERVICER.target.parameters
    parameters = np.concatenate((np.ones(6), body))
    step = np.concatenate((np.full(6, 9.0), np.zeros(10)))
    assert trust_region(parameters, step) == 1.0  # the momentum may
    step[6] = 2.0 * body[0]
    assert trust_region(parameters, step) == pytest.approx(0.25)
    step[6] = -0.4 * body[0]
    assert trust_region(parameters, step) == 1.0
    assert trust_region(np.zeros(16), step) == 1.0  # nothing is known of a body without mass


def test_a_prior_of_other_numbers_or_of_another_order_of_unknowns_is_refused() -> None:
    """The unknowns of the readings are the last."""
    doubted, mount = known_bodies(DOUBTED.model, DOUBTED.errors), odometry_mount(0.01, 0.02)
    count = doubted.count + mount.count
    known = UnknownsPrior(generic(1, count), np.eye(count))
    assert Layout.from_unknowns(DOUBTED, (doubted, mount), known).known is known
    assert Layout.from_unknowns(DOUBTED, (mount, doubted)).unknowns == (doubted, mount)
    for unknowns, prior in (
        ((mount, doubted), known),
        ((doubted,), known),
        ((doubted, mount), UnknownsPrior(known.mean[1:], np.eye(count - 1))),
    ):
        with pytest.raises(ValueError, match='numbers does not match'):
            Layout.from_unknowns(DOUBTED, unknowns, prior)


def test_a_continued_run_knows_all_but_pose_error_and_momentum_as_the_run_before() -> None:
    made, rng = space(), np.random.default_rng(5)
    first, count = made.moving, len(made.scale)
    root = np.triu(rng.normal(size=(count - first, count - first)) + 5.0 * np.eye(count - first))
    right, bias = rng.normal(size=count - first), np.ones((2, 3))
    mean, fresh = np.linalg.solve(root, right), made.prior()[1]
    continued = made.for_continued_run(np.column_stack((root, right)), bias)
    found, information, likelihood = continued.prior()
    expected = np.zeros((count, count))
    expected[:first, :first] = fresh[:first, :first].T @ fresh[:first, :first]
    expected[first:, first:] = root.T @ root
    assert information.T @ information == pytest.approx(expected)
    assert found == pytest.approx(np.concatenate((np.zeros(first), mean)))
    assert likelihood == 0.0
    assert continued.previous_bias is bias
    state = made.state_columns(np.concatenate((np.zeros(first), mean))[:, None])[:, 0]
    state[BODY.start + 1 : BODY.stop] = 0.0  # of the body the mass alone says where the next search begins
    assert continued.mean == pytest.approx(state)
    with pytest.raises(DataError, match='the run to continue has'):
        made.for_continued_run(np.column_stack((root, right))[1:], bias)
