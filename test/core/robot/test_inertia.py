"""The parameters of bodies in their forms, their principal axes, and the errors of known bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import central_difference
from mbaid_ros.core.geometry import Array, exp, skew, unvec, vec
from mbaid_ros.core.links import (
    BodyDeviations,
    KnownLinksConfig,
    calibrated_errors,
    declared_errors,
    independent_errors,
)
from mbaid_ros.core.robot.body import body_sizes, physical, physical_jacobian, principal, pseudo_inertia, standard
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.errors import ParameterError
from mbaid_ros.replay.export import box_sizes, ellipsoid_radii

SEEDS = range(5)


def cloud(seed: int, points: int = 12) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0.2, 5.0, points), rng.normal(size=(points, 3)) + rng.normal(size=3)


def about(masses: Array, points: Array, centre: Array) -> Array:
    """Return the six elements of inertia of point masses about a centre: sum m (r.r 1 - r r^T)."""
    lever = skew(points - centre)
    return vec(-np.einsum('k,kij->ij', masses, lever @ lever))


def random_body(seed: int) -> Array:
    """Return standard parameters (m, h, I_o) of a cloud of point masses."""
    masses, points = cloud(seed)
    return np.concatenate(([masses.sum()], masses @ points, about(masses, points, np.zeros(3))))


@pytest.mark.parametrize('seed', SEEDS)
def test_the_physical_form_is_about_the_centre_of_mass(seed: int) -> None:
    masses, points = cloud(seed)
    centre = masses @ points / masses.sum()
    expected = np.concatenate(([masses.sum()], centre, about(masses, points, centre)))
    assert physical(random_body(seed)) == pytest.approx(expected, rel=1e-12)
    assert standard(expected) == pytest.approx(random_body(seed), rel=1e-12)


def test_a_body_without_mass_has_no_centre() -> None:
    body = random_body(0)
    body[0] = 0.0
    assert physical(body)[0] == 0.0
    assert np.isnan(physical(body)[1:]).all()


@pytest.mark.parametrize('seed', SEEDS)
def test_the_jacobian_is_the_derivative(seed: int) -> None:
    body = random_body(seed)
    assert physical_jacobian(body) == pytest.approx(central_difference(physical, body, 1e-5), rel=1e-7, abs=1e-8)


@pytest.mark.parametrize('seed', SEEDS)
def test_the_pseudo_inertia_is_the_second_moment_of_the_mass(seed: int) -> None:
    masses, points = cloud(seed)
    homogeneous = np.concatenate((points, np.ones((len(points), 1))), axis=1)
    expected = np.einsum('k,ki,kj->ij', masses, homogeneous, homogeneous)
    assert pseudo_inertia(random_body(seed)) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_the_pseudo_inertia_is_positive_exactly_within_the_triangle_inequality() -> None:
    def smallest(moments: tuple[float, float, float]) -> float:
        inertia = vec(np.diag(moments))
        return float(np.linalg.eigvalsh(pseudo_inertia(np.concatenate(([2.0, 0.0, 0.0, 0.0], inertia))))[0])

    assert smallest((1.0, 2.0, 2.9)) > 0.0
    assert smallest((1.0, 2.0, 3.0)) == pytest.approx(0.0, abs=1e-15)
    # The inertia alone is positive definite still, but no body has it.
    assert np.linalg.eigvalsh(unvec(np.array([1.0, 0.0, 0.0, 2.0, 0.0, 3.1])))[0] > 0.0
    assert smallest((1.0, 2.0, 3.1)) < 0.0


def parameters(moments: list[float], turn: list[float]) -> Array:
    rotation = exp(np.array(turn))
    return np.concatenate(([5.0], [0.1, 0.2, 0.3], vec(rotation @ np.diag(moments) @ rotation.T)))


def test_the_axes_diagonalise_the_inertia_and_are_a_rotation() -> None:
    found = principal(parameters([3.0, 1.0, 2.5], [0.3, -0.4, 0.9]))
    assert found.moments == pytest.approx([1.0, 2.5, 3.0], rel=1e-13)
    assert np.linalg.det(found.axes) == pytest.approx(1.0, rel=1e-14)
    tensor = found.axes @ np.diag(found.moments) @ found.axes.T
    assert vec(tensor) == pytest.approx(parameters([3.0, 1.0, 2.5], [0.3, -0.4, 0.9])[4:], abs=1e-14)


def test_the_uniform_bodies_have_the_moments() -> None:
    mass, moments = 5.0, np.array([1.0, 2.5, 3.0])
    a, b, c = ellipsoid_radii(mass, moments)
    assert mass / 5.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) == pytest.approx(moments, rel=1e-14)
    a, b, c = box_sizes(mass, moments)
    assert mass / 12.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) == pytest.approx(moments, rel=1e-14)


LINK = '<link name="{}"><inertial><mass value="{}"/><origin xyz="0.1 0 0.2"/>{}</inertial></link>'
INERTIA = '<inertia ixx="2" ixy="0" ixz="0" iyy="2" iyz="0" izz="2"/>'
JOINT = (
    '<joint name="to_{0}" type="{1}"><parent link="{2}"/><child link="{0}"/><axis xyz="0 0 1"/>'
    '<origin xyz="0.5 -0.2 0.3" rpy="0.3 0.5 -0.7"/></joint>'
)
# Tank and base are one body; so are hand and tool.
URDF = ''.join(
    (
        '<robot name="small">',
        *(LINK.format(name, mass, INERTIA) for name, mass in (('base', 90), ('tank', 20), ('arm', 9), ('hand', 4))),
        LINK.format('tool', 3, INERTIA),
        JOINT.format('tank', 'fixed', 'base'),
        JOINT.format('arm', 'revolute', 'base').replace('</joint>', '<limit effort="1" velocity="1"/></joint>'),
        JOINT.format('hand', 'continuous', 'arm'),
        JOINT.format('tool', 'fixed', 'hand'),
        '</robot>',
    )
)
NAMES = ('base', 'tank', 'arm', 'hand', 'tool')


def covariance() -> Array:
    """Return one of all links, correlated and of widely different sizes."""
    rng = np.random.default_rng(3)
    factor = rng.normal(size=(50, 50)) * 10.0 ** rng.uniform(-4.0, 1.0, 50)[:, None]
    return factor @ factor.T


def test_errors_of_links_are_those_of_the_bodies_that_carry_them() -> None:
    model = load_model(URDF)
    links = [model.link(name) for name in NAMES]
    change = 0.1 * np.random.default_rng(4).normal(size=(5, 10))
    errors = calibrated_errors(links, np.outer(change, change), ['tool'])
    assert errors.bodies == (0, 1, 2)
    assert errors.count == 1
    off = dict(zip(NAMES, change, strict=True))
    other = replace(model, links=tuple(replace(x, parameters=x.parameters + off[x.name]) for x in model.links))
    moved = (MomentumKernel(other, 'tool').known - MomentumKernel(model, 'tool').known).ravel()
    # A factor of rank one is the change itself, up to its sign.
    assert errors.factor[:, 0] * np.sign(errors.factor[0, 0] * moved[0]) == pytest.approx(moved, abs=1e-9)


def test_declared_errors_are_of_each_body_as_a_whole_and_of_each_parameter_by_itself() -> None:
    robot = MomentumKernel(load_model(URDF), 'tool')
    exact = BodyDeviations(0.0, 0.0, 0.0)
    errors = independent_errors(robot.known, 0.01, {1: exact})
    assert errors.bodies == (0, 2)
    assert errors.count == 20
    sizes = np.array([body_sizes(robot.known[body]) for body in errors.bodies])
    whole = np.zeros((20, 2))
    whole[:10, 0], whole[10:, 1] = robot.known[0], robot.known[2]
    wanted = 0.01**2 * (np.diag(sizes.ravel() ** 2) + whole @ whole.T)
    unit = 0.01 * sizes.ravel()
    assert errors.covariance / np.outer(unit, unit) == pytest.approx(wanted / np.outer(unit, unit), abs=1e-12)
    assert independent_errors(robot.known, 0.0).count == 0


def test_links_of_one_body_declare_it_together() -> None:
    link = (
        '<link name="{}"><inertial><mass value="{}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
        '</inertial></link>'
    )
    joint = '<joint name="{0}" type="{1}"><parent link="base"/><child link="{0}"/></joint>'
    links = ''.join(link.format(*each) for each in (('base', 50), ('tank', 5), ('hand', 3)))
    urdf = f'<robot name="r">{links}{joint.format("tank", "fixed")}{joint.format("hand", "continuous")}</robot>'
    robot = MomentumKernel(load_model(urdf), 'hand')
    given = {'base': {'mass_relative_std': 0.1}, 'tank': {'com_std': 0.002}}
    found = declared_errors(robot, KnownLinksConfig(links=given)).covariance
    alone = declared_errors(robot, KnownLinksConfig(links={'tank': {**given['base'], **given['tank']}})).covariance
    assert found == pytest.approx(alone)
    with pytest.raises(ParameterError, match=r'known_links.tank.com_std. is given for another link of the same body'):
        declared_errors(robot, KnownLinksConfig(links={'base': {'com_std': 0.1}, 'tank': {'com_std': 0.1}}))


def test_of_a_body_that_is_weighed_the_mass_is_known_and_the_rest_goes_with_it() -> None:
    body = MomentumKernel(load_model(URDF), 'tool').known[1]
    factor = BodyDeviations(0.02, 0.0, 0.0).factor(body)
    assert factor == pytest.approx(0.02 * body[:, None], rel=1e-12)
    apart = BodyDeviations(0.02, 0.003, 0.05).factor(body)
    heavier = physical(body) * np.concatenate(([1.02], np.ones(3), np.full(6, 1.02)))
    assert physical(body + apart[:, 0]) == pytest.approx(heavier, abs=1e-12)


def test_a_single_body_may_be_known_in_mass_com_and_inertia_each_by_itself() -> None:
    robot = MomentumKernel(load_model(URDF), 'tool')
    body = robot.known[1]
    covariance = independent_errors(robot.known, 0.0, {1: BodyDeviations(0.02, 0.003, 0.0)}).covariance
    of_physical = physical_jacobian(body) @ covariance @ physical_jacobian(body).T
    heavier = 0.02 * np.concatenate((body[:1], np.zeros(3), physical(body)[4:]))
    wanted = np.diag([0.0, *(0.003**2,) * 3, *(0.0,) * 6]) + np.outer(heavier, heavier)
    size = np.concatenate(([body[0]], np.ones(3), np.full(6, body[0])))
    assert of_physical / np.outer(size, size) == pytest.approx(wanted / np.outer(size, size), abs=1e-12)
