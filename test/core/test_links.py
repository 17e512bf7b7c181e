"""Links that are described in another unit, or with an inertia that no body has: bodies on either side of a limit."""

from __future__ import annotations

import numpy as np
import pytest

from checked import some
from mbaid_ros.core.contracts import Convention
from mbaid_ros.core.links import (
    BodyDeviations,
    KnownLinksConfig,
    impossible,
    link_deviations,
    masses,
    mistaken_masses,
    mistaken_tensors,
)
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel

AXES = np.array([0.1, 0.2, 0.3])  # m, half axes of an ellipsoid
VOLUME = 4.0 / 3.0 * np.pi * float(np.prod(AXES))
MOMENTS = np.sum(AXES**2) - AXES**2  # of the ellipsoid, in fifths of its mass
OFFSET = np.array([0.3, -0.4, 1.2])


def arm(masses: list[float], moments: list[list[float]], distance: float) -> RobotModel:
    """Return a base and links in a row, with principal moments about their centres."""
    parts = []
    for place, (mass, moment) in enumerate(zip(masses, moments, strict=True)):
        name = f'link{place}' if place else 'base_link'
        inertia = ' '.join(f'{key}="{value}"' for key, value in zip(('ixx', 'iyy', 'izz'), moment, strict=True))
        parts.append(
            f'<link name="{name}"><inertial><origin xyz="{" ".join(map(str, OFFSET))}"/><mass value="{mass}"/>'
            f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        if place:
            parent = f'link{place - 1}' if place > 1 else 'base_link'
            parts.append(
                f'<joint name="j{place}" type="continuous"><parent link="{parent}"/><child link="{name}"/>'
                f'<origin xyz="0 {distance} 0"/><axis xyz="0 0 1"/></joint>'
            )
    return load_model(f'<robot name="arm">{"".join(parts)}</robot>')


@pytest.mark.parametrize(
    ('distance', 'radius', 'said'),
    [
        (0.5, 4.9, ''),
        (0.5, 5.1, 'the inertia of a body of 5.1 m'),
        (0.0, 0.9, ''),
        (0.0, 1.1, 'the inertia of a body of 1.1 m'),
        (300.0, 1.6, ''),
        (300.0, 1.4, 'j1 is 300 m from its parent, and no link has the inertia of a body of more than 1.4 m'),
        (0.5, 0.0, "link 'link1' has 2 kg and no inertia"),
    ],
)
def test_an_inertia_is_that_of_a_body_that_fits_the_robot(distance: float, radius: float, said: str) -> None:
    """About the centre of mass, which is elsewhere; the base is smaller."""
    moments = [[size**2 * 4.0 / 3.0] * 3 for size in (max(0.5 * radius, 1e-2), radius)]
    text, repair = impossible(arm([2.0, 2.0], moments, distance))
    assert said in text
    assert bool(text) is bool(said)
    assert (repair is not None) is said.startswith('j1')
    assert repair is None or some(repair.conversion).lengths == 1e-3


def dense(*densities: float) -> MomentumKernel:
    """Return a robot of ellipsoids of some densities, kg/m^3, base first; the last one is the target."""
    masses = [VOLUME * each for each in densities]
    moments = [(mass / 5.0 * MOMENTS).tolist() for mass in masses]
    return MomentumKernel(arm(masses, moments, 0.5), f'link{len(densities) - 1}')


def of_all(kernel: MomentumKernel) -> dict[str, Convention]:
    return {each.text.split(') are ')[1].split()[0]: each for each in mistaken_masses(kernel) if 'links' in each.text}


@pytest.mark.parametrize(
    ('densities', 'units', 'repaired'),
    [
        ((300.0, 2700.0, 2700.0, 900.0), ['0.001'], []),
        ((300.0, 12000.0, 2700.0, 900.0), ['0.001'], []),
        ((300.0, 12000.0, 12000.0, 900.0), ['1000', '0.001'], ['1000']),
        ((1.3, 11000.0, 12000.0, 900.0), ['0.001'], []),
        ((1.1, 2700.0, 2700.0, 900.0), ['1000', '0.001'], []),
    ],
)
def test_an_arm_is_in_grams_where_it_is_denser_than_lead_or_the_base_lighter_than_air(
    densities: tuple[float, ...], units: list[str], repaired: list[str]
) -> None:
    kernel = dense(*densities)
    found = of_all(kernel)
    assert list(found) == units
    assert [unit for unit, each in found.items() if each.repair] == repaired
    for unit, each in found.items():
        assert each.kernel.known[1:3] == pytest.approx(kernel.known[1:3] / float(unit))
        assert each.kernel.known[0] == pytest.approx(kernel.known[0])
        if each.repair:
            assert some(each.repair.conversion).masses == {'link1': 1e-3, 'link2': 1e-3}


def test_a_link_is_a_thousand_times_as_heavy_or_light_and_a_base_as_heavy_alone() -> None:
    """An arm in grams is a base in tonnes; the target's mass is unknown anyhow."""
    kernel = dense(300.0, 2700.0, 2700.0, 900.0)
    found = {each.text.partition(' times')[0]: each for each in mistaken_masses(kernel) if 'links' not in each.text}
    units = {f'link link{link} is {unit}': (link, unit) for link in (1, 2) for unit in ('1000', '0.001')}
    assert set(found) == {'link base_link is 1000', *units}
    for text, each in found.items():
        link, unit = units.get(text, (0, '1000'))
        expected = kernel.known.copy()
        expected[link] /= float(unit)
        assert each.kernel.known == pytest.approx(expected)
        if link:
            assert some(some(each.repair).conversion).masses == {f'link{link}': pytest.approx(1.0 / float(unit))}
        else:
            assert each.repair is None


def inertial(mass: float, moments: tuple[float, ...], rpy: str = '0 0 0', place: str = '0 0 0') -> str:
    """Return a description of mass and inertia (ixx, iyy, izz, ixy, ixz, iyz)."""
    tensor = ' '.join(
        f'{key}="{value}"' for key, value in zip(('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz'), moments, strict=True)
    )
    return f'<inertial><origin xyz="{place}" rpy="{rpy}"/><mass value="{mass}"/><inertia {tensor}/></inertial>'


BALL = (4.0, 4.0, 4.0, 0.0, 0.0, 0.0)
LONG = (4.0, 5.0, 6.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ('link', 'meant'),
    [
        (inertial(2.0, BALL), []),
        (inertial(2.0, BALL, rpy='0.3 0 0'), []),
        (inertial(2.0, BALL, place='1 0 0'), ['about the']),
        (inertial(2.0, BALL, place='2 0 0'), []),  # of a body that cannot be, so far from the origin
        (inertial(2.0, LONG, rpy='0.3 0 0'), ['in the axes of the links']),
        (inertial(2.0, (*LONG[:3], 0.3, 0.2, -0.1)), ['opposite sign']),
        (inertial(2.0, (*LONG[:3], 0.3, 0.2, -0.1), rpy='0.3 0 0'), ['opposite sign', 'in the axes of the links']),
    ],
)
def test_tensors_are_meant_otherwise_where_that_is_another_body_that_can_be(link: str, meant: list[str]) -> None:
    joint = '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/></joint>'
    description = (
        f'<robot name="arm"><link name="base_link">{inertial(9.0, BALL)}</link><link name="one">{link}</link>'
        f'<link name="two">{inertial(2.0, (*LONG[:3], 0.3, 0.2, -0.1), "0.3 0 0", "3 0 0")}</link>'
        f'{joint.format("a", "base_link", "one")}{joint.format("b", "one", "two")}</robot>'
    )
    kernel = MomentumKernel(load_model(description), 'two')  # whose description counts for nothing
    found = [*mistaken_tensors(kernel)]
    assert len(found) == len(meant)
    for each, part in zip(found, meant, strict=True):
        assert part in each.text
        assert np.abs(each.kernel.known - kernel.known)[1].max() > 1e-3
        assert np.array_equal(each.kernel.known[[0, 2]], kernel.known[[0, 2]])
        assert each.misfit_left == np.inf


@pytest.mark.parametrize('offset', [0.5, 0.0])  # m, of the centre of mass
def test_the_centre_of_a_link_is_as_uncertain_as_a_part_of_its_size(offset: float) -> None:
    """Of a body with a radius of gyration of 0.2 m, whose mass alone is declared: the rest is by that of all links."""
    centre = offset * np.array([0.6, 0.0, -0.8])
    about = 4.0 * (0.2**2 * np.eye(3) + centre @ centre * np.eye(3) - np.outer(centre, centre))
    body = np.concatenate(([4.0], 4.0 * centre, about[np.triu_indices(3)]))
    found = link_deviations(body, KnownLinksConfig(relative_std=0.05), {'mass_relative_std': 0.2})
    assert found.mass == 0.2
    assert found.inertia == 0.05
    assert found.com == pytest.approx(0.05 * max(offset, 0.2))


def test_an_error_of_a_mass_alone_is_named_by_its_link_and_one_of_a_centre_is_not() -> None:
    factor = np.zeros((30, 6))
    factor[:10, 0] = 0.02 * np.arange(1.0, 11.0)  # a base that is heavier, the same otherwise
    factor[11:14, 1:4] = 0.01 * np.eye(3)  # a first moment
    factor[20:30, 4], factor[21, 5] = 0.03 * np.arange(1.0, 11.0), 0.01
    assert masses(('base', 'arm', 'hand'), factor) == ('mass:base', '', '', '', 'mass:hand', '')
    factor[20, 5] = 0.04
    assert masses(('base', 'arm', 'hand'), factor) == ('mass:base', '', '', '', '', '')  # two make it out


@pytest.mark.parametrize('mass', [0.02, 0.0])
def test_the_mass_of_any_body_is_a_number_by_itself(mass: float) -> None:
    """To the last bit: the numbers of centre and inertia of a body anywhere change no mass."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        centre, root = rng.normal(size=3), rng.normal(size=(3, 3))
        moment = root @ root.T + 5.0 * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        body = 5.0 * np.concatenate(([1.0], centre, moment[np.triu_indices(3)]))
        factor = BodyDeviations(mass, 0.01, 0.03).factor(body)
        assert masses(('arm',), factor) == (*(('mass:arm',) if mass else ()), *[''] * 9)
