"""From a solution to what is published: which parameters, how sure, the status, and what is withdrawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import some
from made_runs import BODY as MADE_BODY
from made_runs import estimate, planar
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.repair import Conversion, Repair, Setting
from mbaid_ros.core.results.estimate import WITHHELD, Estimate, Status, is_complete, is_usable
from mbaid_ros.core.results.verdict import (
    IntervalConsistency,
    Nonlinearity,
    Reason,
    Reporting,
    Severity,
    Solution,
    with_reasons,
)
from mbaid_ros.core.robot.body import is_physical, physical_jacobian, standard
from mbaid_ros.core.robot.model import Plane
from mbaid_ros.estimate_messages import InertiaPublication

BODY = np.array([120.0, 0.3, -0.2, 0.7, 28.0, -3.0, 1.3, 37.0, -1.0, 30.0])
MOMENTUM = np.array([1.0, -2.0, 3.0, 40.0, 50.0, -60.0])
REPORTING = Reporting(
    scale=np.array([600.0, *(1800.0,) * 3, *(5400.0,) * 6]),
    identifiable_std=0.5,
    converged_std=0.01,
    largest_residual=2.0,
)


def covariance_of(deviations: Array, body: Array = BODY) -> Array:
    """Return the (16, 16) covariance of standard parameters and momentum for deviations of the (10,) physical ones."""
    jacobian = np.linalg.inv(physical_jacobian(standard(body)))
    covariance = np.zeros((16, 16))
    covariance[:10, :10] = jacobian @ np.diag(deviations**2) @ jacobian.T
    covariance[10:, 10:] = np.diag(np.arange(1.0, 7.0))
    return covariance


def solution(relative: float | Array, body: Array = BODY, **changes: object) -> Solution:
    """Return a solution whose physical parameters have relative standard deviations."""
    covariance = covariance_of(np.abs(relative * REPORTING.sizes(body)), body)
    made = Solution(
        x=np.concatenate((standard(body), MOMENTUM)),
        covariance=covariance,
        covariance_for_identifiability=covariance,
        cost=600.0,
        redundancy=600,
        origin=np.zeros(3),
        plane=None,
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def report(made: Solution) -> Estimate:
    return REPORTING.estimate(made, Estimate('difference', 'waiting', time=3.0, stamp=4, samples=500))


def test_what_is_well_determined_is_published_with_its_covariance() -> None:
    made = solution(0.002)
    estimate = report(made)
    assert (estimate.method, estimate.time, estimate.stamp, estimate.samples) == ('difference', 3.0, 4, 500)
    assert estimate.parameters == pytest.approx(BODY)
    assert estimate.std == pytest.approx(0.002 * REPORTING.sizes(BODY))
    assert estimate.identifiable.all()
    assert estimate.momentum == pytest.approx(MOMENTUM)
    assert estimate.momentum_covariance == pytest.approx(made.covariance[10:, 10:])
    assert estimate.consistency_correction == 0.0
    assert estimate.residual == pytest.approx(1.0)
    assert estimate.warnings == ()


@pytest.mark.parametrize(('relative', 'warned'), [(0.09, False), (0.2, True), (0.6, False)])
def test_a_mass_that_is_nearly_known_well_enough_is_the_reason_why_nothing_is_published(
    relative: float, warned: bool
) -> None:
    text = f'the mass is known to {100.0 * relative:.3g} % (standard deviation), and numbers are published from 10 % on'
    assert any(warning.startswith(text) for warning in report(solution(relative)).warnings) is warned


CUBE = np.array([9.0, 0.03, 0.0, 0.1, 0.06, 0.0, 0.0, 0.06, 0.0, 0.06])  # 20 cm


def test_sizes() -> None:
    sizes = REPORTING.sizes(BODY)
    assert sizes[0] == 120.0
    # The centre of mass is relative to the body's own size: the side of a cube.
    assert REPORTING.sizes(CUBE)[1:4] == pytest.approx(0.2)
    flat = np.where(np.arange(10) == 9, CUBE, np.nan)  # of a planar motion: one moment is known
    flat[0] = CUBE[0]
    assert REPORTING.sizes(flat)[1:4] == pytest.approx(0.2)
    assert REPORTING.sizes(np.full(10, np.nan))[1:4] == pytest.approx(1.0)
    # The product of inertia I_xy is relative to sqrt(I_xx I_yy): it may itself be zero.
    assert sizes[5] == pytest.approx(np.sqrt(28.0 * 37.0))
    assert sizes[8] == pytest.approx(np.sqrt(37.0 * 30.0))
    assert (REPORTING.sizes(np.zeros(10)) > 0.0).all()


@pytest.mark.parametrize(
    ('shift', 'alike', 'published'),
    [(0.4, 1.0, True), (0.7, 1.0, True), (0.7, 1.5, True), (0.7, 3.0, False), (1.2, 1.0, False)],
)
def test_a_mass_observed_at_first_order_is_published_with_the_remainder(
    shift: float, alike: float, published: bool
) -> None:
    """Of a mass that depends on where the equations were linearised, but is about as well known anywhere."""
    made = solution(0.01)
    own, along = made.covariance[:10, :10], np.linalg.inv(physical_jacobian(standard(BODY)))[:, 0]
    std = 0.01 * BODY[0]
    bent = Nonlinearity(shift * std * along[None], own, covariances=alike * own[None])
    estimate, before = report(replace(made, nonlinearities=(bent,))), report(made)
    assert bool(estimate.identifiable[0]) is published
    assert estimate.std[1:] == pytest.approx(before.std[1:])
    if published:
        assert estimate.std[0] == pytest.approx(std * np.hypot(1.0, shift if shift > 0.5 else 0.0))
    else:
        assert (
            'observable only at second order: mass; known_links.total_mass helps: weigh the robot' in estimate.warnings
        )
    assert report(replace(made, nonlinearities=(replace(bent, covariances=bent.covariances[:0]),))).identifiable[0] == (
        shift < 0.5
    )


@pytest.mark.parametrize(
    ('relative', 'residual', 'redundancy', 'status'),
    [
        (0.009, 1.0, 600, 'converged'),
        (0.011, 1.0, 600, 'estimating'),
        (0.09, 1.0, 600, 'estimating'),
        (0.11, 1.0, 600, 'not_identifiable'),  # the mass
        (0.009, 2.1, 600, 'inconsistent'),
        (0.08, 2.1, 600, 'inconsistent'),
        (0.6, 2.1, 600, 'not_identifiable'),
        (0.08, 1.9, 600, 'estimating'),
        (0.08, 2.1, 40, 'inconsistent'),
        (0.08, 2.1, 8, 'estimating'),  # too few to judge by
        (0.08, 5.0, 8, 'inconsistent'),
        (0.08, 5.0, 0, 'estimating'),
    ],
)
def test_the_rules_of_the_status(relative: float, residual: float, redundancy: int, status: str) -> None:
    made = solution(relative, cost=residual**2 * redundancy, redundancy=redundancy)
    estimate = report(made)
    assert estimate.status == status
    assert estimate.identifiable.any() == (status != 'not_identifiable')


def test_one_parameter_that_is_not_determined_does_not_hold_up_the_others() -> None:
    relative = np.full(10, 0.005)
    relative[[3, 6]] = 0.8
    estimate = report(solution(relative))
    assert estimate.status == 'converged'
    assert np.flatnonzero(~estimate.identifiable).tolist() == [3, 6]
    assert np.isnan(estimate.parameters[[3, 6]]).all()
    assert np.isnan(estimate.covariance[[3, 6]]).all()
    assert np.isnan(estimate.covariance[:, [3, 6]]).all()
    assert np.isfinite(np.delete(estimate.std, [3, 6])).all()
    assert estimate.warnings == ('not determined by the data: com_z, ixz',)


def test_no_centre_of_mass_while_the_mass_is_hardly_known() -> None:
    """However sure the linearised quotient h / m looks: at a mass far off, its derivative is small."""
    relative = np.full(10, 0.01)
    relative[0] = 0.11
    assert not report(solution(relative)).identifiable.any()
    relative[0] = 0.09
    assert report(solution(relative)).identifiable.all()


def test_the_cautious_covariance_decides_what_is_determined() -> None:
    made = solution(0.15)
    cautious = made.covariance.copy()
    cautious[:10, :10] *= 4.0
    estimate = report(replace(made, covariance_for_identifiability=cautious))
    assert estimate.status == 'not_identifiable'
    assert np.isnan(estimate.parameters).all()


def test_an_impossible_body_is_moved_to_the_nearest_real_one() -> None:
    impossible = BODY.copy()
    impossible[9] = 80.0  # Izz > Ixx + Iyy
    estimate = report(solution(0.05, impossible))
    assert estimate.identifiable.all()
    assert is_physical(standard(estimate.parameters))
    assert estimate.consistency_correction > 3.0
    assert any('standard deviations away from any real body' in warning for warning in estimate.warnings)
    # What no data determine is not projected, nor complained of.
    open_body = report(solution(0.7, impossible))
    assert open_body.consistency_correction == 0.0
    assert len(open_body.warnings) == 1


def test_the_momentum_is_given_about_the_origin_of_the_odometry() -> None:
    origin = np.array([10.0, 20.0, 30.0])  # not parallel to the momentum
    estimate = report(solution(0.01, origin=origin))
    assert estimate.momentum[:3] == pytest.approx(MOMENTUM[:3])
    assert estimate.momentum[3:] == pytest.approx(MOMENTUM[3:] + np.cross(origin, MOMENTUM[:3]))
    # Var(L_x) = Var(L0_x) + z^2 Var(P_y) + y^2 Var(P_z)
    assert estimate.momentum_covariance[3, 3] == pytest.approx(4.0 + 30.0**2 * 2.0 + 20.0**2 * 3.0)
    # Cov(L_x, P_y) = -z Var(P_y), Cov(L_x, P_z) = y Var(P_z)
    assert estimate.momentum_covariance[3, :3] == pytest.approx([0.0, -30.0 * 2.0, 20.0 * 3.0])


def test_in_a_plane_four_parameters_are_published() -> None:
    relative = np.full(10, 1e6)
    relative[[0, 1, 2, 9]] = 0.02
    estimate = report(solution(relative, plane=Plane(np.array([0.0, 0.0, 1.0]), np.eye(3)[:2])))
    assert np.flatnonzero(estimate.identifiable).tolist() == [0, 1, 2, 9]
    assert estimate.parameters[[0, 1, 2, 9]] == pytest.approx(BODY[[0, 1, 2, 9]])
    assert estimate.warnings[0].startswith('planar motion')


NEGATIVE = estimate(parameters=np.concatenate(([-3.0], MADE_BODY[1:])))
NOTHING = Estimate(method='trajectory', status='not_identifiable')
CONTRADICTED = estimate(status='inconsistent')


@pytest.mark.parametrize('useless', [NEGATIVE, NOTHING, CONTRADICTED], ids=['negative', 'nothing', 'contradicted'])
def test_the_loss_of_usable_numbers_is_published_once(useless: Estimate) -> None:
    course = InertiaPublication()
    assert course.next_published(useless) is None
    for usable in (estimate(), planar()):
        assert is_usable(usable)
        assert course.next_published(usable) is usable
        lost = some(course.next_published(useless))
        assert np.all(np.isnan(lost.parameters))
        assert (lost.status, lost.stamp) == (useless.status, useless.stamp)
        assert course.next_published(useless) is None


def test_a_link_is_complete_with_all_ten_numbers_alone() -> None:
    assert is_complete(estimate())
    assert not is_complete(planar())
    assert not is_complete(CONTRADICTED)


def moved(time: float, by: float) -> Estimate:
    """Return an estimate whose mass is so many of its standard deviations further on."""
    made = estimate()
    parameters = made.parameters.copy()
    parameters[0] += by * made.std[0]
    return replace(made, time=time, parameters=parameters)


@pytest.mark.parametrize(('by', 'status'), [(4.5, 'as it was'), (5.5, 'inconsistent'), (-5.5, 'inconsistent')])
def test_an_estimate_that_leaves_its_interval_by_far_is_inconsistent(by: float, status: str) -> None:
    steadiness = IntervalConsistency()
    first = steadiness.checked(moved(20.0, 0.0), early=False)
    assert first.status == estimate().status
    then = steadiness.checked(moved(25.0, by), early=False)
    assert then.status == (status if status == 'inconsistent' else first.status)
    assert any('mass has moved by 5.5' in text for text in then.warnings) == (status == 'inconsistent')


def test_it_is_so_for_some_seconds() -> None:
    steadiness = IntervalConsistency()
    steadiness.checked(moved(20.0, 0.0), early=False)
    found = [steadiness.checked(moved(time, 8.0), early=False).status for time in (25.0, 29.0, 31.0)]
    assert found == ['inconsistent', 'inconsistent', estimate().status]


# -- Status, warnings and causes that the reasons of the stages lead to.

UNKNOWN = replace(estimate(), status='not_identifiable', identifiable=np.zeros(10, dtype=bool), warnings=())
PUBLISHED = replace(estimate(), status='estimating', warnings=())


@pytest.mark.parametrize(
    ('given', 'severity', 'status', 'withheld'),
    [
        (PUBLISHED, 'note', 'estimating', False),
        (PUBLISHED, 'contradiction', 'inconsistent', False),
        (PUBLISHED, 'conflict', 'inconsistent', False),
        (UNKNOWN, 'note', 'not_identifiable', False),
        (UNKNOWN, 'contradiction', 'not_identifiable', True),
        (UNKNOWN, 'conflict', 'inconsistent', False),
    ],
)
def test_a_reason_makes_the_status(given: Estimate, severity: Severity, status: Status, withheld: bool) -> None:
    found = with_reasons(given, [Reason('too much', severity), Reason('by the way')])
    assert found.status == status
    assert found.warnings == ('too much', *([WITHHELD] if withheld else []), 'by the way')
    assert found.contradicted == (severity != 'note')


@pytest.mark.parametrize(
    ('conversion', 'gain', 'first'),
    [
        (Conversion(pose='w first'), 70.0, 'poses'),
        (Conversion(scale=1e-3), 70.0, 'poses'),
        (Conversion(pose='w first'), 40.0, 'twist'),  # explains much less
        (Conversion(delay=0.1), 70.0, 'twist'),
        (None, 70.0, 'twist'),
    ],
)
def test_a_twist_that_seems_wrong_follows_from_wrong_poses(
    conversion: Conversion | None, gain: float, first: str
) -> None:
    poses, twist = Repair('poses', conversion=conversion), Repair('twist', conversion=Conversion(with_twist=False))
    given = replace(PUBLISHED, status='inconsistent', causes=(('poses', gain),), remedies={'poses': poses})
    found = with_reasons(given, [Reason('twist', gain=100.0, repair=twist)])
    assert [cause for cause, _ in found.causes] == (['poses'] if first == 'poses' else ['twist', 'poses'])
    assert ('twist' in found.warnings) == (first == 'twist')


@pytest.mark.parametrize(
    ('without_gyro', 'left_out', 'first'),
    [
        (4e4, {'poses.tracker.use': False}, 'tracker'),
        (0.0, {'poses.tracker.use': False}, 'tracker'),
        (9e4, {'poses.tracker.use': False}, 'turned'),  # as much without either
        (4e4, {'poses.tracker.orientation_std': 0.1}, 'turned'),
        (0.0, {'imu.noise_density': 0.0}, 'turned'),  # of the gyro itself
    ],
)
def test_a_gyro_that_seems_turned_follows_from_turned_poses(
    without_gyro: float, left_out: dict[str, Setting], first: str
) -> None:
    gyro = Repair('gyro', {'imu.noise_density': 0.0})
    remedies = {'tracker': Repair('tracker', left_out), 'gyro': gyro}
    causes = (('tracker', 1e5), ('gyro', without_gyro))
    given = replace(PUBLISHED, status='inconsistent', causes=causes, remedies=remedies)
    found = with_reasons(given, [Reason('turned', 'conflict', gain=2e4, repair=replace(gyro, cause='turned'))])
    assert [cause for cause, _ in found.causes] == [*dict.fromkeys((first, 'tracker')), 'gyro']
    assert found.status == 'inconsistent'


def test_a_contradiction_with_a_size_is_the_cause_of_numbers_that_are_withheld_and_stands_once() -> None:
    certain = Reason('in millimetres', 'contradiction', gain=1e6)
    found = with_reasons(UNKNOWN, [certain, Reason('by the way')])
    assert found.likely_causes == (('in millimetres', 1e6),)
    again = with_reasons(replace(PUBLISHED, causes=(('a link', 20.0), ('in millimetres', 30.0))), [certain])
    assert again.causes == (('in millimetres', 1e6), ('a link', 20.0))


def test_a_note_is_a_cause_only_where_there_are_others_and_a_conflict_always() -> None:
    note, conflict = Reason('turned', gain=7.0), Reason('in degrees', 'conflict', gain=5.0)
    assert with_reasons(PUBLISHED, [note]).causes == ()
    suspicious = replace(PUBLISHED, causes=(('a link', 20.0),))
    assert with_reasons(suspicious, [note]).causes == (('turned', 7.0), ('a link', 20.0))
    assert with_reasons(PUBLISHED, [note, conflict]).causes == (('in degrees', 5.0),)
    assert with_reasons(PUBLISHED, [conflict, note]).causes == (('turned', 7.0), ('in degrees', 5.0))
