"""Conventions of poses, joints, target and twist: the true one fits best, and none where nothing is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.contracts import Convention
from mbaid_ros.core.diagnosis.passes import fitted
from mbaid_ros.core.geometry import Array, cross, exp, rotate, rotate_back, rotation_from_quaternion, vec
from mbaid_ros.core.links import _density, mistaken_tensors
from mbaid_ros.core.odometry.faults import RateMotion, axis_conventions, mistaken_poses, twist_check
from mbaid_ros.core.odometry.stream import AttachedFrame
from mbaid_ros.core.repair import Conversion
from mbaid_ros.core.robot.body import physical, standard
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.robot.urdf import replace_inertial, scale_inertials
from mbaid_ros.core.samples import Samples
from mbaid_ros.errors import ModelError
from mbaid_ros.session.catalogue import conventions
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion, kernel, observe, windows
from simulated import CONFIG
from unchanged import Unchanged
from windowed import half_second_windows


@cache
def measured() -> Samples:
    return observe(configured_motion('servicer7', 25.0, 100.0), MID, 3)


def texts(samples: Samples) -> list[str]:
    """Return the axes that samples may be in, the likeliest first."""
    robot, windows = kernel('servicer7'), half_second_windows(samples)
    declared, *fits = (fitted(windows, each, 2) for each in (Convention('', robot), *axis_conventions(robot)))
    likely = [fit for fit in fits if fit.exists and fit.misfit < fit.convention.misfit_left * declared.misfit]
    return [fit.convention.text for fit in sorted(likely, key=lambda fit: fit.misfit)]


def test_poses_as_declared_are_in_no_other_axes() -> None:
    assert texts(measured()) == []


@pytest.mark.parametrize(
    ('axes', 'named'),
    [
        ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], '(x, -z, y)'),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], '(y, x, z)'),
        ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], '(x, y, -z)'),
        ([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], '(-z, -x, y)'),
    ],
)
def test_positions_in_other_axes_are_named(axes: list[list[int]], named: str) -> None:
    samples = measured()
    changed = replace(samples, base_position=samples.base_position @ np.array(axes, dtype=float).T)
    assert texts(changed)[0].startswith(f'the positions of the odometry are {named} in the axes')


@pytest.mark.parametrize(('unit', 'metres'), [('millimetres', 1e-3), ('centimetres', 0.01), ('inches', 0.0254)])
def test_few_windows_are_tried_in_each_smaller_unit(unit: str, metres: float) -> None:
    true, robot = half_second_windows(measured())[:24], kernel('servicer7')
    unit_of = next(each for each in mistaken_poses(robot) if f' in {unit}:' in each.text)
    read, near = (
        [
            replace(each, knots=replace(each.knots, base_position=far * each.knots.base_position / metres))
            for each in true
        ]
        for far in (1.0, 0.003)
    )
    assert unit_of.possible(read)
    assert not unit_of.possible(near)
    meant = unit_of.windows(read)[-1].knots.base_position
    assert meant == pytest.approx(true[-1].knots.base_position, rel=1e-12)
    assert unit_of.repair is not None
    assert unit_of.repair.conversion == Conversion(scale=metres)


@pytest.mark.parametrize(
    ('turn', 'named'),
    [
        (np.pi * np.array([1.0, 0.0, 0.0]), '180 degrees about (1, 0, 0)'),
        (0.5 * np.pi * np.array([0.0, 0.0, -1.0]), '90 degrees about (0, 0, -1)'),
        (0.5 * np.pi * np.array([0.0, 1.0, 0.0]), '90 degrees about (0, 1, 0)'),
        (2.0 / 3.0 * np.pi * np.ones(3) / np.sqrt(3.0), '120 degrees about (0.58, 0.58, 0.58)'),
    ],
)
def test_a_frame_that_is_turned_is_named(turn: Array, named: str) -> None:
    samples = measured()
    text = texts(replace(samples, base_rotation=samples.base_rotation @ exp(turn)))[0]
    assert named in text
    position, orientation = pasted(text)
    assert not np.any(position)
    assert rotation_from_quaternion(orientation) == pytest.approx(exp(turn), abs=1e-4)


def pasted(text: str) -> list[Array]:
    """Return the parameters marker.position and .orientation that a text has to be copied."""
    return [np.array(numbers.split(', '), dtype=float) for numbers in re.findall(r'\[(.*?)\]', text)]


def test_a_marker_declared_the_wrong_way_round_is_named_with_its_parameters(unchanged: Unchanged) -> None:
    samples, position, turn = measured(), np.array([0.3, -0.2, 0.1]), exp(np.array([0.1, 0.5, -0.2]))
    declared = AttachedFrame(turn.T, -turn.T @ position)
    rotation = samples.base_rotation @ turn @ turn
    place = samples.base_position + samples.base_rotation @ position - rotation @ declared.position
    text = likeliest(
        kernel('servicer7'), replace(samples, base_rotation=rotation, base_position=place), declared, unchanged
    )
    assert text.startswith('marker.position and marker.orientation look inverted')
    found = pasted(text)
    assert found[0] == pytest.approx(position, abs=1e-4)
    assert rotation_from_quaternion(found[1]) == pytest.approx(turn, abs=1e-4)


def likeliest(
    robot: MomentumKernel, samples: Samples, marker: AttachedFrame | None = None, unchanged: Unchanged | None = None
) -> str:
    *factories, _ = conventions(marker)  # all but other axes
    windows, others = half_second_windows(samples), (each for mistaken in factories for each in mistaken(robot))
    fits = [fitted(windows, each, 4) for each in (Convention('', robot), *others) if each.possible(windows)]
    if unchanged is not None:
        unchanged.values(fits=[(fit.convention.text, fit.misfit, fit.exists) for fit in fits])
    return min((fit for fit in fits if fit.exists), key=lambda fit: fit.misfit).convention.text


@pytest.mark.parametrize('joint', [1, *(pytest.param(joint, marks=pytest.mark.long) for joint in (0, 2, 3, 4, 5, 6))])
def test_a_joint_with_the_wrong_sign_fits_best(joint: int) -> None:
    samples = measured()
    signs = np.where(np.arange(7) == joint, -1.0, 1.0)
    assert likeliest(kernel('servicer7'), replace(samples, joint_position=samples.joint_position * signs)).startswith(
        f'the sign of joint{joint + 1} is wrong'
    )


def test_joints_that_are_stamped_far_off_fit_best(unchanged: Unchanged) -> None:
    samples = measured()
    off = replace(samples, joint_position=samples.joint_position[np.maximum(np.arange(len(samples)) - 20, 0)])
    assert likeliest(kernel('servicer7'), off, unchanged=unchanged).startswith(
        'the joints are stamped some 200 ms late'
    )


@pytest.mark.parametrize('declared', ['link6', 'base_link'])
def test_the_link_that_holds_the_body_fits_best(declared: str) -> None:
    text = (CONFIG / 'servicer7.urdf').read_text()
    link = re.search(r'<link name="link7">.*?</inertial>', text, re.DOTALL)
    assert link is not None
    empty = re.sub('mass value="162"', 'mass value="9"', re.sub(r'(i..)="[^"]*"', r'\1="0"', link[0]))
    empty = re.sub('ixx="0"(.*?)iyy="0"(.*?)izz="0"', r'ixx="1"\1iyy="1"\2izz="1"', empty)
    robot = MomentumKernel(load_model(text.replace(link[0], empty)), declared)
    assert likeliest(robot, measured()).startswith(f'the unknown body seems to be attached to link7, not {declared}')


READINGS: dict[str, Callable[[Array, Array, Array], tuple[Array, Array]]] = {
    'degrees a second': lambda _turn, v, w: (v, np.rad2deg(w)),
    'millimetres a second': lambda _turn, v, w: (1e3 * v, w),
    'wrong sign': lambda _turn, v, w: (-v, -w),
    'set twist_frame: inertial': lambda turn, v, w: (rotate(turn, v), rotate(turn, w)),
    'set twist_frame: child': lambda turn, v, w: (rotate_back(turn, v), rotate_back(turn, w)),
    'the linear velocity of the odometry has left-handed axes': lambda turn, v, w: (
        rotate(turn, rotate_back(turn, v) * [1.0, -1.0, 1.0]),
        w,
    ),
    'the angular velocity of the odometry has axes of other scales: z reads': lambda turn, v, w: (
        v,
        rotate(turn, rotate_back(turn, w) * [1.0, 1.0, 0.5]),
    ),
    'is zero while its poses move': lambda _turn, v, w: (0.0 * v, 0.0 * w),
}


@cache
def moved(robot: str) -> Truth:
    return configured_motion(robot, 20.0, 100.0)


def seen(robot: str = 'servicer7', seed: int = 1) -> Samples:
    return observe(moved(robot), MID, seed)


def read(samples: Samples, reading: Callable[[Array, Array, Array], tuple[Array, Array]]) -> Samples:
    linear, angular = reading(samples.base_rotation, samples.base_linear_velocity, samples.base_angular_velocity)
    return replace(samples, base_linear_velocity=linear, base_angular_velocity=angular)


def findings(samples: Samples, declared: float = 1.0, unchanged: Unchanged | None = None) -> list[str]:
    """Return the finding of the check after each window; the noise of the base is so many times the declared one."""
    check = twist_check()
    found = []
    for window in windows(samples):
        pose, twist = (each / declared**2 for each in (window.pose_covariance, window.twist_covariance))
        reason = check.update(replace(window, pose_covariance=pose, twist_covariance=twist))
        found.append(reason.text if reason else '')
    if unchanged is not None:
        unchanged.values(motion=RateMotion.concatenate(check._seen), misfits=check._misfits, reason=reason)
    return found


def last_finding(samples: Samples, unchanged: Unchanged | None = None) -> str:
    return findings(samples, unchanged=unchanged)[-1]


@pytest.mark.parametrize('robot', ['servicer7', 'table1'])
@pytest.mark.parametrize('other', ['child', 'inertial'])
@pytest.mark.parametrize('seed', range(3))
def test_a_wrong_declaration_is_found(robot: str, other: str, seed: int) -> None:
    samples = observe(moved(robot), MID, seed + 1)
    assert last_finding(read(samples, READINGS[f'set twist_frame: {other}'])).endswith(f'set twist_frame: {other}')


@pytest.mark.parametrize('seed', range(3))
def test_a_resting_base_decides_nothing(seed: int) -> None:
    samples = observe(moved('servicer7'), MID, seed + 1)
    noise = np.random.default_rng(seed)
    count = len(samples)
    still = replace(
        samples,
        # At a large angle, where the two readings are far apart.
        base_rotation=np.broadcast_to(samples.base_rotation[-1] @ np.diag([-1.0, -1.0, 1.0]), (count, 3, 3)),
        base_position=1e-3 * noise.standard_normal((count, 3)),
        base_linear_velocity=1e-3 * noise.standard_normal((count, 3)),
        base_angular_velocity=1e-4 * noise.standard_normal((count, 3)),
    )
    assert not any(findings(still))
    assert not any(findings(read(still, READINGS['set twist_frame: inertial'])))


@pytest.mark.parametrize('name', READINGS)
@pytest.mark.parametrize('seed', range(3))
def test_a_twist_that_is_read_otherwise_is_found(name: str, seed: int, unchanged: Unchanged) -> None:
    assert name in last_finding(read(seen(seed=seed), READINGS[name]), None if seed else unchanged)


@pytest.mark.parametrize('seed', range(3))
def test_a_twist_of_another_point_is_found_with_the_point(seed: int, unchanged: Unchanged) -> None:
    def reading(rotation: Array, linear: Array, angular: Array) -> tuple[Array, Array]:
        return linear + cross(angular, rotation @ np.array([0.3, -0.2, 0.1])), angular

    found = last_finding(read(seen(seed=seed), reading), unchanged)
    assert 'that of a point' in found
    place = [float(each) for each in found.partition('(')[2].partition(')')[0].split(',')]
    np.testing.assert_allclose(place, [300.0, -200.0, 100.0], atol=20.0)


@pytest.mark.parametrize('degrees', [20.0, 90.0, 170.0])
def test_a_twist_in_turned_axes_is_found_with_the_turn(degrees: float, unchanged: Unchanged) -> None:
    def reading(rotation: Array, linear: Array, angular: Array) -> tuple[Array, Array]:
        linear, angular = (rotate(rotation, rotate_back(rotation, each) @ turn) for each in (linear, angular))
        return linear, angular

    turn = exp(np.deg2rad(degrees) * np.array([0.0, 1.0, 0.0]))
    found = last_finding(read(seen(), reading), unchanged)
    assert f'turned by {degrees:.0f} degrees about (' in found
    axis = [float(each) for each in found.partition('(')[2].partition(')')[0].split(',')]
    np.testing.assert_allclose(axis, [0.0, 1.0, 0.0], atol=0.05)


@pytest.mark.parametrize('robot', ['servicer7', 'table1'])
@pytest.mark.parametrize('declared', [1.0, 10.0])
def test_the_rate_of_the_poses_is_no_other_however_noisy(robot: str, declared: float) -> None:
    for seed in range(5):
        assert not any(findings(seen(robot, seed), declared))


def test_poses_alone_are_no_twist() -> None:
    wrong = read(seen(), READINGS['wrong sign'])
    assert last_finding(replace(wrong, base_linear_velocity=np.full_like(wrong.base_linear_velocity, np.nan))) == ''
    assert last_finding(wrong[:350]) == ''  # seven windows


def grams(factor: float, *links: str) -> MomentumKernel:
    """Return servicer7 with links that are described so many times as heavy as they are."""
    text = scale_inertials((CONFIG / 'servicer7.urdf').read_text(), dict.fromkeys(links, factor))
    return MomentumKernel(load_model(text), 'link7')


def mistaken(robot: MomentumKernel, text: str) -> Convention:
    found = (each for factory in conventions(None) for each in factory(robot))
    return next(each for each in found if each.text.startswith(text))


ARM = tuple(f'link{index}' for index in range(1, 7))


def test_a_link_in_grams_is_no_link_that_holds_the_body() -> None:
    robot, windows = grams(1e3, 'link3'), half_second_windows(measured())
    held = mistaken(robot, 'the unknown body seems to be attached to link3')
    assert not fitted(windows, held, 4).exists  # the link would be lighter with the body than without
    unit = mistaken(robot, 'link link3 is 1000 times as heavy')
    assert fitted(windows, unit, 4).exists
    assert unit.repair is not None
    assert unit.repair.conversion == Conversion(masses={'link3': 1e-3})
    assert fitted(windows, mistaken(grams(1.0), 'the unknown body seems to be attached to link3'), 4).exists


def test_another_target_link_is_set_by_its_parameter() -> None:
    others = [each for factory in conventions(None) for each in factory(kernel('servicer7'))]
    found = [each.repair for each in others if each.text.startswith('the unknown body')]
    named = ['base_link', *(f'link{number}' for number in range(1, 7))]
    assert [some(each).parameters for each in found] == [{'target_link': name} for name in named]


def test_an_arm_in_grams_is_told_from_a_base_in_tonnes_by_matter_that_does_not_exist() -> None:
    arm = mistaken(grams(1e3, *ARM), 'the moving links')
    assert arm.repair is not None
    assert arm.repair.conversion is not None
    assert set(arm.repair.conversion.masses) == set(ARM)
    tonnes = mistaken(grams(1e-3, 'base_link'), 'the moving links (link1')
    assert tonnes.repair is None
    assert mistaken(grams(1.0), 'the moving links').text.endswith('are 0.001 times as heavy as they are: a wrong unit?')


def test_tensors_about_the_origins_of_the_links_are_converted() -> None:
    right = grams(1.0)
    text = right.model.urdf
    for link in right.model.links:
        mass, com = physical(link.parameters)[:1], physical(link.parameters)[1:4]
        text = replace_inertial(text, link.name, np.concatenate((mass, com, link.parameters[4:])))
    wrong = MomentumKernel(load_model(text), 'link7')
    assert np.max(np.abs(wrong.known - right.known)) > 1.0
    found = mistaken(wrong, 'the inertia tensors of the robot description are about')
    np.testing.assert_allclose(found.kernel.known, right.known, atol=1e-9)
    assert some(found.repair).conversion == Conversion(inertias='about the origins')
    # Links have less inertia than their distance from their origins makes out, and their inertials are not turned.
    left = [some(some(each.repair).conversion).inertias for each in mistaken_tensors(right)]
    assert left == ['opposite products']


def test_a_scaled_description_has_the_scaled_inertials_alone() -> None:
    robot, scaled = (grams(factor, 'link2').model for factor in (1.0, 0.5))
    for link, other in zip(robot.links, scaled.links, strict=True):
        factor = 0.5 if link.name == 'link2' else 1.0
        np.testing.assert_allclose(other.parameters, factor * link.parameters, rtol=1e-12)
    with pytest.raises(ModelError, match='elbow'):
        scale_inertials((CONFIG / 'servicer7.urdf').read_text(), {'elbow': 2.0})


def test_the_density_is_that_of_a_solid_ellipsoid() -> None:
    """However it is turned and placed; a plate has none."""
    axes, turn, density = np.array([0.3, 0.5, 0.8]), exp(np.array([0.4, -0.7, 1.1])), 2700.0
    mass = density * 4.0 / 3.0 * np.pi * float(np.prod(axes))
    second = 0.2 * mass * turn @ np.diag(axes**2) @ turn.T
    inertia = np.trace(second) * np.eye(3) - second
    assert _density(standard(np.array([mass, 1.0, -2.0, 0.5, *vec(inertia)]))) == pytest.approx(density)
    flat = 0.2 * mass * np.diag([0.09, 0.25, 0.0])
    assert _density(standard(np.array([mass, 0.0, 0.0, 0.0, *vec(np.trace(flat) * np.eye(3) - flat)]))) == np.inf


def test_all_that_may_be_meant_otherwise_changes_windows_as_it_did(unchanged: Unchanged) -> None:
    """A weighed sum of the knots of one window under each convention, and its repair of a run."""
    marker = AttachedFrame(exp(np.array([0.1, 0.5, -0.2])), np.array([0.3, -0.2, 0.1]))
    windows, found = half_second_windows(measured())[:3], []
    weights = np.sin(np.arange(1.0, 1000.0))
    for each in (one for factory in conventions(marker) for one in factory(kernel('servicer7'))):
        knots = [
            (window.knots.joint_position, window.knots.base_position, window.knots.base_rotation)
            for window in each.windows(windows)
        ]
        sums = [float(weights[: part.size] @ part.ravel()) for window in knots[:1] for part in window]
        known = float(weights[: each.kernel.known.size] @ each.kernel.known.ravel())
        limits = (each.base_range, each.joint_range, each.misfit_left, each.delay, each.least_mass)
        found.append((each.text, sums, known, limits, each.repair, len(knots), each.possible(windows)))
    unchanged.values(found=found)
